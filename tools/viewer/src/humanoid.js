// Which bones of a character are the joints of ours: by the VRM extension, or by the names of legs and arms, the rest
// by the tree. words: {legs, arms}, rows of three names, from motion_jax/rigs/joint_names.py.

const SIDES = ['left', 'right'];
const LIMBS = {legs: ['hip', 'knee', 'ankle'], arms: ['shoulder', 'elbow', 'wrist']};
const VRM = {legs: ['UpperLeg', 'LowerLeg', 'Foot'], arms: ['UpperArm', 'LowerArm', 'Hand']};
const WORDS = /[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+/g;
const IS_SIDE = {left: 'left', l: 'left', right: 'right', r: 'right', c: ''};

/** [side, words] of a joint's name, as `key` of joint_names.py spells it. */
export function key(name) {
  const last = name.split(/[:|]/).at(-1).replace(/(?<![A-Za-z])([LR])(?=[A-Z][A-Za-z]*[a-z])/g, '$1 ');
  const words = (last.match(WORDS) ?? []).map((word) => (/^\d+$/.test(word) ? String(Number(word)) : word.toLowerCase()));
  const side = words.find((word) => word in IS_SIDE);
  return [IS_SIDE[side] ?? '', words.filter((word) => !(word in IS_SIDE)).join('')];
}

/** {joint: [bones]} of a character, for the joints that it has; an Error with one sentence where it is no humanoid. */
export function findHumanoid({json, nodes}, words, name) {
  const tree = new Tree(json);
  const found = vrmLimbs(json) ?? namedLimbs(json, tree, words, name);
  for (const side of SIDES) {
    for (const [kind, joints] of Object.entries(LIMBS)) {
      for (const joint of joints) {
        if (nodes[found[`${side}_${joint}`]]) continue;
        throw new Error(`${name} has no ${side} ${kind.slice(0, -1)} that is known by its bones' names (${joint}); ` +
          'name them as Mixamo, Unity, VRM, Rigify or Unreal do');
      }
    }
  }
  const at = (joint) => found[joint];
  const chest = tree.common(at('left_shoulder'), at('right_shoulder'));
  const pelvis = tree.common(tree.common(at('left_hip'), at('right_hip')), chest);
  if (pelvis === undefined) throw new Error(`${name} has legs and arms of two skeletons; export one character alone`);
  const bones = {pelvis: [pelvis]};
  const spine = tree.between(pelvis, chest);
  if (chest !== pelvis) spine.push(chest);
  spine.forEach((bone, i) => {
    (bones[`spine${Math.max(1, Math.round(((i + 1) * 3) / spine.length))}`] ??= []).push(bone);
  });
  const head = at('head') ?? named(json, tree, chest, /head/) ?? topmost(json, tree, chest);
  if (head !== undefined) Object.assign(bones, {neck: tree.between(chest, head), head: [head]});
  for (const side of SIDES) {
    for (const joint of Object.values(LIMBS).flat()) bones[`${side}_${joint}`] = [at(`${side}_${joint}`)];
    bones[`${side}_collar`] = tree.between(chest, at(`${side}_shoulder`)).slice(0, 1);
    const toes = at(`${side}_foot`) ?? named(json, tree, at(`${side}_ankle`), /toe|ball/);
    bones[`${side}_foot`] = toes === undefined ? [] : [toes];
  }
  return Object.fromEntries(Object.entries(bones).map(([joint, all]) => [joint, all.map((index) => nodes[index])]));
}

class Tree {
  constructor({nodes = []}) {
    this.parents = [];
    nodes.forEach(({children = []}, i) => children.forEach((child) => { this.parents[child] = i; }));
  }

  // A node and its parents, nearest first.
  line(node) {
    const found = [];
    for (let i = node; i !== undefined && !found.includes(i); i = this.parents[i]) found.push(i);
    return found;
  }

  common(a, b) {
    const other = new Set(this.line(b));
    return this.line(a).find((node) => other.has(node));
  }

  // The nodes between one and another below it, from above.
  between(above, below) {
    const line = this.line(below), end = line.indexOf(above);
    return end < 0 ? [] : line.slice(1, end).reverse();
  }
}

// {joint: node} of the VRM extension, 1.0 or 0.x; null without one.
function vrmLimbs({extensions = {}}) {
  const one = extensions.VRMC_vrm?.humanoid?.humanBones, zero = extensions.VRM?.humanoid?.humanBones;
  if (!one && !zero) return null;
  const of = one ? Object.fromEntries(Object.entries(one).map(([bone, {node}]) => [bone, node]))
    : Object.fromEntries(zero.map(({bone, node}) => [bone, node]));
  const found = {head: of.head};
  for (const side of SIDES) {
    found[`${side}_foot`] = of[`${side}Toes`];
    for (const [kind, joints] of Object.entries(LIMBS)) joints.forEach((joint, i) => { found[`${side}_${joint}`] = of[side + VRM[kind][i]]; });
  }
  return found;
}

// {joint: node} of legs and arms whose names fit a row, what surrounds its words being the same in all three.
function namedLimbs(json, tree, words, name) {
  const members = [...new Set(json.skins.flatMap(({joints}) => joints))], found = {};
  for (const side of SIDES) {
    const keys = new Map();
    for (const node of members) {
      const [where, word] = key(json.nodes[node].name ?? '');
      if (where === side) keys.set(word, [...(keys.get(word) ?? []), node]);
    }
    for (const [kind, joints] of Object.entries(LIMBS)) {
      const all = rows(keys, words[kind], tree);
      if (kind === 'legs' && new Set(all.map(([hip]) => tree.line(hip).slice(1).at(0))).size > 1) {
        throw new Error(`${name} has two humanoids; export one character alone`);
      }
      joints.forEach((joint, i) => { found[`${side}_${joint}`] = all[0]?.[i]; });
    }
  }
  return found;
}

// Chains [first, second, third], those with the least around their words first.
function rows(keys, table, tree) {
  const found = [];
  for (const row of table) {
    const words = row.split(' ');
    for (const [key, firsts] of keys) {
      const at = key.lastIndexOf(words[0]);
      if (at < 0) continue;
      const before = key.slice(0, at), after = key.slice(at + words[0].length);
      const [seconds = [], thirds = []] = words.slice(1).map((word) => keys.get(before + word + after));
      for (const first of firsts) {
        const second = seconds.find((node) => tree.line(node).includes(first));
        if (second === undefined) continue;
        const third = thirds.find((node) => tree.line(node).includes(second)), end = third ?? tree.parents.indexOf(second);
        if (end >= 0) found.push({chain: [first, second, end], around: before.length + after.length + (third === undefined ? 1000 : 0)});
      }
    }
  }
  return found.sort((a, b) => a.around - b.around).map(({chain}) => chain);
}

// The node below another whose name has a word, the nearest one.
function named(json, tree, above, word) {
  const fits = json.nodes.map((node, i) => [tree.line(i).indexOf(above), i, key(node.name ?? '')[1]])
    .filter(([steps, , name]) => steps > 0 && word.test(name));
  return fits.sort((a, b) => a[0] - b[0] || a[2].length - b[2].length)[0]?.[1];
}

// The end of the chain without a side above the chest: a head that is not called one.
function topmost(json, tree, chest) {
  const next = (node) => (json.nodes[node].children ?? []).find((child) => json.skins.some(({joints}) => joints.includes(child)) &&
    !key(json.nodes[child].name ?? '')[0]);
  let top = next(chest);
  while (top !== undefined && next(top) !== undefined) top = next(top);
  return top;
}
