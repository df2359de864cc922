// Generates the motions of a project's timeline. They are cached, so that undo shows them at once. Needs no browser.
import { asJson, ofTimeline, offText } from "./control.js";
import { contacts, footprints, fromJson, seconds } from "./motion.js";
import { STEPS_OF_PROMPTS, leftOut } from "./sampling.js";
import { keyOf } from "./state.js";
import { remarkOf, workText } from "./messages.js";

const KEPT = 24, // motions
  MISSED = 10; // millimetres of distance from the constraints that are reported

/** A motion with its foot contacts and footprints. */
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

// What is kept of a motion beside the joints.
const about = ({ report = null, remarks = {}, edits = [] }) => ({ report, remarks, edits });

/** The notes of the edits inside a span of frames. */
const remarkOfSpan = ({ edits = [] }, first, past) =>
  edits.filter(({ change }) => change.some(([a, b]) => a < past && b > first)).map(({ text }) => text).filter(Boolean).join("\n");

export class MultiPrompt {
  // api: {multiPrompt, edit}; tell(sentence, isError, topic) and forget(topic): notes; changed(): the page has to be drawn
  // again; state(): that of state.js; act(action).
  constructor(api, { tell, forget, changed, state, act }) {
    Object.assign(this, { api, tell, forget, changed, state, act });
    this.made = new Map();
    this.last = null; // shown until a newer motion is there
    this.busy = null; // progress as a sentence, while a motion is generated
    this.share = 0; // of it, from 0 to 1
    this.controller = null; // of the request that runs
    this.reply = null; // {reused_frames, same_frames} of the last reply
    this.again = false;
  }

  /** The motion of a take of the project, or null if it has not been generated. */
  of(take, project = this.state().project) {
    return this.made.get(keyOf(project, take)) ?? null;
  }

  /** The motion that is shown: the chosen take, else the previous motion; null for an empty timeline. */
  get shown() {
    const motion = this.of(this.state().project.chosen);
    if (this.isEmpty) return null;
    if (motion) this.last = motion;
    return motion ?? this.last;
  }

  /** Shows a motion until the one that replaces it has been generated. */
  showPreview(motion) {
    this.last = withSteps({ ...motion, stands: undefined, prints: undefined });
    this.changed();
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

  /** Generates these takes; a change in the meantime is generated afterwards. */
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
          if (!error.cancelled) this.tell(error.message, true, error.topic ?? "make");
          this.again = false;
          if (error.cancelled) break;
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
      this.act({ type: "dropEdits", take, keep: (edit) => !left.includes(edit) });
      this.tell("an edit beyond the end of the motion was removed; Ctrl-Z brings it back", false);
      edits = edits.filter((edit) => !left.includes(edit));
    }
    for (; n < edits.length; n++) {
      motion = this.keep(keyOf(upTo(n + 1), take), await this.edited(motion, edits[n], edits.slice(0, n), project.without));
    }
    if (take === this.state().project.chosen) this.last = motion;
  }

  async base(project, take) {
    if (!project.blocks.length) {
      if (project.past) return fromJson(project.past);
      throw new Error("the timeline is empty: click on it and type a prompt");
    }
    this.works(project.seeds.length > 1 ? `generating take ${take + 1}` : "generating the motion");
    const request = {
      segments: project.blocks.map(({ prompt, seconds: length }) => ({ prompt, seconds: length })),
      seed: project.seeds[take],
      cleanup: project.cleanup,
      without: leftOut(project.without, STEPS_OF_PROMPTS),
      sampling: project.sampling,
      past: project.past,
    };
    if (project.model.name) request.model = project.model.name;
    if (ofTimeline(project.control).length) request.control = asJson(ofTimeline(project.control));
    const reply = await this.request("multiPrompt", request);
    this.reply = { reused_frames: reply.reused_frames, same_frames: reply.same_frames };
    const motion = fromJson(reply.motion);
    motion.remarks = Object.fromEntries(
      (reply.segments ?? []).map((segment, i) => [request.segments[i].prompt, remarkOf(segment)]).filter(([, one]) => one),
    );
    motion.report = reply.constraints ?? null;
    const off = motion.report?.off;
    if (off?.worst > MISSED && project.cleanup)
      this.tell(`path and poses cannot all be reached exactly: ${offText(off, motion.fps)}`, false, "control");
    else this.forget("control");
    return motion;
  }

  async edited(motion, edit, before, without) {
    this.works(edit.control ? "generating the span through its keys" : "generating the marked span");
    const { prompt, change, seed, sampling, model, control = null } = edit;
    const request = { motion: motion.sent, prompt, change, seed, sampling, without: leftOut(without) };
    if (control) request.control = control;
    if (model.name) request.model = model.name;
    const reply = await this.request("edit", request);
    const text = remarkOf(reply)?.text ?? "";
    if (text) this.tell(text, false, "edit");
    const made = joined([...(before.length ? (motion.meta.made ?? []) : []), ...reply.made]);
    reply.motion.meta = { ...reply.motion.meta, made };
    return Object.assign(fromJson(reply.motion), {
      report: motion.report && { ...motion.report, off: null }, // the distance is not known after an edit
      remarks: motion.remarks,
      edits: [...(motion.edits ?? []), { change, text }],
    });
  }

  request(kind, body) {
    this.controller = new AbortController();
    return this.api[kind](body, (work) => this.works(workText(work), work.share), this.controller.signal);
  }

  /** Ends what is being generated; the project stays as it is. */
  cancel() {
    this.again = false;
    this.controller?.abort();
  }

  // Shows progress as a sentence.
  works(sentence, share = 0) {
    Object.assign(this, { busy: sentence, share });
    this.changed();
  }

  /** {text, nearest} of a prompt of the motion that is shown, or null. */
  remark(prompt) {
    return this.shown?.remarks?.[prompt] ?? null;
  }

  /** {key, rows}: the generated motions of the project, also those before its edits, for `restore`. */
  toKeep() {
    const { project } = this.state();
    const stages = [...project.edits.keys(), project.edits.length].map((n) => ({
      ...project,
      edits: project.edits.slice(0, n),
    }));
    const keys = new Set(project.seeds.flatMap((_, take) => stages.map((stage) => keyOf(stage, take))));
    const rows = [...keys]
      .filter((key) => this.made.get(key)?.sent)
      .map((key) => ({ key, sent: this.made.get(key).sent, ...about(this.made.get(key)) }));
    return { key: rows.map(({ key }) => key).join(), rows };
  }

  restore(rows) {
    for (const { key, sent, ...known } of rows) this.keep(key, Object.assign(fromJson(sent), known));
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
      ...made.map(([first, past]) => ({ start: first / motion.fps, end: past / motion.fps, kind: "new",
        remark: remarkOfSpan(motion, first, past) })), // prettier-ignore
    ];
  }
}
