// Vectors [x, y, z] and rotations about an axis. Needs no browser.

export const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const length = (a) => Math.hypot(a[0], a[1], a[2]);
export const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1], a[2] - b[2]);
export const mix = (a, b, share) => [a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share];
export const isFinite3 = (a) => a.every(Number.isFinite);
export const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
export const smooth = (share) => share * share * (3 - 2 * share);

/** A vector of length 1; `otherwise` for one without a direction. */
export function unit(a, otherwise = [0, 1, 0]) {
  const size = length(a);
  return size > 1e-9 ? scale(a, 1 / size) : otherwise;
}

/** The part of a vector that is perpendicular to a unit vector. */
export const perpendicular = (a, axis) => sub(a, scale(axis, dot(a, axis)));

/** A vector turned by an angle about a unit axis. */
export function turned(a, axis, angle) {
  const c = Math.cos(angle),
    s = Math.sin(angle);
  return add(add(scale(a, c), scale(cross(axis, a), s)), scale(axis, dot(axis, a) * (1 - c)));
}

/** {axis, angle} of the smallest rotation from one direction to another. */
export function rotationBetween(from, to) {
  const a = unit(from),
    b = unit(to),
    normal = cross(a, b),
    sine = length(normal),
    angle = Math.atan2(sine, dot(a, b));
  if (sine > 1e-9) return { axis: scale(normal, 1 / sine), angle };
  return { axis: unit(perpendicular(Math.abs(a[0]) < 0.9 ? [1, 0, 0] : [0, 0, 1], a)), angle };
}

/** {axis, angle} of a quaternion [x, y, z, w]. */
export function fromQuaternion([x, y, z, w]) {
  const size = Math.hypot(x, y, z);
  return { axis: unit([x, y, z]), angle: 2 * Math.atan2(size, w) };
}
