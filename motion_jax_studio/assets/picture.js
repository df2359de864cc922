// Draws the current frame: the live body, the timeline's motion, or takes side by side.
import { drawn, ofTimeline, pathOf } from "./control.js";
import { footprints, isEdited, part } from "./motion.js";

const GROUND_SECONDS = 60; // of a stream whose path and footprints are drawn
const AGAIN = 0.5; // seconds between two updates of a live path

let marked = []; // the values that the constraint marks were drawn from
let laid = null,
  from = 0,
  since = 0; // the motion drawn on the ground, its first frame, its age

/** Draws what has changed since the last call; passed: seconds since then. */
export function picture(studio, passed, other) {
  since += passed;
  if (other && studio.mode === "live") showLive(studio);
  else if (other) showTimeline(studio);
  if (other || studio.view.turned) studio.desk.tool.show();
  if (other) showConstraints(studio);
  if (other) studio.laidAgain = false;
  studio.view.draw(passed, other);
}

// A live body has only the path.
function showConstraints({ view, mode, live, multiPrompt, state, tool, player }) {
  const inTimeline = mode === "timeline",
    { control } = state.project,
    motion = multiPrompt.shown;
  const report = inTimeline && !multiPrompt.stale ? (motion?.report ?? null) : null,
    fps = motion?.fps ?? live.fps;
  const path = pathOf(control, tool.span);
  const now = [mode, control, report, fps, tool.preview, tool.chosen, path, tool.active];
  if (now.some((value, i) => value !== marked[i])) {
    marked = now;
    const shown = inTimeline ? ofTimeline(control) : control.filter((one) => one.live);
    view.drawConstraints(drawn(shown, report, fps, path, tool.points), tool.chosen);
  }
  view.marks.show(inTimeline ? player.time * fps : 0, fps);
}

// No body, no path and no footprints.
function empty(view) {
  view.clear();
  laid = null;
}

function showLive({ view, live, laidAgain }) {
  if (!live.frames) return empty(view);
  const at = live.time * live.fps - live.first,
    key = `${live.run} ${Math.floor(at)}`;
  view.show([{ motion: live, at, edited: null, parents: live.parents }]);
  if (laidAgain || (laid !== key && since > AGAIN)) {
    const past = Math.max(1, Math.min(Math.floor(at) + 1, live.frames));
    from = Math.max(0, past - Math.round(GROUND_SECONDS * live.fps));
    const shown = part(live, from, past);
    view.lay(shown, footprints(shown, live.stands.subarray(4 * from, 4 * past)));
    laid = key;
    since = 0;
  }
  view.light(Math.floor(at) - from);
}

// A pose that is being dragged, as a motion of one frame.
function held(motion, { pose }) {
  return { ...motion, frames: 1, joints: Float32Array.from(pose.flat()) };
}

function showTimeline({ view, multiPrompt, player, state, side, laidAgain, desk }) {
  const motion = multiPrompt.shown,
    second = player.time,
    { seeds, chosen } = state.project;
  if (!motion) return empty(view);
  const one = (shown) => ({
    motion: shown,
    at: second * shown.fps,
    edited: view.options.edits && !desk.tool.chosen ? isEdited(shown, Math.floor(second * shown.fps)) : null,
  });
  const others = side ? seeds.map((_, take) => (take === chosen ? null : multiPrompt.of(take))).filter(Boolean) : [];
  const { draft } = desk.tool;
  view.show([draft ? { motion: held(motion, draft), at: 0, edited: null } : one(motion), ...others.map(one)]);
  if (laid !== motion || laidAgain) view.lay(motion, motion.prints);
  laid = motion;
  view.light(Math.floor(second * motion.fps));
}
