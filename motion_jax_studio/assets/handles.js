// Handles on the body that is shown: dots at its joints, what of the body is below the pointer, and rotation rings.
import { HANDLES, HANDLE_OF_BONE, JOINTS, PARENTS } from "./skeleton.js";

const COLORS = { left: 0x2f8bd0, right: 0xe9703f, middle: 0x35b56a, chosen: 0xf2b632, pinned: 0x8a4fd3 };
const DOT = 0.0075, // radius, for each metre from the camera
  NEAR = 13, // pixels from a dot that are on it
  THICK = 0.085; // metres from a bone's line that are the limb
const sideOf = (handle) => handle.match(/^(left|right)_/)?.[1] ?? "middle";

export class Handles {
  constructor(view) {
    this.view = view;
    const { three } = view.parts,
      ball = new three.SphereGeometry(1, 16, 12);
    this.group = new three.Group();
    this.dots = Object.fromEntries(
      Object.keys(HANDLES).map((handle) => {
        const look = new three.MeshBasicMaterial({ depthTest: false, transparent: true, opacity: 0.9 });
        const dot = new three.Mesh(ball, look);
        dot.renderOrder = 10;
        this.group.add(dot);
        return [handle, dot];
      }),
    );
    view.world.add(this.group);
    this.group.visible = false;
    this.places = null; // Vector3 of each joint as it is drawn, in metres of the motion
    this.rings = null;
  }

  /** Shows the dots on the first body; pins: a Set; chosen: a handle or null. */
  show(visible, chosen, pins) {
    const figure = this.view.figures[0];
    this.group.visible = Boolean(visible && figure && figure.count === JOINTS.length);
    if (!this.group.visible) return void this.hideRings();
    this.places = this.drawnPlaces(figure);
    const { camera } = this.view.stage,
      { size } = this.view;
    for (const [handle, dot] of Object.entries(this.dots)) {
      const place = this.places[HANDLES[handle].joint];
      dot.position.copy(place);
      const away = camera.position.distanceTo(this.group.localToWorld(dot.position.clone()));
      dot.scale.setScalar(((handle === chosen ? 1.5 : 1) * DOT * away) / size);
      dot.material.color.set(handle === chosen ? COLORS.chosen : pins.has(handle) ? COLORS.pinned : COLORS[sideOf(handle)]);
    }
  }

  // A character's bones are elsewhere than the joints of the motion.
  drawnPlaces(figure) {
    if (!figure.skin?.places || this.view.options.sticks) return figure.places;
    const drawn = this.view.places(),
      { Vector3 } = this.view.parts.three;
    return figure.places.map((place, j) => (drawn[JOINTS[j]] ? new Vector3(...drawn[JOINTS[j]]) : place));
  }

  // [left, top, share of pixels for a metre] of a place on the page.
  onPage(place) {
    const box = this.view.stage.renderer.domElement.getBoundingClientRect(),
      { camera } = this.view.stage,
      world = place.clone().multiplyScalar(this.view.size),
      away = camera.position.distanceTo(world),
      at = world.project(camera);
    const metre = box.height / (2 * Math.tan((camera.fov * Math.PI) / 360) * away);
    return [box.left + ((at.x + 1) / 2) * box.width, box.top + ((1 - at.y) / 2) * box.height, metre * this.view.size];
  }

  /** The handle below a point of the page, by its dot or by the limb that it moves; null beside the body. */
  pick(left, top) {
    if (!this.group.visible) return null;
    this.view.stage.camera.updateMatrixWorld();
    const spots = this.places.map((place) => this.onPage(place)),
      away = (joint) => Math.hypot(spots[joint][0] - left, spots[joint][1] - top);
    const dots = Object.keys(HANDLES)
      .map((handle) => [away(HANDLES[handle].joint), handle])
      .sort((a, b) => a[0] - b[0]);
    if (dots[0][0] < NEAR) return dots[0][1];
    let best = null,
      least = 1;
    for (let joint = 1; joint < JOINTS.length; joint++) {
      const [ax, ay, metre] = spots[PARENTS[joint]],
        [bx, by] = spots[joint],
        size = (bx - ax) ** 2 + (by - ay) ** 2,
        share = size ? Math.max(0, Math.min(1, ((left - ax) * (bx - ax) + (top - ay) * (by - ay)) / size)) : 0,
        off = Math.hypot(left - ax - share * (bx - ax), top - ay - share * (by - ay)) / (THICK * metre);
      if (off < least) [least, best] = [off, HANDLE_OF_BONE[joint]];
    }
    return best;
  }

  /** The place below a point of the page, on the plane through a handle that faces the camera, in metres of the motion. */
  placeOn(origin, left, top) {
    const { camera, renderer } = this.view.stage,
      { Vector3 } = this.view.parts.three,
      box = renderer.domElement.getBoundingClientRect();
    camera.updateMatrixWorld();
    const ray = new Vector3(((left - box.left) / box.width) * 2 - 1, 1 - ((top - box.top) / box.height) * 2, 0.5)
      .unproject(camera)
      .sub(camera.position);
    const normal = camera.getWorldDirection(new Vector3()),
      through = new Vector3(...origin).multiplyScalar(this.view.size),
      far = through.sub(camera.position).dot(normal) / ray.dot(normal);
    return camera.position.clone().addScaledVector(ray, far).divideScalar(this.view.size).toArray();
  }

  /** Rotation rings at the pivot of a handle. on: {turned(quaternion), done()}. */
  showRings(handle, on) {
    const { three, TransformControls } = this.view.parts,
      { stage, world } = this.view;
    this.hideRings();
    const middle = new three.Object3D(),
      rings = new TransformControls(stage.camera, stage.renderer.domElement);
    middle.position.copy(this.places[HANDLES[handle].pivot]);
    world.add(middle);
    rings.setMode("rotate");
    rings.setSize(0.7);
    rings.attach(middle);
    rings.addEventListener("dragging-changed", ({ value }) => {
      stage.controls.enabled = !value;
      if (!value) on.done();
    });
    rings.addEventListener("objectChange", () => on.turned(middle.quaternion.toArray()));
    rings.addEventListener("change", () => {
      this.view.turned = true;
    });
    stage.scene.add(rings.getHelper());
    this.rings = { rings, middle, handle };
    this.view.turned = true;
  }

  /** Whether the pointer is on a ring, so that the body below it is not dragged. */
  get onRing() {
    return Boolean(this.rings && (this.rings.rings.axis || this.rings.rings.dragging));
  }

  hideRings() {
    if (!this.rings) return;
    const { rings, middle } = this.rings;
    this.view.stage.scene.remove(rings.getHelper());
    rings.detach();
    rings.dispose();
    middle.removeFromParent();
    this.view.stage.controls.enabled = true;
    this.view.turned = true;
    this.rings = null;
  }
}
