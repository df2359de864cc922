// The parts of the studio's page that need no browser; tests/studio/server/test_page_parts.py runs this beside copies of them.
import assert from "node:assert/strict";
import { test } from "node:test";

import { asJson, curve, drawn, lengthOf, movedWith, named, offText, pathOf, pointsOf } from "./control.js";
import { poseAt, unpackFigure } from "./stick_figures.js";
import { matching } from "./ideas.js";
import { Live } from "./live.js";
import { socketAddress } from "./stream.js";
import { contacts, curves, footprints, fromJson, isEdited, part, toJson } from "./motion.js";
import { Player } from "./player.js";
import { liveRows, liveProject, timelineRows } from "./timeline_rows.js";
import { STEPS_OF_PROMPTS, leftOut, read, readSeed } from "./sampling.js";
import { between, indexAt, panned, showing, zoomed } from "./scale.js";
import { initial, keyOf, placed, reduce, saved, snapped } from "./state.js";
import { MultiPrompt, joined } from "./multi_prompt.js";
import { legendOf, liveDetails, liveText, remarkOf, statusOf, stepsText, workText } from "./messages.js";
import { shares } from "./shares.js";

const acted = (...actions) => actions.reduce(reduce, initial());
const three = () =>
  acted({ type: "add", prompt: "walk" }, { type: "add", prompt: " wave " }, { type: "add", prompt: "sit" });
const words = (state) => state.project.blocks.map((block) => block.prompt);

test("a stream is beside the page, also below a path", () => {
  assert.equal(socketAddress(new URL("v1/stream", "https://hub.example/a/api.js"), "a b"), "wss://hub.example/a/v1/stream?token=a%20b");
  assert.equal(socketAddress(new URL("v1/stream", "http://127.0.0.1:8765/api.js"), "t"), "ws://127.0.0.1:8765/v1/stream?token=t");
});

test("blocks are added, edited, moved, sized and removed", () => {
  let state = three();
  assert.deepEqual(words(state), ["walk", "wave", "sit"]);
  assert.equal(state.selected, 3);
  state = reduce(state, { type: "edit", id: 2, prompt: "kick" });
  state = reduce(state, { type: "move", id: 3, index: 0 });
  assert.deepEqual(words(state), ["sit", "walk", "kick"]);
  state = reduce(state, { type: "resize", id: 1, seconds: 4.27 });
  assert.equal(state.project.blocks[1].seconds, 4.2);
  state = reduce(state, { type: "remove", id: 3 });
  assert.deepEqual(words(state), ["walk", "kick"]);
  assert.equal(state.selected, null);
  assert.deepEqual(
    placed(state.project).map(({ start, end }) => [start, end]),
    [
      [0, 4.2],
      [4.2, 7.2],
    ],
  );
});

test("what changes nothing is no step to undo", () => {
  const state = three();
  for (const action of [
    { type: "edit", id: 2, prompt: "wave" },
    { type: "edit", id: 2, prompt: "  " },
    { type: "add", prompt: "" },
    { type: "move", id: 1, index: 0 },
    { type: "resize", id: 1, seconds: 3 },
    { type: "resize", id: 1, seconds: NaN },
    { type: "remove", id: 99 },
    { type: "choose", take: 7 },
    { type: "removeTake", take: 0 },
    { type: "dropEdits", take: 0, keep: () => true },
  ]) {
    assert.equal(reduce(state, action), state, JSON.stringify(action));
  }
});

test("undo and redo go through every state, and a new change ends redo", () => {
  const states = [initial()];
  for (const action of [
    { type: "add", prompt: "walk" },
    { type: "resize", id: 1, seconds: 6 },
    { type: "addTake", seed: 5 },
    { type: "remove", id: 1 },
  ])
    states.push(reduce(states.at(-1), action));
  let state = states.at(-1);
  for (const before of states.slice(0, -1).reverse()) {
    state = reduce(state, { type: "undo" });
    assert.deepEqual(state.project, before.project);
  }
  assert.equal(reduce(state, { type: "undo" }), state);
  for (const after of states.slice(1)) {
    state = reduce(state, { type: "redo" });
    assert.deepEqual(state.project, after.project);
  }
  state = reduce(reduce(state, { type: "undo" }), { type: "add", prompt: "run" });
  assert.equal(state.future.length, 0);
});

