// Posing without a browser: bone lengths, bend sides, planted feet, floor, pins, a fuzzer. Run by test_page_parts.py.
import assert from "node:assert/strict";
import { test } from "node:test";

import { dragged, insideAngle, placedEnd, rotated, stands } from "./posing.js";
import { HANDLES, boneLengths, mirrored, pasted, withLimbOf } from "./skeleton.js";
import { add, distance, perpendicular, sub, unit } from "./vectors.js";

// A body that stands with slightly bent knees and elbows.
const STANDING = [[0, 0.94, 0], [0.074, 0.87, 0], [-0.084, 0.87, 0], [0.004, 1.07, 0], [0.08, 0.49, 0.05], [-0.09, 0.49, 0.05],
  [0.004, 1.21, 0], [0.08, 0.075, 0], [-0.09, 0.075, 0], [0.004, 1.27, 0], [0.08, 0.02, 0.125], [-0.09, 0.02, 0.125],
  [0, 1.49, 0], [0.09, 1.38, -0.01], [-0.09, 1.38, -0.01], [0, 1.58, 0.03], [0.21, 1.37, -0.01], [-0.21, 1.37, -0.01],
  [0.26, 1.12, -0.04], [-0.26, 1.12, -0.04], [0.27, 0.88, 0.04], [-0.27, 0.88, 0.04]]; // prettier-ignore
const near = (a, b, tolerance = 1e-3) => assert.ok(distance(a, b) < tolerance, `${a} is not ${b}`);
const stretched = (pose, start = STANDING) => {
  const [now, before] = [boneLengths(pose), boneLengths(start)];
  return Math.max(...now.slice(1).map((size, i) => Math.abs(size / before[i + 1] - 1)));
};
const lowest = (pose) => Math.min(pose[7][1] - 0.06, pose[8][1] - 0.06, pose[10][1] - 0.015, pose[11][1] - 0.015);

test("a hand goes where it is dragged, and nothing else moves", () => {
  const to = add(STANDING[20], [0.05, 0.25, 0.15]),
    pose = dragged(STANDING, "left_hand", to);
  near(pose[20], to);
  assert.ok(stretched(pose) < 1e-9);
  pose.forEach((place, joint) => [18, 20].includes(joint) || near(place, STANDING[joint], 1e-12));
});

test("elbows and knees keep the side that they bend to, also through a straight limb", () => {
  const side = (pose, [a, b, c]) => perpendicular(sub(pose[b], pose[a]), unit(sub(pose[c], pose[a])))[2]; // ahead of the line
  for (const [handle, chain] of [
    ["left_hand", [16, 18, 20]],
    ["right_foot", [2, 5, 8]],
  ]) {
    let pose = STANDING;
    const before = Math.sign(side(pose, chain));
    for (const dy of [-0.6, -0.3, 0, 0.2]) {
      pose = dragged(pose, handle, add(STANDING[HANDLES[handle].joint], [0, dy, 0.02]), { snap: false });
      assert.equal(Math.sign(side(pose, chain)), before, `${handle} at ${dy}`);
      assert.ok(insideAngle(pose, HANDLES[handle].limb) > 0.5);
    }
  }
});

test("a limb follows softly near its reach, the spine leans to a hand that is out of reach", () => {
  const at = (x) => dragged(STANDING, "left_hand", [x, 1.37, 0]);
  const reach = [0.6, 0.7, 0.8, 1.2, 5].map((x) => at(x)[20][0]);
  reach.slice(1).forEach((x, i) => assert.ok(x > reach[i]));
  assert.ok(distance(at(5)[16], STANDING[16]) > 0.1); // the shoulder went along
  near(at(5)[7], STANDING[7], 1e-9);
});

test("hips move over planted feet as far as the legs reach; pinned hands stay", () => {
  const down = dragged(STANDING, "hips", [0.1, 0.7, 0.1], { pins: new Set(["left_hand"]) });
  near(down[0], [0.1, 0.7, 0.1]);
  for (const joint of [7, 8, 10, 11, 20]) near(down[joint], STANDING[joint], 1e-6);
  assert.ok(down[4][2] > 0.15 && stretched(down) < 1e-9);
  const far = dragged(STANDING, "hips", [100, 50, 0]);
  for (const joint of [7, 8]) near(far[joint], STANDING[joint], 0.02);
  assert.ok(distance(far[0], STANDING[0]) < 1.1);
  const air = STANDING.map((place) => add(place, [0, 0.5, 0]));
  assert.ok(!stands(air, "left") && stands(STANDING, "left"));
  assert.ok(Math.abs(distance(dragged(air, "hips", [100, 1.4, 0])[0], air[0]) - 3) < 1e-6);
});

