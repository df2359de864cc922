// The first minute with the page, step by step, and example projects. The steps are notes, so that nothing covers the body.
import { stored } from "./stored.js";

const TOPIC = "guide";

/** [{text, done(studio)}]: what to do, and whether it has been done. */
export const STEPS = [
  {
    text: "click the empty track below and type what happens, such as “a person walks forward”, then Enter",
    done: ({ blocks }) => blocks > 0,
  },
  {
    text: "the motion is generated: press Space to play it, and pause where you want to change it",
    done: ({ made, played }) => made && played,
  },
  {
    text: "drag a hand of the body: the span around the play head is regenerated through your pose",
    done: ({ keys }) => keys > 0,
  },
  {
    text: "wait a moment for the model, then play the result; Ctrl-Z takes a key back",
    done: ({ made, keys }) => made && keys > 0,
  },
  { text: "Export… in the panels writes a .glb, .bvh, .fbx or a film", done: ({ exported }) => exported },
];

const hand = (joint, time, positions) => ({
  type: "effector",
  joint,
  times: [time],
  positions: [positions],
  relative_to: "root",
});
const edit = (prompt, change, constraints) => ({
  take: 0,
  prompt,
  change: [change],
  seed: 0,
  sampling: {},
  control: { version: 1, constraints },
});

/** Projects to begin with: {name: {blocks, edits}}. Their keys are relative to the body. */
export const EXAMPLES = {
  "a wave in passing": {
    blocks: [{ prompt: "a person walks forward", seconds: 4.2 }],
    edits: [
      edit(
        "a person walks forward",
        [28, 62],
        [
          hand("right_wrist", 1.9, [-0.45, 1.6, 0.2]),
          hand("right_wrist", 2.25, [-0.25, 1.65, 0.25]),
          hand("right_wrist", 2.6, [-0.45, 1.6, 0.2]),
        ],
      ),
    ],
  },
  "walk, look up, sit": {
    blocks: [
      { prompt: "a person walks forward", seconds: 3 },
      { prompt: "a person stands still", seconds: 1.8 },
      { prompt: "a person sits down", seconds: 3 },
    ],
    edits: [edit("a person stands still", [62, 90], [hand("left_wrist", 3.8, [0.12, 1.55, 0.32])])],
  },
  "kick and guard": {
    blocks: [{ prompt: "a person kicks with the right leg", seconds: 3 }],
    edits: [
      edit(
        "a person kicks with the right leg",
        [4, 40],
        [hand("left_wrist", 1, [0.15, 1.35, 0.35]), hand("right_wrist", 1, [-0.15, 1.35, 0.35])],
      ),
    ],
  },
};

export class Guide {
  // studio: of main.js
  constructor(studio) {
    Object.assign(this, { studio, step: -1, played: false });
    const select = document.getElementById("examples");
    for (const name of Object.keys(EXAMPLES)) select.append(new Option(name));
    select.onchange = () => {
      if (EXAMPLES[select.value]) this.open(EXAMPLES[select.value]);
      select.value = "";
    };
    document.getElementById("tour").onclick = () => this.start();
  }

  /** Opens an example; undo restores the project before it. */
  open({ blocks, edits }) {
    const { studio } = this,
      { model } = studio.state.project;
    studio.act({
      type: "open",
      project: { blocks, seeds: [0], chosen: 0, model, edits: edits.map((one) => ({ ...one, model: studio.editor() })) },
    });
    studio.setMode("timeline");
    studio.seek(0);
    studio.makeSoon();
  }

  start() {
    this.studio.setMode("timeline");
    this.step = 0;
    this.played = false;
    this.show();
  }

  /** Offers the guide once. */
  offer() {
    if (stored("guide")) return;
    stored("guide", "offered");
    this.studio.notes.tell("new here? A minute shows how to make, pose and export a motion", false, TOPIC, {
      text: "Show me",
      does: () => this.start(),
    });
  }

  show() {
    const { notes } = this.studio;
    if (this.step >= STEPS.length) {
      this.step = -1;
      notes.forget(TOPIC);
      return notes.tell("that was the minute: ? lists all keys", false);
    }
    notes.tell(`${this.step + 1} of ${STEPS.length}: ${STEPS[this.step].text}`, false, TOPIC, {
      text: "Next",
      does: () => {
        this.step += 1;
        this.show();
      },
    });
  }

  /** Goes to the next step once one is done; called after each change. */
  look() {
    if (this.step < 0) return;
    const { studio } = this,
      { multiPrompt, state, desk, panels, player } = studio;
    this.played ||= player.playing;
    const seen = {
      blocks: state.project.blocks.length,
      made: !multiPrompt.isEmpty && !multiPrompt.stale && !multiPrompt.busy,
      played: this.played && !player.playing,
      keys: desk.keys.length,
      exported: Boolean(panels.last),
    };
    if (!STEPS[this.step].done(seen)) return;
    this.step += 1;
    this.show();
  }
}
