// Runs in node, in a folder with three and @pixiv/three-vrm-animation: in_three.mjs FPS OUT.json FILE.
// Where a file's joints are in each frame by three.js' loaders. y up; centimetres of .bvh become metres.
import fs from 'fs';
import path from 'path';
import * as THREE from 'three';
import { BVHLoader } from 'three/examples/jsm/loaders/BVHLoader.js';
import { FBXLoader } from 'three/examples/jsm/loaders/FBXLoader.js';
import { GLTFLoader } from 'three/examples/jsm/loaders/GLTFLoader.js';

globalThis.self = globalThis;
globalThis.window = globalThis;
const [fps, out, file] = process.argv.slice(2);
const kind = path.extname(file), data = fs.readFileSync(file);
const buffer = data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength);
let root, clip, names, nodes, scale = 1, reader = 'three.js ' + THREE.REVISION, hips = null;

if (kind === '.bvh') {
  const bvh = new BVHLoader().parse(data.toString());
  root = new THREE.Group();
  root.add(bvh.skeleton.bones[0]);
  // Tracks find joints by name, and ":" and "." have a meaning of their own in names of tracks.
  const safe = name => THREE.PropertyBinding.sanitizeNodeName(name);
  bvh.skeleton.bones.forEach(bone => { bone.name = safe(bone.name); });
  bvh.clip.tracks.forEach(track => { track.name = track.name.replace(/^(.*)\.(\w+)$/, (_, a, b) => safe(a) + '.' + b); });
  [clip, nodes, scale] = [bvh.clip, bvh.skeleton.bones.filter(bone => bone.name !== 'ENDSITE'), 0.01];
} else if (kind === '.fbx') {
  root = new FBXLoader().parse(buffer, '');
  clip = root.animations[0];
} else {
  const loader = new GLTFLoader();
  let vrm = null;
  if (kind === '.vrma') {
    vrm = await import('@pixiv/three-vrm-animation');
    loader.register(parser => new vrm.VRMAnimationLoaderPlugin(parser));
  }
  const gltf = await new Promise((done, fail) => loader.parse(buffer, '', done, fail));
  root = gltf.scene;
  clip = gltf.animations[0];
  if (vrm) {  // played on a humanoid made of the file's own nodes, as on any VRM character
    const { VRMHumanoid } = await import('@pixiv/three-vrm');
    const human = gltf.parser.json.extensions.VRMC_vrm_animation.humanoid.humanBones;
    const all = await gltf.parser.getDependencies('node');
    const bones = Object.fromEntries(Object.entries(human).map(([name, bone]) => [name, { node: all[bone.node] }]));
    hips = new VRMHumanoid(bones);
    root.add(hips.normalizedHumanBonesRoot);
    const animation = gltf.userData.vrmAnimations[0];
    const tracks = vrm.createVRMAnimationHumanoidTracks(animation, hips, '1');
    clip = new THREE.AnimationClip('clip', animation.duration,
      [...tracks.translation.values(), ...tracks.rotation.values()]);
    names = Object.keys(human);
    nodes = names.map(name => hips.getRawBoneNode(name));
    reader = 'three-vrm-animation';
  }
}
if (!nodes) {
  nodes = [];
  root.traverse(node => { if (node.isBone) nodes.push(node); });
}
names = names || nodes.map(node => node.name);
root.updateMatrixWorld(true);
const turn = node => node.getWorldQuaternion(new THREE.Quaternion());
const rest = nodes.map(node => turn(node).invert());
const mixer = new THREE.AnimationMixer(root), action = mixer.clipAction(clip);
action.setLoop(THREE.LoopOnce);
action.clampWhenFinished = true;
action.play();
const count = Math.round(clip.duration * fps) + 1, places = [], turns = [];
for (let t = 0; t < count; t++) {
  mixer.setTime(Math.min(t / fps, clip.duration - 1e-7));
  if (hips) hips.update();
  root.updateMatrixWorld(true);
  places.push(nodes.map(node => node.getWorldPosition(new THREE.Vector3()).multiplyScalar(scale).toArray()));
  turns.push(nodes.map((node, i) => { const q = turn(node).multiply(rest[i]); return [q.w, q.x, q.y, q.z]; }));
}
fs.writeFileSync(out, JSON.stringify({ names, places, turns, reader }));
