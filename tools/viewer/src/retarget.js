// A person's joints onto the bones of a character of any rest pose and proportions.
//
// A bone turns in the world as its joint does, from its own rest: Q = R D W, with R the turn of the joint from the
// T-pose, W the bone's rest and D what brings the limb from there to the T-pose. Local rotations are never copied. The
// character is scaled until its legs are as long, its hips stand between the person's, and a two-bone solution puts
// the ankles where the person's are, raised by what its soles are thicker: feet that stand keep standing.
import {Quaternion, Vector3} from 'three';

const UP = new Vector3(0, 1, 0);
const NEXT = {hip: 'knee', knee: 'ankle', shoulder: 'elbow', elbow: 'wrist'};  // bones that D straightens
const SIDES = ['left', 'right'];
const OTHER = 0.03;  // share by which legs are longer or shorter before the character is scaled again

/** [x, y, z] directions {left, up} of a character, from the places of its bones, snapped to its axes where near. */
export function facing(place) {
  const across = (name) => place(`left_${name}`).sub(place(`right_${name}`));
  const middle = (name) => place(`left_${name}`).add(place(`right_${name}`)).multiplyScalar(0.5);
  const up = snapped(middle('shoulder').sub(middle('ankle')), 0.7);
  const left = across('hip').add(across('shoulder'));
  left.addScaledVector(up, -left.dot(up));
  return {left: snapped(left, 0.9), up};
}

function snapped(vector, near) {
  const unit = vector.clone().normalize(), all = unit.toArray();
  const i = all.map(Math.abs).indexOf(Math.max(...all.map(Math.abs)));
  return Math.abs(all[i]) < near ? unit : new Vector3().setComponent(i, Math.sign(all[i]));
}

export class Retarget {
  // names, rest: joints of the person and where they are in the T-pose; bones: [{joint, parent (an index here or -1),
  // place: Vector3, turned: Quaternion, above: Quaternion}], parents first, as they rest: y up, looking along +z;
  // above: how the node is turned that the bone hangs on. sole: height of the character's soles.
  constructor(names, rest, bones, sole) {
    Object.assign(this, {bones, scale: 0});
    const at = (name) => names.indexOf(name), places = rest.map((place) => new Vector3(...place));
    const first = (joint) => bones.findIndex((bone) => bone.joint === joint);
    const floor = Math.min(...places.map(({y}) => y));
    this.legs = SIDES.map((side) => ['hip', 'knee', 'ankle'].map((kind) => first(`${side}_${kind}`)));
    this.joints = SIDES.map((side) => ['hip', 'knee', 'ankle'].map((kind) => at(`${side}_${kind}`)));
    this.length = this.legs.reduce((sum, leg) => sum + span(leg.map((i) => bones[i].place)) / 2, 0);
    const ankle = ([,, end], all) => all(end).y;
    this.ankle = this.legs.reduce((sum, leg) => sum + ankle(leg, (i) => bones[i].place) / 2, 0) - sole;
    this.person = this.joints.reduce((sum, leg) => sum + ankle(leg, (j) => places[j]) / 2, 0) - floor;
    const straight = {};
    for (const bone of bones) {
      const [side, kind] = bone.joint.split('_');
      const child = NEXT[kind] && first(`${side}_${NEXT[kind]}`);
      const turn = new Quaternion();
      if (child >= 0 && first(bone.joint) === bones.indexOf(bone)) {
        const from = bones[child].place.clone().sub(bone.place).normalize();
        turn.setFromUnitVectors(from, places[at(`${side}_${NEXT[kind]}`)].clone().sub(places[at(bone.joint)]).normalize());
        straight[bone.joint] = turn;
      }
      if (kind === 'wrist' && straight[`${side}_elbow`]) turn.copy(straight[`${side}_elbow`]);
      bone.source = at(bone.joint);
      bone.rest = turn.multiply(bone.turned);  // D W
      const above = bones[bone.parent];
      bone.offset = above ? bone.place.clone().sub(above.place).applyQuaternion(above.turned.clone().invert()) : null;
      bone.hangs = above ? above.turned.clone().invert().multiply(bone.above) : bone.above;
      Object.assign(bone, {world: new Quaternion(), local: new Quaternion(), at: new Vector3()});
    }
    this.a = new Vector3();
    this.b = new Vector3();
    this.c = new Vector3();
    this.q = new Quaternion();
  }

  /** Sets `local` and `world` rotation and place `at` of all bones, in units of the character; `scale` makes metres. */
  solve(positions, rotations) {
    const length = this.joints.reduce((sum, leg) => sum + span(leg.map((j) => positions[j])) / 2, 0);
    if (Math.abs(length / this.length / this.scale - 1) > OTHER || !this.scale) this.scale = length / this.length;
    for (const bone of this.bones) bone.world.multiplyQuaternions(rotations[bone.source], bone.rest);
    this.bones[0].at.set(0, 0, 0);
    this.hang(1);
    const lift = this.ankle - this.person / this.scale;
    const move = this.a.set(0, lift, 0);
    this.legs.forEach(([hip], i) => {
      move.addScaledVector(positions[this.joints[i][0]], 0.5 / this.scale).addScaledVector(this.bones[hip].at, -0.5);
    });
    for (const bone of this.bones) bone.at.add(move);
    this.legs.forEach((leg, i) => {
      const target = this.b.copy(positions[this.joints[i][2]]).divideScalar(this.scale).addScaledVector(UP, lift);
      this.reach(leg.map((index) => this.bones[index]), target);
    });
    this.hang(1);
    for (const bone of this.bones) {
      const above = this.bones[bone.parent];
      this.q.copy(bone.hangs);
      if (above) this.q.premultiply(above.world);
      bone.local.copy(this.q.invert()).multiply(bone.world);
    }
  }

  // Places of bones from a number on, below their parents.
  hang(first) {
    for (const bone of this.bones.slice(first)) {
      const above = this.bones[bone.parent];
      bone.at.copy(bone.offset).applyQuaternion(above.world).add(above.at);
    }
  }

  // Turns a leg so that its ankle is at the target, the knee staying on its side of the line.
  reach([hip, knee, ankle], target) {
    const thigh = knee.at.distanceTo(hip.at), shin = ankle.at.distanceTo(knee.at);
    const line = target.sub(hip.at);
    const far = Math.min(Math.max(line.length(), Math.abs(thigh - shin) * 1.001), thigh + shin);
    line.normalize();
    const along = (thigh ** 2 - shin ** 2 + far ** 2) / (2 * far);
    const out = this.c.subVectors(knee.at, hip.at);
    out.addScaledVector(line, -out.dot(line));
    if (out.length() < 1e-6 * thigh) out.set(0, 0, 1).addScaledVector(line, -line.z);
    out.normalize();
    const bent = line.clone().multiplyScalar(along).addScaledVector(out, Math.sqrt(Math.max(0, thigh ** 2 - along ** 2)));
    const end = line.multiplyScalar(far);
    turn(hip.world, knee.at.clone().sub(hip.at), bent);
    turn(knee.world, ankle.at.clone().sub(knee.at), end.sub(bent));
  }
}

function turn(world, from, to) {
  world.premultiply(new Quaternion().setFromUnitVectors(from.normalize(), to.clone().normalize()));
}

// Length of a chain of places.
const span = (places) => places.slice(1).reduce((sum, place, i) => sum + place.distanceTo(places[i]), 0);
