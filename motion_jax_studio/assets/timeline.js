// The timeline: a ruler to scrub, blocks of words on a track, a strip to mark frames. It draws what it is given and
// reports what the user wants; it keeps nothing but its scale and what is being dragged.
import { ask, make, makeBlock } from "./blocks.js";
import { between, panned, showing, zoomed } from "./scale.js";

export class Timeline {
  // on: {seek(s), select(id), edit(id, prompt), resize(id, s), remove(id), move(id, index), add(prompt), span(a, b),
  // explain(id): its mark was clicked, drawn()}
  constructor(element, on) {
    this.element = element;
    this.on = on;
    this.window = { start: 0, end: 12 };
    this.blocks = new Map();
    this.ruler = make("canvas", "ruler");
    this.hint = make("div", "hint", "click here and type what happens first");
    this.track = make("div", "track", this.hint);
    this.strip = make("div", "strip");
    this.marked = make("div", "marked");
    this.head = make("div", "playhead");
    this.tip = make("div", "tip");
    this.tip.hidden = true;
    this.controls = make("div", "controls");
    element.replaceChildren(this.ruler, this.track, this.controls, this.strip, this.marked, this.head, this.tip);
    element.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.drags(
      this.ruler,
      (second) => on.seek(second),
      (second) => on.seek(second),
    );
    let from = 0;
    this.drags(
      this.strip,
      (second) => {
        from = second;
      },
      (second) => on.span(from, second),
      (moved, second) => {
        if (!moved) on.span(second, second);
      },
    );
    this.drags(
      this.track,
      (_, event) => {
        from = event.clientX;
      },
      (_, event) => {
        this.pan(((from - event.clientX) / this.width) * (this.window.end - this.window.start));
        from = event.clientX;
      },
      (moved, second) => this.clicked(moved, second),
    );
    this.track.addEventListener("contextmenu", (event) => this.menu(event));
    this.track.addEventListener("dblclick", (event) => {
      const id = this.idOf(event.target);
      if (id !== null) ask(this, id);
    });
  }

  get width() {
    return this.element.clientWidth || 1;
  }

  place(second) {
    return ((second - this.window.start) / (this.window.end - this.window.start)) * this.width;
  }

  second(x) {
    return (
      this.window.start +
      ((x - this.element.getBoundingClientRect().left) / this.width) * (this.window.end - this.window.start)
    );
  }

  // A pointer that goes down on an element itself, moves and goes up.
  drags(element, down, move, up) {
    element.addEventListener("pointerdown", (event) => {
      if (event.button || (event.target !== element && event.target.parentElement !== this.strip)) return;
      element.setPointerCapture(event.pointerId);
      const start = event.clientX;
      let moved = false;
      down(Math.max(0, this.second(event.clientX)), event);
      const step = (next) => {
        moved ||= Math.abs(next.clientX - start) > 3;
        if (moved) move(Math.max(0, this.second(next.clientX)), next);
      };
      const end = (last) => {
        element.removeEventListener("pointermove", step);
        if (last.type === "pointerup") up?.(moved, Math.max(0, this.second(last.clientX)));
      };
      element.addEventListener("pointermove", step);
      element.addEventListener("pointerup", end, { once: true });
      element.addEventListener("pointercancel", end, { once: true });
    });
  }

