// What stands around the picture and the timeline: takes, the marked span, files, export.
import * as api from "./api.js";
import { asJson, isPath, named, offSaid } from "./control.js";
import { part, toJson } from "./motion.js";
import { MOST_TAKES, lengthOf, saved } from "./state.js";

const $ = (id) => document.getElementById(id);

// A constraint by its name, at a time, with a cross.
function chipOf(name, time, index) {
  const chip = Object.assign(document.createElement("span"), { className: "chip" });
  const text = Object.assign(document.createElement("button"), { type: "button", textContent: name });
  text.dataset.time = time;
  const gone = Object.assign(document.createElement("button"), { type: "button", textContent: "✕" });
  gone.dataset.index = index;
  gone.setAttribute("aria-label", `take away ${name}`);
  chip.append(text, gone);
  return chip;
}

export class Panels {
  // studio: {state(), act(action), story, tell, motion(), span(frames), changed(), editor()}
  constructor(studio) {
    this.studio = studio;
    const { act, tell } = studio;
    const tried =
      (work) =>
      async (...given) => {
        try {
          await work(...given);
        } catch (error) {
          tell(error.message, true);
        }
      };
    $("add-take").onclick = () => {
      const { seeds } = studio.state().project;
      if (seeds.length >= MOST_TAKES) return tell(`there are ${MOST_TAKES} takes, which is the most`, true);
      act({ type: "addTake", seed: Math.max(...seeds) + 1 });
    };
    $("takes").onclick = ({ target }) => {
      const chip = target.closest("button");
      if (chip) act({ type: "choose", take: Number(chip.dataset.take) });
    };
    $("takes").oncontextmenu = (event) => {
      event.preventDefault();
      const chip = event.target.closest("button");
      if (chip) act({ type: "removeTake", take: Number(chip.dataset.take) });
    };
    $("edit-row").onsubmit = (event) => {
      event.preventDefault();
      this.edit();
    };
    $("unmark").onclick = () => act({ type: "span", span: null });
    $("import").onclick = () => $("motion-file").click();
    $("open").onclick = () => $("project-file").click();
    $("save").onclick = tried(() => this.save());
    $("motion-file").onchange = tried((event) => this.import(event.target));
    $("project-file").onchange = tried((event) => this.open(event.target));
    $("export").onclick = () => this.showExport();
    $("export-button").onclick = () => this.export();
    document.addEventListener("dragover", (event) => event.preventDefault());
    document.addEventListener(
      "drop",
      tried(async (event) => {
        event.preventDefault();
        const files = [...event.dataTransfer.files];
        if (files[0]) await (files[0].name.endsWith(".json") ? this.open({ files }) : this.import({ files }));
      }),
    );
  }

  draw() {
    const { project, span } = this.studio.state(),
      { story } = this.studio;
    const chips = $("takes");
    while (chips.children.length > project.seeds.length) chips.lastChild.remove();
    project.seeds.forEach((seed, take) => {
      const chip =
        chips.children[take] ?? chips.appendChild(Object.assign(document.createElement("button"), { type: "button" }));
      chip.dataset.take = take;
      chip.textContent = `seed ${seed}`;
      chip.title = "click picks it, right click takes it away";
      chip.className = story.of(take) ? "" : "none";
      chip.setAttribute("aria-pressed", String(take === project.chosen));
    });
    $("span").textContent = span ? `frames ${span[0]} to ${span[1]}` : "drag below the blocks to mark frames";
    this.drawAsked(project);
    $("edit-button").disabled = !span || !story.shown || Boolean(story.busy);
    $("unmark").hidden = !span;
  }

  // A chip of each constraint: a click goes to its time, the cross takes it away.
  drawAsked({ control, blocks }) {
    const { story, mode, tool } = this.studio,
      motion = story.shown,
      inStory = mode() === "story",
      length = blocks.reduce((sum, block) => sum + lengthOf(block), 0);
    const rows = control
      .map((one, index) => [one, index])
      .filter(([one]) => inStory || isPath(one))
      .map(([one, index]) => [named(one, inStory ? length : 0), one.time ?? one.times?.[0] ?? "", index]);
    // Those that stay are not drawn anew: a click would be lost between the button's going down and up.
    if (JSON.stringify(rows) !== this.chips) {
      this.chips = JSON.stringify(rows);
      $("asked").replaceChildren(...rows.map((row) => chipOf(...row)));
    }
    $("off").textContent = inStory && motion && !story.stale ? offSaid(motion.asked?.off, motion.fps) : "";
    $("draw-path").setAttribute("aria-pressed", String(tool().active));
    $("follow-path").disabled = !control.some(isPath);
    $("keep-pose").disabled = !motion;
  }

