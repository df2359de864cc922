// Suggestions for a field of words: what the model can do, searched while one types, with small moving figures.
import { play, unpackFigure } from "./stick_figures.js";

const SOON = 250, // milliseconds after the last key that captions of the training are looked up
  MOST = 40; // rows

/** The rows that fit what was typed, the best first: of each word its beginning is looked for. */
export function matching(rows, typed) {
  const words = typed.toLowerCase().match(/\p{L}+/gu)?.filter((word) => !["a", "an", "the", "person"].includes(word));
  if (!words?.length) return rows;
  const score = ({ prompt, kind }) => {
    const there = `${prompt} ${kind}`.toLowerCase().match(/\p{L}+/gu);
    const stem = (word) => word.slice(0, Math.max(3, word.length - 3)); // walking finds walks
    return words.filter((word) => there.some((one) => one.startsWith(word) || one.startsWith(stem(word)))).length;
  };
  return rows
    .map((row) => [score(row), row])
    .filter(([found]) => found > 0)
    .sort((a, b) => b[0] - a[0])
    .map(([, row]) => row);
}

export class Ideas {
  // element: where the list is shown; ask(words): {fps, scale, parents, rows, captions} of the studio
  constructor(element, ask) {
    Object.assign(this, { element, ask, field: null, active: -1, head: null, stop: () => {} });
    element.addEventListener("pointerdown", (event) => event.preventDefault()); // the field keeps the focus
    element.addEventListener("click", ({ target }) => {
      const option = target.closest("[role=option]");
      if (option) this.take(option);
    });
    addEventListener("resize", () => this.close());
    document.addEventListener("pointerdown", ({ target }) => {
      if (!element.contains(target) && target !== this.field && !target.closest?.("[data-ideas]")) this.close();
    });
  }

  /** A field offers suggestions while one types; take(prompt): one was chosen. */
  attach(field, take) {
    const names = { role: "combobox", "aria-autocomplete": "list", "aria-controls": this.element.id };
    for (const [name, value] of Object.entries(names)) field.setAttribute(name, value);
    field.setAttribute("aria-expanded", "false");
    field.addEventListener("input", () => this.open(field, take));
    field.addEventListener("keydown", (event) => this.key(event, field, take), true);
    field.form?.addEventListener("submit", () => this.close());
    field.addEventListener("blur", () => this.field === field && this.close());
  }

  key(event, field, take) {
    const open = this.field === field,
      { key } = event;
    if (key === "ArrowDown" || key === "ArrowUp") {
      event.preventDefault();
      if (!open) return void this.open(field, take);
      this.mark(this.active + (key === "ArrowDown" ? 1 : -1));
    } else if (open && key === "Escape") {
      event.preventDefault();
      event.stopImmediatePropagation();
      this.close();
    } else if (open && key === "Enter") {
      const option = this.options[this.active];
      if (!option) return this.close();
      event.preventDefault();
      event.stopImmediatePropagation();
      this.take(option);
    }
  }

  async open(field, take, all = false) {
    this.field = field;
    this.taken = take;
    field.setAttribute("aria-expanded", "true");
    const typed = all ? "" : field.value;
    this.typed = typed;
    try {
      this.head ??= await (this.coming ??= this.ask("")); // keys do not send it again while it is under way
    } catch {
      this.coming = null;
      return this.close(); // the page says already that the studio does not answer
    }
    if (this.field === field && this.typed === typed) this.draw(typed, []);
    clearTimeout(this.timer);
    if (typed.trim().length > 2) this.timer = setTimeout(() => this.lookUp(field, typed), SOON);
  }

  async lookUp(field, typed) {
    const found = await this.ask(typed).catch(() => null);
    this.head ??= found;
    if (found && this.field === field && this.typed === typed) this.draw(typed, found.captions);
  }

  get options() {
    return [...this.element.querySelectorAll("[role=option]")];
  }

  draw(typed, captions) {
    if (!this.head) return;
    this.stop();
    const rows = matching(this.head.rows, typed).slice(0, MOST),
      more = [...new Set([...captions, ...this.head.captions])].filter((text) => !rows.some((row) => row.prompt === text)),
      moving = [];
    const option = (prompt, figure) => {
      const row = document.createElement("div");
      row.setAttribute("role", "option");
      row.setAttribute("aria-selected", "false");
      row.id = `idea-${(this.count = (this.count ?? 0) + 1)}`;
      row.dataset.prompt = prompt;
      if (figure) {
        const canvas = Object.assign(document.createElement("canvas"), { width: 88, height: 88 });
        canvas.setAttribute("aria-hidden", "true");
        moving.push({ canvas, points: unpackFigure(figure, this.head.scale) });
        row.append(canvas);
      }
      row.append(Object.assign(document.createElement("span"), { textContent: prompt }));
      return row;
    };
    const title = (words) => {
      const row = Object.assign(document.createElement("p"), { textContent: words });
      row.setAttribute("role", "presentation");
      return row;
    };
    const found = rows.map((row) => option(row.prompt, row.figure));
    if (more.length) found.push(title("similar sentences that the model has learned from"), ...more.map((text) => option(text)));
    if (!found.length) found.push(title("nothing similar is known to the model; other words may work"));
    this.element.replaceChildren(...found);
    const { left, top } = this.field.getBoundingClientRect();
    this.element.style.left = `${Math.max(8, Math.min(left, innerWidth - 480))}px`;
    this.element.style.bottom = `${innerHeight - top + 6}px`;
    this.element.style.maxHeight = `${Math.min(420, top - 56)}px`;
    this.element.hidden = false;
    this.element.scrollTop = 0;
    this.active = -1;
    this.stop = play(moving, this.head);
  }

  mark(index) {
    const { options } = this;
    options[this.active]?.setAttribute("aria-selected", "false");
    this.active = Math.max(-1, Math.min(index, options.length - 1));
    const option = options[this.active];
    option?.setAttribute("aria-selected", "true");
    option?.scrollIntoView({ block: "nearest" });
    if (option) this.field.setAttribute("aria-activedescendant", option.id);
    else this.field.removeAttribute("aria-activedescendant");
  }

  take(option) {
    const take = this.taken;
    this.close();
    take(option.dataset.prompt);
  }

  /** Another model may know other words. */
  forget() {
    this.head = this.coming = null;
  }

  close() {
    clearTimeout(this.timer);
    this.stop();
    this.element.hidden = true;
    this.field?.setAttribute("aria-expanded", "false");
    this.field?.removeAttribute("aria-activedescendant");
    this.field = null;
  }
}
