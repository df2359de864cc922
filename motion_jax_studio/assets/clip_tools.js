// A desk for clips: trim, reverse, mirror, speed, and the best loop of a motion with its score. Needs no browser.
import { part } from "./motion.js";
import { JOINTS, MIRRORED, boneLengths, directions, poseOf, withLengths } from "./skeleton.js";
import { distance, dot, mix, sub } from "./vectors.js";

export const SPEEDS = [0.25, 4]; // smallest and largest factor
const SHORTEST_LOOP = 0.5, // seconds
  SPEED_WEIGHT = 0.2, // metres that a metre a second off at a seam counts
  DRIFT_WEIGHT = 0.5; // a metre of height or a radian of heading off

const withFrames = (motion, poses, captions = motion.captions ?? []) => ({
  ...motion,
  sent: null,
  stands: undefined,
  prints: undefined,
  preview: false,
  frames: poses.length,
  joints: Float32Array.from(poses.flat(2)),
  captions,
  meta: {},
});

const all = (motion) => Array.from({ length: motion.frames }, (_, t) => poseOf(motion, t));
const retimed = (captions, how, end) =>
  (captions ?? [])
    .map((one) => (one.end > one.start ? { ...one, start: Math.max(0, how(one.start)), end: Math.min(end, how(one.end)) } : one))
    .filter((one) => one.end > one.start || !(one.end || one.start));

/** The frames from first up to past. */
export function trimmed(motion, first, past) {
  const cut = part(motion, first, past);
  return {
    ...cut,
    stands: undefined,
    prints: undefined,
    captions: retimed(motion.captions, (second) => second - first / motion.fps, (past - first) / motion.fps),
    meta: {},
  };
}

/** The motion from its end to its start. */
export function reversed(motion) {
  const end = motion.frames / motion.fps,
    captions = (motion.captions ?? []).map((one) =>
      one.end > one.start ? { ...one, start: end - one.end, end: end - one.start } : one,
    );
  return withFrames(motion, all(motion).reverse(), captions.reverse());
}

/** Left and right exchanged across the plane in which the first frame faces. */
export function mirroredMotion(motion) {
  const start = poseOf(motion, 0),
    { left } = directions(start),
    swap = motion.count === JOINTS.length ? MIRRORED : null;
  return withFrames(
    motion,
    all(motion).map((pose) => {
      const flipped = pose.map((_, joint) => {
        const place = pose[swap ? swap[joint] : joint],
          away = dot(sub(place, start[0]), left);
        return place.map((value, k) => value - 2 * away * left[k]);
      });
      return swap ? withLengths(flipped, boneLengths(pose)) : flipped;
    }),
  );
}

/** The motion played `factor` times as fast: planted feet stay where they are, bones keep their lengths. */
export function atSpeed(motion, factor) {
  const frames = Math.max(2, Math.round((motion.frames - 1) / factor) + 1),
    step = (motion.frames - 1) / (frames - 1);
  const poses = Array.from({ length: frames }, (_, t) => {
    const at = Math.min(t * step, motion.frames - 1),
      [a, b] = [poseOf(motion, Math.floor(at)), poseOf(motion, Math.min(Math.floor(at) + 1, motion.frames - 1))];
    const pose = a.map((place, joint) => mix(place, b[joint], at - Math.floor(at)));
    return motion.count === JOINTS.length ? withLengths(pose, boneLengths(a)) : pose;
  });
  return withFrames(
    motion,
    poses,
    retimed(motion.captions, (second) => second / step, frames / motion.fps),
  );
}

// A pose around its root on the floor, turned to face +z.
function atOrigin(pose) {
  const { left, ahead } = directions(pose);
  return pose.map((place) => {
    const away = sub(place, [pose[0][0], 0, pose[0][2]]);
    return [dot(away, left), away[1], dot(away, ahead)];
  });
}

const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;

// What seams are compared by: {poses, seen (around the root), steps (metres a second), headings} of each frame.
function seams(motion) {
  const poses = all(motion),
    seen = poses.map(atOrigin);
  return {
    poses,
    seen,
    steps: seen.map((pose, t) => {
      const next = seen[Math.min(t + 1, seen.length - 1)];
      return next.map((place, joint) => sub(place, pose[joint]).map((value) => value * motion.fps));
    }),
    headings: poses.map((pose) => Math.atan2(directions(pose).ahead[0], directions(pose).ahead[2])),
  };
}

