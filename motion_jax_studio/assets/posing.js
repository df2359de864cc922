// What dragging or turning a part of the body does to a pose: two-bone inverse kinematics with the bend side kept, hips
// over planted feet, a spine that follows chest and head, soft limits of joints, a floor. Needs no browser. All functions
// return new poses (skeleton.js) with the bone lengths of the one they are given.
import { DESCENDANTS, HANDLES, LIMBS, copied, directions } from "./skeleton.js";
import {
  add,
  clamp,
  cross,
  distance,
  dot,
  fromQuaternion,
  isFinite3,
  length,
  mix,
  perpendicular,
  rotationBetween,
  scale,
  smooth,
  sub,
  turned,
  unit,
} from "./vectors.js";

const RADIANS = Math.PI / 180,
  FOLDED = { arm: 30 * RADIANS, leg: 35 * RADIANS }, // smallest angle inside elbow and knee
  STRAIGHT = 178 * RADIANS,
  SOFT = 0.96, // share of the reach from which on a dragged hand or foot follows less and less
  BENDS = [0.01, 0.06]; // metres that the middle of a limb is off the straight line: below, the usual side counts
const ANKLE = 0.06,
  TOES = 0.015, // metres above the floor at which a foot stands
  SNAP = 0.05, // metres above that, within which a dragged foot is put on the floor
  STANDS = 0.13, // height of an ankle that counts as standing
  LOWEST = { pelvis: 0.1, hand: 0.02 };
export const FARTHEST = 3; // metres that one drag may move the hips
// Pivots of the spine with the share of a turn that each takes, and its largest angle.
const SPINE = [
  { pivot: 0, moves: [3, ...DESCENDANTS[3]], share: 0.25, most: 25 * RADIANS },
  { pivot: 3, moves: [6, ...DESCENDANTS[6]], share: 0.35, most: 30 * RADIANS },
  { pivot: 6, moves: [9, ...DESCENDANTS[9]], share: 0.35, most: 30 * RADIANS },
];
const NECK = [
  { pivot: 9, moves: [12, 15], share: 0.3, most: 30 * RADIANS },
  { pivot: 12, moves: [15], share: 0.6, most: 45 * RADIANS },
];
const MOST_LEAN = 0.4; // metres that shoulders or hips go along with a hand or foot
const ROUNDS = 20; // rounds in which a spine turns towards its target

const kindOf = (limb) => (limb.endsWith("arm") ? "arm" : "leg");

// The usual side of a bend: knees ahead, elbows back and down.
const usualBend = (pose, limb) => {
  const { ahead } = directions(pose);
  return kindOf(limb) === "leg" ? ahead : unit(add(scale(ahead, -0.8), [0, -0.6, 0]));
};

// {least, most, upper, lower}: how near and far the end of a limb can be from its root.
function reachOf(pose, limb) {
  const [a, b, c] = LIMBS[limb].chain,
    upper = distance(pose[a], pose[b]),
    lower = distance(pose[b], pose[c]),
    across = (angle) => Math.sqrt(Math.max(upper * upper + lower * lower - 2 * upper * lower * Math.cos(angle), 0));
  return { least: across(FOLDED[kindOf(limb)]), most: across(STRAIGHT), upper, lower };
}

// Puts the end of a limb at a place, in a pose that may be changed. bend: another direction for its middle. soft: the end
// follows less and less near its reach.
function solve(pose, limb, place, { bend = null, soft = false } = {}) {
  const { chain, tail } = LIMBS[limb],
    [a, b, c] = chain,
    root = pose[a],
    { least, most, upper, lower } = reachOf(pose, limb),
    away = sub(place, root),
    axis = unit(away, unit(sub(pose[c], root)));
  let far = length(away);
  const from = SOFT * most;
  if (soft && far > from) far = from + (most - from) * (1 - Math.exp(-(far - from) / (most - from)));
  far = clamp(far, least, most);
  const before = unit(sub(pose[c], root)),
    side = perpendicular(sub(pose[b], root), before),
    { axis: about, angle } = rotationBetween(before, axis),
    known = smooth(clamp((length(side) - BENDS[0]) / (BENDS[1] - BENDS[0]), 0, 1)),
    kept = turned(unit(side, [0, 0, 0]), about, angle),
    wanted = bend ?? mix(usualBend(pose, limb), kept, known),
    off = perpendicular(wanted, axis),
    out =
      length(off) > 1e-6 ? unit(off) : unit(perpendicular(usualBend(pose, limb), axis), unit(cross(axis, [0, 0, 1]), [1, 0, 0])),
    cosine = clamp((upper * upper + far * far - lower * lower) / (2 * upper * far), -1, 1),
    end = add(root, scale(axis, far)),
    moved = sub(end, pose[c]);
  pose[b] = add(root, add(scale(axis, upper * cosine), scale(out, upper * Math.sqrt(1 - cosine * cosine))));
  pose[c] = end;
  for (const joint of tail) pose[joint] = add(pose[joint], moved);
  return pose;
}

