// The tracks of keys below the blocks: a row for each part of the body. Keys are selected by clicks and boxes, and moved by
// dragging; the borders of a regenerated span are dragged too. It draws what it is given and reports what the user wants.
import { make } from "./blocks.js";
import { TRACKS, labelOf } from "./pose_keys.js";

const ROW = 14, // pixels
  STILL = 3;

export class KeyTracks {
  // timeline: of timeline.js. on: {select(ids, more), move(ids, frames), remove(ids),
  // span(index, number, [first, past]), stretch(id, [first, last]), seek(second)}
  constructor(timeline, on) {
    Object.assign(this, { timeline, on, shown: null, dragging: null });
    this.element = make("div", "tracks");
    this.element.setAttribute("role", "group");
    this.element.setAttribute("aria-label", "keys of the body's parts");
    this.inner = make("div", "rows");
    this.inner.style.height = `${TRACKS.length * ROW}px`;
    TRACKS.forEach((track, i) => {
      const row = make("div", "row-of-keys", make("span", "label", labelOf(track)));
      Object.assign(row.style, { top: `${i * ROW}px`, height: `${ROW}px` });
      this.inner.append(row);
    });
    this.stands = make("div", "spans"); // of feet in the motion
    this.spans = make("div", "spans");
    this.dots = make("div", "dots");
    this.box = make("div", "box");
    this.box.hidden = true;
    this.inner.append(this.stands, this.spans, this.dots, this.box);
    this.element.append(this.inner);
    timeline.element.insertBefore(this.element, timeline.marked);
    this.element.addEventListener("pointerdown", (event) => this.down(event));
    this.element.addEventListener("contextmenu", (event) => {
      event.preventDefault();
      if (event.target.dataset.key) on.remove([event.target.dataset.key]);
    });
  }

  // shown: {keys (of keysOf), edits: [{index, change}], fps, frames, prints (of footprints), selected: Set of ids}
  draw(shown) {
    this.shown = shown;
    if (!shown) return;
    const { timeline } = this,
      { keys, edits, fps, selected, prints } = shown,
      x = (frame) => timeline.place(frame / fps);
    const spans = edits.flatMap(({ index, change }) => change.map((span, number) => ({ index, number, span })));
    this.fit(this.spans, spans.length, () => make("i", "span-of-keys", make("b", "left"), make("b", "right")));
    spans.forEach(({ index, number, span }, i) => {
      const element = this.spans.children[i],
        [first, past] = this.dragging?.key === `${index} ${number}` ? this.dragging.change : span;
      Object.assign(element.style, { left: `${x(first)}px`, width: `${Math.max(2, x(past) - x(first))}px` });
      element.title = `frames ${first} to ${past - 1} are regenerated through these keys; drag a border`;
      for (const border of element.children) Object.assign(border.dataset, { index, number });
    });
    this.fit(this.stands, prints.length, () => make("i", "stand"));
    prints.forEach(({ first, past, left }, i) => {
      Object.assign(this.stands.children[i].style, {
        left: `${x(first)}px`,
        width: `${Math.max(2, x(past) - x(first))}px`,
        top: `${TRACKS.indexOf(left ? "left_foot" : "right_foot") * ROW + 5}px`,
      });
    });
    this.fit(this.dots, keys.length, () =>
      Object.assign(make("button", "key", make("i", "slack"), make("i", "until")), { type: "button", tabIndex: -1 }),
    );
    keys.forEach((key, i) => {
      const element = this.dots.children[i],
        by = selected.has(key.id) ? (this.dragging?.by ?? 0) : 0,
        wide = x(key.frame + key.slack) - x(key.frame - key.slack);
      element.dataset.key = key.id;
      element.className = `key${selected.has(key.id) ? " selected" : ""}`;
      element.setAttribute("aria-pressed", String(selected.has(key.id)));
      const until = this.dragging?.stretched === key.id ? this.dragging.until : key.until;
      const words =
        `${labelOf(key.track)} at frame ${key.frame + by}` +
        (until > key.frame ? ` to ${until + by}` : "") +
        (key.slack ? `, ${key.slack} frames of slack` : "") +
        (key.strength < 1 ? `, strength ${Math.round(100 * key.strength)} %` : "");
      element.title = words;
      element.setAttribute("aria-label", words);
      Object.assign(element.style, {
        left: `${x(key.frame + by)}px`,
        top: `${TRACKS.indexOf(key.track) * ROW + 2}px`,
        opacity: String(0.35 + 0.65 * key.strength),
      });
      element.firstChild.hidden = !key.slack;
      element.lastChild.hidden = until === key.frame;
      element.lastChild.style.width = `${x(until) - x(key.frame)}px`;
      element.lastChild.dataset.stretch = key.id;
      Object.assign(element.firstChild.style, { width: `${wide}px`, left: `${5 - wide / 2}px` });
    });
  }

