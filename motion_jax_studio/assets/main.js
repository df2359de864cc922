// The page: connects its parts and draws them sixty times a second.
import * as api from "./api.js";
import { Characters } from "./character.js";
import { bind } from "./controls.js";
import { pathOf, pointsOf } from "./control.js";
import { showCurves } from "./curves.js";
import { Desk } from "./desk.js";
import { PathTool } from "./path_tool.js";
import { Guide } from "./guide.js";
import { Ideas } from "./ideas.js";
import { listen } from "./keys.js";
import { layOut } from "./layout.js";
import { Live } from "./live.js";
import { Notes, STEP } from "./notes.js";
import { Panels } from "./panels.js";
import { Player } from "./player.js";
import { picture } from "./picture.js";
import { liveRows, liveProject, timelineRows } from "./timeline_rows.js";
import { Sampling } from "./sampling.js";
import { SelectedBlock } from "./selected_block.js";
import { restoreSession } from "./session.js";
import { MOST_BLOCKS, initial, reduce } from "./state.js";
import { MultiPrompt } from "./multi_prompt.js";
import { expose } from "./testing.js";
import { Timeline } from "./timeline.js";
import { View } from "./view.js";

const $ = (id) => document.getElementById(id);
const CHANGED_AFTER = 300; // milliseconds after the last change that a motion is made again
const LONGEST_FRAME = 1; // seconds between two drawings that count as played; a hidden tab draws nothing
const POLL_MODELS = 1000; // milliseconds between two requests for the loading progress of the models

const notes = new Notes($("notes"), $("notes-list"), $("show-notes"));
const studio = {
  mode: "live",
  state: initial(),
  models: [],
  notes,
  view: null,
  player: new Player(),
  dirty: true,
  curves: null,
};
const tell = (...given) => notes.tell(...given);
const forget = (topic) => notes.forget(topic);
const changed = () => {
  studio.dirty = true;
};
const live = (studio.live = new Live(api.streamAddress(), {
  tell,
  changed,
  forget,
  reach: api.reach,
  started: () => {
    // While the timeline is shown, the live motion is paused.
    if (studio.mode !== "timeline") return;
    live.pause();
    studio.wasRunning = true;
  },
  back: () => {
    watchModels();
    makeSoon();
  },
  atStart: () => studio.mode === "live" && timeline.reveal(0), // the track shows the body from its first frame
  replaced: () => tool.active || studio.follow(), // a path that is being drawn is sent when it is complete
}));
const multiPrompt = (studio.multiPrompt = new MultiPrompt(api, { tell, forget, changed, state: () => studio.state, act }));
const selected = new SelectedBlock(studio);
let waiting = null;

// Every change goes through here; a changed project is generated soon, if "on change" is checked.
function act(action) {
  const before = studio.state;
  studio.state = reduce(before, action);
  changed();
  drawTimeline();
  studio.autosave?.changed();
  if (studio.state.project === before.project || ["model", "restore"].includes(action.type)) return;
  notes.forget(STEP); // the step that they belong to is over
  if (action.type !== "addEdit") notes.forget("edit");
  if (multiPrompt.isEmpty) notes.forget("make");
  // The live body follows the path that is shown.
  const other = pathOf(before.project.control, "live") !== pathOf(studio.state.project.control, "live");
  if (other && ["undo", "redo"].includes(action.type) && studio.mode === "live" && !tool.active) studio.follow();
  makeSoon();
}
studio.act = act;

// The line at the bottom is that of the selected block, as long as it has something to note.
let explained = null;
function explain(id) {
  const block = studio.mode === "timeline" && studio.state.project.blocks.find((one) => one.id === id),
    remark = block && multiPrompt.remark(block.prompt),
    key = remark ? `${id} ${block.prompt}` : null;
  if (key === explained) return;
  explained = key;
  if (!remark) return notes.forget("block");
  const use = { text: `Use “${remark.nearest}”`, does: () => act({ type: "edit", id, prompt: remark.nearest }) };
  tell(remark.short, false, "block", remark.nearest ? use : null);
}

// Nothing is generated from a path that is still being drawn.
studio.makeSoon = makeSoon;
function makeSoon() {
  const { blocks, past } = studio.state.project;
  clearTimeout(waiting);
  if ($("auto").checked && (blocks.length || past) && multiPrompt.stale && !studio.tool.active)
    waiting = setTimeout(() => multiPrompt.make(), CHANGED_AFTER);
}

const tool = (studio.tool = new PathTool($("stage"), {
  view: () => studio.view,
  // Of the timeline each block has its own path: the selected one, else that at the play head.
  span: () => (studio.mode === "live" ? "live" : selected.row),
  points: (span) => pointsOf(studio.state.project.control, span),
  start: (span) => (span && span !== "live" ? selected.startOf(span) : null),
  change: (points, span) => act({ type: "path", points, span }),
  changed,
  tell,
  // The live body pauses while its path is drawn.
  began: () => {
    if (studio.mode === "timeline" && tool.span) studio.seek(tool.span.start);
    studio.waits = studio.mode === "live" && live.state === "running";
    if (studio.waits) live.pause();
  },
  ended: (span) => {
    changed();
    if (studio.mode === "timeline") {
      selected.checkPace(span);
      return makeSoon();
    }
    studio.follow();
    if (studio.waits) live.resume();
  },
}));