test("chest and head take the spine along, and no further than a spine bends", () => {
  const pose = dragged(STANDING, "chest", add(STANDING[9], [0, -0.03, 0.12]));
  near(pose[9], add(STANDING[9], [0, -0.03, 0.12]), 0.02);
  for (const joint of [0, 1, 2, 4, 7]) near(pose[joint], STANDING[joint], 1e-9);
  const nod = dragged(STANDING, "head", add(STANDING[15], [0, -0.05, 0.12]));
  near(nod[15], add(STANDING[15], [0, -0.05, 0.12]), 0.02);
  const most = dragged(STANDING, "head", [0, 0.2, 3]);
  assert.ok(most[15][1] > 0.9 && stretched(most) < 1e-9);
});

test("an elbow swivels about its hand", () => {
  const pose = dragged(STANDING, "left_elbow", add(STANDING[18], [0.5, 0, 0]));
  near(pose[20], STANDING[20], 1e-6);
  assert.ok(pose[18][0] > STANDING[18][0] + 0.02 && stretched(pose) < 1e-9);
});

test("a dragged foot snaps to the floor and never goes below it", () => {
  near(dragged(STANDING, "left_foot", [0.2, 0.09, 0.1])[10], [0.2, 0.02 - 0.005, 0.225], 0.02);
  assert.ok(Math.abs(lowest(dragged(STANDING, "left_foot", [0.2, 0.09, 0.1]))) < 1e-6);
  const free = dragged(STANDING, "left_foot", [0.15, 0.1, 0.1], { snap: false });
  assert.ok(free[7][1] > 0.095);
  assert.ok(lowest(dragged(STANDING, "left_foot", [0.2, -2, 0.1])) > -1e-6);
});

test("rings turn a part about its pivot, and a knee folds no further than it can", () => {
  const quarter = [0, 0, Math.SQRT1_2, Math.SQRT1_2],
    pose = rotated(STANDING, "left_elbow", quarter);
  assert.ok(stretched(pose) < 1e-9 && pose[20][0] > 0.5);
  const folded = rotated(STANDING, "left_hand", [-1, 0, 0, 0.001]);
  assert.ok(insideAngle(folded, "left_arm") > 0.5);
  const turn = rotated(STANDING, "hips", [0, Math.sin(0.2), 0, Math.cos(0.2)]);
  near(turn[7], STANDING[7], 1e-3);
});

test("poses are mirrored twice, pasted and reset", () => {
  const pose = dragged(STANDING, "left_hand", [0.4, 1.6, 0.2]),
    mirror = mirrored(pose);
  assert.ok(mirror[21][1] > 1.4 && mirror[20][1] < 1.1 && stretched(mirror) < 1e-9);
  mirrored(mirror).forEach((place, joint) => near(place, pose[joint], 0.03));
  const there = STANDING.map(([x, y, z]) => [z + 3, y, 2 - x]), // turned to +x and moved
    paste = pasted(pose, there);
  near(paste[0], there[0], 1e-9);
  near(paste[20], [3 + 0.2, 1.6, 2 - 0.4], 0.02);
  near(withLimbOf(pose, STANDING, "left_hand")[20], STANDING[20], 1e-9);
  near(placedEnd(STANDING, "left_hand", [0.3, 1.2, 0.3])[20], [0.3, 1.2, 0.3]);
});

test("1,000 drags of a fuzzer: no NaN, no foot below the floor, bones as long as before", () => {
  let seed = 1;
  const random = () => (seed = (seed * 1103515245 + 12345) % 2147483648) / 2147483648,
    names = Object.keys(HANDLES),
    before = process.cpuUsage();
  let pose = STANDING;
  for (let i = 0; i < 1000; i++) {
    const handle = names[Math.floor(random() * names.length)],
      size = random() < 0.1 ? 100 : 0.5,
      by = [0, 1, 2].map(() => (random() - 0.5) * size),
      pins = new Set(names.filter(() => random() < 0.2));
    const next =
      random() < 0.25
        ? rotated(pose, handle, [random() - 0.5, random() - 0.5, random() - 0.5, random()], { pins })
        : dragged(pose, handle, add(pose[HANDLES[handle].joint], by), { pins, snap: random() < 0.5 });
    assert.ok(next.flat().every(Number.isFinite), `${i} ${handle}`);
    assert.ok(lowest(next) > Math.min(lowest(pose), 0) - 1e-4, `${i} ${handle} ${lowest(pose)} ${lowest(next)}`);
    assert.ok(stretched(next) < 1e-3, `${i} ${handle} ${stretched(next)}`);
    pose = i % 50 === 49 ? STANDING : next;
  }
  const each = process.cpuUsage(before).user / 1e6;
  assert.ok(each < 4, `${each} ms a drag`); // a frame of 60 has 16.7
  for (const bad of [
    [NaN, 0, 0],
    [Infinity, 0, 0],
  ])
    assert.deepEqual(dragged(STANDING, "hips", bad), STANDING);
});