  wheel(event) {
    event.preventDefault();
    const sideways = event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY);
    const amount = event.deltaX && sideways ? event.deltaX : event.deltaY;
    if (sideways) this.pan((amount / this.width) * (this.window.end - this.window.start));
    else this.zoom(Math.exp(Math.max(-200, Math.min(200, amount)) * 0.002), this.second(event.clientX));
  }

  zoom(factor, around = (this.window.start + this.window.end) / 2) {
    this.window = zoomed(this.window, factor, around);
    this.draw(this.shown);
  }

  pan(seconds) {
    this.window = panned(this.window, seconds);
    this.draw(this.shown);
  }

  fit() {
    this.window = { start: 0, end: Math.max(this.shown.end * 1.15, 6) };
    this.draw(this.shown);
  }

  /** Moves so that a second is seen. */
  reveal(second) {
    this.window = showing(this.window, second);
  }

  /** Opens the field for the prompt of a block; null: of a new one. */
  ask(id) {
    const row = this.shown.rows.find((one) => one.id === id);
    this.reveal(row?.start ?? this.shown.end);
    this.draw(this.shown);
    ask(this, id);
  }

  idOf(target) {
    const element = target.closest?.(".block");
    return element && !this.shown.fixed && element.dataset.id !== "import" ? Number(element.dataset.id) : null;
  }

  clicked(moved, second) {
    if (moved || this.shown.fixed) return;
    if (second >= this.shown.end - 1e-6 || !this.shown.rows.length) ask(this, null);
    else this.on.select(null);
  }

  menu(event) {
    event.preventDefault();
    const element = event.target.closest?.(".block");
    if (!element || this.shown.fixed) return;
    this.on.remove(element.dataset.id === "import" ? "import" : Number(element.dataset.id));
  }

  // shown: {rows: [{id, prompt, start, end, stale, remark: {text, nearest}}], among (of placed()), end, time, span, selected, pieces, fixed};
  // pieces: [{start, end, kind, remark}] of the strip; controls: likewise, of paths and poses; all in seconds.
  draw(shown) {
    this.shown = shown;
    this.element.classList.toggle("fixed", shown.fixed);
    this.hint.hidden = shown.fixed || shown.rows.length > 0;
    for (const [id, element] of this.blocks) {
      if (shown.rows.some((row) => row.id === id)) continue;
      element.remove();
      this.blocks.delete(id);
    }
    for (const row of shown.rows) {
      const element = this.blocks.get(row.id) ?? makeBlock(this, row.id);
      if (this.dragging === row.id) continue;
      element.firstChild.textContent = row.prompt;
      element.title = `${row.prompt} (${(row.end - row.start).toFixed(1)} s)`;
      element.className =
        `block${row.id === shown.selected ? " selected" : ""}${row.stale ? " stale" : ""}` +
        (row.id === "import" ? " import" : "");
      element.id = `block-${row.id}`;
      element.setAttribute("aria-selected", String(row.id === shown.selected));
      element.style.left = `${this.place(row.start)}px`;
      element.style.width = `${Math.max(4, this.place(row.end) - this.place(row.start) - 2)}px`;
      const mark = element.querySelector(".mark");
      mark.hidden = !row.remark;
      mark.title = row.remark?.text ?? "";
      mark.setAttribute("aria-label", mark.title);
      // Words of a block that begins left of what is seen stay in sight.
      element.firstChild.style.marginLeft = `${Math.max(0, -this.place(row.start))}px`;
    }
    this.drawStrip(shown.pieces);
    this.drawStrip(shown.controls ?? [], this.controls);
    if (shown.selected === null) this.element.removeAttribute("aria-activedescendant");
    else this.element.setAttribute("aria-activedescendant", `block-${shown.selected}`);
    this.marked.hidden = !shown.span;
    if (shown.span) {
      this.marked.style.left = `${this.place(shown.span[0])}px`;
      this.marked.style.width = `${this.place(shown.span[1]) - this.place(shown.span[0])}px`;
    }
    this.head.style.left = `${this.place(shown.time)}px`;
    this.drawRuler();
    this.on.drawn?.();
  }

  /** The words and the length of a block that is being dragged, above it; null when it is dropped. */
  showTip(words, left) {
    this.tip.hidden = words === null;
    if (words === null) return;
    this.tip.textContent = words;
    this.tip.style.left = `${Math.max(2, Math.min(left, this.width - this.tip.offsetWidth - 2))}px`;
  }

  drawStrip(pieces, strip = this.strip) {
    while (strip.children.length > pieces.length) strip.lastChild.remove();
    pieces.forEach(({ start, end, kind, remark }, i) => {
      const element = strip.children[i] ?? strip.appendChild(document.createElement("i"));
      element.className = kind;
      element.title = remark ?? "";
      element.style.left = `${this.place(start)}px`;
      element.style.width = `${Math.max(1, this.place(end) - this.place(start))}px`;
    });
  }

  drawRuler() {
    const { start, end } = this.window,
      ratio = devicePixelRatio,
      step = between(this.window, this.width);
    const style = getComputedStyle(this.element),
      soft = style.getPropertyValue("--soft");
    const key = [start, end, this.width, ratio, soft].join();
    if (key === this.drawn) return;
    this.drawn = key;
    this.ruler.width = this.width * ratio;
    this.ruler.height = 24 * ratio;
    const pen = this.ruler.getContext("2d");
    pen.scale(ratio, ratio);
    pen.fillStyle = soft;
    pen.font = "11px system-ui, sans-serif";
    for (let n = Math.floor(start / step); n * step <= end; n++) {
      const x = this.place(n * step);
      pen.fillRect(x, 14, 1, 10);
      for (let k = 1; k < 5; k++) pen.fillRect(this.place((n + k / 5) * step), 19, 1, 5);
      pen.fillText(step < 1 ? (n * step).toFixed(1) : `${n * step} s`, x + 4, 13);
    }
  }
}
