// The selected block: the path that it has, and what keys do with it.
import { WALK, paceOf, pathOf } from "./control.js";
import { STEP } from "./notes.js";
import { lengthOf, placed, snapped } from "./state.js";

const CREEPS = 0.4,
  RUNS = 2.5; // metres a second

export class SelectedBlock {
  // studio: of main.js
  constructor(studio) {
    this.studio = studio;
  }

  get step() {
    const { live } = this.studio;
    return live.blockFrames / live.fps;
  }

  get index() {
    const { project, selected } = this.studio.state;
    return project.blocks.findIndex((block) => block.id === selected);
  }

  /** {block, start, end} of the selected block, or of the one at the play head; null without blocks. */
  get row() {
    const rows = placed(this.studio.state.project),
      { time } = this.studio.player;
    return rows[this.index] ?? rows.findLast(({ start }) => start <= time) ?? rows[0] ?? null;
  }

  /** Where the body is as a span begins: at the end of a path before it, else as the motion has it; null at the first
      frame, where a motion begins with its path. */
  startOf({ start }) {
    const { state, multiPrompt } = this.studio,
      before = state.project.control.find((one) => one.points && !one.live && Math.abs(one.times?.at(-1) - start) < 0.06);
    if (before) return [before.points.at(-1)[0], before.points.at(-1).at(-1)];
    const motion = multiPrompt.shown;
    if (!motion || start <= 0) return null;
    const k = 3 * motion.count * Math.min(motion.frames - 1, Math.round(start * motion.fps));
    return [motion.joints[k], motion.joints[k + 2]].map((value) => Math.round(value * 100) / 100);
  }

  /** Offers another length of the block of a span whose path has too much or too little time in it. */
  checkPace(span) {
    const { state, notes, act } = this.studio,
      path = span?.block && pathOf(state.project.control, span),
      { speed, length } = path ? paceOf(path) : {};
    if (!speed || (speed >= CREEPS && speed <= RUNS) || length < WALK) return; // a step to the side may take its time
    const seconds = snapped(length / WALK, this.step);
    notes.tell(`the path of ${length.toFixed(1)} m takes all of its block, at ${speed.toFixed(1)} m/s`, false, STEP, {
      text: `Make the block ${seconds.toFixed(1)} s long`,
      does: () => act({ type: "resize", id: span.block.id, seconds, step: this.step }),
    });
  }

  /** What keys do, for keys.js; nothing outside the timeline, or while a path is drawn. */
  get keys() {
    const { studio } = this,
      inTimeline = (does) => (given) => {
        if (studio.mode === "timeline" && !studio.tool.active) does(given);
      },
      withBlock = (does) =>
        inTimeline((by) => {
          if (this.index >= 0) does(studio.state.project.blocks[this.index], by);
        });
    return {
      add: inTimeline(() => studio.timeline.ask(null)),
      choose: inTimeline((by) => this.choose(by)),
      edit: withBlock(({ id }) => studio.timeline.ask(id)),
      longer: withBlock((block, by) =>
        studio.act({ type: "resize", id: block.id, seconds: lengthOf(block) + by * this.step, step: this.step }),
      ),
      shift: withBlock(({ id }, by) => studio.act({ type: "move", id, index: this.index + by })),
    };
  }

  // Selects the block `by` places after the selected one, or the one at the play head.
  choose(by) {
    const rows = placed(this.studio.state.project),
      row = this.index < 0 ? this.row : rows[Math.max(0, Math.min(rows.length - 1, this.index + by))];
    if (!row) return;
    this.studio.act({ type: "select", id: row.block.id });
    this.studio.timeline.reveal(row.start);
  }
}