test("a project is saved without what only the page knows, and opens as it was", () => {
  const state = three(),
    file = saved(state.project);
  assert.deepEqual(file.blocks[0], { prompt: "walk", seconds: 3 });
  assert.equal(file.format, "motion_jax project");
  const opened = reduce(state, { type: "open", project: JSON.parse(JSON.stringify(file)) });
  assert.deepEqual(saved(opened.project), file);
  assert.equal(new Set([...state.project.blocks, ...opened.project.blocks].map((block) => block.id)).size, 6);
  assert.deepEqual(reduce(opened, { type: "undo" }).project, state.project);
});

test("takes keep their own edits", () => {
  const edit = (take) => ({
    take,
    prompt: "kick",
    change: [[0, 9]],
    seed: 0,
    sampling: {},
    model: { name: "", id: "" },
  });
  let state = acted(
    { type: "addTake", seed: 1 },
    { type: "addTake", seed: 2 },
    { type: "addEdit", edit: edit(0) },
    { type: "addEdit", edit: edit(2) },
  );
  assert.notEqual(keyOf(state.project, 2), keyOf({ ...state.project, edits: [] }, 2));
  assert.equal(keyOf(state.project, 1), keyOf({ ...state.project, edits: [] }, 1));
  state = reduce(state, { type: "removeTake", take: 1 });
  assert.deepEqual(state.project.seeds, [0, 2]);
  assert.deepEqual(
    state.project.edits.map((one) => one.take),
    [0, 1],
  );
  assert.equal(state.project.chosen, 1);
});

test("a span is put the right way round, and an empty one is none", () => {
  assert.deepEqual(acted({ type: "span", span: [9, 3] }).span, [3, 9]);
  assert.equal(acted({ type: "span", span: [3, 3] }).span, null);
});

test("lengths go by the model's blocks and are never nothing", () => {
  assert.deepEqual(
    [0, -3, 0.7, 0.95, 500].map((s) => snapped(s)),
    [0.6, 0.6, 0.6, 1.2, 120],
  );
});

test("the scale zooms around a second, pans, shows and marks", () => {
  const wide = zoomed({ start: 2, end: 12 }, 2, 4);
  assert.equal((4 - wide.start) / (wide.end - wide.start), 0.2);
  assert.equal(zoomed({ start: 0, end: 1 }, 1e-9, 0).end, 0.5);
  assert.deepEqual(panned({ start: 1, end: 5 }, -3), { start: 0, end: 4 });
  const { start, end } = showing({ start: 0, end: 10 }, 14);
  assert.ok(start <= 14 && 14 <= end && end - start === 10);
  assert.equal(between({ start: 0, end: 12 }, 1000), 1);
  const rows = placed(three().project);
  assert.deepEqual(
    [0, 4, 8.9].map((second) => indexAt(rows, 1, second)),
    [0, 0, 2],
  );
});

const motion = (frames, place) => ({
  fps: 20,
  frames,
  count: 22,
  joints: Float32Array.from({ length: frames * 66 }, (_, k) =>
    place(Math.floor(k / 66), Math.floor(k / 3) % 22, k % 3),
  ),
});

test("a motion goes to the studio and back bit for bit", () => {
  const one = motion(7, (t, j, k) => Math.sin(t + 3 * j + k));
  const back = fromJson(toJson(one));
  assert.deepEqual(back.joints, one.joints);
  assert.deepEqual(part(back, 2, 5).joints, one.joints.slice(132, 330));
  assert.equal(toJson(back), back.sent);
});

test("feet that stand are found, and leave prints", () => {
  const walk = motion(40, (t, j, k) => (k === 2 && t >= 20 ? (t - 20) * 0.1 : 0));
  const stands = contacts(walk),
    prints = footprints(walk, stands);
  assert.equal(stands[4 * 5], 1);
  assert.equal(stands[4 * 35], 0);
  assert.deepEqual(
    prints.map((print) => [print.first, print.left]),
    [
      [0, true],
      [0, false],
    ],
  );
  assert.ok(Math.abs(prints[0].past - 20) <= 2);
});

test("curves tell speed, feet, jerk and heading", () => {
  const turning = motion(60, (t, j, k) => {
    const angle = (t / 59) * 4 * Math.PI,
      side = j === 1 ? 0.1 : j === 2 ? -0.1 : 0; // two whole turns
    return k === 0 ? side * Math.cos(angle) : k === 1 ? 0.02 : t * 0.05 - side * Math.sin(angle);
  });
  const found = curves(turning),
    last = (name) => found[name].lines[0].at(-1);
  assert.ok(Math.abs(last("speed") - 1) < 1e-4);
  assert.ok(Math.abs(last("feet") - 0.02) < 1e-6);
  assert.ok(Math.abs(last("heading") - 720) < 1e-3, String(last("heading")));
  assert.ok(Math.max(...curves(motion(30, (t, j, k) => t * t * 0.01)).jerk.lines[0]) < 0.05);
  assert.deepEqual(
    [0, 2, 5].map((t) => isEdited({ meta: { made: [[2, 4]] } }, t)),
    [false, true, false],
  );
  assert.equal(isEdited({ meta: {} }, 0), null);
});

