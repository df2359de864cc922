// The panels around the view and the timeline: takes, constraints, the marked span, files, export.
import * as api from "./api.js";
import { ExportChoices } from "./export_choices.js";
import { isCharacter } from "./character.js";
import { asJson, isPath, named, ofTimeline, offText } from "./control.js";
import { part, toJson } from "./motion.js";
import { MOST_TAKES, lengthOf, saved } from "./state.js";
import { legendOf, workText } from "./messages.js";

const $ = (id) => document.getElementById(id);

// A chip with a constraint's label and a button that removes it.
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
  // studio: {state(), act(action), multiPrompt, tell, forget, load(file), motion(), changed(), editor()}
  constructor(studio) {
    this.studio = studio;
    this.savedProject = null; // the project as last saved to a file
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
      if (seeds.length >= MOST_TAKES) return tell(`there are ${MOST_TAKES} takes, the maximum`, true);
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
    this.choices = new ExportChoices(api.exportChoices);
    $("export").onclick = tried(() => this.showExport());
    $("export-button").onclick = () => this.export();
    document.addEventListener("dragover", (event) => event.preventDefault());
    document.addEventListener(
      "drop",
      tried(async (event) => {
        event.preventDefault();
        const files = [...event.dataTransfer.files];
        if (!files[0]) return;
        if (isCharacter(files[0].name)) await studio.load(files[0]);
        else await (files[0].name.endsWith(".json") ? this.open({ files }) : this.import({ files }));
      }),
    );
  }

  draw() {
    const { project, span } = this.studio.state(),
      { multiPrompt } = this.studio;
    const chips = $("takes");
    while (chips.children.length > project.seeds.length) chips.lastChild.remove();
    project.seeds.forEach((seed, take) => {
      const chip =
        chips.children[take] ?? chips.appendChild(Object.assign(document.createElement("button"), { type: "button" }));
      chip.dataset.take = take;
      chip.textContent = `seed ${seed}`;
      chip.title = "click to show, right click to remove";
      chip.className = multiPrompt.of(take) ? "" : "none";
      chip.setAttribute("aria-pressed", String(take === project.chosen));
    });
    $("span").textContent = span ? `frames ${span[0]} to ${span[1]}` : "drag below the blocks to mark a span";
    this.drawConstraints(project);
    $("edit-button").disabled = !span || !multiPrompt.shown || Boolean(multiPrompt.busy);
    $("unmark").hidden = !span;
    $("new").disabled = !project.blocks.length && !project.past && !project.control.length;
    const edited = this.studio.mode() === "timeline" && Array.isArray(multiPrompt.shown?.meta?.made);
    $("edits").parentElement.hidden = !edited;
    this.drawLegend(this.studio.mode() === "timeline" ? multiPrompt.pieces() : this.studio.livePieces());
  }

  // The legend of the strip's colours.
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

  // A chip for each constraint: a click seeks to its time, the cross removes it.
  drawConstraints({ control, blocks }) {
    const { multiPrompt, mode, tool } = this.studio,
      motion = multiPrompt.shown,
      inTimeline = mode() === "timeline",
      length = blocks.reduce((sum, block) => sum + lengthOf(block), 0);
    const rows = control
      .map((one, index) => [one, index])
      .filter(([one]) => inTimeline !== Boolean(one.live))
      .map(([one, index]) => [named(one, inTimeline ? length : 0), one.time ?? one.times?.[0] ?? "", index]);
    // Unchanged chips are not replaced: that would lose a click between pointer down and up.
    if (JSON.stringify(rows) !== this.chips) {
      this.chips = JSON.stringify(rows);
      $("constraints").replaceChildren(...rows.map((row) => chipOf(...row)));
    }
    $("off").textContent = inTimeline && motion && !multiPrompt.stale ? offText(motion.report?.off, motion.fps) : "";
    $("draw-path").setAttribute("aria-pressed", String(tool().active));
    $("follow-path").disabled = !control.some((one) => one.live);
    $("draw-path").title = inTimeline ? "draw the path of the selected block" : "draw the path that the body follows";
    $("keep-pose").disabled = !motion;
  }

  edit() {
    const { state, act, multiPrompt, tell, editor } = this.studio,
      { span, project } = state();
    const prompt = $("edit-prompt").value.trim();
    if (!span) return tell("mark a span first: drag below the blocks, or press [ and ]", true);
    if (!prompt) return tell("type what happens in the marked span", true);
    if (multiPrompt.stale) return tell("the motion is not generated yet; press Make first", true);
    const change = [[span[0], Math.min(span[1], multiPrompt.shown.frames)]];
    if (change[0][0] >= change[0][1]) return tell("the marked span is after the end of the motion; mark another one", true);
    const edit = { take: project.chosen, prompt, change, seed: 0, sampling: {}, model: editor() };
    // The same prompt for the same frames again gets another seed.
    while (project.edits.some((one) => JSON.stringify(one) === JSON.stringify(edit))) edit.seed += 1;
    act({ type: "addEdit", edit });
    multiPrompt.make().then(() => {
      // an edit that failed is removed from the project
      if (multiPrompt.stale && state().project.edits.includes(edit)) act({ type: "undo" });
    });
  }

  async import(input) {
    const file = input.files[0];
    input.value = "";
    if (!file) return;
    const { state, act, multiPrompt, tell } = this.studio,
      { project } = state();
    const motion = await api.importFile(file),
      length = `${(motion.shape[0] / motion.fps).toFixed(1)} s`;
    const place = project.blocks.length ? await this.askWhere(file.name, length, project.blocks.length) : "instead";
    if (!place) return;
    act({ type: "importMotion", motion, alone: place === "instead" });
    await multiPrompt.make();
    tell(`${file.name}: ${length}; add blocks to continue it, or mark a span to change it`, false);
  }

  // Where an imported motion goes: "before" the blocks, which are generated again, "instead" of them, or "" to cancel.
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

  /** Whether the project has changes that are not saved to a file. */
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
      throw new Error(`${file.name} is not a complete project file: it is not valid JSON`);
    }
    const project = await api.project(value);
    const known = this.studio.models().find((model) => model.name === project.model.name);
    if (!known) {
      throw new Error(
        `the project needs the model ${project.model.name}, which this studio does not have: start it with ` +
          `--model ${project.model.name}`,
      );
    }
    this.studio.act({ type: "open", project });
    if (known.id && project.model.id && known.id !== project.model.id) {
      this.studio.tell(
        `the project was made with ${project.model.id}, this is ${known.id}: the motion may differ`,
        false,
      );
    }
    this.studio.multiPrompt.make();
  }

  async showExport() {
    const motion = this.studio.motion(),
      { span } = this.studio.state();
    if (!motion?.frames) return this.studio.tell("there is no motion to export yet", true);
    this.exported = motion;
    $("trim").checked = false; // a marked span is only suggested: the whole motion is exported by default
    $("trim-from").value = span?.[0] ?? 0;
    $("trim-to").value = Math.min(span?.[1] ?? motion.frames, motion.frames);
    $("trim-to").max = motion.frames;
    $("export-status").textContent = `${motion.frames} frames, ${(motion.frames / motion.fps).toFixed(1)} s`;
    $("export-panel").showModal();
    $("export-button").disabled = true; // until the formats are there
    try {
      await this.choices.open(this.studio.character());
    } catch (error) {
      $("export-status").textContent = `the formats did not come: ${error.message}; close this and try again`;
    }
  }

  async export() {
    const status = $("export-status"),
      format = $("format").value,
      button = $("export-button");
    let motion = this.exported;
    const request = { in_place: $("in-place").checked, loop: $("loop").checked };
    const control = ofTimeline(this.studio.state().project.control);
    if (this.studio.mode() === "timeline" && control.length && !this.studio.multiPrompt.stale) request.control = asJson(control);
    if ($("export-name").value.trim()) request.name = $("export-name").value.trim();
    if ($("trim").checked) request.trim = [[Number($("trim-from").value), Number($("trim-to").value)]];
    if (["mp4", "gif"].includes(format) && !request.trim && motion.frames > 60 * motion.fps && !motion.sent) {
      motion = part(motion, motion.frames - Math.floor(60 * motion.fps), motion.frames); // of a stream, the last minute
    }
    const controller = new AbortController(),
      running = (runs) => {
        button.disabled = this.exporting = runs;
        $("export-cancel").hidden = $("export-work").hidden = !runs;
      };
    running(true);
    $("export-cancel").onclick = () => controller.abort();
    $("export-work").removeAttribute("value");
    status.textContent = "writing the file";
    try {
      Object.assign(request, await this.choices.read());
      const { blob, name } = await api.exportMotion({ motion: toJson(motion), ...request }, (work) => {
        status.textContent = workText(work);
        $("export-work").value = work.share;
      }, controller.signal);
      api.download(blob, name);
      status.textContent = `${name}, ${(blob.size / 1024).toFixed(0)} KB`;
      this.last = { name, bytes: blob.size };
    } catch (error) {
      status.textContent = error.message;
      if (!error.cancelled) this.studio.tell(error.message, true);
    } finally {
      running(false);
    }
  }
}