  edit() {
    const { state, act, story, tell, editor } = this.studio,
      { span, project } = state();
    const prompt = $("edit-prompt").value.trim();
    if (!span) return tell("mark frames first: drag below the blocks, or [ and ]", true);
    if (!prompt) return tell("say what happens in the marked span", true);
    if (story.stale) return tell("the motion is not made yet; make it first", true);
    const change = [[span[0], Math.min(span[1], story.shown.frames)]];
    if (change[0][0] >= change[0][1]) return tell("the marked span lies behind the end of the motion", true);
    const edit = { take: project.chosen, prompt, change, seed: 0, sampling: {}, model: editor() };
    // The same words on the same frames again are another try.
    while (project.edits.some((one) => JSON.stringify(one) === JSON.stringify(edit))) edit.seed += 1;
    act({ type: "addEdit", edit });
    story.make().then(() => {
      // what could not be made is no part of the project
      if (story.stale && state().project.edits.includes(edit)) act({ type: "undo" });
    });
  }

  async import(input) {
    const file = input.files[0];
    input.value = "";
    if (!file) return;
    const motion = await api.importFile(file);
    this.studio.act({ type: "importMotion", motion });
    await this.studio.story.make();
    this.studio.tell(
      `${file.name}: ${(motion.shape[0] / motion.fps).toFixed(1)} s; add blocks to go on from it, or ` +
        "mark a span to make it anew",
      false,
    );
  }

  async save() {
    const { project } = this.studio.state();
    if (!project.blocks.length)
      throw new Error("there are no blocks to save yet: click on the timeline and say what happens");
    const value = await api.project(saved(project));
    const name = `${project.blocks[0].prompt
      .toLowerCase()
      .replace(/[^a-z0-9]+/g, "-")
      .slice(0, 40)}.json`;
    api.download(new Blob([JSON.stringify(value, null, 1)], { type: "application/json" }), name);
  }

  async open(input) {
    const file = input.files[0];
    const text = await file?.text();
    input.value = "";
    if (text === undefined) return;
    let value;
    try {
      value = JSON.parse(text);
    } catch {
      throw new Error(`${file.name} is no project, or was cut: it is no valid JSON`);
    }
    const project = await api.project(value);
    const known = this.studio.models().find((model) => model.name === project.model.name);
    if (!known) {
      throw new Error(
        `the project needs the model ${project.model.name}, which this studio does not have: start it with ` +
          `--model ${project.model.name}`,
      );
    }
    if (known.id && project.model.id && known.id !== project.model.id) {
      this.studio.tell(
        `the project was made with ${project.model.id}, this is ${known.id}: the motion may be another one`,
        false,
      );
    }
    this.studio.act({ type: "open", project });
    this.studio.story.make();
  }

  showExport() {
    const motion = this.studio.motion(),
      { span } = this.studio.state();
    if (!motion?.frames) return this.studio.tell("there is no motion to export yet", true);
    this.exported = motion;
    $("trim").checked = Boolean(span) && this.studio.mode() === "story";
    $("trim-from").value = span?.[0] ?? 0;
    $("trim-to").value = Math.min(span?.[1] ?? motion.frames, motion.frames);
    $("trim-to").max = motion.frames;
    $("export-told").textContent = `${motion.frames} frames, ${(motion.frames / motion.fps).toFixed(1)} s`;
    $("export-panel").showModal();
  }

  async export() {
    const told = $("export-told"),
      format = $("format").value,
      button = $("export-button");
    let motion = this.exported;
    const request = { format, in_place: $("in-place").checked, loop: $("loop").checked };
    const { control } = this.studio.state().project;
    if (this.studio.mode() === "story" && control.length && !this.studio.story.stale) request.control = asJson(control);
    if ($("export-name").value.trim()) request.name = $("export-name").value.trim();
    if ($("trim").checked) request.trim = [[Number($("trim-from").value), Number($("trim-to").value)]];
    if (["mp4", "gif"].includes(format) && !request.trim && motion.frames > 60 * motion.fps && !motion.sent) {
      motion = part(motion, motion.frames - Math.floor(60 * motion.fps), motion.frames); // of a stream, the last minute
    }
    button.disabled = true;
    told.textContent = "writing";
    try {
      const { blob, name } = await api.exportMotion({ motion: toJson(motion), ...request });
      api.download(blob, name);
      told.textContent = `${name}, ${(blob.size / 1024).toFixed(0)} KB`;
      this.last = { name, bytes: blob.size };
    } catch (error) {
      told.textContent = error.message;
      this.studio.tell(error.message, true);
    } finally {
      button.disabled = false;
    }
  }
}
