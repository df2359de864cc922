// Keys of the project in the page: what the pose tool makes, the tracks show and the row of the selected keys changes.
import { MOST_EDITS, MOST_SLACK, constraintsOf, keysOf, labelOf, plantedOf, taken, trackOf } from "./pose_keys.js";
import { PoseTool } from "./pose_tool.js";
import { previewed } from "./preview.js";
import { HANDLES, JOINTS } from "./skeleton.js";
import { KeyTracks } from "./tracks.js";

const PLANTED = 10; // frames
const $ = (id) => document.getElementById(id);

export class Desk {
  // studio: of main.js
  constructor(studio) {
    this.studio = studio;
    this.selected = new Set();
    this.whole = false;
    this.previewTime = null; // milliseconds that the last preview took
    const { tell } = studio.notes;
    this.tool = new PoseTool($("stage"), {
      view: () => studio.view,
      motion: () => this.motion,
      frame: () => studio.player.frame,
      may: () => this.may,
      key: (pose, handles, frame) => this.key(pose, handles, frame),
      changed: () => {
        studio.dirty = true;
      },
      tell: (...given) => tell.call(studio.notes, ...given),
    });
    this.tracks = new KeyTracks(studio.timeline, {
      select: (ids, more, seek) => this.select(ids, more, seek),
      move: (ids, by) => this.move(by),
      remove: (ids) => this.remove(ids),
      span: (index, span, change) => this.act({ type: "setSpan", index, span, change }),
      seek: (second) => studio.seek(second),
      stretch: (id, ends) => this.act({ type: "stretchKey", keys: this.keys.filter((key) => key.id === id), ends }),
    });
    $("pose-whole").onchange = () => {
      this.whole = $("pose-whole").checked;
    };
    for (const [id, does] of Object.entries({
      "pose-key": () => this.tool.keyPose(),
      "pose-turn": () => this.tool.turn(),
      "pose-pin": () => this.tool.pin(),
      "pose-plant": () => this.plant(),
      "pose-mirror": () => this.tool.mirror(),
      "pose-copy": () => this.tool.copyPose(),
      "pose-paste": () => this.tool.pastePose(),
      "pose-reset": () => this.reset(),
      "key-copy": () => this.copy(),
      "key-remove": () => this.remove(),
      "key-between": () => this.between(),
      "key-again": () => this.again(),
      "key-none": () => this.select([]),
    }))
      $(id).onclick = does;
    $("key-slack").onchange = () => this.set({ slack: Math.max(0, Math.min(MOST_SLACK, Math.round(Number($("key-slack").value) || 0))) });
    $("key-strength").onchange = () => this.set({ strength: Number($("key-strength").value) / 100 });
  }

  /** The motion that is posed: the one that is shown. */
  get motion() {
    return this.studio.multiPrompt.shown;
  }

  /** Whether the body can be taken hold of: a motion of 22 joints that stands still, on its own in the timeline. */
  get may() {
    const { studio, motion } = this;
    return Boolean(
      studio.view &&
      studio.mode === "timeline" &&
      motion?.count === JOINTS.length &&
      !studio.player.playing &&
      !studio.tool.active &&
      !studio.side &&
      $("posing").checked,
    );
  }

  get take() {
    return this.studio.state.project.chosen;
  }

  get keys() {
    const { project } = this.studio.state;
    return this.motion ? keysOf(project, this.take, this.motion.fps) : [];
  }

  get chosen() {
    return this.keys.filter((key) => this.selected.has(key.id));
  }

  // What an edit of these frames is made of: the words that are there now, and the model that edits.
  about(frame) {
    const { motion, studio } = this,
      second = frame / motion.fps,
      captions = motion.captions ?? [],
      caption =
        captions.find(({ start, end }) => start <= second && second < end) ??
        captions.find(({ start, end }) => start === end) ??
        captions.at(-1);
    return {
      prompt: caption?.text?.trim() || studio.state.project.blocks[0]?.prompt || "a person moves",
      model: studio.editor(),
    };
  }

  act(action) {
    const { motion, studio } = this,
      before = studio.state;
    studio.act({ take: this.take, fps: motion.fps, frames: motion.frames, ...action });
    if (studio.state === before) return false;
    this.preview(before.project);
    studio.makeSoon();
    return true;
  }

