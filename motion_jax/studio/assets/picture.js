// What the view shows at this moment: the live body, the made one, or takes side by side.
import { footprints, madeAnew, part } from "./motion.js";

const GROUND_SECONDS = 60;   // of a stream whose way and steps are drawn
const AGAIN = 0.5;           // seconds between two drawings of a live way

let laid = null, since = 0;

/** Draws; passed: seconds since the last time. */
export function picture(studio, passed) {
  const { view, live, story, player, state } = studio;
  since += passed;
  if (studio.mode === "live") {
    if (live.frames) showLive(view, live);
  } else {
    const motion = story.shown;
    if (motion) showStory(studio, motion);
    else view.show([]);
    if (laid !== motion || studio.laidAgain) {
      if (motion) view.lay(motion, motion.prints);
      laid = motion;
      studio.laidAgain = false;
    }
    if (motion) view.light(Math.floor(player.time * motion.fps));
  }
  view.draw(passed);

  function showLive() {
    const at = live.time * live.fps - live.first;
    view.show([{ motion: live, at, anew: null, parents: live.parents }]);
    const key = `${live.run} ${Math.floor(at)}`;
    if (studio.laidAgain || (laid !== key && since > AGAIN)) {
      const past = Math.max(1, Math.min(Math.floor(at) + 1, live.frames));
      const first = Math.max(0, past - Math.round(GROUND_SECONDS * live.fps));
      const shown = part(live, first, past);
      view.lay(shown, footprints(shown, live.stands.subarray(4 * first, 4 * past)));
      laid = key;
      since = 0;
      studio.laidAgain = false;
    }
    view.light(Infinity);
  }

  function showStory(_, motion) {
    const at = player.time * motion.fps, { seeds, chosen } = state.project;
    const shown = [{ motion, at, anew: madeAnew(motion, Math.floor(at)) }];
    if (studio.side) {
      seeds.forEach((_seed, take) => {
        const other = take === chosen ? null : story.of(take);
        if (other) shown.push({ motion: other, at: player.time * other.fps, anew: madeAnew(other, Math.floor(player.time * other.fps)) });
      });
    }
    view.show(shown);
  }
}
