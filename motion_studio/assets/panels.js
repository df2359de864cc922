// What is around the picture and the timeline: takes, the marked span, files, export.
import * as api from "./api.js";
import { asJson, isPath, named, offSaid } from "./control.js";
import { part, toJson } from "./motion.js";
import { MOST_TAKES, lengthOf, saved } from "./state.js";
import { legendOf, workSaid } from "./words.js";

const $ = (id) => document.getElementById(id);

// A constraint by its name, at a time, with a cross.
function chipOf(name, time, index) {
  const chip = Object.assign(document.createElement("span"), { className: "chip" });
  const text = Object.assign(document.createElement("button"), { type: "button", textContent: name });
  text.dataset.time = time;
  const gone = Object.assign(document.createElement("button"), { type: "button", textContent: "✕" });
  gone.dataset.index = index;
  gone.setAttribute("aria-label", `Remove ${name}`);
  chip.append(text, gone);
  return chip;
}

export class Panels {
  // studio: {state(), act(action), story, tell, forget, motion(), changed(), editor()}
  constructor(studio) {
    this.studio = studio;
    this.savedProject = null; // as it was written to a file
    this.exporting = false;
    const { act, tell, forget } = studio;
    const tried =
      (work) =>
      async (...given) => {
        try {
          await work(...given);
          forget("file");
        } catch (error) {
          tell(error.message, true, error.topic ?? "file");
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
    $("new").onclick = () => act({ type: "new" });
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
      chip.title = "a click shows it, a right click removes it";
      chip.className = story.of(take) ? "" : "none";
      chip.setAttribute("aria-pressed", String(take === project.chosen));
    });
    $("span").textContent = span ? `frames ${span[0]} to ${span[1]}` : "drag below the blocks to mark a span";
    this.drawAsked(project);
    $("edit-button").disabled = !span || !story.shown || Boolean(story.busy);
    $("unmark").hidden = !span;
    $("new").disabled = !project.blocks.length && !project.past && !project.control.length;
    const edited = this.studio.mode() === "story" && Array.isArray(story.shown?.meta?.made);
    $("edits").parentElement.hidden = !edited;
    this.drawLegend(this.studio.mode() === "story" ? story.pieces() : this.studio.livePieces());
  }

  // What the colours of the strip mean.
  drawLegend(pieces) {
    const rows = legendOf(pieces),
      key = rows.join();
    if (key === this.legend) return;
    this.legend = key;
    $("legend").replaceChildren(
      ...rows.map(([kind, words]) => {
        const row = document.createElement("span");
        row.append(Object.assign(document.createElement("i"), { className: kind }), words);
        return row;
      }),
    );
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
    // Those that stay are not replaced: a click would be lost between the button's going down and up.
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
    if (!span) return tell("mark a span first: drag below the blocks, or press [ and ]", true);
    if (!prompt) return tell("type what happens in the marked span", true);
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
    const { state, act, story, tell } = this.studio,
      { project } = state();
    const motion = await api.importFile(file),
      length = `${(motion.shape[0] / motion.fps).toFixed(1)} s`;
    const place = project.blocks.length ? await this.askWhere(file.name, length, project.blocks.length) : "instead";
    if (!place) return;
    act({ type: "importMotion", motion, alone: place === "instead" });
    await story.make();
    tell(`${file.name}: ${length}; add blocks to continue it, or mark a span to change it`, false);
  }

  // A motion goes before the blocks, which are then made again, or in their place: "before", "instead", or nothing.
  askWhere(name, length, count) {
    const panel = $("import-panel"),
      blocks = count === 1 ? "1 block" : `${count} blocks`;
    $("import-question").textContent = `${name} has ${length} of motion, and the timeline has ${blocks}: where does it go?`;
    panel.returnValue = "";
    panel.showModal();
    return new Promise((done) => panel.addEventListener("close", () => done(panel.returnValue), { once: true }));
  }

  async save() {
    const { project } = this.studio.state();
    if (!project.blocks.length)
      throw new Error("there are no blocks to save yet: click on the timeline and type what happens");
    const value = await api.project(saved(project));
    const name = `${project.blocks[0].prompt
      .toLowerCase()
      .replace(/[^a-z0-9]+/g, "-")
      .slice(0, 40)}.json`;
    api.download(new Blob([JSON.stringify(value, null, 1)], { type: "application/json" }), name);
    this.savedProject = project;
  }

  /** Whether leaving the page would lose what is in no file. */
  get unsaved() {
    const { project } = this.studio.state();
    return project !== this.savedProject && Boolean(project.blocks.length || project.past);
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
    $("trim").checked = false; // a marked span is a proposal: what is exported is the whole motion
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
    button.disabled = this.exporting = true;
    told.textContent = "writing the file";
    try {
      const { blob, name } = await api.exportMotion({ motion: toJson(motion), ...request }, (work) => {
        told.textContent = workSaid(work);
      });
      api.download(blob, name);
      told.textContent = `${name}, ${(blob.size / 1024).toFixed(0)} KB`;
      this.last = { name, bytes: blob.size };
    } catch (error) {
      told.textContent = error.message;
      this.studio.tell(error.message, true);
    } finally {
      button.disabled = this.exporting = false;
    }
  }
}
