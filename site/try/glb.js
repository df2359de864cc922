// A motion as binary glTF: the body as a skinned mesh with one animation, metres, y up.
const FLOAT = 5126, SHORT = 5123, BYTE = 5121;

const decode = (text, Type) => new Type(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);

// body: of body.json; pose: as in bvh.js; about: {caption, license}.
export function glb(body, pose, about) {
  const parts = [], views = [], accessors = [];
  let size = 0;
  const add = (array, componentType, type, more = {}) => {
    const width = {SCALAR: 1, VEC3: 3, VEC4: 4, MAT4: 16}[type], bytes = new Uint8Array(array.buffer, array.byteOffset, array.byteLength);
    views.push({buffer: 0, byteOffset: size, byteLength: bytes.length});
    const padded = new Uint8Array(Math.ceil(bytes.length / 4) * 4);
    padded.set(bytes);
    parts.push(padded);
    size += padded.length;
    accessors.push({bufferView: views.length - 1, componentType, count: array.length / width, type, ...more});
    return accessors.length - 1;
  };
  const bounds = (array, width) => {
    const column = (i) => array.filter((_, k) => k % width === i), ends = (pick) => Array.from({length: width}, (_, i) => column(i).reduce((a, b) => pick(a, b)));
    return {min: ends(Math.min), max: ends(Math.max)};
  };
  const linear = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  const materials = body.skins.map(({group}) => ({name: group, pbrMetallicRoughness:
    {baseColorFactor: [...body.colors[group].map(linear), 1], metallicFactor: 0, roughnessFactor: 0.65}}));
  const primitives = body.skins.map((skin, i) => {
    const points = Float32Array.from(decode(skin.points, Int16Array), (value) => value / 32767 * body.reach);
    const normals = Float32Array.from(decode(skin.normals, Int8Array));
    for (let k = 0; k < normals.length; k += 3) {
      const length = Math.hypot(normals[k], normals[k + 1], normals[k + 2]) || 1;
      for (let axis = 0; axis < 3; axis++) normals[k + axis] /= length;
    }
    return {material: i, indices: add(decode(skin.triangles, Uint16Array), SHORT, 'SCALAR'), attributes: {
      POSITION: add(points, FLOAT, 'VEC3', bounds(points, 3)), NORMAL: add(normals, FLOAT, 'VEC3'),
      JOINTS_0: add(decode(skin.joints, Uint8Array), BYTE, 'VEC4'),
      WEIGHTS_0: add(decode(skin.weights, Uint8Array), BYTE, 'VEC4', {normalized: true})}};
  });
  const {names, parents, offsets, fps, roots, turns} = pose;
  const inverse = Float32Array.from(body.rest.flatMap(([x, y, z]) => [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, -x, -y, -z, 1]));
  const nodes = names.map((name, j) => {
    const children = parents.flatMap((parent, k) => (parent === j ? [k] : []));
    return {name, translation: j ? offsets[j] : body.rest[0], ...(children.length && {children})};
  });
  nodes.push({name: 'mannequin', mesh: 0, skin: 0});
  const times = Float32Array.from(roots, (_, t) => t / fps), input = add(times, FLOAT, 'SCALAR', bounds(times, 1));
  const samplers = [], channels = [];
  const channel = (node, path, values, type) => {
    samplers.push({input, output: add(Float32Array.from(values), FLOAT, type), interpolation: 'LINEAR'});
    channels.push({sampler: samplers.length - 1, target: {node, path}});
  };
  channel(0, 'translation', roots.flat(), 'VEC3');
  names.forEach((_, j) => channel(j, 'rotation', turns.flatMap((frame) => frame[j]), 'VEC4'));
  const document = {asset: {version: '2.0', generator: 'motion_jax', extras: {fps, ...about}}, scene: 0, scenes: [{nodes: [0, names.length]}],
    nodes, materials, meshes: [{name: 'mannequin', primitives}],
    skins: [{skeleton: 0, joints: names.map((_, j) => j), inverseBindMatrices: add(inverse, FLOAT, 'MAT4')}],
    animations: [{name: about.caption || 'motion', samplers, channels}], accessors, bufferViews: views, buffers: [{byteLength: size}]};
  let json = new TextEncoder().encode(JSON.stringify(document));
  const padded = new Uint8Array(Math.ceil(json.length / 4) * 4).fill(32);
  padded.set(json);
  json = padded;
  const head = (...numbers) => new Uint8Array(Uint32Array.from(numbers).buffer);
  return new Blob([head(0x46546c67, 2, 28 + json.length + size, json.length, 0x4e4f534a), json, head(size, 0x004e4942), ...parts],
    {type: 'model/gltf-binary'});
}
