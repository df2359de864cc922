// Keys: poses and places of parts of the body at frames, which spans of a take are regenerated through. They are the
// constraints of docs/control.md, in the `control` of a project's edits. Needs no browser.
import { JOINTS } from "./skeleton.js";

export const HALF_SPAN = 12, // frames on either side of a new key that are regenerated
  MOST_EDITS = 100,
  MOST_SLACK = 20; // frames
const MARGIN = 4; // frames between a key and the border of its span

/** Tracks of the timeline, from the top. */
export const TRACKS = ["pose", "head", "chest", "left_hand", "right_hand", "hips", "left_foot", "right_foot"];
export const labelOf = (part) => (part === "pose" ? "whole pose" : part.replace("_", " "));

const TRACK_OF = {
  head: "head",
  spine3: "chest",
  left_elbow: "left_hand",
  left_wrist: "left_hand",
  left_hand: "left_hand",
  right_elbow: "right_hand",
  right_wrist: "right_hand",
  right_hand: "right_hand",
  pelvis: "hips",
  hips: "hips",
  root: "hips",
  left_knee: "left_foot",
  left_ankle: "left_foot",
  left_foot: "left_foot",
  right_knee: "right_foot",
  right_ankle: "right_foot",
  right_foot: "right_foot",
};
// The joints of the key that dragging a handle makes.
const JOINTS_OF = {
  left_hand: [20],
  right_hand: [21],
  left_elbow: [18, 20],
  right_elbow: [19, 21],
  left_foot: [7, 10],
  right_foot: [8, 11],
  left_knee: [4, 7, 10],
  right_knee: [5, 8, 11],
  hips: [0],
  chest: [9],
  head: [15],
};

const rounded = (place) => place.map((value) => Math.round(value * 1e4) / 1e4);
export const trackOf = (constraint) => (constraint.type === "keyframe" ? "pose" : TRACK_OF[constraint.joint]);
const timeOf = (constraint) => (constraint.type === "keyframe" ? constraint.time : constraint.times[0]);
const frameOf = (constraint, fps) => Math.floor(timeOf(constraint) * fps + 0.5 + 1e-9);
const isKey = (constraint) =>
  constraint.type === "keyframe" ||
  (constraint.type === "effector" && constraint.times.length === (constraint.between ? 2 : 1) && constraint.joint in TRACK_OF);
const secondOf = (frame, fps) => Math.round((frame / fps) * 1e4) / 1e4;
const lastOf = (constraint, fps) => Math.floor((constraint.times?.at(-1) ?? constraint.time) * fps + 0.5 + 1e-9);
// The constraint from another frame on; until: its last frame, where it holds a place.
const at = (constraint, frame, fps, until = frame + lastOf(constraint, fps) - frameOf(constraint, fps)) =>
  constraint.type === "keyframe"
    ? { ...constraint, time: secondOf(frame, fps) }
    : { ...constraint, times: (constraint.between ? [frame, until] : [frame]).map((one) => secondOf(one, fps)) };

/** The constraints of a key at a frame: of the whole pose, or of the parts that handles moved. */
export function constraintsOf(pose, handles, frame, fps, whole) {
  const time = secondOf(frame, fps);
  if (whole) return [{ type: "keyframe", joints: pose.map(rounded), place: "world", time }];
  const joints = new Set(handles.flatMap((handle) => JOINTS_OF[handle]));
  return [...joints].map((joint) => ({
    type: "effector",
    joint: JOINTS[joint],
    times: [time],
    positions: [rounded(pose[joint])],
  }));
}

/** The constraints that hold a hand or foot in its place from one frame to another. */
export function plantedOf(pose, handle, frame, until, fps) {
  return constraintsOf(pose, [handle], frame, fps, false).map(({ positions, ...one }) => ({
    ...one,
    times: [frame, until].map((end) => secondOf(end, fps)),
    positions: [positions[0], positions[0]],
    between: true,
  }));
}

const constraintsIn = (edit) => edit.control?.constraints ?? [];
const withConstraints = (edit, constraints) => ({
  ...edit,
  control: constraints.length ? { version: 1, constraints } : null,
});
const covers = (edit, frame) => edit.change.some(([first, past]) => first <= frame && frame < past);

