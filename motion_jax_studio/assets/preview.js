// What a motion looks like with new keys, until the model has regenerated the span: the change of each key fades smoothly
// towards the borders and the other keys; bones keep their lengths and standing feet their places. Needs no browser.
import { dragged, placedEnd } from "./posing.js";
import { HANDLES, JOINTS, boneLengths, copied, pasted, poseOf, withLengths } from "./skeleton.js";
import { add, mix, smooth, sub } from "./vectors.js";

const HANDLE_OF = Object.fromEntries(Object.entries(HANDLES).map(([handle, { joint }]) => [JOINTS[joint], handle]));
const NAMES = { left_hand: "left_wrist", right_hand: "right_wrist", hips: "pelvis", root: "pelvis" };
const ORDER = ["pelvis", "spine3", "head"]; // what takes others along comes first

/** The pose of a key: that of the motion with its constraints met. */
export function poseOfKey(pose, constraints) {
  const rank = ({ joint }) => (ORDER.includes(joint) ? ORDER.indexOf(joint) : ORDER.length);
  const nameOf = (one) => NAMES[one.joint] ?? one.joint;
  let found = pose;
  for (const one of [...constraints].sort((a, b) => rank({ joint: nameOf(a) }) - rank({ joint: nameOf(b) }))) {
    let next = found;
    if (one.type === "keyframe") {
      next = one.place === "world" ? copied(one.joints) : pasted(one.joints, pose);
    } else if (nameOf(one) in HANDLE_OF) {
      const handle = HANDLE_OF[nameOf(one)],
        { limb, bend } = HANDLES[handle];
      next =
        limb && !bend ? placedEnd(found, handle, one.positions[0]) : dragged(found, handle, one.positions[0], { snap: false });
    } else {
      next = copied(found); // toes
      next[JOINTS.indexOf(nameOf(one))] = [...one.positions[0]];
    }
    const strength = one.strength ?? 1;
    found = strength < 1 ? found.map((place, joint) => mix(place, next[joint], strength)) : next;
  }
  return withLengths(found, boneLengths(pose));
}

/** The motion with a span of frames bent through keys of keysOf (pose_keys.js); the other frames are the same numbers. */
export function previewed(motion, [first, past], keys) {
  const { count } = motion,
    end = Math.min(past, motion.frames),
    joints = Float32Array.from(motion.joints);
  const all = keys.flatMap((key) => Array.from({ length: key.until - key.frame + 1 }, (_, i) => key.frame + i));
  const frames = [...new Set(all)].filter((frame) => first <= frame && frame < end).sort((a, b) => a - b);
  const nodes = frames.map((frame) => {
    const pose = poseOf(motion, frame),
      aim = poseOfKey(
        pose,
        keys.filter((key) => key.frame <= frame && frame <= key.until).flatMap((key) => key.constraints),
      );
    return { frame, off: aim.map((place, joint) => sub(place, pose[joint])), aim };
  });
  const still = Array(count).fill([0, 0, 0]),
    stops = [
      { frame: first - 1, off: first > 0 ? still : (nodes[0]?.off ?? still) },
      ...nodes,
      { frame: end, off: end < motion.frames ? still : (nodes.at(-1)?.off ?? still) },
    ];
  const moved = (foot) => keys.some(({ track }) => track === "pose" || track === foot);
  for (let t = Math.max(first, 0); t < end; t++) {
    const next = stops.findIndex((stop) => stop.frame >= t),
      node = stops[next];
    let pose;
    if (node.aim && node.frame === t) pose = node.aim;
    else {
      const before = stops[next - 1],
        share = smooth((t - before.frame) / (node.frame - before.frame)),
        start = poseOf(motion, t);
      pose = withLengths(
        start.map((place, joint) => add(place, mix(before.off[joint], node.off[joint], share))),
        boneLengths(start),
      );
      for (const [side, foot] of [
        [0, "left_foot"],
        [2, "right_foot"],
      ]) {
        if (motion.stands?.[4 * t + side] && !moved(foot)) pose = placedEnd(pose, foot, start[HANDLES[foot].joint]);
      }
    }
    pose.forEach((place, joint) => joints.set(place, 3 * (t * count + joint)));
  }
  return { ...motion, joints, sent: null, preview: true };
}