/** The live body follows the path that is drawn. */
studio.follow = () => {
  if (live.connected) live.follow(pathOf(studio.state.project.control, "live"));
  else tell("the studio is not connected; the path stays here until it is", true);
};

/** Adds a keyframe of the pose that is shown, at its time and at any place. */
studio.keepPose = () => {
  const motion = multiPrompt.shown;
  if (!motion) return tell("there is no motion yet; generate one first, then keep its pose", true);
  if (motion.count !== studio.view?.body.rest.length) return tell("this motion has another skeleton than the body of the page", true);
  const { frame } = studio.player,
    first = 3 * frame * motion.count;
  const joints = Array.from({ length: motion.count }, (_, j) =>
    [...motion.joints.subarray(first + 3 * j, first + 3 * j + 3)].map((value) => Math.round(value * 1e4) / 1e4),
  );
  const before = studio.state;
  act({ type: "pose", time: Math.round((frame / motion.fps) * 1000) / 1000, joints });
  if (studio.state === before) tell("the number of poses has reached its limit; remove one first", true);
};

studio.setMode = (mode) => {
  if (mode === studio.mode) return;
  if (tool.active) tool.end();
  studio.mode = document.body.dataset.mode = mode;
  for (const topic of [STEP, mode === "live" ? "control" : "words"]) notes.forget(topic);
  for (const name of ["live", "timeline"]) $(`mode-${name}`).setAttribute("aria-selected", String(name === mode));
  if (mode === "timeline" && live.state === "running") {
    live.pause();
    studio.wasRunning = true;
  } else if (mode === "live" && studio.wasRunning) {
    live.resume();
    studio.wasRunning = false;
  }
  if (mode === "timeline") studio.player.load(multiPrompt.shown);
  studio.ideas.forget();
  studio.autosave?.changed();
  timeline.window = { start: 0, end: 12 };
  changed();
  drawTimeline();
};

studio.livePieces = () => liveRows(live).pieces;

/** The motion that is shown. */
studio.motion = () => (studio.mode === "live" ? live.motion() : multiPrompt.shown);

studio.editor = () => {
  const model = studio.models.find((one) => one.abilities?.includes("edit"));
  return { name: model?.name ?? "", id: model?.id ?? "" };
};

studio.seek = (second) => {
  if (studio.mode === "live") live.seek(second);
  else studio.player.seek(second);
  studio.autosave?.changed();
  changed();
};

studio.play = () => {
  if (studio.mode === "timeline") studio.player.toggle();
  else if (live.state === "paused") live.resume();
  else if (live.state === "stopped" || live.state === "ended") live.restart();
  else live.pause();
  changed();
};

studio.step = (frames) => {
  if (studio.mode === "live") live.seek((Math.round(live.time * live.fps) + frames) / live.fps);
  else studio.player.step(frames);
  timeline.reveal(studio.time());
  changed();
};

studio.time = () => (studio.mode === "live" ? live.time : studio.player.time);

const frameAt = (second) => Math.round(second * (multiPrompt.shown?.fps ?? 20));

/** Marks frames between two seconds. */
studio.mark = (from, to) => {
  const frames = multiPrompt.shown?.frames ?? 0;
  if (studio.mode === "timeline")
    act({ type: "span", span: [frameAt(from), frameAt(to)].map((frame) => Math.min(frame, frames)) });
};

// A span starts or ends at the play head; without another end it is one second long.
const markedAt = (end) => (studio.state.span ? studio.state.span[end] / (multiPrompt.shown?.fps ?? 20) : -1);
studio.markIn = () => studio.mark(studio.time(), markedAt(1) > studio.time() ? markedAt(1) : studio.time() + 1);
studio.markOut = () => {
  const from = markedAt(0);
  studio.mark(from >= 0 && from < studio.time() ? from : Math.max(0, studio.time() - 1), studio.time());
};

/** The live prompts, as blocks on the timeline. */
studio.toTimeline = () => {
  const project = liveProject(live, studio.state.project);
  if (!project.blocks.length) return tell("there is no live motion yet", true);
  act({ type: "open", project });
  studio.setMode("timeline");
};