/** How well the frames from first to last, both included, play again and again: {pose, speed, turn, height, drift, score};
    metres, metres a second, degrees; drift: metres over the floor in a round; score: less is better. */
export function loopScore(motion, first, last, { poses, seen, steps, headings } = seams(motion)) {
  const pose = mean(seen[first].map((place, joint) => distance(place, seen[last][joint]))),
    speed = mean(steps[first].map((value, joint) => distance(value, steps[Math.min(last, motion.frames - 2)][joint]))),
    turn = Math.abs(((((headings[last] - headings[first]) % (2 * Math.PI)) + 3 * Math.PI) % (2 * Math.PI)) - Math.PI),
    [a, b] = [poses[first][0], poses[last][0]],
    height = Math.abs(a[1] - b[1]),
    score = pose + SPEED_WEIGHT * speed + DRIFT_WEIGHT * (turn + height);
  return { pose, speed, turn: (turn * 180) / Math.PI, height, drift: Math.hypot(b[0] - a[0], b[2] - a[2]), score };
}

/** {first, last, ...loopScore} of the best loop, or null for a motion that is too short. */
export function bestLoop(motion) {
  const least = Math.round(SHORTEST_LOOP * motion.fps),
    stride = Math.max(1, Math.floor(motion.frames / 120)), // of frames that are compared
    known = seams(motion);
  let best = null;
  for (let first = 0; first + least < motion.frames - 1; first += stride) {
    for (let last = first + least; last < motion.frames - 1; last += stride) {
      const found = loopScore(motion, first, last, known);
      if (!best || found.score < best.score - 1e-9) best = { first, last, ...found };
    }
  }
  return best;
}

export const loopText = ({ first, last, pose, speed, turn, drift }, fps) =>
  `loop of ${((last - first) / fps).toFixed(2)} s, frames ${first} to ${last}: pose ${(1000 * pose).toFixed(0)} mm, speed ` +
  `${speed.toFixed(2)} m/s and ${turn.toFixed(0)}° off at the seam, ${drift.toFixed(2)} m on in a round`;

const $ = (id) => document.getElementById(id);

/** Connects the buttons. Each turns the motion that is shown into an imported one; undo restores the blocks. */
export function bindClips(studio, toJson) {
  const { notes, multiPrompt, act } = studio;
  const change = (how, words) => () => {
    const motion = multiPrompt.shown;
    if (!motion || multiPrompt.stale) return notes.tell("generate or import a motion first", true);
    const changed = how(motion);
    if (!changed) return;
    act({ type: "importMotion", motion: toJson(changed), alone: true });
    multiPrompt.make();
    notes.tell(`${words}; Ctrl-Z restores the blocks`, false);
  };
  $("clip-trim").onclick = change((motion) => {
    const { span } = studio.state;
    if (!span) return void notes.tell("mark a span first: drag below the blocks, or press [ and ]", true);
    return trimmed(motion, span[0], Math.min(span[1], motion.frames));
  }, "trimmed to the marked span");
  $("clip-reverse").onclick = change(reversed, "reversed");
  $("clip-mirror").onclick = change(mirroredMotion, "left and right are exchanged");
  $("clip-speed").onchange = () => {
    const factor = Number($("clip-speed").value);
    $("clip-speed").value = "1";
    if (!(factor >= SPEEDS[0] && factor <= SPEEDS[1]))
      return notes.tell(`got a speed of ${factor}, expected ${SPEEDS.join(" to ")}`, true);
    if (factor !== 1) change((motion) => atSpeed(motion, factor), `${factor} times as fast; planted feet stay planted`)();
  };
  $("clip-loop").onclick = () => {
    const motion = multiPrompt.shown,
      loop = motion?.count === JOINTS.length ? bestLoop(motion) : null;
    if (!loop) return notes.tell("there is no loop in a motion this short", true);
    act({ type: "span", span: [loop.first, loop.last + 1] });
    notes.tell(loopText(loop, motion.fps), false);
  };
}