/** The keys of a take: [{id, edit, track, frame, until, slack (frames), strength, constraints}]; until: the last frame of a
    hand or foot that is planted, else `frame`. A key in frames that a later edit regenerates is that edit's. */
export function keysOf(project, take, fps) {
  const edits = project.edits.map((edit, index) => ({ ...edit, index })).filter((edit) => edit.take === take);
  const keys = new Map();
  for (const edit of edits) {
    for (const constraint of constraintsIn(edit).filter(isKey)) {
      const frame = frameOf(constraint, fps),
        track = trackOf(constraint);
      if (edits.some((later) => later.index > edit.index && covers(later, frame))) continue;
      const id = `${edit.index} ${track} ${frame}`,
        { slack = 0, strength = 1 } = constraint;
      if (!keys.has(id))
        keys.set(id, {
          id,
          edit: edit.index,
          track,
          frame,
          until: lastOf(constraint, fps),
          slack: Math.round(slack * fps),
          strength,
          constraints: [],
        });
      keys.get(id).constraints.push(constraint);
    }
  }
  return [...keys.values()].sort((a, b) => a.frame - b.frame);
}

/** The index of the edit whose keys a key at a frame would join, or -1. */
export function editAt(project, take, frame) {
  const top = project.edits.findLastIndex((edit) => edit.take === take && covers(edit, frame));
  return top >= 0 && constraintsIn(project.edits[top]).length ? top : -1;
}

// The span with room around a frame.
const widened = ([first, past], frame, frames) => [
  Math.max(0, Math.min(first, frame - MARGIN)),
  Math.min(frames, Math.max(past, frame + MARGIN + 1)),
];

const sameKey = (one, other, fps) => trackOf(one) === trackOf(other) && frameOf(one, fps) === frameOf(other, fps);
const joined = (constraints, more, fps) => [
  ...constraints.filter((one) => !more.some((other) => sameKey(one, other, fps))),
  ...more,
];

