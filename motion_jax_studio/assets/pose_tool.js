// Taking hold of the body: a press on a limb drags it, a second click shows rotation rings. What was dragged becomes a key.
import { Handles } from "./handles.js";
import { FARTHEST, dragged, rotated } from "./posing.js";
import { HANDLES, mirrored, pasted, poseOf, withLimbOf } from "./skeleton.js";
import { add, distance, sub } from "./vectors.js";

const STILL = 4; // pixels that a click may move

export class PoseTool {
  // element: where the stage is. studio: {view(), motion(), frame(), may(): whether the body can be posed now,
  // key(pose, handles, frame): a key is made of it, changed(), tell(sentence, error)}
  constructor(element, studio) {
    Object.assign(this, { element, studio, chosen: null, pins: new Set(), draft: null, drag: null, copy: null });
    for (const [type, does] of [
      ["pointerdown", this.down],
      ["pointermove", this.move],
      ["pointerup", this.up],
      ["pointercancel", this.cancel],
    ]) {
      element.addEventListener(type, (event) => does.call(this, event), true);
    }
  }

  get handles() {
    const view = this.studio.view();
    if (view && this.known?.view !== view) this.known = new Handles(view);
    return this.known ?? null;
  }

  /** The pose at the frame that is shown, as it is drawn. */
  get pose() {
    return this.draft?.pose ?? poseOf(this.studio.motion(), this.studio.frame());
  }

  /** Draws the dots; called with each picture of the timeline. */
  show() {
    const may = this.studio.may();
    if (!may) this.release();
    this.handles?.show(may, this.chosen, this.pins);
  }

  down(event) {
    if (event.button || event.target.tagName !== "CANVAS" || !this.studio.may() || this.handles.onRing) return;
    const handle = this.handles.pick(event.clientX, event.clientY);
    if (!handle) {
      this.pressed = { x: event.clientX, y: event.clientY };
      return; // the camera turns, unless it is a click
    }
    event.stopPropagation();
    event.preventDefault();
    const start = this.pose,
      origin = [...this.handles.places[HANDLES[handle].joint].toArray()];
    this.element.setPointerCapture(event.pointerId);
    this.drag = {
      handle,
      start,
      origin,
      again: handle === this.chosen,
      frame: this.studio.frame(),
      moved: false,
      x: event.clientX,
      y: event.clientY,
      from: this.handles.placeOn(origin, event.clientX, event.clientY),
    };
    if (handle !== this.chosen) this.choose(handle);
    this.studio.changed();
  }

  move(event) {
    const { drag } = this;
    if (!drag) return this.hover(event);
    event.stopPropagation();
    if (!drag.moved && Math.hypot(event.clientX - drag.x, event.clientY - drag.y) < STILL) return;
    if (!drag.moved) this.handles.hideRings();
    drag.moved = true;
    const by = sub(this.handles.placeOn(drag.origin, event.clientX, event.clientY), drag.from),
      place = add(drag.start[HANDLES[drag.handle].joint], by);
    drag.far = drag.handle === "hips" && distance(place, drag.start[0]) > FARTHEST;
    const pose = dragged(drag.start, drag.handle, place, { pins: this.pins, snap: !event.altKey });
    this.draft = { frame: drag.frame, pose };
    this.studio.changed();
  }

  up(event) {
    const { drag, draft, pressed } = this;
    this.drag = this.pressed = null;
    if (pressed && Math.hypot(event.clientX - pressed.x, event.clientY - pressed.y) < STILL) this.choose(null);
    if (!drag) return;
    event.stopPropagation();
    if (!drag.moved) {
      if (drag.again) this.turn();
    } else if (draft) {
      this.finish(drag.handle);
      if (drag.far) this.studio.tell(`the body stays within ${FARTHEST} m of where it was: use a path for longer ways`, true);
    }
    this.studio.changed();
  }

  cancel() {
    this.drag = this.draft = this.pressed = null;
    this.studio.changed();
  }

  hover(event) {
    if (event.target.tagName !== "CANVAS" || event.buttons) return;
    const handle = this.studio.may() && !this.handles.onRing && this.handles.pick(event.clientX, event.clientY);
    this.element.style.cursor = handle ? "grab" : "";
    this.element.title = handle ? HANDLES[handle].label : "";
  }

  choose(handle) {
    if (handle === this.chosen) return;
    this.chosen = handle;
    this.handles?.hideRings();
    this.studio.changed();
  }

  // Nothing is held: the motion plays, or another mode is shown.
  release() {
    this.drag = this.draft = null;
    this.known?.hideRings();
  }

  finish(handle) {
    const { pose, frame } = this.draft;
    this.draft = null;
    this.studio.key(pose, [handle, ...[...this.pins].filter((pin) => pin !== handle)], frame);
  }

  /** Rotation rings of the chosen handle. */
  turn() {
    if (!this.studio.may()) return;
    this.chosen ??= "hips";
    const handle = this.chosen,
      start = this.pose,
      frame = this.studio.frame();
    this.show();
    this.handles.showRings(handle, {
      turned: (quaternion) => {
        this.draft = { frame, pose: rotated(start, handle, quaternion, { pins: this.pins }) };
        this.studio.changed();
      },
      done: () => {
        if (!this.draft) return;
        const { pose } = this.draft;
        this.draft = null;
        this.handles.hideRings();
        this.studio.key(pose, HANDLES[handle].limb ? [handle] : null, frame);
        this.studio.changed();
      },
    });
  }

  /** Dragging again, without rings. */
  grab() {
    this.handles?.hideRings();
    this.studio.changed();
  }

  /** Pins the chosen hand or foot to its place in the world, or lets it go. */
  pin() {
    const { limb, bend } = HANDLES[this.chosen] ?? {};
    if (!limb || bend) return this.studio.tell("click a hand or a foot first, then pin it", true);
    if (!this.pins.delete(this.chosen)) this.pins.add(this.chosen);
    this.studio.changed();
  }

  // A change of the whole pose at the frame that is shown.
  make(pose, handles = null) {
    if (this.studio.may()) this.studio.key(pose, handles, this.studio.frame());
  }

  keyPose() {
    this.make(this.pose);
  }

  mirror() {
    this.make(mirrored(this.pose));
  }

  copyPose() {
    if (!this.studio.may()) return;
    this.copy = this.pose;
    this.studio.tell(`the pose of frame ${this.studio.frame()} is copied; go to another frame and paste it`, false);
  }

  pastePose() {
    if (!this.copy) return this.studio.tell("copy a pose first", true);
    this.make(pasted(this.copy, this.pose));
  }

  /** The chosen part as the motion had it before its keys. */
  reset(original) {
    if (!this.chosen) return this.studio.tell("click the part of the body to reset first", true);
    if (original) this.make(withLimbOf(this.pose, poseOf(original, this.studio.frame()), this.chosen), [this.chosen]);
  }
}