// How far the lower of ankle and toes is above the floor.
const clearance = (pose, [ankle, toes]) => Math.min(pose[ankle][1] - ANKLE, pose[toes][1] - TOES);
const feet = (limb) => [LIMBS[limb].chain[2], LIMBS[limb].tail[0]];

/** Whether a foot stands, so that it stays where it is while the hips move. */
export const stands = (pose, side) => pose[side === "left" ? 7 : 8][1] < STANDS && clearance(pose, feet(`${side}_leg`)) < SNAP;

// Lifts feet and hands out of the floor, but not above where they were.
function aboveFloor(pose, start) {
  for (const limb of ["left_leg", "right_leg"]) {
    const low = Math.min(0, clearance(start, feet(limb)));
    for (let i = 0; i < 3 && clearance(pose, feet(limb)) < low - 1e-6; i++) {
      const up = low - clearance(pose, feet(limb));
      solve(pose, limb, add(pose[feet(limb)[0]], [0, up, 0]));
    }
    const sunk = low - clearance(pose, feet(limb));
    if (sunk > 1e-6) for (const place of pose) place[1] += sunk; // legs that are folded: the body rises
  }
  for (const limb of ["left_arm", "right_arm"]) {
    const hand = LIMBS[limb].chain[2];
    if (pose[hand][1] < Math.min(LOWEST.hand, start[hand][1]) - 1e-6) {
      solve(pose, limb, [pose[hand][0], LOWEST.hand, pose[hand][2]]);
    }
  }
  return pose;
}

function rotate(pose, joints, pivot, axis, angle) {
  for (const joint of joints) pose[joint] = add(pose[pivot], turned(sub(pose[joint], pose[pivot]), axis, angle));
}

// Turns the pivots of a spine so that joint `end` goes to a place.
function follow(pose, pivots, end, place) {
  const used = pivots.map(() => 0);
  for (let round = 0; round < ROUNDS && distance(pose[end], place) > 1e-4; round++) {
    pivots.forEach(({ pivot, moves, share, most }, i) => {
      const { axis, angle } = rotationBetween(sub(pose[end], pose[pivot]), sub(place, pose[pivot])),
        by = Math.min(angle * share, most - used[i]);
      if (by < 1e-6) return;
      used[i] += by;
      rotate(pose, moves, pivot, axis, by);
    });
  }
}

// Hands and feet that are pinned go back to where they were.
function hold(pose, start, pins) {
  for (const [handle, { joint, limb, bend }] of Object.entries(HANDLES)) {
    if (pins.has(handle) && limb && !bend) solve(pose, limb, start[joint]);
  }
}

function dragEnd(start, handle, place, pins, snap) {
  const { limb, joint } = HANDLES[handle],
    isArm = kindOf(limb) === "arm";
  let to = [...place],
    pose = copied(start);
  if (isArm) to[1] = Math.max(to[1], Math.min(LOWEST.hand, start[joint][1]));
  else {
    const low = Math.min(0, clearance(start, feet(limb))),
      high = clearance(start, feet(limb)) + to[1] - start[joint][1];
    if (high < low || (snap && Math.abs(high) < SNAP)) to[1] -= high - (snap && Math.abs(high) < SNAP ? Math.max(low, 0) : low);
  }
  // Out of reach: the spine leans towards a hand, the hips move towards a foot.
  const root = LIMBS[limb].chain[0],
    beyond = distance(to, start[root]) - SOFT * reachOf(start, limb).most,
    others = new Set([...pins].filter((name) => name !== handle));
  if (beyond > 0) {
    const by = scale(unit(sub(to, start[root])), Math.min(beyond, MOST_LEAN));
    if (isArm) {
      follow(pose, SPINE, root, add(start[root], by));
      hold(pose, start, others);
    } else pose = dragHips(start, add(start[0], by), others, [handle]);
  }
  return solve(pose, limb, to, { soft: true });
}

