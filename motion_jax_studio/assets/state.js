// The project and its undo history as plain data, and how each action changes them. Needs no browser.
//
// state: {project, past, future, selected, span, next}
// project: {blocks: [{id, prompt, seconds}], seeds, chosen, cleanup, without, sampling, past, control, edits,
// model: {name, id}}; `without` names steps that are left out;
// what undo goes back through. A block's `seconds` may be null: as long as similar clips. `past` is an imported motion,
// `control` a list of constraints (control.js).

import { KEY_CHANGES } from "./pose_keys.js";
import { MOST_POSES, asJson, movedWith, ofTimeline, withPath, withPose } from "./control.js";

export const SHORTEST = 0.6,
  LONGEST = 120,
  MOST_BLOCKS = 64,
  MOST_TAKES = 8,
  LONGEST_PROMPT = 1000; // characters
const KEPT = 200; // steps that can be undone
const DEFAULT_SECONDS = 3;

const empty = () => ({
  blocks: [],
  seeds: [0],
  chosen: 0,
  cleanup: true,
  without: [],
  sampling: {},
  past: null,
  control: [],
  edits: [],
  model: { name: "", id: "" },
});

export const initial = () => ({ project: empty(), past: [], future: [], selected: null, span: null, next: 1 });

export const lengthOf = (block) => block.seconds ?? DEFAULT_SECONDS;

/** Lengths are multiples of the model's blocks, at which prompts change. */
export const snapped = (seconds, step = SHORTEST) =>
  Math.min(LONGEST, Math.max(step, Math.round(Math.round(seconds / step) * step * 1000) / 1000));

/** [{block, start, end}] in seconds, one behind the other, after an imported motion. */
export function placed(project) {
  let start = project.past ? project.past.shape[0] / project.past.fps : 0;
  return project.blocks.map((block) => {
    const row = { block, start, end: start + lengthOf(block) };
    start = row.end;
    return row;
  });
}

const clean = (prompt) => String(prompt ?? "").trim();

// Each returns the changed project, or the same object if nothing changes.
const CHANGES = {
  add: (project, { prompt, seconds, index = project.blocks.length, id }) => {
    if (!clean(prompt) || project.blocks.length >= MOST_BLOCKS) return project;
    const block = { id, prompt: clean(prompt), seconds: seconds === undefined ? DEFAULT_SECONDS : seconds };
    return { ...project, blocks: project.blocks.toSpliced(index, 0, block) };
  },
  edit: (project, { id, prompt }) => {
    const block = project.blocks.find((one) => one.id === id);
    if (!block || !clean(prompt) || clean(prompt) === block.prompt) return project;
    return {
      ...project,
      blocks: project.blocks.map((one) => (one === block ? { ...one, prompt: clean(prompt) } : one)),
    };
  },
  resize: (project, { id, seconds, step }) => {
    const block = project.blocks.find((one) => one.id === id),
      length = snapped(seconds, step);
    if (!block || !Number.isFinite(seconds) || length === block.seconds) return project;
    return { ...project, blocks: project.blocks.map((one) => (one === block ? { ...one, seconds: length } : one)) };
  },
  remove: (project, { id }) => {
    const blocks = project.blocks.filter((one) => one.id !== id);
    return blocks.length === project.blocks.length ? project : { ...project, blocks };
  },
  move: (project, { id, index }) => {
    const from = project.blocks.findIndex((one) => one.id === id);
    const to = Math.max(0, Math.min(index, project.blocks.length - 1));
    if (from < 0 || from === to) return project;
    return { ...project, blocks: project.blocks.toSpliced(from, 1).toSpliced(to, 0, project.blocks[from]) };
  },
  addTake: (project, { seed }) => {
    if (project.seeds.length >= MOST_TAKES || project.seeds.includes(seed)) return project;
    return { ...project, seeds: [...project.seeds, seed], chosen: project.seeds.length };
  },
  removeTake: (project, { take }) => {
    if (project.seeds.length < 2 || !(take in project.seeds)) return project;
    const edits = project.edits
      .filter((edit) => edit.take !== take)
      .map((edit) => ({ ...edit, take: edit.take - Number(edit.take > take) }));
    const chosen = Math.max(0, project.chosen - Number(project.chosen >= take && project.chosen > 0));
    return { ...project, seeds: project.seeds.toSpliced(take, 1), edits, chosen };
  },
  choose: (project, { take }) =>
    take in project.seeds && take !== project.chosen ? { ...project, chosen: take } : project,
  ...KEY_CHANGES,
  dropEdits: (project, { take, keep }) => {
    const edits = project.edits.filter((edit) => edit.take !== take || keep(edit));
    return edits.length === project.edits.length ? project : { ...project, edits };
  },
  importMotion: (project, { motion, alone }) => ({
    ...project,
    past: motion,
    edits: [],
    blocks: alone ? [] : project.blocks,
  }),
  new: (project) => ({ ...empty(), model: project.model }),
  path: (project, { points, span }) => ({ ...project, control: withPath(project.control, points, span) }),
  pose: (project, { time, joints }) => {
    if (project.control.filter((one) => one.type === "keyframe").length >= MOST_POSES) return project;
    return { ...project, control: withPose(project.control, time, joints) };
  },
  removeConstraint: (project, { index }) =>
    index in project.control ? { ...project, control: project.control.toSpliced(index, 1) } : project,
  set: (project, { fields }) => ({ ...project, ...fields }),
};