test("the player plays, stops at the end, begins again, steps and repeats", () => {
  const player = new Player();
  player.toggle();
  assert.equal(player.playing, false); // nothing is there
  player.load({ frames: 21, fps: 20 });
  player.toggle();
  player.tick(0.5);
  assert.equal(player.frame, 10);
  player.tick(9);
  assert.deepEqual([player.playing, player.frame], [false, 20]);
  player.toggle();
  assert.deepEqual([player.playing, player.frame], [true, 0]);
  player.step(-1);
  assert.deepEqual([player.playing, player.frame], [false, 0]);
  player.step(10);
  assert.equal(player.frame, 10);
  player.repeat = player.playing = true;
  player.tick(0.75);
  assert.ok(player.playing && player.time < 0.3);
});

const LINE = { fps: 20, skeleton: "humanml3d", captions: [], meta: {} };
const sent = (frames) => ({ ...LINE, ...toJson(motion(frames, () => 0)) });

function studio(refuse = () => null) {
  let state = initial();
  const asked = [],
    notes = [];
  const api = {
    multiPrompt: async (request) => {
      asked.push(["timeline", request.segments.map((block) => block.prompt), request.seed]);
      if (refuse(request)) throw new Error(refuse(request));
      return { motion: sent(20 * request.segments.length), reused_frames: 0, same_frames: 0 };
    },
    edit: async (request) => {
      assert.deepEqual(request.without, []);
      asked.push(["edit", request.prompt]);
      return { motion: request.motion, made: request.change };
    },
  };
  const act = (action) => {
    state = reduce(state, action);
  };
  const multiPrompt = new MultiPrompt(api, { tell: (text) => notes.push(text), forget: () => {}, changed: () => {}, state: () => state, act });
  return { multiPrompt, act, asked, notes, state: () => state };
}

test("a multiPrompt is made once, undo shows what there was, an edit does not make it again", async () => {
  const { multiPrompt, act, asked, state } = studio();
  act({ type: "add", prompt: "walk" });
  await multiPrompt.make();
  act({ type: "add", prompt: "wave" });
  assert.ok(multiPrompt.stale && multiPrompt.shown.frames === 20); // what there was is still shown
  await multiPrompt.make();
  act({ type: "undo" });
  assert.ok(!multiPrompt.stale && multiPrompt.shown.frames === 20);
  await multiPrompt.make();
  act({
    type: "addEdit",
    edit: { take: 0, prompt: "kick", change: [[2, 8]], seed: 0, sampling: {}, model: { name: "" } },
  });
  await multiPrompt.make();
  assert.deepEqual(asked, [
    ["timeline", ["walk"], 0],
    ["timeline", ["walk", "wave"], 0],
    ["edit", "kick"],
  ]);
  assert.deepEqual(multiPrompt.shown.meta.made, [[2, 8]]);
  assert.deepEqual(
    multiPrompt.pieces().map((piece) => piece.kind),
    ["kept", "new"],
  );
  assert.equal(state().project.edits.length, 1);
});

test("the share of a request rises within a part, counted or estimated", () => {
  const share = shares("edit", () => 0),
    at = (seconds, more = {}) => share.of({ doing: "compiling, which", done: 0, of: 0, seconds, ...more });
  const found = [1, 5, 30, 88].map((seconds) => at(seconds));
  assert.ok(found.every((value, i) => value > (found[i - 1] ?? 0) && value < 1), String(found));
  assert.equal(at(90, { doing: "drawing", done: 3, of: 12 }), 0.25);
  assert.equal(at(91, { doing: "drawing", done: 1, of: 12 }), 0.25);
});

