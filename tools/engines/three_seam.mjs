// Runs in node, in a folder with three: three_seam.mjs FILE.glb ... plays the first clip of each over and over.
// The largest step of any bone in the world, millimetres and degrees: in zero time at the seam, in a sixtieth of a
// second across it, and in any sixtieth of the clip.
import fs from 'fs';
import * as THREE from 'three';
import { GLTFLoader } from 'three/examples/jsm/loaders/GLTFLoader.js';

globalThis.self = globalThis;
for (const file of process.argv.slice(2)) {
  const data = fs.readFileSync(file);
  const buffer = data.buffer.slice(data.byteOffset, data.byteOffset + data.byteLength);
  const gltf = await new Promise((done, fail) => new GLTFLoader().parse(buffer, '', done, fail));
  const clip = gltf.animations[0], mixer = new THREE.AnimationMixer(gltf.scene), bones = [];
  const names = new Set(clip.tracks.map(track => track.name.split('.')[0]));
  gltf.scene.traverse(node => { if (names.has(node.name)) bones.push(node); });
  mixer.clipAction(clip).play();
  const pose = time => {
    mixer.setTime(time);
    gltf.scene.updateMatrixWorld(true);
    return bones.map(bone => [new THREE.Vector3().setFromMatrixPosition(bone.matrixWorld), bone.quaternion.clone()]);
  };
  const step = (start, end) => {
    const [before, after] = [pose(start), pose(end)];
    const most = measure => Math.max(...before.map((_, i) => measure(before[i], after[i])));
    return [1000 * most((a, b) => a[0].distanceTo(b[0])), most((a, b) => a[1].angleTo(b[1])) * 180 / Math.PI];
  };
  const frame = 1 / 60, end = clip.duration;
  const text = ([place, turn]) => `${place.toFixed(1)} mm ${turn.toFixed(1)} deg`;
  let inside = [0, 0];
  for (let time = frame; time + frame < end; time += frame) {
    inside = step(time, time + frame).map((value, i) => Math.max(value, inside[i]));
  }
  console.log(`${file} ${clip.name} ${end.toFixed(3)} s: zero time ${text(step(end - 1e-5, end + 1e-5))}, 1/60 s ` +
    `${text(step(end - frame / 2, end + frame / 2))}, inside ${text(inside)}`);
}
