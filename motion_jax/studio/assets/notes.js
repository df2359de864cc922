// Sentences for the user: what went wrong stays until it is closed, what is merely worth knowing goes by itself.

const MOST = 3,
  SHOWN = 7000; // notes at once; milliseconds

export class Notes {
  constructor(element) {
    this.element = element;
    this.errors = [];
    this.all = [];
  }

  tell(sentence, error) {
    this.all.push(sentence);
    if (error) this.errors.push(sentence);
    for (const list of [this.all, this.errors]) list.splice(0, list.length - 100);
    for (const old of this.element.children) if (old.firstChild.textContent === sentence) old.remove();
    const note = Object.assign(document.createElement("div"), { className: error ? "note error" : "note" });
    const text = Object.assign(document.createElement("span"), { textContent: sentence });
    const close = Object.assign(document.createElement("button"), { textContent: "✕", type: "button" });
    close.setAttribute("aria-label", "close");
    close.onclick = () => note.remove();
    note.append(text, close);
    this.element.append(note);
    while (this.element.children.length > MOST) this.element.firstChild.remove();
    if (!error) setTimeout(() => note.remove(), SHOWN);
  }

  /** Takes a sentence away that is true no longer. */
  forget(sentence) {
    for (const old of [...this.element.children]) if (old.firstChild.textContent === sentence) old.remove();
  }
}
