// Motions as the page holds them, and what can be reckoned of them. No browser is needed here.
// A motion: {fps, frames, count (of joints), joints: Float32Array of frames * count * 3 in metres, skeleton, captions,
// meta, id}; what came from the studio is kept beside it as `sent`, to be sent back as it was.

const FEET = [7, 10, 8, 11]; // left ankle, left toes, right ankle, right toes of the 22 joints
const SLOW = 0.15,
  LOW = 0.1; // metres a second, metres: what is below stands
const HALF_WINDOW = 2; // frames on both sides whose majority decides

export function fromJson(sent) {
  const bytes = Uint8Array.from(atob(sent.joints), (c) => c.charCodeAt(0));
  const [frames, count] = sent.shape;
  return { ...sent, joints: new Float32Array(bytes.buffer), frames, count, sent };
}

export function toJson(motion) {
  if (motion.sent) return motion.sent;
  const bytes = new Uint8Array(motion.joints.buffer, motion.joints.byteOffset, motion.joints.byteLength);
  let text = "";
  for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
  return {
    shape: [motion.frames, motion.count, 3],
    joints: btoa(text),
    fps: motion.fps,
    skeleton: "humanml3d",
    captions: motion.captions ?? [],
    id: motion.id ?? "motion",
    meta: motion.meta ?? {},
  };
}

export const seconds = (motion) => (motion ? motion.frames / motion.fps : 0);

const at = (motion, frame, joint) => {
  const k = 3 * (Math.max(0, Math.min(frame, motion.frames - 1)) * motion.count + joint);
  return motion.joints.subarray(k, k + 3);
};

const far = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);

/** Uint8Array of frames * 4: which of left ankle, left toes, right ankle, right toes stand. */
export function contacts(motion) {
  const found = new Uint8Array(motion.frames * 4);
  if (motion.count !== 22) return found;
  const raw = found.slice();
  for (let t = 0; t < motion.frames; t++) {
    FEET.forEach((joint, i) => {
      const before = Math.max(0, t - 1),
        after = Math.min(motion.frames - 1, t + 1);
      const speed =
        (far(at(motion, after, joint), at(motion, before, joint)) * motion.fps) / Math.max(1, after - before);
      raw[4 * t + i] = Number(speed < SLOW && at(motion, t, joint)[1] < LOW);
    });
  }
  for (let t = 0; t < motion.frames; t++) {
    for (let i = 0; i < 4; i++) {
      let votes = 0;
      for (let s = t - HALF_WINDOW; s <= t + HALF_WINDOW; s++) {
        votes += raw[4 * Math.max(0, Math.min(s, motion.frames - 1)) + i];
      }
      found[4 * t + i] = Number(votes > HALF_WINDOW);
    }
  }
  return found;
}

/** Where feet stood: [{first, past, x, z, left}], of the toes. */
export function footprints(motion, stands) {
  const found = [];
  if (motion.count !== 22) return found;
  for (const i of [1, 3]) {
    let first = -1;
    for (let t = 0; t <= motion.frames; t++) {
      const stand = t < motion.frames && stands[4 * t + i];
      if (stand && first < 0) first = t;
      if (!stand && first >= 0) {
        const place = at(motion, (first + t) >> 1, FEET[i]);
        found.push({ first, past: t, x: place[0], z: place[2], left: i === 1 });
        first = -1;
      }
    }
  }
  return found.sort((a, b) => a.first - b.first);
}

/** {name: {unit, lines: [Float32Array, ...]}} of the whole motion: speed, feet, jerk, heading. */
export function curves(motion) {
  const { frames, fps, count } = motion;
  const line = (value) => Float32Array.from({ length: frames }, (_, t) => value(t));
  const flat = (t) => {
    const a = at(motion, t - 1, 0),
      b = at(motion, t + 1, 0),
      passed = Math.min(t + 1, frames - 1) - Math.max(t - 1, 0);
    return passed ? (Math.hypot(b[0] - a[0], b[2] - a[2]) * fps) / passed : 0;
  };
  const jerk = (t) => {
    if (t < 2 || t > frames - 2) return 0;
    let sum = 0;
    for (let j = 0; j < count; j++) {
      const p = [t - 2, t - 1, t, t + 1].map((s) => at(motion, s, j));
      sum += Math.hypot(...[0, 1, 2].map((k) => p[3][k] - 3 * p[2][k] + 3 * p[1][k] - p[0][k]));
    }
    return (sum / count) * fps ** 3;
  };
  const found = { speed: { unit: "m/s", lines: [line(flat)] }, jerk: { unit: "m/s³", lines: [line(jerk)] } };
  if (count !== 22) return found;
  found.feet = { unit: "m", lines: [10, 11].map((joint) => line((t) => at(motion, t, joint)[1])) };
  let last = 0;
  found.heading = {
    unit: "°",
    lines: [
      line((t) => {
        const left = at(motion, t, 1),
          right = at(motion, t, 2);
        let angle = (Math.atan2(right[2] - left[2], left[0] - right[0]) * 180) / Math.PI;
        angle += 360 * Math.round((last - angle) / 360); // whole turns are followed
        last = angle;
        return angle;
      }),
    ],
  };
  return found;
}

/** Whether an edit regenerated a frame: true, false, or null where the motion was not edited. */
export function isEdited(motion, frame) {
  const made = motion?.meta?.made;
  if (!Array.isArray(made)) return null;
  return made.some(([first, past]) => first <= frame && frame < past);
}

/** A part of a motion's frames as a motion of its own. */
export function part(motion, first, past) {
  const k = 3 * motion.count;
  return { ...motion, sent: null, joints: motion.joints.slice(first * k, past * k), frames: past - first };
}
