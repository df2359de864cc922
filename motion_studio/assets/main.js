// The page: what belongs together is joined here, and drawn sixty times a second.
import * as api from "./api.js";
import { bind } from "./controls.js";
import { pathOf, pointsOf } from "./control.js";
import { showCurves } from "./curves.js";
import { PathTool } from "./draw.js";
import { Ideas } from "./ideas.js";
import { listen } from "./keys.js";
import { Live } from "./live.js";
import { Notes } from "./notes.js";
import { Panels } from "./panels.js";
import { Player } from "./player.js";
import { picture } from "./picture.js";
import { liveRows, saidProject, storyRows } from "./rows.js";
import { Sampling } from "./sampling.js";
import { restoreSession } from "./session.js";
import { MOST_BLOCKS, initial, reduce } from "./state.js";
import { Story } from "./story.js";
import { expose } from "./testing.js";
import { Timeline } from "./timeline.js";
import { View } from "./view.js";

const $ = (id) => document.getElementById(id);
const CHANGED_AFTER = 300; // milliseconds after the last change that a motion is made again
const LONGEST_FRAME = 1; // seconds between two drawings that the clock takes for played; a hidden tab draws nothing
const ASKED_AGAIN = 1000; // milliseconds between two questions how far the models are

const notes = new Notes($("told"));
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
const tell = (sentence, error, topic) => notes.tell(sentence, error, topic);
const forget = (topic) => notes.forget(topic);
const changed = () => {
  studio.dirty = true;
};
const live = (studio.live = new Live(api.token, {
  tell,
  changed,
  forget,
  reach: api.reach,
  started: () => {
    // Behind the timeline the live motion waits.
    if (studio.mode !== "story") return;
    live.pause();
    studio.wasRunning = true;
  },
  back: () => {
    watchModels();
    makeSoon();
  },
  replaced: () => tool.active || studio.follow(), // a path that is being drawn is sent when it is done
}));
const story = (studio.story = new Story(api, { tell, forget, changed, state: () => studio.state, act }));
let waiting = null;

// Every change goes through here; the motion of a changed project is made soon, if the user wants that.
function act(action) {
  const before = studio.state;
  studio.state = reduce(before, action);
  changed();
  drawTimeline();
  studio.keeper?.changed();
  if (studio.state.project === before.project || ["model", "restore"].includes(action.type)) return;
  // The live body does what is seen.
  const other = pathOf(before.project.control) !== pathOf(studio.state.project.control);
  if (other && ["undo", "redo"].includes(action.type) && studio.mode === "live" && !tool.active) studio.follow();
  makeSoon();
}
studio.act = act;

// While a path is drawn, nothing is made of half of it.
studio.makeSoon = makeSoon;
function makeSoon() {
  const { blocks, past } = studio.state.project;
  clearTimeout(waiting);
  if ($("auto").checked && (blocks.length || past) && story.stale && !studio.tool.active)
    waiting = setTimeout(() => story.make(), CHANGED_AFTER);
}

const tool = (studio.tool = new PathTool($("stage"), {
  view: () => studio.view,
  points: () => pointsOf(studio.state.project.control),
  change: (points) => act({ type: "path", points }),
  changed,
  tell,
  // A live body waits for its path.
  began: () => {
    studio.waits = studio.mode === "live" && live.state === "running";
    if (studio.waits) live.pause();
  },
  ended: () => {
    changed();
    if (studio.mode === "story") return makeSoon();
    studio.follow();
    if (studio.waits) live.resume();
  },
}));

/** The live body goes along the path that is drawn. */
studio.follow = () => {
  if (live.connected) live.follow(pathOf(studio.state.project.control));
  else tell("the studio is not connected; the path stays here until it is", true);
};

/** The body is as it is shown now at that time, wherever it is then. */
studio.keepPose = () => {
  const motion = story.shown;
  if (!motion) return tell("there is no motion yet to keep a pose of; make one first", true);
  if (motion.count !== studio.view?.body.rest.length) return tell("this motion's joints are not those of the body", true);
  const { frame } = studio.player,
    first = 3 * frame * motion.count;
  const joints = Array.from({ length: motion.count }, (_, j) =>
    [...motion.joints.subarray(first + 3 * j, first + 3 * j + 3)].map((value) => Math.round(value * 1e4) / 1e4),
  );
  const before = studio.state;
  act({ type: "pose", time: Math.round((frame / motion.fps) * 1000) / 1000, joints });
  if (studio.state === before) tell("there are as many poses as there may be", true);
};