test("a block's note has one line and the caption to use instead, and stays with the motion", async () => {
  assert.equal(remarkOf({ notes: [], unknown: [] }), null);
  assert.deepEqual(remarkOf({ notes: ["a", "b"], unknown: ["yodels"], nearest: "sings" }), {
    text: "a\nb", short: "the model has not learned: yodels", nearest: "sings" }); // prettier-ignore
  const { multiPrompt, act, notes, state } = studio(),
    made = multiPrompt.api.multiPrompt;
  multiPrompt.api.multiPrompt = async (request) => ({ ...(await made(request)),
    segments: request.segments.map(({ prompt }) => (prompt === "yodel" ? { notes: ["odd"], unknown: [], nearest: "sing" } : {})) }); // prettier-ignore
  act({ type: "add", prompt: "walk" });
  act({ type: "add", prompt: "yodel" });
  await multiPrompt.make();
  const marks = () => timelineRows(state(), multiPrompt, 0).rows.map(({ remark }) => remark?.nearest ?? "");
  assert.deepEqual(marks(), ["", "sing"]);
  assert.deepEqual(notes, []); // nothing covers the body
  act({ type: "edit", id: 2, prompt: "sing" });
  assert.deepEqual(marks(), ["", ""]);
  act({ type: "undo" });
  const other = studio();
  other.act({ type: "restore", state: structuredClone(state()) });
  other.multiPrompt.restore(structuredClone(multiPrompt.toKeep().rows));
  assert.equal(other.multiPrompt.remark("yodel").nearest, "sing");
});

test("a motion that is cancelled is not reported, and the rest of the takes is left", async () => {
  const { multiPrompt, act, notes, asked } = studio();
  act({ type: "add", prompt: "walk" });
  act({ type: "addTake", seed: 1 });
  multiPrompt.api.multiPrompt = (request, report, signal) =>
    new Promise((_, failed) => {
      asked.push(request.seed);
      signal.addEventListener("abort", () => failed(Object.assign(new Error("cancelled"), { cancelled: true })));
    });
  const making = multiPrompt.make([0, 1]);
  multiPrompt.cancel();
  await making;
  assert.deepEqual([notes, asked, multiPrompt.busy, multiPrompt.stale], [[], [0], null, true]);
});

test("a refusal is reported and loses nothing", async () => {
  const { multiPrompt, act, notes } = studio(({ segments }) => (segments.length > 1 ? "too long" : null));
  await multiPrompt.make();
  assert.match(notes[0], /timeline is empty/);
  act({ type: "add", prompt: "walk" });
  await multiPrompt.make();
  act({ type: "add", prompt: "wave" });
  await multiPrompt.make();
  assert.equal(notes.at(-1), "too long");
  assert.ok(multiPrompt.shown.frames === 20 && multiPrompt.busy === null && multiPrompt.stale);
});

test("what was removed while a motion was made is not made, and nothing is shown of an empty timeline", async () => {
  const { multiPrompt, act, notes } = studio();
  act({ type: "add", prompt: "walk" });
  const making = multiPrompt.make();
  act({ type: "edit", id: 1, prompt: "run" });
  multiPrompt.make(); // behind the one that runs
  act({ type: "remove", id: 1 });
  await making;
  assert.deepEqual(notes, []);
  assert.equal(multiPrompt.shown, null);
});

test("an edit beyond the end is removed and reported", async () => {
  const { multiPrompt, act, notes, state } = studio();
  act({ type: "add", prompt: "walk" });
  act({
    type: "addEdit",
    edit: { take: 0, prompt: "kick", change: [[2, 80]], seed: 0, sampling: {}, model: { name: "" } },
  });
  await multiPrompt.make();
  assert.ok(!multiPrompt.stale && state().project.edits.length === 0 && /beyond the end/.test(notes[0]));
});

test("spans that meet are joined", () => {
  assert.deepEqual(
    joined([
      [5, 9],
      [0, 2],
      [8, 12],
      [2, 3],
    ]),
    [
      [0, 3],
      [5, 12],
    ],
  );
});

function live() {
  const notes = [],
    said = [],
    nothing = () => {},
    page = new Live("ws://studio/v1/stream", { tell: (text) => notes.push(text), forget: nothing, changed: nothing, started: nothing });
  page.stream = { send: (message) => said.push(message) };
  page.connected = true;
  page.message({
    type: "started",
    run: 1,
    fps: 20,
    joints: Array(22).fill("j"),
    parents: [],
    block_frames: 12,
    seed: 4,
  });
  page.message({ type: "words", words: 1, prompt: "walk", from_frame: 0, unknown: [] });
  page.message({ type: "state", state: "running" });
  const block = (sequence, run = 1) =>
    page.block({
      sequence,
      run,
      firstFrame: 12 * sequence,
      frames: 12,
      joints: 22,
      committed: 12 * sequence + 12,
      begun: 12 * sequence + 24,
      milliseconds: 9,
      positions: new Float32Array(12 * 66).fill(sequence),
      contacts: new Uint8Array(48),
    });
  return { page, notes, said, block };
}

