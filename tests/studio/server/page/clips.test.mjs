// The desk for clips, without a browser. Run by test_page_parts.py.
import assert from "node:assert/strict";
import { test } from "node:test";

import { atSpeed, bestLoop, loopScore, loopText, mirroredMotion, reversed, trimmed } from "./clip_tools.js";
import { boneLengths, poseOf } from "./skeleton.js";
import { add, distance } from "./vectors.js";

const BODY = [[0, 0.94, 0], [0.074, 0.87, 0], [-0.084, 0.87, 0], [0.004, 1.07, 0], [0.08, 0.49, 0.05], [-0.09, 0.49, 0.05],
  [0.004, 1.21, 0], [0.08, 0.075, 0], [-0.09, 0.075, 0], [0.004, 1.27, 0], [0.08, 0.02, 0.125], [-0.09, 0.02, 0.125],
  [0, 1.49, 0], [0.09, 1.38, -0.01], [-0.09, 1.38, -0.01], [0, 1.58, 0.03], [0.21, 1.37, -0.01], [-0.21, 1.37, -0.01],
  [0.26, 1.12, -0.04], [-0.26, 1.12, -0.04], [0.27, 0.88, 0.04], [-0.27, 0.88, 0.04]]; // prettier-ignore
const FRAMES = 60;
// Goes ahead by 2 cm a frame, the left hand circles once in 20 frames.
const poses = Array.from({ length: FRAMES }, (_, t) =>
  BODY.map((place, joint) => add(place, [0, joint === 20 ? 0.05 * Math.sin((t * Math.PI) / 10) : 0, 0.02 * t +
    (joint === 20 ? 0.05 * Math.cos((t * Math.PI) / 10) : 0)]))); // prettier-ignore
const captions = [
  { text: "walks", start: 0, end: 2 },
  { text: "waves", start: 2, end: 3 },
];
const motion = { frames: FRAMES, count: 22, fps: 20, joints: Float32Array.from(poses.flat(2)), captions, meta: {}, sent: {} };
const near = (a, b, tolerance = 1e-5) => assert.ok(distance(a, b) < tolerance, `${a} is not ${b}`);

test("a clip is trimmed, reversed and mirrored with its captions", () => {
  const cut = trimmed(motion, 30, 50);
  assert.deepEqual(
    [cut.frames, cut.sent, cut.captions.map(({ start, end }) => [start, end])],
    [
      20,
      null,
      [
        [0, 0.5],
        [0.5, 1],
      ],
    ],
  );
  near(poseOf(cut, 0)[0], poseOf(motion, 30)[0]);
  const back = reversed(motion);
  near(poseOf(back, 0)[20], poseOf(motion, 59)[20]);
  assert.deepEqual(
    back.captions.map(({ text, start, end }) => [text, start, end]),
    [
      ["waves", 0, 1],
      ["walks", 1, 3],
    ],
  );
  near(poseOf(reversed(back), 17)[20], poseOf(motion, 17)[20]);
  const mirror = mirroredMotion(motion);
  near(poseOf(mirror, 40)[0], poseOf(motion, 40)[0], 0.02);
  assert.ok(Math.abs(poseOf(mirror, 5)[21][1] - poseOf(motion, 5)[20][1]) < 0.06);
  boneLengths(poseOf(mirror, 5)).forEach((size, joint) =>
    assert.ok(Math.abs(size - boneLengths(poseOf(motion, 5))[joint]) < 1e-5),
  );
});

test("another speed has the same way, still feet stay still, bones keep their lengths", () => {
  for (const factor of [0.5, 2, 1.3]) {
    const other = atSpeed(motion, factor);
    assert.ok(Math.abs(other.frames - 59 / factor) < 2);
    near(poseOf(other, other.frames - 1)[0], poseOf(motion, 59)[0]);
    assert.ok(Math.abs(other.captions[1].end - other.frames / 20) < 0.06);
  }
  const still = { ...motion, joints: Float32Array.from(poses.map(() => BODY).flat(2)) };
  near(poseOf(atSpeed(still, 0.7), 33)[7], BODY[7]);
});

test("the best loop is a whole round of the hand, and its score says what is off", () => {
  const loop = bestLoop(motion);
  assert.equal((loop.last - loop.first) % 20, 0);
  assert.ok(loop.pose < 1e-4 && loop.turn < 1e-3 && loop.drift > 0.3);
  assert.ok(loopScore(motion, 0, 30).score > loop.score);
  assert.match(loopText(loop, 20), /^loop of [12]\.00 s, frames \d+ to \d+: pose 0 mm, speed 0\.00 m\/s and 0° off/);
  assert.equal(bestLoop({ ...motion, frames: 8 }), null);
});
