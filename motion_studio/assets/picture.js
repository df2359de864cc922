// What the view shows at this moment: the live body, the made one, or takes side by side.
import { drawn, isPath } from "./control.js";
import { footprints, isEdited, part } from "./motion.js";

const GROUND_SECONDS = 60; // of a stream whose way and steps are drawn
const AGAIN = 0.5; // seconds between two drawings of a live way

let asked = []; // what the marks were drawn of
let laid = null,
  from = 0,
  since = 0; // what lies on the ground, the frame that it begins with, its age

/** Draws what is other than the last time; passed: seconds since then. */
export function picture(studio, passed, other) {
  since += passed;
  if (other && studio.mode === "live") showLive(studio);
  else if (other) showStory(studio);
  if (other) showAsked(studio);
  if (other) studio.laidAgain = false;
  studio.view.draw(passed, other);
}

// A live body has the path alone.
function showAsked({ view, mode, live, story, state, tool, player }) {
  const inStory = mode === "story",
    { control } = state.project,
    motion = story.shown;
  const told = inStory && !story.stale ? (motion?.asked ?? null) : null,
    fps = motion?.fps ?? live.fps;
  const now = [mode, control, told, fps, tool.preview, tool.chosen];
  if (now.some((value, i) => value !== asked[i])) {
    asked = now;
    view.ask(drawn(inStory ? control : control.filter(isPath), told, fps, tool.points), tool.chosen);
  }
  view.marks.show(inStory ? player.time * fps : 0, fps);
}

// Without a body nothing lies on the ground either.
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

function showStory({ view, story, player, state, side, laidAgain }) {
  const motion = story.shown,
    second = player.time,
    { seeds, chosen } = state.project;
  if (!motion) return empty(view);
  const one = (shown) => ({
    motion: shown,
    at: second * shown.fps,
    edited: view.options.edits ? isEdited(shown, Math.floor(second * shown.fps)) : null,
  });
  const others = side ? seeds.map((_, take) => (take === chosen ? null : story.of(take))).filter(Boolean) : [];
  view.show([motion, ...others].map(one));
  if (laid !== motion || laidAgain) view.lay(motion, motion.prints);
  laid = motion;
  view.light(Math.floor(second * motion.fps));
}
