// Constraints of a motion as plain objects, in the form of docs/control.md. Needs no browser.

export const MOST_POINTS = 200,
  MOST_POSES = 60;
const FINE = 24; // pieces of a curve between two points

const FRAME = 0.05, // seconds: the last frame of a block, one before the next block begins
  NEAR = 1e-6;
export const WALK = 1.2; // metres a second

export const isPath = (one) => one.type === "root_path" && Array.isArray(one.points);
/** Constraints of the timeline: all but the path of the live body, `live: true`. */
export const ofTimeline = (control) => control.filter((one) => !one.live);

/** The path of a span of seconds {start, end}, such as a block's; "live": of the live body; without a span: of the whole
    timeline. Or null. */
export const pathOf = (control, span = null) =>
  control.filter(isPath).find((one) => {
    if (span === "live" || one.live) return span === "live" && one.live;
    if (!one.times || !span) return !one.times && !span;
    return one.times[0] >= span.start - NEAR && one.times.at(-1) <= span.end + NEAR;
  }) ?? null;
const onFloor = (points) => points.map((point) => [point[0], point.at(-1)]);
/** [[x, z], ...] of the path of a span. */
export const pointsOf = (control, span = null) => onFloor(pathOf(control, span)?.points ?? []);

/** The constraints with another path of a span, which takes all of it at one speed; no points remove it. Headings are
    dropped if the number of points changes. */
export function withPath(control, points, span = null) {
  const old = pathOf(control, span),
    rest = control.filter((one) => one !== old);
  if (!points.length) return rest;
  const { times, heading, ...kept } = old ?? { type: "root_path", ...(span === "live" ? { live: true } : {}) };
  const same = old && old.points.length === points.length,
    block = span && span !== "live" && points.length > 1;
  const timed = { ...(block ? { times: evenly(points, span.start, span.end - FRAME) } : {}),
    ...(heading !== undefined && same ? { heading } : {}) }; // prettier-ignore
  return [{ ...kept, ...timed, points, ...(span && span !== "live" && !block ? { times: [span.start] } : {}) }, ...rest];
}

// When each point is passed at one speed from start to end.
function evenly(points, start, end) {
  const gone = points.map((_, i) => lengthOf(curve(points.slice(0, i + 1))) + i * NEAR); // times rise, also on the spot
  return gone.map((length) => Math.round(1e4 * (start + ((end - start) * length) / gone.at(-1))) / 1e4);
}

/** The constraints after blocks have changed: what has times inside one block goes with it. before, after: rows of
    placed(). */
export function movedWith(control, before, after) {
  return control.flatMap((one) => {
    const times = one.times ?? (one.time === undefined ? null : [one.time]);
    const row = times && before.find(({ start, end }) => times[0] >= start - NEAR && times[0] < end - NEAR);
    if (!row || one.live || times.at(-1) > row.end + NEAR) return [one];
    const now = after.find(({ block }) => block.id === row.block.id);
    if (!now) return [];
    const length = row.end - row.start - FRAME,
      other = now.end - now.start - FRAME;
    const factor = isPath(one) || times.at(-1) - row.start > other ? other / length : 1; // a path takes all of its block
    const moved = times.map((time) => Math.round(1e4 * (now.start + (time - row.start) * factor)) / 1e4);
    if (moved.every((time, i) => time === times[i])) return [one];
    return [one.times ? { ...one, times: moved } : { ...one, time: moved[0] }];
  });
}

/** The constraints with a keyframe; it replaces one at the same time. */
export const withPose = (control, time, joints) => [
  ...control.filter((one) => one.type !== "keyframe" || Math.abs(one.time - time) > 1e-3),
  { type: "keyframe", time, joints },
];

/** The field of a request or message. */
export function asJson(control) {
  const constraints = control.map(({ live: _, ...one }) => one);
  return constraints.length ? { version: 1, constraints } : null;
}

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
    that may be anywhere; path: the one whose points are shown; points: while it is being changed. */
export function drawn(control, report, fps, path = control.find(isPath) ?? null, points = onFloor(path?.points ?? [])) {
  const same = path?.points.length === points.length;
  const lines = control
    .filter((one) => isPath(one) && one !== path)
    .map((one) => curve(onFloor(one.points), one.times ?? null));
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

/** {length in metres, seconds, speed} of a path; seconds: of the motion, for a path without times. */
export function paceOf(one, seconds) {
  const length = lengthOf(curve(onFloor(one.points), one.times ?? null)),
    takes = one.times ? one.times.at(-1) - one.times[0] : seconds;
  return { length, seconds: takes, speed: takes > 0 && one.points.length > 1 ? length / takes : null };
}

/** A short label of a constraint; seconds: the length of the motion, for the speed along a path. */
export function named(one, seconds) {
  if (isPath(one)) {
    const { length, speed } = paceOf(one, seconds),
      points = one.points.length === 1 ? "1 point" : `${one.points.length} points`;
    const when = one.live ? "" : one.times ? ` from ${one.times[0].toFixed(1)} s` : " of the whole timeline";
    return `path${when}: ${points}, ${length.toFixed(1)} m${speed === null ? "" : `, ${speed.toFixed(1)} m/s`}`;
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