test("a stream is played by the page's clock and acknowledged when it has been", () => {
  const { page, said, block } = live();
  page.tick(1);
  assert.equal(page.time, 0); // nothing has come
  block(0);
  block(1);
  block(7, 0); // of an older run
  assert.equal(page.end, 24);
  page.tick(0.5);
  assert.deepEqual(said, []);
  page.tick(0.1);
  assert.deepEqual(said, [{ type: "ack", sequence: 0 }]);
  page.tick(5);
  assert.deepEqual([page.missed, page.time * 20], [1, 23]);
  page.tick(1);
  assert.equal(page.missed, 1); // one gap is counted once
});

test("new words count from their frame on, and looking back moves nothing", () => {
  const { page, said, block } = live();
  for (let i = 0; i < 4; i++) block(i);
  page.say("wave");
  page.message({
    type: "words",
    words: 2,
    prompt: "wave",
    from_frame: 24,
    unknown: ["xyzzy"],
    nearest: "a person waves",
  });
  page.tick(1.0);
  assert.equal(page.at(20).prompt, "walk");
  page.tick(0.5);
  assert.equal(page.at(30).prompt, "wave");
  assert.ok(page.latency >= 0);
  page.seek(0.2);
  assert.ok(said.some((message) => message.type === "pause") && page.played === 1.5 && page.time === 0.2);
  page.message({ type: "state", state: "running" });
  page.tick(0.1);
  assert.ok(Math.abs(page.time - 1.6) < 1e-9);
  assert.deepEqual(
    page.motion().captions.map(({ text, start, end }) => [text, start, end]),
    [
      ["walk", 0, 1.2],
      ["wave", 1.2, 2.4],
    ],
  );
});

test("what was not played of an older run is acknowledged when another one begins", () => {
  const { page, said, block } = live();
  block(0);
  block(1);
  page.message({ type: "started", run: 2, sequence: 2, fps: 20, joints: Array(22).fill("j"), parents: [], block_frames: 12 });
  assert.deepEqual(said, [{ type: "ack", sequence: 1 }]);
  assert.equal(page.end, 0);
});

test("a refused prompt is reported and is not the one that a restart uses", () => {
  const { page, notes } = live();
  page.say("x".repeat(10_000));
  page.message({ type: "error", message: "got a prompt of 10,000 characters, expected at most 1,000", fatal: false });
  assert.equal(page.choices.prompt, "walk");
  assert.deepEqual(notes, ["got a prompt of 10,000 characters, expected at most 1,000"]);
  assert.equal(page.pendingPrompt, null);
});

test("other choices of sampling count once the studio has begun with them", () => {
  const { page, said, block } = live();
  page.begin({ model: "other", seed: 7, sampling: { num_steps: 9 } });
  assert.deepEqual([said[0].type, said[0].prompt, said[0].seed, said[0].sampling], ["start", "walk", 7, { num_steps: 9 }]);
  page.message({ type: "error", message: "got num_steps 9", fatal: false });
  page.message({ type: "words", words: 2, prompt: "wave", from_frame: 12, unknown: [] });
  assert.deepEqual([page.choices.seed, page.choices.sampling], [4, undefined]); // refused, so all is as it was
  page.begin({ model: "other", seed: 7, sampling: { num_steps: 10 } });
  page.message({ type: "started", run: 2, seed: 7, fps: 20, joints: Array(22).fill("j"), parents: [], block_frames: 12 });
  page.message({ type: "words", words: 3, prompt: "wave", from_frame: 0, unknown: [] });
  assert.deepEqual([page.choices.seed, page.choices.sampling], [7, { num_steps: 10 }]);
  page.run = 1;
  block(0);
  const made = liveProject(page, { ...initial().project, cleanup: false, edits: [{}] });
  assert.deepEqual([made.seeds, made.sampling, made.cleanup, made.edits], [[7], { num_steps: 10 }, true, []]);
});

test("steps that are left out go to the requests that have them", () => {
  assert.deepEqual(leftOut(["warn", "check"], STEPS_OF_PROMPTS), ["warn"]);
  assert.deepEqual(leftOut(["warn", "check", "new"]), ["warn", "check"]);
  assert.deepEqual(leftOut(undefined), []); // a project of an earlier page
  const state = acted({ type: "add", prompt: "walk" }, { type: "set", fields: { without: ["check"] } });
  assert.deepEqual(saved(state.project).without, ["check"]);
  assert.notEqual(keyOf(state.project), keyOf({ ...state.project, without: [] }));
});