  // Until the model has made it, the motion that was shown is bent through the keys of the edits that have changed.
  preview(before) {
    const { project } = this.studio.state,
      began = performance.now(),
      keys = this.keys;
    let shown = this.motion;
    if (!this.studio.multiPrompt.stale) return; // made before: an undo
    project.edits.forEach((edit, index) => {
      if (edit.take !== this.take || edit === before.edits[index] || !edit.control) return;
      for (const span of edit.change)
        shown = previewed(
          shown,
          span,
          keys.filter((key) => key.edit === index),
        );
    });
    if (shown === this.motion) return;
    this.studio.multiPrompt.showPreview(shown);
    this.previewTime = performance.now() - began;
  }

  /** Plants the chosen hand or foot: it stays where it is from the play head on, as long as it stands or half a second. */
  plant() {
    const { tool, motion, studio } = this,
      { limb, bend, label } = HANDLES[tool.chosen] ?? {};
    if (!limb || bend) return studio.notes.tell("click a hand or a foot first, then plant it", true);
    const { frame } = studio.player,
      standing = motion.prints?.find(
        (print) => (print.left ? "left_foot" : "right_foot") === tool.chosen && print.first <= frame && frame < print.past,
      ),
      until = Math.min(motion.frames - 1, standing && standing.past - 1 > frame + 1 ? standing.past - 1 : frame + PLANTED);
    if (until <= frame) return studio.notes.tell("there is no frame after the play head to plant it in", true);
    const constraints = plantedOf(tool.pose, tool.chosen, frame, until, motion.fps);
    if (this.crosses(constraints, frame, until)) return;
    this.act({ type: "addKey", frame, constraints, edit: this.about(frame) });
    studio.notes.tell(`the ${label} stays where it is from frame ${frame} to ${until}; drag the ends of its bar`, false);
  }

  // Whether a part has another key in these frames, which is reported; a key at the first frame is replaced.
  crosses(constraints, frame, until) {
    const track = trackOf(constraints[0]),
      other = this.keys.find((key) => key.track === track && key.frame !== frame && key.frame <= until && frame <= key.until);
    if (other)
      this.studio.notes.tell(
        `there is a key of the ${labelOf(track)} from frame ${other.frame} to ${other.until} already: delete ` +
          "or shorten it first",
        true,
      );
    return Boolean(other);
  }

  /** A key of a pose at a frame; handles: those that moved, null for the whole pose. */
  key(pose, handles, frame) {
    const { motion, studio } = this;
    if (!(frame < motion.frames)) return studio.notes.tell("there is no frame to key: the motion has ended", true);
    const constraints = constraintsOf(pose, handles ?? [], frame, motion.fps, this.whole || !handles);
    if (this.crosses(constraints, frame, frame)) return;
    if (!this.act({ type: "addKey", frame, constraints, edit: this.about(frame) })) {
      return studio.notes.tell(`there are ${MOST_EDITS} edits, the maximum: delete some keys first`, true);
    }
    const made = this.keys.filter((key) => key.frame === frame && constraints.every((one) => key.constraints.includes(one)));
    this.selected = new Set(made.map((key) => key.id));
  }

  select(ids, more = false, seek = false) {
    const selected = new Set(more ? this.selected : []);
    for (const id of ids) if (!(more && selected.delete(id))) selected.add(id);
    this.selected = selected;
    if (seek && this.chosen[0]) this.studio.seek(this.chosen[0].frame / this.motion.fps);
    this.studio.dirty = true;
  }

  move(by) {
    const hit = taken(this.keys, this.chosen, by);
    if (hit)
      return this.studio.notes.tell(
        `there is a key of the ${labelOf(hit.track)} at frame ${hit.frame} already: delete it first, or ` +
          "move to another frame",
        true,
      );
    const frames = this.chosen.map((key) => [key.track, key.frame]);
    if (!this.act({ type: "moveKeys", keys: this.chosen, by })) return;
    this.selected = new Set(
      this.keys
        .filter((key) => frames.some(([track, frame]) => track === key.track && Math.abs(key.frame - frame - by) < 1))
        .map((key) => key.id),
    );
  }

  remove(ids = [...this.selected]) {
    const keys = this.keys.filter((key) => ids.includes(key.id));
    if (!keys.length) return false;
    this.selected = new Set();
    return this.act({ type: "removeKeys", keys });
  }

