// A character of the user's instead of the mannequin: a rigged .glb or .vrm, read in the page, never uploaded.
import {Color, Group, Matrix4, Quaternion, SRGBColorSpace, Vector3} from 'three';
import {clone} from 'three/examples/jsm/utils/SkeletonUtils.js';
import {heightOf} from './body.js';
import {readGlb} from './glb.js';
import {findHumanoid} from './humanoid.js';
import {Retarget, facing} from './retarget.js';

const MATT = 0.3;
const LARGEST = 4; // times that a character is enlarged, or made smaller, to the height of the body

/** A character from the bytes of a file; an Error says in a sentence why it cannot move. */
export async function readCharacter(bytes, name, words) {
  return new Character(await readGlb(bytes, name), words, name);
}

const list = (root) => {
  const found = [];
  root.traverse((object) => found.push(object));
  return found;
};

export class Character {
  constructor(file, words, name) {
    this.name = name;
    const joints = findHumanoid(file, words, name), {scene} = file;
    scene.updateMatrixWorld(true);
    const first = (joint) => new Vector3().setFromMatrixPosition(joints[joint][0].matrixWorld);
    if (joints.pelvis[0].matrixWorld.determinant() <= 0) throw new Error(`${name} is mirrored or flattened by its scale; apply the scale and export it again`);
    const {left, up} = facing(first);
    // From the file's axes to y up, looking along +z.
    this.turn = new Quaternion().setFromRotationMatrix(new Matrix4().makeBasis(left, up, left.clone().cross(up))).invert();
    this.scene = new Group().add(scene);
    this.scene.quaternion.copy(this.turn);
    this.scene.updateMatrixWorld(true);
    const all = list(this.scene), bones = [];
    for (const [joint, members] of Object.entries(joints)) {
      for (const object of members) bones.push({joint, object, number: all.indexOf(object)});
    }
    bones.sort((a, b) => a.number - b.number);  // the tree's order: parents first
    const objects = bones.map(({object}) => object);
    this.bones = bones.map(({joint, object, number}) => {
      let above = object.parent;
      while (above && !objects.includes(above)) above = above.parent;
      return {joint, number, parent: above ? objects.indexOf(above) : -1,
        place: new Vector3().setFromMatrixPosition(object.matrixWorld), turned: turnOf(object), above: turnOf(object.parent)};
    });
    this.bones.forEach((bone, i) => {
      if (i && bone.parent < 0) throw new Error(`${name} has bones in several trees (${bone.joint}); export one armature`);
    });
    const {sole, top} = extentOf(this.scene, joints);
    Object.assign(this, {sole, height: top - sole});
    const leg = first('left_hip').distanceTo(first('left_knee'));
    if (!(leg > 0) || !Number.isFinite(this.sole)) throw new Error(`${name} has bones or points in one place; export it in its rest pose`);
  }

  /** A figure like the mannequin's, for a body {names, rest}. */
  figure(body) {
    return new CharacterFigure(this, body);
  }
}

function turnOf(object) {
  const turned = new Quaternion();
  object.matrixWorld.decompose(new Vector3(), turned, new Vector3());
  return turned;
}

// {sole, top} at rest: the lowest point of the feet and the highest of the head; of the whole mesh, if none hangs on them.
function extentOf(scene, joints) {
  const below = (...names) => new Set(names.filter((joint) => joints[joint]).flatMap((joint) => list(joints[joint][0])));
  const feet = below('left_ankle', 'right_ankle'), head = below('neck', 'head'), point = new Vector3();
  let sole = Infinity, lowest = Infinity, top = -Infinity, highest = -Infinity;
  scene.traverse((mesh) => {
    if (!mesh.isSkinnedMesh) return;
    const {position, skinIndex, skinWeight} = mesh.geometry.attributes;
    if (!skinIndex || !skinWeight) return;
    for (let i = 0; i < position.count; i++) {
      const most = [0, 1, 2, 3].reduce((best, k) => (skinWeight.getComponent(i, k) > skinWeight.getComponent(i, best) ? k : best), 0);
      mesh.getVertexPosition(i, point).applyMatrix4(mesh.matrixWorld);
      lowest = Math.min(lowest, point.y);
      highest = Math.max(highest, point.y);
      const bone = mesh.skeleton.bones[skinIndex.getComponent(i, most)];
      if (feet.has(bone)) sole = Math.min(sole, point.y);
      if (head.has(bone)) top = Math.max(top, point.y);
    }
  });
  return {sole: Number.isFinite(sole) ? sole : lowest, top: Number.isFinite(top) ? top : highest};
}

class CharacterFigure {
  constructor(character, body) {
    this.character = character;
    this.stature = heightOf(body) / character.height;
    this.group = new Group();
    this.holder = clone(character.scene);
    this.group.add(this.holder);
    const all = list(this.holder);
    this.retarget = new Retarget(body.names, body.rest, character.bones.map((bone) => ({...bone})), character.sole);
    this.objects = character.bones.map(({number}) => all[number]);
    this.materials = [];
    for (const mesh of all.filter((object) => object.isMesh)) {
      const own = [mesh.material].flat().map((material) => material.clone());
      for (const material of own) {  // a metal without surroundings to reflect, such as glTF's default, is black
        if (!material.envMap && material.metalness > MATT) material.metalness = MATT;
      }
      mesh.material = Array.isArray(mesh.material) ? own : own[0];
      this.materials.push(...own.map((material) => ({material, own: material.color?.clone()})));
      mesh.frustumCulled = false;
      mesh.castShadow = mesh.receiveShadow = true;
    }
    this.tint = new Color();
  }

  // positions: a Vector3, rotations: a Quaternion in the world, of each joint of the person.
  put(positions, rotations) {
    const {retarget, objects} = this;
    retarget.solve(positions, rotations);
    this.holder.scale.setScalar(retarget.scale);
    retarget.bones.forEach(({local}, i) => objects[i].quaternion.copy(local));
    const pelvis = objects[0];
    this.holder.updateMatrixWorld(true);
    pelvis.position.copy(retarget.bones[0].at).multiplyScalar(retarget.scale);
    pelvis.parent.worldToLocal(this.group.localToWorld(pelvis.position));
  }

  /** By how much what is drawn has to be scaled, so that the character is as tall as the body. */
  get size() {
    return Math.min(LARGEST, Math.max(1 / LARGEST, this.stature / this.retarget.scale));
  }

  /** {joint: [x, y, z]} of the bones as they are drawn. */
  places() {
    this.group.updateMatrixWorld(true);
    return Object.fromEntries(this.retarget.bones.map(({joint}, i) => [joint, new Vector3().setFromMatrixPosition(this.objects[i].matrixWorld).toArray()]).reverse());
  }

  // One colour over the own ones, [r, g, b] from 0 to 1; null takes it off.
  color(rgb) {
    for (const {material, own} of this.materials) {
      if (!own) continue;
      material.color.copy(own);
      if (rgb) material.color.lerp(this.tint.setRGB(...rgb, SRGBColorSpace), 0.7);
    }
  }

  dispose() {
    for (const {material} of this.materials) material.dispose();
  }
}
