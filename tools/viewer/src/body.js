// Figures: skinned meshes whose bones are put where the joints are.
import {
  Bone, BufferAttribute, BufferGeometry, Color, Float32BufferAttribute, Group, Matrix4, MeshStandardMaterial,
  Quaternion, Skeleton, SkinnedMesh, SRGBColorSpace, Vector3,
} from 'three';
import {Marks, PALE} from './marks.js';
import {ribbon} from './ribbon.js';

const ONE = new Vector3(1, 1, 1);

function decode(text, Type) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Type(bytes.buffer);
}

// Geometries of a body description; figures of the same body share them.
function geometries(body) {
  body.geometries ??= body.skins.map((skin) => {
    const geometry = new BufferGeometry();
    const points = Float32Array.from(decode(skin.points, Int16Array), (value) => (value / 32767) * body.reach);
    geometry.setAttribute('position', new BufferAttribute(points, 3));
    geometry.setAttribute('normal', new Float32BufferAttribute(Float32Array.from(decode(skin.normals, Int8Array), (v) => v / 127), 3));
    geometry.setAttribute('skinIndex', new BufferAttribute(decode(skin.joints, Uint8Array), 4));
    geometry.setAttribute('skinWeight', new BufferAttribute(decode(skin.weights, Uint8Array), 4, true));
    geometry.setIndex(new BufferAttribute(decode(skin.triangles, Uint16Array), 1));
    return geometry;
  });
  return body.geometries;
}

/** How tall a body is at rest, metres. */
export function heightOf(body) {
  const heights = geometries(body).flatMap((geometry) => {
    geometry.computeBoundingBox();
    return [geometry.boundingBox.min.y, geometry.boundingBox.max.y];
  });
  return Math.max(...heights) - Math.min(...heights);
}

// A body that stands as it is told.
export class Figure {
  constructor(body, colors, {opacity = 1} = {}) {
    this.group = new Group();
    this.bones = body.rest.map(() => Object.assign(new Bone(), {matrixAutoUpdate: false}));
    this.group.add(...this.bones);
    this.parts = [];
    const skeleton = new Skeleton(this.bones, body.rest.map((at) => new Matrix4().makeTranslation(-at[0], -at[1], -at[2])));
    geometries(body).forEach((geometry, i) => {
      const mesh = new SkinnedMesh(geometry, new MeshStandardMaterial({
        color: new Color().setRGB(...colors[body.skins[i].group], SRGBColorSpace), roughness: 0.62, metalness: 0,
        transparent: opacity < 1, opacity, depthWrite: opacity === 1,
      }));
      mesh.bind(skeleton, new Matrix4());
      mesh.castShadow = mesh.receiveShadow = opacity === 1;
      mesh.frustumCulled = false;
      this.parts.push({mesh, material: mesh.material, own: mesh.material.color.clone()});
      this.group.add(mesh);
    });
  }

  // positions: a Vector3, rotations: a Quaternion in the world, of each joint.
  put(positions, rotations) {
    this.bones.forEach((bone, j) => {
      bone.matrix.compose(positions[j], rotations[j], ONE);
      bone.matrixWorldNeedsUpdate = true;
    });
  }

  // One colour all over, [r, g, b] from 0 to 1; null gives each part its own again.
  color(rgb) {
    for (const {material, own} of this.parts) {
      if (rgb) material.color.setRGB(...rgb, SRGBColorSpace);
      else material.color.copy(own);
    }
  }

  dispose() {
    for (const {material} of this.parts) material.dispose();
    this.parts[0]?.mesh.skeleton.dispose();
  }
}

// The figure of a clip that was written into a page, with its joints and rotations.
export class Body extends Figure {
  constructor(clip, body, colors, place) {
    super(body, colors);
    this.clip = clip;
    this.frames = clip.frames;
    this.joints = decode(clip.joints, Float32Array);
    this.turned = decode(clip.turned, Int16Array);
    this.count = clip.numJoints;
    this.group.position.set(place.x - clip.start[0], -clip.floor, place.z - clip.start[1]);
    this.positions = Array.from({length: this.count}, () => new Vector3());
    this.rotations = Array.from({length: this.count}, () => new Quaternion());
    this.next = new Quaternion();
    this.tint = null;
    const roots = Array.from({length: this.frames}, (_, t) => [this.joints[t * this.count * 3], this.joints[t * this.count * 3 + 2]]);
    this.way = ribbon(roots, clip.floor);
    this.group.add(this.way);
    if (clip.constraints) this.ask(clip.constraints, body, colors);
    this.show(0);
  }

  // The constraints are drawn where the motion is.
  ask({poses, ...parts}, body, colors) {
    const figures = poses.map((pose) => {
      const figure = new Figure(body, colors, {opacity: PALE});
      this.place(decode(pose.joints, Float32Array), decode(pose.turned, Int16Array), 0, 0, 0);
      figure.put(this.positions, this.rotations);
      return figure;
    });
    this.marks = new Marks();
    this.marks.set({...parts, figures}, {floor: this.clip.floor});
    this.group.add(this.marks.group);
  }

  // Joints and rotations at a frame that need not be a whole number.
  pose(at) {
    const t = Math.min(Math.floor(at), this.frames - 1);
    this.place(this.joints, this.turned, t, Math.min(t + 1, this.frames - 1), at - t);
  }

  // Those of J and R between the frames t and n, of which the second counts w.
  place(J, R, t, n, w) {
    for (let j = 0; j < this.count; j++) {
      const p = (t * this.count + j) * 3, q = (n * this.count + j) * 3;
      this.positions[j].set(J[p] + (J[q] - J[p]) * w, J[p + 1] + (J[q + 1] - J[p + 1]) * w, J[p + 2] + (J[q + 2] - J[p + 2]) * w);
      const r = (t * this.count + j) * 4, s = (n * this.count + j) * 4;
      this.rotations[j].set(R[r + 1], R[r + 2], R[r + 3], R[r]).normalize();
      this.next.set(R[s + 1], R[s + 2], R[s + 3], R[s]).normalize();
      this.rotations[j].slerp(this.next, w);
    }
  }

  show(at) {
    const inside = Math.max(0, Math.min(at, this.frames - 1));
    this.pose(inside);
    this.paint(Math.floor(inside));
    this.marks?.show(inside, this.clip.fps);
    this.put(this.positions, this.rotations);
  }

  // Spans of frames may have a colour of their own, such as what was made anew in an edit.
  paint(frame) {
    const span = (this.clip.tints ?? []).find(({first, past}) => first <= frame && frame < past) ?? null;
    if (span === this.tint) return;
    this.tint = span;
    this.color(span && span.color);
  }

  root(target) {
    return target.copy(this.positions[0]).add(this.group.position);
  }
}
