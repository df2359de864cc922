// Saves the user's work in this browser (IndexedDB), so that a reload or a crash loses nothing. Each tab has its own
// record; a new tab takes over the newest one that no open tab holds.

const DATABASE = "motion_jax",
  WORK = "work",
  LARGE = "large", // stores
  VERSION = 1; // of records
const SOON = 250; // milliseconds between a change and its copy
const MOST = 8; // records; the oldest are deleted

const promised = (request) =>
  new Promise((done, failed) => {
    request.onsuccess = () => done(request.result);
    request.onerror = () => failed(request.error);
  });

// Holds a name until the page ends; false where another tab does. Browsers offer no locks to pages of other machines
// without https: there each tab has a record of its own name.
const hold = (name) =>
  new Promise((done) => {
    if (!navigator.locks) return done(true);
    navigator.locks
      .request(name, { ifAvailable: true }, (lock) => {
        done(Boolean(lock));
        return lock && new Promise(() => {});
      })
      .catch(() => done(true));
  });

const isHeld = async (name) => {
  const { held = [] } = (await navigator.locks?.query()) ?? {};
  return held.some((lock) => lock.name === name);
};

export class Autosave {
  // snapshot(): the work as plain data; large(): {key, rows}, what is large and stays the same while its key does;
  // works: whether this browser keeps it
  constructor(snapshot, large) {
    Object.assign(this, { snapshot, large, works: false, pending: false, id: null, timer: null, largeKey: null });
  }

  /** The work of this tab, or of one that has been closed: {saved (milliseconds), rows, ...snapshot}, else null. */
  async open() {
    try {
      const opening = indexedDB.open(DATABASE, 1);
      opening.onupgradeneeded = () => {
        for (const store of [WORK, LARGE]) opening.result.createObjectStore(store, { keyPath: "id" });
      };
      this.database = await promised(opening);
      const records = (await promised(this.objects(WORK).getAll())).filter((record) => record.version === VERSION);
      records.sort((a, b) => b.saved - a.saved);
      this.works = true;
      return await this.claim(records);
    } catch {
      return null; // this browser stores nothing
    }
  }

  async claim(records) {
    const own = sessionStorage.getItem("work");
    let found = records.find((record) => record.id === own);
    if (!found && !own) {
      for (const record of records) {
        if (await isHeld(`work-${record.id}`)) continue;
        found = record;
        break;
      }
    }
    // A tab that was duplicated has the name of the other one; after a reload the older page lets go in a moment.
    let free = Boolean(own) && (await hold(`work-${own}`));
    for (let i = 0; own && !free && i < 5; i++) {
      await new Promise((done) => setTimeout(done, 60));
      free = await hold(`work-${own}`);
    }
    this.id = free ? own : `${Date.now()}-${Math.random().toString(36).slice(2, 8)}`;
    if (!free) await hold(`work-${this.id}`);
    sessionStorage.setItem("work", this.id);
    for (const { id } of records.slice(MOST)) {
      if (await isHeld(`work-${id}`)) continue;
      for (const store of [WORK, LARGE]) this.objects(store, "readwrite").delete(id);
    }
    if (!found) return null;
    const { rows = [] } = (await promised(this.objects(LARGE).get(found.id))) ?? {};
    return { ...found, rows };
  }

  objects(store, mode) {
    return this.database.transaction(store, mode).objectStore(store);
  }

  put(store, record) {
    return promised(this.objects(store, "readwrite").put({ ...record, id: this.id }));
  }

  /** Schedules a save after a change. */
  changed() {
    if (!this.works) return;
    this.pending = true;
    this.timer ??= setTimeout(() => this.save(), SOON);
  }

  async save() {
    clearTimeout(this.timer);
    this.timer = null;
    if (!this.works || !this.pending) return;
    this.pending = false;
    try {
      const { key, rows } = this.large();
      if (key !== this.largeKey) await this.put(LARGE, { rows });
      this.largeKey = key;
      await this.put(WORK, { ...this.snapshot(), version: VERSION, saved: Date.now() });
    } catch {
      this.works = false; // storage is full, or the user has cleared it
    }
  }
}