/** How actions on keys change a project, for state.js. Actions have `fps` and `frames` of the motion. */
export const KEY_CHANGES = {
  // constraints: of constraintsOf; edit: {prompt, model} of a new edit.
  addKey: (project, { take, frame, constraints, fps, frames, edit }) => {
    if (!(frame >= 0 && frame < frames)) return project;
    const until = Math.max(...constraints.map((one) => lastOf(one, fps)));
    if (until >= frames) return project;
    const index = editAt(project, take, frame);
    if (index < 0) {
      if (project.edits.length >= MOST_EDITS) return project;
      const change = widened([frame - HALF_SPAN, until + HALF_SPAN + 1], frame, frames),
        around = keysInside(project, take, change, fps);
      const added = { take, seed: 0, sampling: {}, ...edit, change: [change] };
      return { ...project, edits: [...project.edits, withConstraints(added, joined(around, constraints, fps))] };
    }
    return changed(project, index, (old) => ({
      ...withConstraints(old, joined(constraintsIn(old), constraints, fps)),
      change: old.change.map((span) =>
        covers({ change: [span] }, frame) ? widened(widened(span, frame, frames), until, frames) : span,
      ),
    }));
  },
  // keys: of keysOf
  removeKeys: (project, { keys }) => replaced(project, keys, () => []),
  moveKeys: (project, { keys, by, fps, frames }) => {
    const step = Math.max(
      -Math.min(...keys.map((key) => key.frame)),
      Math.min(by, frames - 1 - Math.max(...keys.map((key) => key.until))),
    );
    if (!keys.length || !step) return project;
    return withRoom(
      replaced(project, keys, (constraint) => [at(constraint, frameOf(constraint, fps) + step, fps)]),
      keys,
      step,
      frames,
    );
  },
  // Keys again at another frame: the earliest of them there.
  copyKeys: (project, { take, keys, frame, fps, frames, edit }) => {
    const first = Math.min(...keys.map((key) => key.frame));
    return keys.reduce((found, key) => {
      const to = key.frame - first + frame;
      return KEY_CHANGES.addKey(found, {
        take,
        frame: to,
        fps,
        frames,
        edit,
        constraints: key.constraints.map((one) => at(one, to, fps)),
      });
    }, project);
  },
  // fields: {slack (frames), strength}
  setKeys: (project, { keys, fields, fps }) =>
    replaced(project, keys, ({ slack, strength, ...one }) => {
      const next = { slack: (slack ?? 0) * fps, strength: strength ?? 1, ...fields };
      return [
        {
          ...one,
          ...(next.slack ? { slack: Math.round((next.slack / fps) * 1e4) / 1e4 } : {}),
          ...(next.strength < 1 ? { strength: next.strength } : {}),
        },
      ];
    }),
  // The first and last frame of a planted hand or foot.
  stretchKey: (project, { keys: [key], ends: [frame, until], fps, frames }) => {
    if (!key || !(0 <= frame && frame < until && until < frames)) return project;
    const found = replaced(project, [key], (constraint) => [at(constraint, frame, fps, until)]);
    return withRoom(found, [{ ...key, frame, until }], 0, frames);
  },
  setSpan: (project, { index, span, change, fps }) => {
    const edit = project.edits[index];
    if (!edit || !(change[0] < change[1])) return project;
    const inside = constraintsIn(edit)
      .flatMap((one) => [frameOf(one, fps), lastOf(one, fps)])
      .filter((frame) => covers({ change: [edit.change[span]] }, frame));
    const room = inside.reduce(([first, past], frame) => [Math.min(first, frame), Math.max(past, frame + 1)], change);
    return changed(project, index, (old) => ({ ...old, change: old.change.with(span, room) }));
  },
  // A span between two keys is regenerated, with the keys inside it.
  addEdit: (project, { edit, fps }) => {
    if (project.edits.length >= MOST_EDITS) return project;
    const inside = edit.control || !fps ? [] : edit.change.flatMap((span) => keysInside(project, edit.take, span, fps));
    return { ...project, edits: [...project.edits, inside.length ? withConstraints(edit, inside) : edit] };
  },
  reseed: (project, { index }) => changed(project, index, (old) => ({ ...old, seed: old.seed + 1 })),
};

const keysInside = (project, take, [first, past], fps) =>
  keysOf(project, take, fps)
    .filter((key) => first <= key.frame && key.until < past)
    .flatMap((key) => key.constraints);

const changed = (project, index, how) => ({
  ...project,
  edits: project.edits.map((edit, i) => (i === index ? how(edit) : edit)),
});

// Each constraint of the keys becomes what how(constraint) returns; an edit without keys goes.
function replaced(project, keys, how) {
  const edits = project.edits.map((edit, index) => {
    const constraints = new Set(keys.filter((key) => key.edit === index).flatMap((key) => key.constraints));
    if (!constraints.size) return edit;
    return withConstraints(
      edit,
      constraintsIn(edit).flatMap((one) => (constraints.has(one) ? how(one) : [one])),
    );
  });
  const emptied = (edit, index) => !constraintsIn(edit).length && constraintsIn(project.edits[index]).length;
  return { ...project, edits: edits.filter((edit, index) => !emptied(edit, index)) };
}

// The spans of moved keys, widened where these are near a border or beyond it.
function withRoom(project, keys, step, frames) {
  const edits = project.edits.map((edit, index) => {
    const moved = keys.filter((key) => key.edit === index).flatMap((key) => [key.frame + step, key.until + step]);
    if (!moved.length) return edit;
    const span = moved.reduce((found, frame) => widened(found, frame, frames), edit.change[0]);
    return { ...edit, change: [span, ...edit.change.slice(1)] };
  });
  return { ...project, edits };
}

/** {track, frame} of another key of the same track that keys would come upon, or null. */
export function taken(all, keys, by) {
  const rest = all.filter((key) => !keys.includes(key));
  const hit = keys.find((key) =>
    rest.some((other) => other.track === key.track && other.frame <= key.until + by && key.frame + by <= other.until),
  );
  return hit ? { track: hit.track, frame: hit.frame + by } : null;
}
