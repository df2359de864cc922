// Notifications: one line at the bottom of the view, and a list of all of them. A note has a topic, its cause: a newer one
// on the topic replaces it, and `forget` removes it once its cause is gone. Notes without a topic belong to one step of the
// user: they end with the next one, or after some seconds.

const SHOWN = 7000,
  ERROR_SHOWN = 15_000, // milliseconds
  MOST = 100; // notes of the list
export const STEP = "step"; // the topic of notes without one

const button = (text, does, label) => {
  const made = Object.assign(document.createElement("button"), { type: "button", textContent: text, onclick: does });
  if (label) made.setAttribute("aria-label", label);
  return made;
};

export class Notes {
  // element: of the line; list: of all notes, newest first; opener: the button that shows the list
  constructor(element, list, opener) {
    Object.assign(this, { element, list, opener, current: [], errors: [], all: [] });
  }

  /** topic: a key such as "connection"; error: whether it reports a failure; action: {text, does()}, a button. */
  tell(sentence, error, topic = STEP, action = null) {
    this.all.push(sentence);
    if (error) this.errors.push(sentence);
    for (const list of [this.all, this.errors]) list.splice(0, list.length - MOST);
    const note = { sentence, error: Boolean(error), topic, action };
    this.current = [...this.current.filter((one) => one.sentence !== sentence && (topic === STEP || one.topic !== topic)), note];
    if (topic === STEP) setTimeout(() => this.drop((one) => one === note), error ? ERROR_SHOWN : SHOWN);
    const row = Object.assign(document.createElement("li"), { textContent: sentence, className: error ? "error" : "" });
    row.prepend(Object.assign(document.createElement("time"), { textContent: new Date().toLocaleTimeString() }));
    this.list.prepend(row);
    while (this.list.children.length > MOST) this.list.lastChild.remove();
    this.opener.hidden = false;
    this.draw();
  }

  /** Removes the notes of a topic whose cause is gone. */
  forget(topic) {
    this.drop((note) => note.topic === topic);
  }

  drop(which) {
    const left = this.current.filter((note) => !which(note));
    if (left.length === this.current.length) return;
    this.current = left;
    this.draw();
  }

  /** The note of the line: the last error, else the last one. */
  get shown() {
    return this.current.findLast(({ error }) => error) ?? this.current.at(-1) ?? null;
  }

  draw() {
    const note = this.shown;
    if (!note) return this.element.replaceChildren();
    const line = Object.assign(document.createElement("div"), { className: note.error ? "note error" : "note" });
    if (note.error) line.setAttribute("role", "alert");
    const text = Object.assign(document.createElement("span"), { textContent: note.sentence, title: note.sentence });
    text.onclick = () => line.classList.toggle("whole");
    line.append(text);
    if (note.action) {
      const use = () => {
        this.drop((one) => one === note);
        note.action.does();
      };
      line.append(Object.assign(button(note.action.text, use), { className: "use", title: note.action.text }));
    }
    line.append(button("✕", () => this.drop((one) => one === note), "Close this note"));
    this.element.replaceChildren(line);
  }
}