const timeline = (studio.timeline = new Timeline($("timeline"), {
  seek: studio.seek,
  select: (id) => act({ type: "select", id }),
  edit: (id, prompt) => act({ type: "edit", id, prompt }),
  resize: (id, length) => act({ type: "resize", id, seconds: length, step: live.blockFrames / live.fps }),
  remove: (id) => act(id === "import" ? { type: "importMotion", motion: null } : { type: "remove", id }),
  move: (id, index) => act({ type: "move", id, index }),
  add: (prompt) => {
    if (studio.state.project.blocks.length >= MOST_BLOCKS)
      tell(`there are ${MOST_BLOCKS} blocks, the maximum`, true);
    else act({ type: "add", prompt });
  },
  span: studio.mark,
  explain: (id) => {
    explained = null; // again, also after its line was closed
    if (studio.mode === "live") live.remarked(id);
    else act({ type: "select", id });
  },
  typing: (field, take) => studio.ideas.attach(field, take),
  drawn: () => studio.desk?.draw(),
}));
const desk = (studio.desk = new Desk(studio));

listen({
  play: studio.play,
  step: studio.step,
  home: () => {
    studio.seek(0);
    timeline.reveal(0);
  },
  end: () => {
    studio.seek(studio.end());
    timeline.reveal(studio.time());
  },
  ...selected.keys,
  remove: () => {
    if (tool.active && tool.chosen >= 0) tool.remove();
    else if (!tool.active && !desk.remove()) removeSelected();
  },
  undo: () => act({ type: "undo" }),
  redo: () => act({ type: "redo" }),
  markIn: () => studio.markIn(),
  markOut: () => studio.markOut(),
  unmark: () => (tool.active ? tool.end() : desk.escape() || act({ type: "span", span: null })),
  help: () => $("help-panel").showModal(),
  control: desk.control,
  letters: { ...desk.letters, n: () => studio.toggleDrawer(), f: () => studio.centre(), 1: () => studio.lookFrom("front"),
    3: () => studio.lookFrom("side"), 7: () => studio.lookFrom("top") }, // prettier-ignore
});

function removeSelected() {
  if (studio.mode === "timeline" && studio.state.selected !== null) act({ type: "remove", id: studio.state.selected });
}

studio.end = () => (studio.mode === "live" ? live.played : studio.player.last);

const panels = (studio.panels = new Panels({
  state: () => studio.state,
  act,
  multiPrompt,
  tell,
  forget,
  load: (file) => studio.characters.load(file),
  character: () => studio.characters.current,
  motion: studio.motion,
  livePieces: () => studio.livePieces(),
  mode: () => studio.mode,
  tool: () => tool,
  editor: studio.editor,
  models: () => studio.models,
}));
new Sampling(studio);
studio.characters = new Characters(studio);
studio.ideas = new Ideas($("ideas"), (words) =>
  api.suggestions(studio.mode === "live" ? (live.model?.name ?? "") : studio.state.project.model.name, words),
);
bind(studio);
layOut(studio);
const guide = (studio.guide = new Guide(studio));
expose(studio);

function drawTimeline() {
  timeline.draw(studio.mode === "live" ? liveRows(live) : timelineRows(studio.state, multiPrompt, studio.player.time));
}

function drawAll(passed) {
  const before = studio.time(),
    motion = multiPrompt.shown;
  if (studio.mode === "live") live.tick(passed);
  else {
    if (motion !== studio.loaded) studio.player.load(motion);
    studio.loaded = motion;
    studio.player.tick(passed);
  }
  const moved = studio.time() !== before,
    other = moved || studio.dirty || studio.laidAgain;
  if (moved && (studio.mode === "timeline" ? studio.player.playing : live.state === "running"))
    timeline.reveal(studio.time());
  if (moved || studio.dirty) {
    drawTimeline();
    if (!$("curves").hidden) showCurves(studio);
  }
  if (studio.dirty) {
    panels.draw();
    guide.look();
    explain(studio.state.selected);
  }
  studio.status(moved || studio.dirty);
  studio.dirty = false;
  if (studio.view) picture(studio, passed, other);
}

let last = performance.now();
function tick(now) {
  const passed = Math.min(Math.max(now - last, 0) / 1000, LONGEST_FRAME);
  last = now;
  drawAll(passed);
  requestAnimationFrame(tick);
}

let watching = false;

// Polls the loading progress of the models until all are ready; runs again after the studio has restarted.
async function watchModels() {
  if (watching) return;
  watching = true;
  do {
    try {
      studio.models = await api.models();
      studio.modelsChanged();
    } catch {
      break; // the stream notices when the studio is back
    }
    if (studio.models.every((model) => ["ready", "failed"].includes(model.state))) break;
    await new Promise((done) => setTimeout(done, POLL_MODELS));
  } while (true);
  watching = false;
}

async function begin() {
  await restoreSession(studio);
  live.connect();
  watchModels();
  requestAnimationFrame(tick);
  try {
    studio.view = new View($("stage"), await api.body(), document.documentElement.dataset.theme === "dark");
    Object.assign(studio.view.options, studio.look());
    await studio.characters.restore();
    changed();
    if (!studio.state.project.blocks.length) guide.offer();
  } catch (error) {
    tell(
      /webgl/i.test(error.message)
        ? `the picture needs WebGL, which this browser does not offer (${error.message})`
        : error.message,
      true,
    );
  }
}
begin();