  copy() {
    const { chosen, studio } = this,
      { frame } = studio.player;
    if (!chosen.length) return studio.notes.tell("select keys first: click them, or drag a box around them", true);
    if (chosen[0].frame === frame) return studio.notes.tell("move the play head to where the copies go", true);
    this.act({ type: "copyKeys", keys: chosen, frame, edit: this.about(frame) });
  }

  set(fields) {
    const frames = this.chosen.map((key) => `${key.track} ${key.frame}`);
    if (!this.act({ type: "setKeys", keys: this.chosen, fields })) return;
    this.selected = new Set(this.keys.filter((key) => frames.includes(`${key.track} ${key.frame}`)).map((key) => key.id));
  }

  /** Another take of the spans of the selected keys. */
  again() {
    const edits = new Set(this.chosen.map((key) => key.edit));
    for (const index of edits) this.studio.act({ type: "reseed", index });
  }

  /** Regenerates what is between the first and the last of the selected keys. */
  between() {
    const frames = [...new Set(this.chosen.map((key) => key.frame))].sort((a, b) => a - b),
      { notes } = this.studio;
    if (frames.length < 2 || frames.at(-1) - frames[0] < 3) return notes.tell("select two keys with frames between them", true);
    const words = $("edit-prompt").value.trim(),
      about = this.about((frames[0] + frames.at(-1)) >> 1);
    const edit = {
      take: this.take,
      seed: 0,
      sampling: {},
      ...about,
      ...(words ? { prompt: words } : {}),
      change: [[frames[0] + 1, frames.at(-1)]],
    };
    this.act({ type: "addEdit", edit });
  }

  reset() {
    const { state, multiPrompt } = this.studio,
      edits = state.project.edits.filter((edit) => edit.take !== this.take || !edit.control);
    this.tool.reset(multiPrompt.of(this.take, { ...state.project, edits }));
  }

  /** Lets go of rings, of the part that is held, or of the selected keys; whether there was any. */
  escape() {
    const { tool } = this,
      held = Boolean(tool.draft || tool.known?.rings || tool.chosen || this.selected.size);
    if (tool.draft) tool.cancel();
    else tool.choose(null);
    this.select([]);
    return held;
  }

  /** What keys do, for keys.js. */
  get letters() {
    const { tool } = this,
      inTimeline = (does) => () => this.studio.mode === "timeline" && does();
    return Object.fromEntries(
      Object.entries({
        g: () => tool.grab(),
        r: () => tool.turn(),
        k: () => tool.keyPose(),
        p: () => tool.pin(),
        l: () => this.plant(),
        m: () => tool.mirror(),
        x: () => this.remove(),
        "shift-r": () => this.reset(),
      }).map(([letter, does]) => [letter, inTimeline(does)]),
    );
  }

  get control() {
    const inTimeline = (does) => () => this.studio.mode === "timeline" && does();
    return {
      c: inTimeline(() => this.tool.copyPose()),
      v: inTimeline(() => this.tool.pastePose()),
      d: inTimeline(() => this.copy()),
    };
  }

  /** Draws the tracks and the row of the selected keys. */
  draw() {
    const { motion, studio } = this,
      timeline = studio.mode === "timeline";
    this.tracks.element.hidden = !timeline;
    if (!timeline || !motion)
      return this.tracks.draw({ keys: [], edits: [], fps: 20, frames: 0, prints: [], selected: this.selected });
    const keys = this.keys,
      edits = studio.state.project.edits
        .map((edit, index) => ({ ...edit, index }))
        .filter((edit) => edit.take === this.take && edit.control && keys.some((key) => key.edit === edit.index));
    this.selected = new Set(keys.filter((key) => this.selected.has(key.id)).map((key) => key.id));
    this.tracks.draw({
      keys,
      edits,
      fps: motion.fps,
      frames: motion.frames,
      prints: motion.prints ?? [],
      selected: this.selected,
    });
    const chosen = keys.filter((key) => this.selected.has(key.id)),
      [first] = chosen;
    $("key-row").hidden = !first;
    if (!first) return;
    $("key-name").textContent = chosen.length === 1 ? `${labelOf(first.track)}, frame ${first.frame}` : `${chosen.length} keys`;
    if (document.activeElement !== $("key-slack")) $("key-slack").value = first.slack;
    if (document.activeElement !== $("key-strength")) $("key-strength").value = Math.round(100 * first.strength);
    $("key-between").disabled = chosen.length < 2;
  }
}
