// How each joint of a body is turned, from where its joints are: a T-pose body follows them, one frame at a time.
import {Matrix4, Quaternion, Vector3} from 'three';

// Axis of elbows and knees in the T-pose.
const HINGES = {left_shoulder: [0, -1, 0], right_shoulder: [0, 1, 0], left_hip: [1, 0, 0], right_hip: [1, 0, 0]};
// Where the bones below them point in an easy pose, from which the turn to anywhere else is never ambiguous.
const EASY = {
  left_shoulder: [0.45, -0.55, 0.7], right_shoulder: [-0.45, -0.55, 0.7],
  left_hip: [0.1, -0.85, 0.5], right_hip: [-0.1, -0.85, 0.5],
};
const UNSURE = 0.08;  // what a bend is weighed against: a limb that hardly bends hardly says where its hinge is

export class Turns {
  // names, parents: of the joints; rest: where they are in the T-pose, [[x, y, z], ...].
  constructor(names, parents, rest) {
    const at = (name) => names.indexOf(name);
    this.parents = parents;
    this.rest = rest.map((place) => new Vector3(...place));
    this.children = names.map((_, j) => parents.flatMap((parent, k) => (parent === j ? [k] : [])));
    this.pelvis = [0, at('left_hip'), at('right_hip'), at('spine1')];
    this.chest = [at('spine3'), at('left_shoulder'), at('right_shoulder'), at('neck')];
    this.hinges = names.map((name) => HINGES[name] && new Vector3(...HINGES[name]));
    this.easy = names.map((name, j) => EASY[name] && new Quaternion().setFromUnitVectors(
      this.rest[this.children[j][0]].clone().sub(this.rest[j]).normalize(), new Vector3(...EASY[name]).normalize()));
    this.order = [0];
    for (const joint of this.order) this.order.push(...this.children[joint]);
    this.spine = new Map([[at('spine1'), 1 / 3], [at('spine2'), 1 / 2]]);
    this.a = new Vector3();
    this.b = new Vector3();
    this.c = new Vector3();
    this.q = new Quaternion();
  }

  // A frame whose x goes from the right to the left and whose y goes up, as a rotation.
  frame([origin, left, right, top], places, target) {
    const x = this.a.subVectors(places[left], places[right]).normalize();
    const y = this.b.subVectors(places[top], places[origin]);
    y.addScaledVector(x, -y.dot(x)).normalize();
    return target.setFromRotationMatrix(new Matrix4().makeBasis(x, y, this.c.crossVectors(x, y)));
  }

  whole(part, positions, target) {
    this.frame(part, this.rest, this.q).invert();
    return this.frame(part, positions, target).multiply(this.q);
  }

  // positions: a Vector3 of each joint; rotations: a Quaternion of each, which are set.
  set(positions, rotations) {
    this.whole(this.pelvis, positions, rotations[0]);
    this.whole(this.chest, positions, rotations[this.chest[0]]);
    for (const joint of this.order) {
      if (joint === 0 || joint === this.chest[0]) continue;
      const turned = rotations[joint].copy(rotations[this.parents[joint]]), child = this.children[joint][0];
      if (child === undefined) continue;
      if (this.spine.has(joint)) turned.slerp(rotations[this.chest[0]], this.spine.get(joint));
      if (this.easy[joint]) turned.multiply(this.easy[joint]);
      this.swing(turned, joint, child, positions);
      if (this.hinges[joint]) this.twist(turned, joint, child, positions);
    }
  }

  // The least turn that makes the bone point to where the child is.
  swing(turned, joint, child, positions) {
    const from = this.a.subVectors(this.rest[child], this.rest[joint]).normalize().applyQuaternion(turned);
    const to = this.b.subVectors(positions[child], positions[joint]).normalize();
    turned.premultiply(this.q.setFromUnitVectors(from, to));
  }

  // Turns an upper limb about itself so that the lower one bends like a hinge; hardly, where it is nearly straight.
  twist(turned, joint, child, positions) {
    const end = this.children[child][0];
    const bone = this.a.subVectors(positions[child], positions[joint]).normalize();
    const axis = this.b.subVectors(positions[end], positions[child]).normalize();
    axis.crossVectors(bone, axis.clone());
    const own = this.c.copy(this.hinges[joint]).applyQuaternion(turned), sine = axis.length();
    const angle = Math.atan2(bone.dot(own.clone().cross(axis)) * sine, own.dot(axis) * sine + UNSURE);
    turned.premultiply(this.q.setFromAxisAngle(bone, angle));
  }
}
