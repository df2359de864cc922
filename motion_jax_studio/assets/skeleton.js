// The 22 joints of a body: their tree, limbs, handles, and what follows from a pose. Needs no browser.
// A pose: [[x, y, z], ...] of all joints, metres, y up; a standing body faces +z, its left is +x.
import { add, cross, distance, dot, scale, sub, turned, unit } from "./vectors.js";

export const JOINTS = [
  "pelvis",
  "left_hip",
  "right_hip",
  "spine1",
  "left_knee",
  "right_knee",
  "spine2",
  "left_ankle",
  "right_ankle",
  "spine3",
  "left_foot",
  "right_foot",
  "neck",
  "left_collar",
  "right_collar",
  "head",
  "left_shoulder",
  "right_shoulder",
  "left_elbow",
  "right_elbow",
  "left_wrist",
  "right_wrist",
];
export const PARENTS = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19];
export const MIRRORED = JOINTS.map((name) =>
  JOINTS.indexOf(name.replace(/^(left|right)/, (side) => (side === "left" ? "right" : "left"))),
);

/** Two-bone limbs: the joints of their chain, and what hangs on its end. */
export const LIMBS = {
  left_arm: { chain: [16, 18, 20], tail: [] },
  right_arm: { chain: [17, 19, 21], tail: [] },
  left_leg: { chain: [1, 4, 7], tail: [10] },
  right_leg: { chain: [2, 5, 8], tail: [11] },
};

/** Handles of the body. joint: where it is; limb: whose end (or, with bend, middle) it is; pivot: what its rotation rings
    turn about; label: for people. */
export const HANDLES = {
  left_hand: { joint: 20, limb: "left_arm", pivot: 18, label: "left hand" },
  right_hand: { joint: 21, limb: "right_arm", pivot: 19, label: "right hand" },
  left_foot: { joint: 7, limb: "left_leg", pivot: 7, label: "left foot" },
  right_foot: { joint: 8, limb: "right_leg", pivot: 8, label: "right foot" },
  left_elbow: { joint: 18, limb: "left_arm", bend: true, pivot: 16, label: "left elbow" },
  right_elbow: { joint: 19, limb: "right_arm", bend: true, pivot: 17, label: "right elbow" },
  left_knee: { joint: 4, limb: "left_leg", bend: true, pivot: 1, label: "left knee" },
  right_knee: { joint: 5, limb: "right_leg", bend: true, pivot: 2, label: "right knee" },
  hips: { joint: 0, pivot: 0, label: "hips" },
  chest: { joint: 9, pivot: 3, label: "chest" },
  head: { joint: 15, pivot: 12, label: "head" },
};

/** The handle that moves the bone that ends at a joint. */
export const HANDLE_OF_BONE = {
  1: "hips",
  2: "hips",
  3: "hips",
  4: "left_knee",
  5: "right_knee",
  6: "chest",
  7: "left_foot",
  8: "right_foot",
  9: "chest",
  10: "left_foot",
  11: "right_foot",
  12: "chest",
  13: "chest",
  14: "chest",
  15: "head",
  16: "chest",
  17: "chest",
  18: "left_elbow",
  19: "right_elbow",
  20: "left_hand",
  21: "right_hand",
};

export const copied = (pose) => pose.map((place) => [...place]);

/** The joints below a joint. */
export const DESCENDANTS = PARENTS.map((_, joint) => {
  const below = [];
  PARENTS.forEach((parent, child) => {
    if (parent === joint || below.includes(parent)) below.push(child);
  });
  return below;
});

export const boneLengths = (pose) => pose.map((place, joint) => (joint ? distance(place, pose[PARENTS[joint]]) : 0));

/** A pose with other bone lengths, the bones' directions kept. */
export function withLengths(pose, lengths) {
  const found = copied(pose);
  for (let joint = 1; joint < pose.length; joint++) {
    const parent = PARENTS[joint];
    found[joint] = add(found[parent], scale(unit(sub(pose[joint], pose[parent]), [0, -1, 0]), lengths[joint]));
  }
  return found;
}

/** Unit vectors of a body on the floor: to its left, and ahead. */
export function directions(pose) {
  const hips = sub(pose[1], pose[2]),
    shoulders = sub(pose[16], pose[17]),
    across = unit([hips[0] + shoulders[0], 0, hips[2] + shoulders[2]], [1, 0, 0]);
  return { left: across, ahead: cross(across, [0, 1, 0]) };
}

const headingOf = (pose) => {
  const { ahead } = directions(pose);
  return Math.atan2(ahead[0], ahead[2]);
};

/** The pose with left and right exchanged, on the bones of the body. */
export function mirrored(pose) {
  const { left } = directions(pose),
    flipped = pose.map((_, joint) => {
      const place = pose[MIRRORED[joint]],
        away = dot(sub(place, pose[0]), left);
      return sub(place, scale(left, 2 * away));
    });
  return withLengths(flipped, boneLengths(pose));
}

/** A copied pose where another pose is on the floor and faces, with that body's bones. */
export function pasted(pose, onto) {
  const angle = headingOf(onto) - headingOf(pose),
    moved = pose.map((place) => {
      const [x, y, z] = turned(sub(place, [pose[0][0], 0, pose[0][2]]), [0, 1, 0], angle);
      return [x + onto[0][0], y, z + onto[0][2]];
    });
  return withLengths(moved, boneLengths(onto));
}

/** A pose whose limb, or trunk for a handle without one, has the bone directions of another pose. */
export function withLimbOf(pose, original, handle) {
  const { limb, joint } = HANDLES[handle],
    found = copied(pose);
  if (handle === "hips") return pose.map((place) => add(sub(place, pose[0]), original[0]));
  const joints = limb ? [...LIMBS[limb].chain.slice(1), ...LIMBS[limb].tail] : joint === 15 ? [15] : [6, 9, ...DESCENDANTS[9]];
  for (const child of joints) found[child] = add(found[PARENTS[child]], sub(original[child], original[PARENTS[child]]));
  return found;
}

/** The pose of a frame of a motion (motion.js). */
export function poseOf(motion, frame) {
  const first = 3 * motion.count * clampFrame(motion, frame);
  return Array.from({ length: motion.count }, (_, j) => [...motion.joints.subarray(first + 3 * j, first + 3 * j + 3)]);
}

const clampFrame = (motion, frame) => Math.max(0, Math.min(Math.round(frame), motion.frames - 1));