test("numbers of sampling are read, and other text is reported", () => {
  assert.deepEqual([read("steps", ""), read("guidance", " 2.5 "), readSeed("4294967295")], [null, 2.5, 4294967295]);
  assert.throws(() => read("steps", "many"), /got steps many, expected a number/);
  for (const text of ["", "-1", "1.5", "4294967296", "x"]) assert.throws(() => readSeed(text), /seed/);
});

test("the timeline of a stream shows what was said, what is there and what is under way", () => {
  const { page, block } = live();
  block(0);
  page.message({ type: "words", words: 2, prompt: "wave", from_frame: 18, unknown: [] });
  page.message({ type: "words", words: 3, prompt: "sit", from_frame: 90, unknown: [] });
  const { rows, pieces, fixed } = liveRows(page);
  assert.deepEqual(
    rows.map(({ prompt, start, end }) => [prompt, start, end]),
    [
      ["walk", 0, 0.9],
      ["wave", 0.9, 1.2],
    ],
  );
  assert.deepEqual(
    pieces.map(({ start, end, kind }) => [start, end, kind]),
    [
      [0, 0.6, "there"],
      [0.6, 1.2, "flight"],
    ],
  );
  assert.ok(fixed);
});

test("a stream of hours keeps its last minutes", () => {
  const { page, block } = live();
  for (let i = 0; i < 1100; i++) block(i);
  assert.equal(page.end, 13_200);
  assert.ok(page.frames <= 12_000 && page.joints.length <= 12_000 * 66);
  assert.equal(page.joints[66 * (page.frames - 1)], 1099);
  assert.equal(page.joints[0], page.first / 12);
});

test("a path is the curve that the library lays", () => {
  const points = [
    [0, 0],
    [1, 0.5],
    [1.2, 2],
    [0, 3],
  ];
  const near = (found, expected) =>
    found.forEach((value, i) => assert.ok(Math.abs(value - expected[i]) < 1e-5, `${found} ${expected}`));
  const line = curve(points); // numbers of motion_jax.control.paths
  near(line[12], [0.595693, 0.158788]);
  near(line[36], [1.250396, 1.220249]);
  near(line[60], [0.776791, 2.566017]);
  assert.ok(Math.abs(lengthOf(line) - 4.320626) < 0.01);
  near(curve(points, [0, 1, 2.5, 3])[36], [1.55375, 1.053125]);
  assert.deepEqual(curve([[1, 2], [1, 2]]), [[1, 2]]);
});

test("a path and poses belong to a block and go with it", () => {
  let state = three();
  const span = () => placed(state.project)[1],
    control = () => state.project.control,
    change = (action) => (state = reduce(state, action));
  change({ type: "path", span: span(), points: [[0, 0], [1, 0], [3.1, 0]] });
  change({ type: "pose", time: 4.5, joints: [[0, 1, 0]] });
  const times = () => control().find((one) => one.points)?.times,
    pose = () => control().find((one) => one.joints)?.time;
  assert.deepEqual([times()[0], times().at(-1), pose()], [3, 5.95, 4.5]); // 3.1 m in the block's 3 s, not in all 9
  assert.match(named(control()[0]), /^path from 3.0 s: 3 points, 3.1 m, 1.1 m\/s/);
  const speed = (times()[1] - times()[0]) / (times()[2] - times()[0]);
  assert.ok(Math.abs(speed - 1 / 3.1) < 0.05, "one speed");
  assert.equal(pathOf(control(), placed(state.project)[0]), null);
  change({ type: "resize", id: 1, seconds: 6 });
  assert.deepEqual([times()[0], times().at(-1), pose()], [6, 8.95, 7.5]);
  change({ type: "resize", id: 2, seconds: 1.2 }); // the path takes all of the block, a pose stays inside
  assert.deepEqual([times()[0], times().at(-1)], [6, 7.15]);
  assert.ok(pose() > 6 && pose() < 7.2);
  change({ type: "move", id: 2, index: 0 });
  assert.deepEqual([times()[0], times().at(-1)], [0, 1.15]);
  change({ type: "undo" });
  assert.equal(times()[0], 6);
  change({ type: "remove", id: 2 });
  assert.deepEqual(control(), []);
  // The live body's path is not the timeline's.
  change({ type: "path", span: "live", points: [[0, 0], [0, 3]] });
  const alone = { ...state.project, control: [] };
  assert.equal(keyOf(state.project), keyOf(alone));
  assert.equal(saved(state.project).control, null);
  assert.deepEqual(asJson([pathOf(control(), "live")]).constraints, [{ type: "root_path", points: [[0, 0], [0, 3]] }]);
  const whole = { type: "root_path", points: [[0, 0], [1, 1]] };
  assert.deepEqual(movedWith([whole], placed(three().project), placed(state.project)), [whole]);
});

