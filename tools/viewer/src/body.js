// One figure: capsules between joints, moved to any moment of the motion.
import {
  Color, DoubleSide, Group, LatheGeometry, Mesh, MeshBasicMaterial, MeshStandardMaterial, BufferGeometry,
  Float32BufferAttribute, Quaternion, SRGBColorSpace, Vector2, Vector3,
} from 'three';

const UP = new Vector3(0, 1, 0);

function decode(text, Type) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return new Type(bytes.buffer);
}

// The hull of two balls on the y axis, ball a (radius ra) at 0 and ball b at height `length`.
function capsule(ra, rb, length) {
  const points = [];
  const slope = Math.asin(Math.max(-1, Math.min(1, (ra - rb) / Math.max(length, 1e-4))));
  const arc = (radius, height, from, to) => {
    for (let i = 0; i <= 8; i++) {
      const angle = from + ((to - from) * i) / 8;
      points.push(new Vector2(Math.max(radius * Math.cos(angle), 1e-5), height + radius * Math.sin(angle)));
    }
  };
  arc(ra, 0, -Math.PI / 2, slope);
  arc(rb, length, slope, Math.PI / 2);
  return new LatheGeometry(points, 20);
}

export class Body {
  constructor(clip, place) {
    this.clip = clip;
    this.frames = clip.frames;
    this.joints = decode(clip.joints, Float32Array);
    this.turned = decode(clip.turned, Int16Array);
    this.count = clip.numJoints;
    this.group = new Group();
    this.group.position.set(place.x - clip.start[0], -clip.floor, place.z - clip.start[1]);
    const materials = clip.colors.map((rgb) => new MeshStandardMaterial({
      color: new Color().setRGB(...rgb, SRGBColorSpace), roughness: 0.62, metalness: 0.0,
    }));
    this.parts = clip.parts.map((part) => ({...part, from: new Vector3(...part.aOffset), to: new Vector3(...part.bOffset)}));
    this.positions = Array.from({length: this.count}, () => new Vector3());
    this.rotations = Array.from({length: this.count}, () => new Quaternion());
    this.a = new Vector3();
    this.b = new Vector3();
    this.next = new Quaternion();
    this.pose(0);
    for (const part of this.parts) {
      this.ends(part);
      part.length = this.b.sub(this.a).length();
      part.mesh = new Mesh(capsule(part.aRadius, part.bRadius, part.length), materials[part.color]);
      part.mesh.castShadow = part.mesh.receiveShadow = true;
      this.group.add(part.mesh);
    }
    this.way = this.path();
    this.group.add(this.way);
    this.show(0);
  }

  // Joints and rotations at a frame that need not be a whole number.
  pose(at) {
    const t = Math.min(Math.floor(at), this.frames - 1), n = Math.min(t + 1, this.frames - 1), w = at - t;
    for (let j = 0; j < this.count; j++) {
      const p = (t * this.count + j) * 3, q = (n * this.count + j) * 3, J = this.joints;
      this.positions[j].set(J[p] + (J[q] - J[p]) * w, J[p + 1] + (J[q + 1] - J[p + 1]) * w, J[p + 2] + (J[q + 2] - J[p + 2]) * w);
      const r = (t * this.count + j) * 4, s = (n * this.count + j) * 4, R = this.turned;
      this.rotations[j].set(R[r + 1], R[r + 2], R[r + 3], R[r]).normalize();
      this.next.set(R[s + 1], R[s + 2], R[s + 3], R[s]).normalize();
      this.rotations[j].slerp(this.next, w);
    }
  }

  ends(part) {
    const turn = this.rotations[part.frame];
    this.a.copy(part.from).applyQuaternion(turn).add(this.positions[part.a]);
    this.b.copy(part.to).applyQuaternion(turn).add(this.positions[part.b]);
  }

  show(at) {
    this.pose(Math.max(0, Math.min(at, this.frames - 1)));
    for (const part of this.parts) {
      this.ends(part);
      part.mesh.position.copy(this.a);
      this.b.sub(this.a);
      const length = this.b.length();
      if (length > 1e-6) part.mesh.quaternion.setFromUnitVectors(UP, this.b.divideScalar(length));
      part.mesh.scale.y = part.length > 1e-4 ? length / part.length : 1;
    }
  }

  root(target) {
    return target.copy(this.positions[0]).add(this.group.position);
  }

  // The root's way as a ribbon on the ground.
  path() {
    const vertices = [], index = [], last = new Vector3(Infinity, 0, 0), here = new Vector3();
    let side = null;
    for (let t = 0; t < this.frames; t++) {
      const p = t * this.count * 3;
      here.set(this.joints[p], 0, this.joints[p + 2]);
      if (here.distanceTo(last) < 0.02) continue;
      if (Number.isFinite(last.x)) {
        const ahead = here.clone().sub(last).normalize();
        side = new Vector3(ahead.z, 0, -ahead.x).multiplyScalar(0.013);
        for (const point of vertices.length ? [here] : [last, here]) {
          for (const sign of [1, -1]) vertices.push(point.x + sign * side.x, this.clip.floor + 0.004, point.z + sign * side.z);
          const n = vertices.length / 3;
          if (n >= 4) index.push(n - 4, n - 3, n - 2, n - 3, n - 1, n - 2);
        }
      }
      last.copy(here);
    }
    const geometry = new BufferGeometry();
    geometry.setAttribute('position', new Float32BufferAttribute(vertices, 3));
    geometry.setIndex(index);
    return new Mesh(geometry, new MeshBasicMaterial({color: 0xf2853f, transparent: true, opacity: 0.75, side: DoubleSide}));
  }
}
