// The constraints of a motion: its path and way points on the floor, marks where hands and feet are to be, pale
// bodies in poses. All of it stands in one group.
import {CircleGeometry, Group, Mesh, MeshBasicMaterial, MeshStandardMaterial, SphereGeometry} from 'three';
import {ribbon} from './ribbon.js';

const GREEN = 0x1f9d5c, CHOSEN = 0xf2b632, RED = 0xe0246a;
const MOST_POINTS = 400;
const FULL = 0.95, FAINT = 0.12, FADES = 0.7;  // how opaque a target is before and long after its time, seconds between
export const PALE = 0.32;  // how opaque the body of a pose is

export class Marks {
  constructor() {
    this.group = new Group();
    this.disc = new CircleGeometry(0.075, 24).rotateX(-Math.PI / 2);
    this.ball = new SphereGeometry(0.05, 20, 14);
    this.own = [];
    this.targets = [];
    this.points = [];
  }

  // lines: ways [[x, z], ...] on the floor; points: [[x, z], ...], of which number `chosen` is marked; targets:
  // [[frame, x, y, z], ...]; figures: bodies that stand as they are to stand.
  set({lines = [], points = [], targets = [], figures = []}, {floor = 0, chosen = -1} = {}) {
    this.clear();
    for (const line of lines) this.add(ribbon(line, floor + 0.002, {color: GREEN, width: 0.045, opacity: 0.85}));
    this.points = points.slice(0, MOST_POINTS).map(([x, z], i) => {
      const look = {color: i === chosen ? CHOSEN : GREEN, transparent: true, depthWrite: false};
      const disc = this.add(new Mesh(this.disc, new MeshBasicMaterial(look)));
      disc.position.set(x, floor + 0.009, z);
      if (i === chosen) disc.scale.setScalar(1.35);
      return disc;
    });
    this.targets = targets.map(([frame, x, y, z]) => {
      const ball = this.add(new Mesh(this.ball, new MeshStandardMaterial({color: RED, roughness: 0.5, transparent: true})));
      ball.position.set(x, y, z);
      ball.castShadow = true;
      return {frame, ball};
    });
    for (const figure of figures) this.group.add(figure.group);
    this.figures = figures;
  }

  add(mesh) {
    this.own.push(mesh);
    this.group.add(mesh);
    return mesh;
  }

  clear() {
    for (const mesh of this.own) {
      if (mesh.geometry !== this.disc && mesh.geometry !== this.ball) mesh.geometry.dispose();
      mesh.material.dispose();
    }
    for (const figure of this.figures ?? []) figure.dispose();
    this.own = [];
    this.group.clear();
  }

  // Targets are seen until their time, and fade then.
  show(frame, fps) {
    for (const target of this.targets) {
      const gone = Math.max(0, frame - target.frame) / fps / FADES;
      target.ball.material.opacity = Math.max(FAINT, FULL - gone * (FULL - FAINT));
      target.ball.castShadow = gone < 1;
    }
  }
}