test("paths, poses and other constraints are steps of the user's", () => {
  let state = acted({ type: "path", points: [[0, 0], [1, 2]] }, { type: "pose", time: 1.5, joints: [[0, 1, 0]] });
  assert.deepEqual(pointsOf(state.project.control), [[0, 0], [1, 2]]);
  assert.deepEqual(asJson(state.project.control), { version: 1, constraints: state.project.control });
  state = reduce(state, { type: "pose", time: 1.5, joints: [[0, 2, 0]] });
  assert.equal(state.project.control.length, 2, "one pose at a time");
  assert.equal(state.project.control[1].joints[0][1], 2);
  assert.equal(named(state.project.control[0], 2), "path of the whole timeline: 2 points, 2.2 m, 1.1 m/s");
  assert.equal(named(state.project.control[1]), "pose at 1.50 s");
  const seen = drawn(state.project.control, null, 20);
  assert.deepEqual([seen.lines.length, seen.points.length, seen.poses[0].frame], [1, 2, 30]);
  assert.deepEqual(drawn(state.project.control, { targets: [[1, 0, 0, 0]], poses: [] }, 20).targets, [[1, 0, 0, 0]]);
  state = reduce(state, { type: "removeConstraint", index: 1 });
  state = reduce(state, { type: "path", points: [] });
  assert.equal(asJson(state.project.control), null);
  assert.equal(reduce(state, { type: "removeConstraint", index: 3 }), state);
  for (let i = 0; i < 5; i++) state = reduce(state, { type: "undo" });
  assert.deepEqual(state.project.control, []);
  const timed = { type: "root_path", points: [[0, 0], [1, 1]], times: [0, 2], heading: 1 };
  const opened = acted({ type: "open", project: { blocks: [], control: { version: 1, constraints: [timed] } } });
  assert.deepEqual(saved(opened.project).control.constraints, [timed]);
  const span = { start: 0, end: 2.05 };
  const moved = reduce(opened, { type: "path", span, points: [[0, 0], [2, 1]] }).project.control;
  assert.deepEqual([moved.length, moved[0].times, moved[0].heading], [1, [0, 2], 1]);
  const longer = reduce(opened, { type: "path", span, points: [[0, 0], [2, 1], [4, 2]] }).project.control[0];
  assert.deepEqual([longer.times, longer.heading], [[0, 1, 2], undefined], "headings of other points mean nothing");
  assert.notEqual(keyOf(opened.project), keyOf(initial().project));
  assert.equal(offText({ mean: 0.21, worst: 12.4, joint: "left wrist", frame: 50 }, 20),
    "off by 0.2 mm, at most 12 mm (left wrist at 2.50 s)");
});

test("the page says in plain words how it goes, and figures on demand", () => {
  const { page, block } = live();
  block(0);
  assert.equal(liveText(page), "");
  page.tick(9);
  assert.match(liveText(page), /waiting for the next part/);
  page.starved = false;
  assert.match(liveText(page), /slower than it plays/);
  assert.match(liveDetails(page), /0.0 s ahead, 0.6 s in flight, block 9 ms, 1 pauses/);
  const steps = [{ step: "sample", did: "one pass" }, { step: "pose", did: "trunk leant", cm: 12.3 }];
  assert.equal(stepsText({ meta: { steps } }), "sample: one pass · pose: trunk leant (up to 12.3 cm)");
  assert.equal(stepsText(null) + stepsText({ meta: { steps: 3 } }), "");
  assert.equal(workText({ doing: "making the motion", of: 120, share: 0.25, seconds: 4.2 }), "25 %, 4 s: making the motion");
  assert.equal(workText({ doing: "compiling", of: 0, share: 0.4, seconds: 9 }), "about 40 %, 9 s: compiling");
  const multiPrompt = { busy: null, stale: true };
  const status = (more) => statusOf({ mode: "timeline", live: page, multiPrompt, models: [], blocks: 1, ...more });
  assert.deepEqual(status(), { text: "changed; press Make", is: "busy" });
  assert.match(status({ models: [{ name: "tiny", state: "compiling", seconds: 9 }] }).text, /preparing the model tiny/);
  page.absence = "gone";
  assert.equal(status().is, "bad");
});

