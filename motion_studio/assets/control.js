// Constraints of a motion as plain objects, in the form of docs/control.md. Needs no browser.

export const MOST_POINTS = 200,
  MOST_POSES = 60;
const FINE = 24; // pieces of a curve between two points

export const isPath = (one) => one.type === "root_path" && Array.isArray(one.points);
export const pathOf = (control) => control.find(isPath) ?? null;
/** [[x, z], ...] of the path that is drawn. */
export const pointsOf = (control) => pathOf(control)?.points.map((point) => [point[0], point.at(-1)]) ?? [];

/** The constraints with another path; no points remove it. Times and headings are dropped if the number of points changes. */
export function withPath(control, points) {
  const old = pathOf(control),
    rest = control.filter((one) => one !== old);
  if (!points.length) return rest;
  const { times, heading, ...kept } = old ?? { type: "root_path" };
  const same = old && old.points.length === points.length;
  const timed = { ...(times && same ? { times } : {}), ...(heading !== undefined && same ? { heading } : {}) };
  return [{ ...kept, ...timed, points }, ...rest];
}

/** The constraints with a keyframe; it replaces one at the same time. */
export const withPose = (control, time, joints) => [
  ...control.filter((one) => one.type !== "keyframe" || Math.abs(one.time - time) > 1e-3),
  { type: "keyframe", time, joints },
];

/** The field of a request or message. */
export const asJson = (control) => (control.length ? { version: 1, constraints: control } : null);

// Slopes at points: of the parabola through each and its neighbours.
function slopes(values, times) {
  const n = values.length,
    step = (i) => (values[i + 1] - values[i]) / (times[i + 1] - times[i]);
  if (n === 2) return [step(0), step(0)];
  const found = values.map((_, i) => {
    if (i === 0 || i === n - 1) return 0;
    const before = times[i] - times[i - 1],
      after = times[i + 1] - times[i];
    return (before * step(i) + after * step(i - 1)) / (before + after);
  });
  found[0] = 2 * step(0) - found[1];
  found[n - 1] = 2 * step(n - 2) - found[n - 2];
  return found;
}

/** The smooth curve [[x, z], ...] through points, as `motion_jax/control/paths.py` computes it. */
export function curve(points, times = null) {
  const apart = points.map((point, i) => (i ? Math.hypot(point[0] - points[i - 1][0], point[1] - points[i - 1][1]) : 1));
  if (!times) {
    const kept = points.filter((_, i) => Math.sqrt(apart[i]) > 1e-6);
    if (kept.length < points.length) return curve(kept);
    times = apart.map((_, i) => apart.slice(1, i + 1).reduce((sum, length) => sum + Math.sqrt(length), 0));
  }
  if (points.length < 2) return points;
  const axes = [0, 1].map((axis) => slopes(points.map((point) => point[axis]), times));
  const found = [];
  for (let i = 0; i + 1 < points.length; i++) {
    const length = times[i + 1] - times[i];
    for (let k = i ? 1 : 0; k <= FINE; k++) {
      const s = k / FINE;
      found.push(
        [0, 1].map((axis) => {
          const [a, b] = [points[i][axis], points[i + 1][axis]],
            [da, db] = [axes[axis][i] * length, axes[axis][i + 1] * length];
          return a + s * (da + s * (3 * (b - a) - 2 * da - db + s * (da + db - 2 * (b - a))));
        }),
      );
    }
  }
  return found;
}

export const lengthOf = (line) =>
  line.slice(1).reduce((sum, [x, z], i) => sum + Math.hypot(x - line[i][0], z - line[i][1]), 0);

/** What is drawn: {lines, points, targets, poses}. report: where the studio placed poses and targets
    that may be anywhere; points: of the path while it is being changed. */
export function drawn(control, report, fps, points = pointsOf(control)) {
  const path = pathOf(control),
    same = path?.points.length === points.length;
  const lines = control
    .filter((one) => isPath(one) && one !== path)
    .map((one) => curve(pointsOf([one]), one.times ?? null));
  if (points.length > 1) lines.push(curve(points, same ? (path.times ?? null) : null));
  const world = control.filter((one) => one.type === "effector" && (one.relative_to ?? "world") === "world");
  const targets = world.flatMap(({ times, positions }) =>
    times.map((time, i) => [Math.round(time * fps), ...positions[i]]),
  );
  const poses = control
    .filter((one) => one.type === "keyframe")
    .map(({ time, joints }) => ({ frame: Math.round(time * fps), joints }));
  return { lines, points, targets: report?.targets ?? targets, poses: report?.poses ?? poses };
}

/** A short label of a constraint; seconds: the length of the motion, for the speed along a path. */
export function named(one, seconds) {
  if (isPath(one)) {
    const length = lengthOf(curve(pointsOf([one]), one.times ?? null)),
      points = one.points.length === 1 ? "1 point" : `${one.points.length} points`;
    const speed = one.times || !seconds || one.points.length < 2 ? "" : `, ${(length / seconds).toFixed(1)} m/s`;
    return `path: ${points}, ${length.toFixed(1)} m${speed}`;
  }
  if (one.type === "keyframe") return `pose at ${one.time.toFixed(2)} s`;
  if (one.type === "effector") return `${one.joint.replace("_", " ")} at ${one.times[0].toFixed(2)} s`;
  return one.type.replace("_", " ");
}

/** The distance of a motion from its constraints, as a sentence. */
export const offText = (off, fps) => {
  const mm = (value) => value.toFixed(value < 10 ? 1 : 0);
  return off
    ? `off by ${mm(off.mean)} mm, at most ${mm(off.worst)} mm (${off.joint} at ${(off.frame / fps).toFixed(2)} s)`
    : "";
};
