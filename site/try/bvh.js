// A motion as BVH text: joints turn, the root also moves; centimetres, y up, as motion_jax writes them.
const ORDER = ['Y', 'Z', 'X'];

// Angles in degrees of a unit quaternion [x, y, z, w], as R = Ry Rz Rx.
function angles([x, y, z, w]) {
  const m = (a, b) => [
    [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
    [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)]][a][b];
  return [Math.atan2(-m(2, 0), m(0, 0)), Math.asin(Math.max(-1, Math.min(1, m(1, 0)))), Math.atan2(-m(1, 2), m(1, 1))];
}

// Of equal triples, whole turns apart, the one nearest to the frame before: no jumps in between.
function nearest(now, before) {
  if (!before) return now;
  const turns = [now, [now[0] + Math.PI, Math.PI - now[1], now[2] + Math.PI]].map((triple) =>
    triple.map((angle, i) => angle + 2 * Math.PI * Math.round((before[i] - angle) / (2 * Math.PI))));
  const far = (triple) => triple.reduce((sum, angle, i) => sum + Math.abs(angle - before[i]), 0);
  return far(turns[0]) <= far(turns[1]) ? turns[0] : turns[1];
}

/** pose: {names, parents, offsets [[x, y, z]], fps, roots [[x, y, z] of a frame], turns [[[x, y, z, w] of a joint] of a frame]}. */
export function bvh({names, parents, offsets, fps, roots, turns}) {
  const number = (value) => (value + 0).toFixed(6), row = (values) => values.map(number).join(' ');
  const lines = ['HIERARCHY'], order = [];
  const write = (joint, depth) => {
    const pad = '  '.repeat(depth), children = parents.flatMap((parent, k) => (parent === joint ? [k] : []));
    const channels = [...(depth ? [] : ['Xposition', 'Yposition', 'Zposition']), ...ORDER.map((axis) => `${axis}rotation`)];
    order.push(joint);
    lines.push(`${pad}${depth ? 'JOINT' : 'ROOT'} ${names[joint]}`, `${pad}{`, `${pad}  OFFSET ${row(offsets[joint].map((v) => 100 * v))}`,
      `${pad}  CHANNELS ${channels.length} ${channels.join(' ')}`);
    children.forEach((child) => write(child, depth + 1));
    if (!children.length) lines.push(`${pad}  End Site`, `${pad}  {`, `${pad}    OFFSET 0.000000 5.000000 0.000000`, `${pad}  }`);
    lines.push(`${pad}}`);
  };
  write(0, 0);
  lines.push('MOTION', `Frames: ${roots.length}`, `Frame Time: ${(1 / fps).toFixed(8)}`);
  const before = [];
  roots.forEach((root, t) => {
    const values = order.flatMap((joint) => (before[joint] = nearest(angles(turns[t][joint]), before[joint])).map((a) => a * 180 / Math.PI));
    lines.push(row([...root.map((v) => 100 * v), ...values]));
  });
  return lines.join('\n') + '\n';
}
