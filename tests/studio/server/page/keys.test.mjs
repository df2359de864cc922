// Keys on tracks and their preview, without a browser. Run by test_page_parts.py.
import assert from "node:assert/strict";
import { test } from "node:test";

import { constraintsOf, editAt, keysOf, plantedOf, taken } from "./pose_keys.js";
import { previewed } from "./preview.js";
import { contacts } from "./motion.js";
import { boneLengths, poseOf } from "./skeleton.js";
import { initial, keyOf, reduce, saved } from "./state.js";
import { add, distance } from "./vectors.js";

const FPS = 20,
  FRAMES = 100;
// A body that stands, and from frame 50 on goes ahead.
const BODY = [[0, 0.94, 0], [0.074, 0.87, 0], [-0.084, 0.87, 0], [0.004, 1.07, 0], [0.08, 0.49, 0.05], [-0.09, 0.49, 0.05],
  [0.004, 1.21, 0], [0.08, 0.075, 0], [-0.09, 0.075, 0], [0.004, 1.27, 0], [0.08, 0.02, 0.125], [-0.09, 0.02, 0.125],
  [0, 1.49, 0], [0.09, 1.38, -0.01], [-0.09, 1.38, -0.01], [0, 1.58, 0.03], [0.21, 1.37, -0.01], [-0.21, 1.37, -0.01],
  [0.26, 1.12, -0.04], [-0.26, 1.12, -0.04], [0.27, 0.88, 0.04], [-0.27, 0.88, 0.04]]; // prettier-ignore
const joints = new Float32Array(
  Array.from({ length: FRAMES }, (_, t) => BODY.map((place) => add(place, [0, 0, Math.max(0, t - 50) * 0.05])).flat(2)).flat(),
);
const motion = { joints, frames: FRAMES, count: 22, fps: FPS };
motion.stands = contacts(motion);

const edit = { prompt: "a person stands", model: { name: "editor", id: "" } };
const key = (state, frame, handles = ["left_hand"], by = [0, 0.3, 0.1], whole = false) => {
  const pose = BODY.map((place) => add(place, by));
  const constraints = constraintsOf(pose, handles, frame, FPS, whole);
  return reduce(state, { type: "addKey", take: 0, frame, constraints, fps: FPS, frames: FRAMES, edit });
};
const keys = (state) => keysOf(state.project, 0, FPS);
const brief = (state) => keys(state).map(({ track, frame }) => `${track} ${frame}`);

test("keys join the span that is there, and are constraints of a saved project", () => {
  let state = key(initial(), 40);
  state = key(state, 46, ["hips"]);
  state = key(state, 40, ["left_hand"], [0, 0.1, 0]); // the same key again
  state = key(state, 50, [], [0, 0, 0], true);
  assert.deepEqual(brief(state), ["left_hand 40", "hips 46", "pose 50"]);
  assert.equal(state.project.edits.length, 1);
  assert.deepEqual(state.project.edits[0].change, [[28, 55]]);
  const { control } = saved(state.project).edits[0];
  assert.equal(control.version, 1);
  const hand = control.constraints.find((one) => one.joint === "left_wrist");
  assert.deepEqual(hand, { type: "effector", joint: "left_wrist", times: [2], positions: [[0.27, 0.98, 0.04]] });
  assert.equal(control.constraints.find((one) => one.type === "keyframe").place, "world");
  assert.deepEqual(brief(reduce(state, { type: "undo" })), ["left_hand 40", "hips 46"]);
  assert.deepEqual(brief(key(state, 5, ["left_foot"])), ["left_foot 5", "left_hand 40", "hips 46", "pose 50"]);
  assert.deepEqual(key(state, 5).project.edits[1].change, [[0, 18]]);
  for (const frame of [-1, 100, NaN]) assert.equal(key(state, frame), state);
});

test("keys move, are copied, deleted, and get slack and strength", () => {
  let state = key(key(initial(), 30), 34, ["right_foot"]);
  const act = (action) => {
    state = reduce(state, { take: 0, fps: FPS, frames: FRAMES, edit, ...action });
  };
  const before = keyOf(state.project);
  act({ type: "moveKeys", keys: keys(state), by: 10 });
  assert.deepEqual(brief(state), ["left_hand 40", "right_foot 44"]);
  assert.deepEqual(state.project.edits[0].change, [[18, 49]]);
  assert.notEqual(keyOf(state.project), before);
  act({ type: "moveKeys", keys: keys(state), by: 1000 }); // not beyond the end
  assert.deepEqual(brief(state), ["left_hand 95", "right_foot 99"]);
  act({ type: "copyKeys", keys: keys(state), frame: 10 });
  assert.deepEqual(brief(state), ["left_hand 10", "right_foot 14", "left_hand 95", "right_foot 99"]);
  act({ type: "setKeys", keys: keys(state).slice(0, 1), fields: { slack: 3, strength: 0.5 } });
  assert.deepEqual([keys(state)[0].slack, keys(state)[0].strength], [3, 0.5]);
  assert.equal(keys(state)[0].constraints[0].slack, 0.15);
  act({ type: "setKeys", keys: keys(state).slice(0, 1), fields: { slack: 0, strength: 1 } });
  assert.ok(!("slack" in keys(state)[0].constraints[0]));
  assert.deepEqual(taken(keys(state), keys(state).slice(0, 1), 85), { track: "left_hand", frame: 95 });
  assert.equal(taken(keys(state), keys(state).slice(0, 1), 84), null);
  act({ type: "removeKeys", keys: keys(state).slice(0, 2) });
  assert.equal(state.project.edits.length, 1);
  act({ type: "removeKeys", keys: keys(state) });
  assert.equal(state.project.edits.length, 0);
});

