// Drawing a path: clicks on the floor add way points, drags move them, a right click or Delete removes one.
import { MOST_POINTS } from "./control.js";

const NEAR = 16, // pixels from a way point that are on it
  STILL = 5, // pixels that a click may move
  FARTHEST = 50; // metres from the camera's target

export class PathTool {
  // element: where the stage is. studio: {view(), span(), points(span), start(span), change(points, span), changed(), began(),
  // ended(span), tell}; span: of seconds that the path is for, "live" or null; start(): where the body is when it begins
  constructor(element, studio) {
    Object.assign(this, { element, studio, active: false, chosen: -1, preview: null, pressed: null });
    for (const [type, does] of [
      ["pointerdown", this.down],
      ["pointermove", this.move],
      ["pointerup", this.up],
      ["pointercancel", this.cancel],
      ["contextmenu", this.menu],
    ]) {
      element.addEventListener(type, (event) => this.active && does.call(this, event), true);
    }
  }

  /** What the path is for: it stays the same while the tool is active. */
  get span() {
    return this.active ? this.drawing : this.studio.span();
  }

  /** The points as they are seen just now. */
  get points() {
    return this.preview ?? this.studio.points(this.span);
  }

  toggle() {
    if (this.active) return this.end();
    if (!this.studio.view()) return;
    this.drawing = this.studio.span();
    this.active = true;
    this.chosen = -1;
    this.studio.view().beginDrawing(this.studio.start(this.drawing));
    this.studio.began();
    this.studio.changed();
  }

  end() {
    if (!this.active) return;
    this.cancel();
    this.active = false;
    this.chosen = -1;
    this.studio.view().drawing = false;
    this.studio.ended(this.drawing);
  }

  remove(index = this.chosen) {
    const points = this.studio.points(this.span);
    if (!(index in points)) return;
    this.chosen = Math.min(index, points.length - 2);
    this.studio.change(points.toSpliced(index, 1), this.span);
  }

  near(event) {
    const view = this.studio.view(),
      away = this.studio.points(this.span).map(([x, z]) => {
        const [left, top] = view.screenOf(x, z);
        return Math.hypot(left - event.clientX, top - event.clientY);
      });
    const index = away.indexOf(Math.min(...away));
    return away[index] <= NEAR ? index : -1;
  }

  place(event) {
    const at = this.studio.view().floorAt(event.clientX, event.clientY, FARTHEST);
    return at?.map((value) => Math.round(value * 100) / 100);
  }

  down(event) {
    if (event.target.tagName !== "CANVAS") return;
    const index = this.near(event);
    this.pressed = { x: event.clientX, y: event.clientY, index, button: event.button };
    if (index < 0) return; // the camera turns, unless it is a click
    event.stopPropagation();
    this.chosen = index;
    if (event.button === 0) this.element.setPointerCapture(event.pointerId);
    this.studio.changed();
  }

  move(event) {
    if (!this.pressed || this.pressed.index < 0 || this.pressed.button !== 0) return;
    event.stopPropagation();
    const at = this.place(event);
    if (!at || !this.dragged(event)) return;
    this.preview = this.studio.points(this.span).with(this.pressed.index, at);
    this.studio.changed();
  }

  up(event) {
    const { pressed, preview } = this;
    this.cancel();
    if (!pressed) return;
    this.pressed = pressed;
    const moved = this.dragged(event);
    this.pressed = null;
    if (preview) this.studio.change(preview, this.span);
    else if (pressed.button === 0 && pressed.index < 0 && !moved) this.add(event);
  }

  dragged(event) {
    return this.preview || Math.hypot(event.clientX - this.pressed.x, event.clientY - this.pressed.y) > STILL;
  }

  add(event) {
    const known = this.studio.points(this.span),
      start = known.length ? null : this.studio.start(this.span),
      points = start ? [start] : known, // a block's path begins where the body is then
      at = this.place(event);
    if (!at) return this.studio.tell("click on the floor, nearer to the body", true);
    if (points.length >= MOST_POINTS) return this.studio.tell(`there are ${MOST_POINTS} way points, the maximum`, true);
    this.chosen = points.length;
    this.studio.change([...points, at], this.span);
  }

  menu(event) {
    if (event.target.tagName !== "CANVAS") return;
    event.preventDefault();
    const index = this.near(event);
    if (index >= 0) this.remove(index);
  }

  cancel() {
    this.pressed = this.preview = null;
    this.studio.changed();
  }
}