test("the legend names the colours that are seen", () => {
  const pieces = [
    { start: 0, end: 4, kind: "kept" },
    { start: 1, end: 2, kind: "new" },
    { start: 4, end: 4, kind: "flight" },
  ];
  assert.deepEqual(legendOf(pieces), [
    ["kept", "kept"],
    ["new", "regenerated"],
  ]);
});

test("a lost studio is named once, and what was chosen before a reload is given up where it cannot be had", () => {
  const { page, notes, said } = live();
  page.connect = () => {};
  page.missing("gone");
  page.missing("gone");
  page.missing("refused");
  assert.deepEqual(notes.length, 2);
  Object.assign(page, { run: 0, restored: true });
  page.choices = { prompt: "walk", speed: 1, keep_going: true, model: "not here", seed: 3 };
  page.message({ type: "error", message: "got the model 'not here'" });
  assert.deepEqual(said.at(-1), { type: "start", prompt: "walk", speed: 1, keep_going: true });
  assert.equal(notes.length, 2);
});

test("what was made is kept and put back, with its state and undo", async () => {
  const { multiPrompt, act, state, asked } = studio();
  act({ type: "add", prompt: "walk" });
  await multiPrompt.make();
  act({ type: "add", prompt: "wave" });
  act({ type: "undo" });
  const kept = structuredClone({ state: state(), ...multiPrompt.toKeep() }),
    other = studio();
  other.act({ type: "restore", state: kept.state });
  other.multiPrompt.restore(kept.rows);
  assert.deepEqual(other.state(), state());
  assert.ok(!other.multiPrompt.stale && other.multiPrompt.shown.frames === 20);
  other.act({ type: "redo" });
  assert.deepEqual(words(other.state()), ["walk", "wave"]);
  assert.deepEqual(other.asked, []);
  assert.equal(asked.length, 1);
});

test("the motion before an edit is kept too, for an undo after a reload", async () => {
  const { multiPrompt, act, state } = studio();
  act({ type: "add", prompt: "walk" });
  await multiPrompt.make();
  const edit = { take: 0, prompt: "kick", change: [[2, 8]], seed: 0, sampling: {}, model: { name: "tiny" } };
  act({ type: "addEdit", edit });
  await multiPrompt.make();
  const kept = structuredClone({ state: state(), ...multiPrompt.toKeep() }),
    other = studio();
  other.act({ type: "restore", state: kept.state });
  other.multiPrompt.restore(kept.rows);
  assert.ok(!other.multiPrompt.stale);
  other.act({ type: "undo" });
  assert.ok(!other.state().project.edits.length && !other.multiPrompt.stale);
  assert.deepEqual(other.asked, []);
});

test("an import goes before the blocks or replaces them, and New keeps the model alone", () => {
  const motion = { shape: [20, 22, 3], fps: 20, joints: "" };
  let state = reduce(three(), { type: "importMotion", motion });
  assert.deepEqual(words(state), ["walk", "wave", "sit"]);
  state = reduce(state, { type: "importMotion", motion, alone: true });
  assert.deepEqual(words(state), []);
  state = reduce(reduce(state, { type: "model", model: { name: "tiny", id: "" } }), { type: "new" });
  assert.equal(state.project.past, null);
  assert.equal(state.project.model.name, "tiny");
  assert.deepEqual(words(reduce(reduce(reduce(state, { type: "undo" }), { type: "undo" }), { type: "undo" })).length, 3);
});

test("suggestions are found by the beginnings of words, and figures move between their frames", () => {
  const rows = ["walks forward", "waves the left hand", "kicks with the left leg"].map((words) => ({
    prompt: `a person ${words}`,
    kind: words.startsWith("kick") ? "fight" : "move",
  }));
  const found = (typed) => matching(rows, typed).map((row) => row.prompt);
  assert.equal(found("a person").length, 3);
  assert.deepEqual(found("walking"), ["a person walks forward"]);
  assert.equal(found("left kick")[0], "a person kicks with the left leg");
  assert.deepEqual(found("fight"), ["a person kicks with the left leg"]);
  assert.deepEqual(found("zzz"), []);
  const points = unpackFigure(btoa(String.fromCharCode(0, 60, 60, 196)), 60); // one joint, two frames
  assert.deepEqual([...points], [0, 1, 1, -1]);
  assert.deepEqual([...poseAt(points, 1, 8, 1 / 16)], [0.5, 0]);
  assert.deepEqual([...poseAt(points, 1, 8, 9)], [1, -1]);
});