test("a planted foot is a key with a last frame: it moves, is stretched, and the preview holds it", () => {
  let state = initial();
  const act = (action) => {
    state = reduce(state, { take: 0, fps: FPS, frames: FRAMES, edit, ...action });
  };
  act({ type: "addKey", frame: 60, constraints: plantedOf(poseOf(motion, 60), "left_foot", 60, 66, FPS) });
  assert.deepEqual(
    keys(state).map(({ track, frame, until }) => [track, frame, until]),
    [["left_foot", 60, 66]],
  );
  assert.deepEqual(state.project.edits[0].change, [[48, 79]]);
  const shown = previewed(motion, state.project.edits[0].change[0], keys(state));
  // as far as the leg reaches
  for (let t = 60; t <= 62; t++) assert.ok(distance(poseOf(shown, t)[7], poseOf(motion, 60)[7]) < 2e-3, `${t}`);
  act({ type: "stretchKey", keys: keys(state), ends: [60, 80] });
  assert.deepEqual(
    keys(state).map(({ frame, until }) => [frame, until]),
    [[60, 80]],
  );
  assert.deepEqual(keys(state)[0].constraints[0].times, [3, 4]);
  assert.equal(state.project.edits[0].change[0][1], 85);
  act({ type: "moveKeys", keys: keys(state), by: 100 });
  assert.deepEqual(
    keys(state).map(({ frame, until }) => [frame, until]),
    [[79, 99]],
  );
  const before = state;
  act({ type: "stretchKey", keys: keys(state), ends: [79, 100] });
  assert.equal(state, before);
  assert.deepEqual(taken([...keys(state), { track: "left_foot", frame: 90, until: 90 }], keys(state), 0), {
    track: "left_foot",
    frame: 79,
  });
});

test("words for a span take its keys along; the new edit has them", () => {
  let state = key(initial(), 40);
  state = reduce(state, { type: "addEdit", fps: FPS, edit: { ...edit, take: 0, change: [[30, 60]], seed: 0, sampling: {} } });
  assert.deepEqual(brief(state), ["left_hand 40"]);
  assert.equal(keys(state)[0].edit, 1);
  assert.equal(editAt(state.project, 0, 45), 1);
  assert.equal(editAt(state.project, 0, 29), 0);
});

test("the preview meets a key, keeps bones, planted feet and all other frames, within 50 ms", () => {
  const state = key(key(initial(), 40), 44, ["hips"], [0.05, -0.15, 0]);
  const [{ change }] = state.project.edits;
  const before = process.cpuUsage(), // wall time would be that of a busy machine
    shown = previewed(motion, change[0], keys(state)),
    took = process.cpuUsage(before).user / 1000;
  assert.ok(took < 50, `${took} ms`);
  assert.ok(distance(poseOf(shown, 40)[20], add(BODY[20], [0, 0.3, 0.1])) < 1e-3);
  assert.ok(distance(poseOf(shown, 44)[0], add(BODY[0], [0.05, -0.15, 0])) < 1e-3);
  const usual = boneLengths(BODY);
  for (let t = 0; t < FRAMES; t++) {
    const pose = poseOf(shown, t);
    boneLengths(pose).forEach((size, joint) => joint && assert.ok(Math.abs(size / usual[joint] - 1) < 1e-3));
    if (t >= 28 && t < 46) for (const foot of [7, 8]) assert.ok(distance(pose[foot], BODY[foot]) < 0.01, `${t}`);
  }
  const [[first, past]] = change;
  for (const [a, b] of [
    [0, first],
    [past, FRAMES],
  ])
    assert.deepEqual(shown.joints.subarray(66 * a, 66 * b), motion.joints.subarray(66 * a, 66 * b));
  assert.ok(distance(poseOf(shown, first)[20], poseOf(shown, first - 1)[20]) < 0.02);
});