// Swivels elbow or knee about the line from the limb's root to its end.
function dragBend(start, handle, place) {
  const { limb } = HANDLES[handle],
    [a, , c] = LIMBS[limb].chain,
    axis = unit(sub(start[c], start[a])),
    bend = perpendicular(sub(place, start[a]), axis);
  return solve(copied(start), limb, start[c], { bend: length(bend) > 1e-4 ? bend : null });
}

// loose: feet that need not stay where they stand.
function dragHips(start, place, pins, loose = []) {
  let by = sub(place, start[0]);
  by = scale(by, Math.min(1, FARTHEST / Math.max(length(by), 1e-9)));
  by[1] = Math.max(by[1], Math.min(LOWEST.pelvis - start[0][1], 0));
  const planted = ["left", "right"].filter(
    (side) => !loose.includes(`${side}_foot`) && (pins.has(`${side}_foot`) || stands(start, side)),
  );
  for (let round = 0; round < 24; round++) {
    for (const side of planted) {
      const [hip, , ankle] = LIMBS[`${side}_leg`].chain,
        { least, most } = reachOf(start, `${side}_leg`),
        away = sub(add(start[hip], by), start[ankle]),
        far = length(away),
        fit = clamp(far, least, most);
      by = add(by, scale(unit(away), fit - far));
    }
  }
  const pose = start.map((joint) => add(joint, by));
  for (const side of planted) solve(pose, `${side}_leg`, start[LIMBS[`${side}_leg`].chain[2]]);
  // a planted foot keeps its own direction
  for (const side of planted)
    pose[feet(`${side}_leg`)[1]] = add(
      pose[feet(`${side}_leg`)[0]],
      sub(start[feet(`${side}_leg`)[1]], start[feet(`${side}_leg`)[0]]),
    );
  hold(pose, start, pins);
  return pose;
}

function dragSpine(start, handle, place, pins) {
  const pose = copied(start);
  if (handle === "chest") follow(pose, SPINE, 9, place);
  else follow(pose, [...SPINE.map((row) => ({ ...row, share: row.share * 0.5 })), ...NECK], 15, place);
  hold(pose, start, pins);
  return pose;
}

const checked = (pose, start) => (pose.every(isFinite3) ? aboveFloor(pose, start) : copied(start));

/** The pose after a handle was dragged from where `start` has it to a place. pins: a Set of handles of hands and feet that
    stay in the world; snap: whether a foot near the floor is put on it. */
export function dragged(start, handle, place, { pins = new Set(), snap = true } = {}) {
  if (!isFinite3(place)) return copied(start);
  const { limb, bend } = HANDLES[handle];
  const pose = bend
    ? dragBend(start, handle, place)
    : limb
      ? dragEnd(start, handle, place, pins, snap)
      : handle === "hips"
        ? dragHips(start, place, pins)
        : dragSpine(start, handle, place, pins);
  return checked(pose, start);
}

// Opens an elbow or knee that is folded more than it can be.
function unfold(pose, limb) {
  const [a, b, c] = LIMBS[limb].chain,
    inside = rotationBetween(sub(pose[a], pose[b]), sub(pose[c], pose[b])),
    least = FOLDED[kindOf(limb)];
  if (inside.angle < least) rotate(pose, [c, ...LIMBS[limb].tail], b, inside.axis, least - inside.angle);
}

/** The pose after rotation rings turned a handle's part by a quaternion [x, y, z, w]. */
export function rotated(start, handle, quaternion, { pins = new Set() } = {}) {
  const { pivot, limb } = HANDLES[handle],
    { axis, angle } = fromQuaternion(quaternion);
  if (!Number.isFinite(angle)) return copied(start);
  const pose = copied(start);
  rotate(pose, DESCENDANTS[pivot], pivot, axis, angle);
  if (limb) unfold(pose, limb);
  if (handle === "hips") {
    const planted = ["left_foot", "right_foot"].filter((foot) => pins.has(foot) || stands(start, foot.split("_")[0]));
    hold(pose, start, new Set([...pins, ...planted]));
  } else if (!limb) hold(pose, start, pins);
  return checked(pose, start);
}

/** How much a limb bends: the angle inside its elbow or knee, radians. */
export const insideAngle = (pose, limb) => {
  const [a, b, c] = LIMBS[limb].chain;
  return Math.acos(clamp(dot(unit(sub(pose[a], pose[b])), unit(sub(pose[c], pose[b]))), -1, 1));
};

/** The pose with a hand or foot at a place, wherever that is within reach; used for previews and planted feet. */
export const placedEnd = (pose, handle, place) => solve(copied(pose), HANDLES[handle].limb, place);