studio.setMode = (mode) => {
  if (mode === studio.mode) return;
  if (tool.active) tool.end();
  studio.mode = document.body.dataset.mode = mode;
  for (const name of ["live", "story"]) $(`mode-${name}`).setAttribute("aria-selected", String(name === mode));
  if (mode === "story" && live.state === "running") {
    live.pause();
    studio.wasRunning = true;
  } else if (mode === "live" && studio.wasRunning) {
    live.resume();
    studio.wasRunning = false;
  }
  if (mode === "story") studio.player.load(story.shown);
  studio.ideas.forget();
  studio.keeper?.changed();
  timeline.window = { start: 0, end: 12 };
  changed();
  drawTimeline();
};

studio.livePieces = () => liveRows(live).pieces;

/** The motion that is on the screen. */
studio.motion = () => (studio.mode === "live" ? live.motion() : story.shown);

studio.editor = () => {
  const model = studio.models.find((one) => one.abilities?.includes("edit"));
  return { name: model?.name ?? "", id: model?.id ?? "" };
};

studio.seek = (second) => {
  if (studio.mode === "live") live.seek(second);
  else studio.player.seek(second);
  studio.keeper?.changed();
  changed();
};

studio.play = () => {
  if (studio.mode === "story") studio.player.toggle();
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

const frameAt = (second) => Math.round(second * (story.shown?.fps ?? 20));

/** Marks frames between two seconds. */
studio.mark = (from, to) => {
  const frames = story.shown?.frames ?? 0;
  if (studio.mode === "story")
    act({ type: "span", span: [frameAt(from), frameAt(to)].map((frame) => Math.min(frame, frames)) });
};

// From the play head to where the span ends, or a second; up to the play head from where it begins, or a second before.
const markedAt = (end) => (studio.state.span ? studio.state.span[end] / (story.shown?.fps ?? 20) : -1);
studio.markIn = () => studio.mark(studio.time(), markedAt(1) > studio.time() ? markedAt(1) : studio.time() + 1);
studio.markOut = () => {
  const from = markedAt(0);
  studio.mark(from >= 0 && from < studio.time() ? from : Math.max(0, studio.time() - 1), studio.time());
};

/** The live prompts, as blocks on the timeline. */
studio.toTimeline = () => {
  const said = saidProject(live, studio.state.project);
  if (!said.blocks.length) return tell("nothing has been made yet", true);
  act({ type: "open", project: said });
  studio.setMode("story");
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
      tell(`there are ${MOST_BLOCKS} blocks, which is the most`, true);
    else act({ type: "add", prompt });
  },
  span: studio.mark,
  typing: (field, take) => studio.ideas.attach(field, take),
}));

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
  remove: () => {
    if (tool.active && tool.chosen >= 0) tool.remove();
    else if (!tool.active) removeSelected();
  },
  undo: () => act({ type: "undo" }),
  redo: () => act({ type: "redo" }),
  markIn: () => studio.markIn(),
  markOut: () => studio.markOut(),
  unmark: () => (tool.active ? tool.end() : act({ type: "span", span: null })),
});

function removeSelected() {
  if (studio.mode === "story" && studio.state.selected !== null) act({ type: "remove", id: studio.state.selected });
}

studio.end = () => (studio.mode === "live" ? live.played : studio.player.last);

const panels = (studio.panels = new Panels({
  state: () => studio.state,
  act,
  story,
  tell,
  forget,
  motion: studio.motion,
  livePieces: () => studio.livePieces(),
  mode: () => studio.mode,
  tool: () => tool,
  editor: studio.editor,
  models: () => studio.models,
}));
new Sampling(studio);
studio.ideas = new Ideas($("ideas"), (words) =>
  api.suggestions(studio.mode === "live" ? (live.model?.name ?? "") : studio.state.project.model.name, words),
);
bind(studio);
expose(studio);

function drawTimeline() {
  timeline.draw(studio.mode === "live" ? liveRows(live) : storyRows(studio.state, story, studio.player.time));
}

function drawAll(passed) {
  const before = studio.time(),
    motion = story.shown;
  if (studio.mode === "live") live.tick(passed);
  else {
    if (motion !== studio.loaded) studio.player.load(motion);
    studio.loaded = motion;
    studio.player.tick(passed);
  }
  const moved = studio.time() !== before,
    other = moved || studio.dirty || studio.laidAgain;
  if (moved && (studio.mode === "story" ? studio.player.playing : live.state === "running"))
    timeline.reveal(studio.time());
  if (moved || studio.dirty) {
    drawTimeline();
    if (!$("curves").hidden) showCurves(studio);
  }
  if (studio.dirty) panels.draw();
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

// Asks how far the models are until all are ready; once more when the studio was started again.
async function watchModels() {
  if (watching) return;
  watching = true;
  do {
    try {
      studio.models = await api.models();
      studio.modelsCame();
    } catch {
      break; // the stream finds out when the studio is back
    }
    if (studio.models.every((model) => ["ready", "failed"].includes(model.state))) break;
    await new Promise((done) => setTimeout(done, ASKED_AGAIN));
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
    changed();
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
