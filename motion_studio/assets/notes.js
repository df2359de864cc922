// Notifications. Each has a topic: a newer one on the topic replaces it, and `forget` removes it once its cause is gone.
// Errors on a topic stay until then, others disappear after some seconds.

const MOST = 3; // notes at once
const SHOWN = 7000,
  ERROR_SHOWN = 15_000; // milliseconds

export class Notes {
  constructor(element) {
    this.element = element;
    this.errors = [];
    this.all = [];
  }

  /** topic: a key such as "connection"; error: whether it reports a failure. */
  tell(sentence, error, topic = "") {
    this.all.push(sentence);
    if (error) this.errors.push(sentence);
    for (const list of [this.all, this.errors]) list.splice(0, list.length - 100);
    this.remove((note) => note.firstChild.textContent === sentence || (topic && note.dataset.topic === topic));
    const note = Object.assign(document.createElement("div"), { className: error ? "note error" : "note" });
    note.dataset.topic = topic;
    const text = Object.assign(document.createElement("span"), { textContent: sentence });
    const close = Object.assign(document.createElement("button"), { textContent: "✕", type: "button" });
    close.setAttribute("aria-label", "Close this note");
    close.onclick = () => note.remove();
    note.append(text, close);
    this.element.append(note);
    while (this.element.children.length > MOST) this.element.firstChild.remove();
    if (!error || !topic) setTimeout(() => note.remove(), error ? ERROR_SHOWN : SHOWN);
  }

  /** Removes the notes of a topic whose cause is gone. */
  forget(topic) {
    this.remove((note) => note.dataset.topic === topic);
  }

  remove(which) {
    for (const note of [...this.element.children]) if (which(note)) note.remove();
  }
}
