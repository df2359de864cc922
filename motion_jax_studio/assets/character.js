// Whose body moves: the mannequin, or a character of the user's, a .glb or .vrm. It leaves this
// browser only when a motion is exported on it, for the studio writes the file.

const STORE = "characters",
  MOST = 4, // characters that this browser keeps; the oldest are deleted
  MANNEQUIN = ""; // its name in the list

const $ = (id) => document.getElementById(id);
const promised = (request) =>
  new Promise((done, failed) => {
    request.onsuccess = () => done(request.result);
    request.onerror = () => failed(request.error);
  });

/** Whether a dropped file is a character, and not a motion or a project. */
export const isCharacter = (name) => /\.(glb|vrm)$/i.test(name);

export class Characters {
  // studio: {view, notes, laidAgain, dirty}; what is kept: {name, bytes, saved (milliseconds), shown}
  constructor(studio) {
    this.studio = studio;
    this.kept = new Map();
    this.shown = MANNEQUIN;
    $("load-character").onclick = () => $("character-file").click();
    $("character-file").onchange = ({ target }) => {
      const [file] = target.files;
      target.value = "";
      if (file) this.load(file);
    };
    $("character").onchange = () => this.show($("character").value);
  }

  /** The characters of the last visit, once the view is there. */
  async restore() {
    try {
      const opening = indexedDB.open("motion_jax_characters", 1);
      opening.onupgradeneeded = () => opening.result.createObjectStore(STORE, { keyPath: "name" });
      this.database = await promised(opening);
      const records = await promised(this.objects("readonly").getAll());
      for (const record of records.sort((a, b) => a.saved - b.saved)) this.kept.set(record.name, record);
    } catch {
      this.database = null; // this browser stores nothing
    }
    const shown = [...this.kept.values()].find((record) => record.shown);
    if (shown) await this.show(shown.name);
    this.list();
  }

  /** {name, bytes} of the character that is shown, or null for the mannequin. */
  get current() {
    return this.kept.get(this.shown) ?? null;
  }

  objects(mode) {
    return this.database.transaction(STORE, mode).objectStore(STORE);
  }

  /** Reads a file of the user's and shows it. */
  async load(file) {
    const { name } = file;
    if (await this.show(name, await file.arrayBuffer())) {
      for (const [oldest] of [...this.kept].slice(0, -MOST)) {
        this.kept.delete(oldest);
        this.database && this.objects("readwrite").delete(oldest);
      }
    }
    this.list();
  }

  /** Shows a character by its name; bytes: those of one that is not known yet. Whether that was possible. */
  async show(name, bytes = this.kept.get(name)?.bytes) {
    const { view, notes } = this.studio;
    try {
      const character = name === MANNEQUIN ? null : await view.parts.readCharacter(bytes, name, view.body.limbs);
      view.wear(character);
      notes.forget("character");
    } catch (error) {
      notes.tell(error.message, true, "character");
      this.list();
      return false;
    }
    if (name !== MANNEQUIN) {
      this.kept.delete(name); // the last one loaded comes last
      this.kept.set(name, { name, bytes, saved: Date.now() });
    }
    this.shown = name;
    this.keep();
    this.list();
    this.studio.laidAgain = this.studio.dirty = true;
    return true;
  }

  async keep() {
    if (!this.database) return;
    try {
      for (const record of this.kept.values())
        await promised(this.objects("readwrite").put({ ...record, shown: record.name === this.shown }));
    } catch {
      this.database = null; // storage is full: the characters stay until the page is closed
    }
  }

  list() {
    const options = [["mannequin", MANNEQUIN], ...[...this.kept.keys()].sort().map((name) => [name, name])];
    $("character").replaceChildren(...options.map(([text, value]) => new Option(text, value)));
    $("character").value = this.shown;
  }
}