  fit(parent, count, create) {
    while (parent.children.length > count) parent.lastChild.remove();
    while (parent.children.length < count) parent.append(create());
  }

  frameAt(clientX) {
    return Math.round(this.timeline.second(clientX) * this.shown.fps);
  }

  follow(event, step, end) {
    this.element.setPointerCapture(event.pointerId);
    const stop = (last) => {
      this.element.removeEventListener("pointermove", step);
      end(last.type === "pointerup" ? last : null);
      this.dragging = null;
      this.draw(this.shown);
    };
    this.element.addEventListener("pointermove", step);
    this.element.addEventListener("pointerup", stop, { once: true });
    this.element.addEventListener("pointercancel", stop, { once: true });
  }

  down(event) {
    if (event.button || !this.shown) return;
    const { index, number, key, stretch } = event.target.dataset;
    if (stretch) this.dragEnd(event, stretch);
    else if (index !== undefined) this.dragBorder(event, Number(index), Number(number), event.target.className);
    else if (key) this.dragKeys(event, key);
    else this.dragBox(event);
  }

  dragBorder(event, index, number, side) {
    const { edits, frames } = this.shown,
      span = edits.find((edit) => edit.index === index).change[number];
    this.dragging = { key: `${index} ${number}`, change: span };
    const step = (next) => {
      const frame = Math.max(0, Math.min(frames, this.frameAt(next.clientX)));
      this.dragging.change = side === "left" ? [Math.min(frame, span[1] - 1), span[1]] : [span[0], Math.max(frame, span[0] + 1)];
      this.draw(this.shown);
    };
    this.follow(event, step, (last) => {
      const { change } = this.dragging;
      if (last && change.some((frame, i) => frame !== span[i])) this.on.span(index, number, change);
    });
  }

  dragEnd(event, id) {
    const key = this.shown.keys.find((one) => one.id === id);
    this.on.select([id], false);
    const step = (next) => {
      const until = Math.max(key.frame + 1, Math.min(this.shown.frames - 1, this.frameAt(next.clientX)));
      this.dragging = { stretched: id, until };
      this.draw(this.shown);
    };
    this.follow(event, step, (last) => {
      if (last && this.dragging && this.dragging.until !== key.until) this.on.stretch(id, [key.frame, this.dragging.until]);
    });
  }

  dragKeys(event, key) {
    const more = event.shiftKey || event.ctrlKey || event.metaKey,
      from = event.clientX;
    if (!this.shown.selected.has(key) || more) this.on.select([key], more);
    const begin = this.frameAt(from);
    const step = (next) => {
      if (Math.abs(next.clientX - from) < STILL && !this.dragging) return;
      this.dragging = { by: this.frameAt(next.clientX) - begin };
      this.draw(this.shown);
    };
    this.follow(event, step, (last) => {
      if (last && this.dragging?.by) this.on.move([...this.shown.selected], this.dragging.by);
      else if (last && !this.dragging && !more) this.on.select([key], false, true);
    });
  }

  dragBox(event) {
    const rect = this.inner.getBoundingClientRect(),
      from = [event.clientX - rect.left, event.clientY - rect.top];
    let to = from;
    const step = (next) => {
      to = [next.clientX - rect.left, next.clientY - rect.top];
      const [left, right] = [from[0], to[0]].sort((a, b) => a - b),
        [top, bottom] = [from[1], to[1]].sort((a, b) => a - b);
      Object.assign(this.box.style, {
        left: `${left}px`,
        top: `${top}px`,
        width: `${right - left}px`,
        height: `${bottom - top}px`,
      });
      this.box.hidden = false;
    };
    this.follow(event, step, (last) => {
      this.box.hidden = true;
      if (!last) return;
      const [left, right] = [from[0], to[0]].sort((a, b) => a - b),
        [top, bottom] = [from[1], to[1]].sort((a, b) => a - b);
      const inside = this.shown.keys.filter((key) => {
        const x = this.timeline.place(key.frame / this.shown.fps),
          y = (TRACKS.indexOf(key.track) + 0.5) * ROW;
        return left <= x && x <= right && top - ROW / 2 <= y && y <= bottom + ROW / 2;
      });
      this.on.select(to === from ? [] : inside.map((key) => key.id), last.shiftKey);
      if (to === from) this.on.seek(this.timeline.second(last.clientX));
    });
  }
}