export function reduce(state, action) {
  if (action.type in CHANGES) {
    const given = action.type === "add" ? { ...action, id: state.next } : action;
    let project = CHANGES[action.type](state.project, given);
    if (project === state.project) return state;
    if (project.control === state.project.control && project.control.length)
      project = { ...project, control: movedWith(project.control, placed(state.project), placed(project)) };
    const next = {
      ...state,
      project,
      past: [...state.past, state.project].slice(-KEPT),
      future: [],
      next: state.next + Number(action.type === "add"),
      selected: action.type === "add" ? state.next : state.selected,
    };
    return kept(next);
  }
  switch (action.type) {
    case "undo":
      if (!state.past.length) return state;
      return kept({
        ...state,
        project: state.past.at(-1),
        past: state.past.slice(0, -1),
        future: [state.project, ...state.future],
      });
    case "redo":
      if (!state.future.length) return state;
      return kept({
        ...state,
        project: state.future[0],
        future: state.future.slice(1),
        past: [...state.past, state.project],
      });
    case "restore": // from the browser's storage
      return { ...initial(), ...action.state };
    case "select":
      return { ...state, selected: action.id };
    case "span": {
      const span = action.span && [Math.min(...action.span), Math.max(...action.span)];
      return { ...state, span: span && span[1] > span[0] ? span : null };
    }
    case "model": // a model of the studio; not an undo step
      return { ...state, project: { ...state.project, model: action.model } };
    case "open": {
      const blocks = action.project.blocks.map((block, i) => ({ ...block, id: state.next + i }));
      const { format, version, ...fields } = action.project;
      return {
        ...state,
        project: { ...empty(), ...fields, blocks, control: fields.control?.constraints ?? [] },
        next: state.next + blocks.length,
        past: [...state.past, state.project].slice(-KEPT),
        future: [],
        selected: null,
        span: null,
      };
    }
    default:
      throw new Error(`there is no action ${action.type}`);
  }
}

// A removed block cannot be selected.
function kept(state) {
  return state.project.blocks.some((block) => block.id === state.selected) ? state : { ...state, selected: null };
}

/** The contents of a project file, docs/protocol.md. */
export const saved = (project) => ({
  format: "motion_jax project",
  version: 1,
  ...project,
  blocks: project.blocks.map(({ prompt, seconds }) => ({ prompt, seconds })),
  control: asJson(ofTimeline(project.control)),
});

/** Projects with the same key have the same motion of a take. */
export const keyOf = (project, take = project.chosen) =>
  JSON.stringify([
    project.model.name,
    project.blocks.map(({ prompt, seconds }) => [prompt, seconds]),
    project.seeds[take],
    project.cleanup,
    project.without,
    project.sampling,
    ofTimeline(project.control),
    project.past && [project.past.shape, project.past.joints.length, project.past.joints.slice(0, 400)],
    project.edits
      .filter((edit) => edit.take === take)
      .map(({ prompt, change, seed, sampling, model, control = null }) => [prompt, change, seed, sampling, model.name, control]),
  ]);
