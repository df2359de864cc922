// Motions that were made of a project, and how they are asked for. What has been made is kept, so that undo shows it
// at once. Of the browser it needs nothing.
import { offSaid, asJson } from "./control.js";
import { contacts, footprints, fromJson, seconds } from "./motion.js";
import { keyOf } from "./state.js";
import { workSaid } from "./words.js";

const KEPT = 24, // motions
  MISSED = 10; // millimetres that are told

/** A motion with what is shown of it. */
export function withSteps(motion) {
  motion.stands ??= contacts(motion);
  motion.prints ??= footprints(motion, motion.stands);
  return motion;
}

// Spans of frames, joined where they meet.
export function joined(spans) {
  const found = [];
  for (const [first, past] of [...spans].sort((a, b) => a[0] - b[0])) {
    if (found.length && first <= found.at(-1)[1]) found.at(-1)[1] = Math.max(found.at(-1)[1], past);
    else found.push([first, past]);
  }
  return found;
}

export class Story {
  // api: {story, edit}; tell(sentence, isError, topic) and forget(topic): notes; changed(): something that is shown has
  // changed; state(): that of state.js; act(action).
  constructor(api, { tell, forget, changed, state, act }) {
    Object.assign(this, { api, tell, forget, changed, state, act });
    this.made = new Map();
    this.last = null; // what is shown while nothing newer is there
    this.busy = null; // what is being made, as a sentence
    this.reply = null; // {reused_frames, same_frames} of the last story
    this.again = false;
  }

  /** The motion of a take as the project is, or null while it has not been made. */
  of(take, project = this.state().project) {
    return this.made.get(keyOf(project, take)) ?? null;
  }

  /** The motion that is shown: that of the chosen take, else the one before; none of an empty timeline. */
  get shown() {
    const motion = this.of(this.state().project.chosen);
    if (this.isEmpty) return null;
    if (motion) this.last = motion;
    return motion ?? this.last;
  }

  get isEmpty() {
    const { blocks, past } = this.state().project;
    return !blocks.length && !past;
  }

  get stale() {
    return !this.of(this.state().project.chosen);
  }

  keep(key, motion) {
    this.made.delete(key);
    this.made.set(key, withSteps(motion));
    while (this.made.size > KEPT) this.made.delete(this.made.keys().next().value);
    return motion;
  }

  /** Makes what the timeline says, of these takes; what is asked meanwhile is made behind it. */
  async make(takes = [this.state().project.chosen]) {
    if (this.busy) {
      this.again = true;
      return;
    }
    do {
      this.again = false;
      for (const take of takes) {
        try {
          await this.makeTake(take);
          this.forget("make");
        } catch (error) {
          this.tell(error.message, true, error.topic ?? "make");
          this.again = false;
        } finally {
          this.busy = null;
          this.changed();
        }
      }
      takes = [this.state().project.chosen];
    } while (this.again && this.stale && !this.isEmpty);
  }

  async makeTake(take) {
    const { project } = this.state();
    if (!(take in project.seeds) || this.of(take, project)) return;
    let edits = project.edits.filter((edit) => edit.take === take);
    const upTo = (n) => ({ ...project, edits: edits.slice(0, n) });
    let n = edits.length,
      motion = null;
    while (n >= 0 && !(motion = this.of(take, upTo(n)))) n -= 1;
    if (!motion) {
      n = 0;
      motion = this.keep(keyOf(upTo(0), take), await this.base(project, take));
    }
    const left = edits.slice(n).filter((edit) => edit.change.at(-1)[1] > motion.frames);
    if (left.length) {
      this.tell("an edit lies beyond the end of the motion and was taken away; Ctrl-Z brings it back", false);
      this.act({ type: "dropEdits", take, keep: (edit) => !left.includes(edit) });
      edits = edits.filter((edit) => !left.includes(edit));
    }
    for (; n < edits.length; n++) {
      motion = this.keep(keyOf(upTo(n + 1), take), await this.edited(motion, edits[n], edits.slice(0, n)));
    }
    if (take === this.state().project.chosen) this.last = motion;
  }

  async base(project, take) {
    if (!project.blocks.length) {
      if (project.past) return fromJson(project.past);
      throw new Error("the timeline is empty: click on it and say what happens");
    }
    this.works(project.seeds.length > 1 ? `making take ${take + 1}` : "making the motion");
    const request = {
      blocks: project.blocks.map(({ prompt, seconds: length }) => ({ prompt, seconds: length })),
      seed: project.seeds[take],
      cleanup: project.cleanup,
      sampling: project.sampling,
      past: project.past,
    };
    if (project.model.name) request.model = project.model.name;
    if (project.control.length) request.control = asJson(project.control);
    const reply = await this.api.story(request, (work) => this.works(workSaid(work)));
    this.reply = { reused_frames: reply.reused_frames, same_frames: reply.same_frames };
    this.noted(reply);
    const motion = fromJson(reply.motion);
    motion.asked = reply.asked ?? null;
    const off = motion.asked?.off;
    if (off?.worst > MISSED && project.cleanup)
      this.tell(`path and poses cannot all be met: ${offSaid(off, motion.fps)}`, false, "control");
    else this.forget("control");
    return motion;
  }

  async edited(motion, edit, before) {
    this.works("making the marked span");
    const { prompt, change, seed, sampling, model } = edit;
    const request = { motion: motion.sent, prompt, change, seed, sampling };
    if (model.name) request.model = model.name;
    const reply = await this.api.edit(request, (work) => this.works(workSaid(work)));
    this.noted(reply);
    const made = joined([...(before.length ? (motion.meta.made ?? []) : []), ...reply.made]);
    reply.motion.meta = { ...reply.motion.meta, made };
    return Object.assign(fromJson(reply.motion), {
      asked: motion.asked && { ...motion.asked, off: null }, // how far this one is from it is not known
    });
  }

  // What runs, as a sentence.
  works(sentence) {
    this.busy = sentence;
    this.changed();
  }

  // What the studio says of a motion: words that the model does not know, requirements that it does not meet.
  noted({ unknown = [], notes = [] }) {
    const said = [...(unknown.length ? [`the model has not learned: ${unknown.join(", ")}`] : []), ...notes];
    if (said.length) this.tell(said.join("; "), false, "words");
    else this.forget("words");
  }

  /** {key, rows}: what was made of the project as it is, for `restore`. */
  toKeep() {
    const { project } = this.state();
    const rows = project.seeds
      .map((_, take) => keyOf(project, take))
      .filter((key) => this.made.get(key)?.sent)
      .map((key) => ({ key, sent: this.made.get(key).sent, asked: this.made.get(key).asked ?? null }));
    return { key: rows.map(({ key }) => key).join(), rows };
  }

  restore(rows) {
    for (const { key, sent, asked } of rows) this.keep(key, Object.assign(fromJson(sent), { asked }));
  }

  /** Pieces of the strip below the blocks, in seconds. */
  pieces() {
    const motion = this.shown;
    if (!motion) return [];
    const end = seconds(motion),
      { made } = motion.meta ?? {};
    if (!Array.isArray(made)) return [{ start: 0, end, kind: "there" }];
    return [
      { start: 0, end, kind: "kept" },
      ...made.map(([first, past]) => ({ start: first / motion.fps, end: past / motion.fps, kind: "new" })),
    ];
  }
}
