// What outlives a reload: the work is kept in the browser, and put back. Asks before the page is left where it must.
import { Keeper } from "./keeper.js";

const $ = (id) => document.getElementById(id);
const BOXES = ["auto", "repeat", "side", "keep-going", "follow", "path", "steps", "ghosts", "sticks", "edits",
  "show-curves", "details"]; // prettier-ignore

// The work as plain data.
function snapshot(studio) {
  const { state, mode, live, timeline } = studio;
  const { prompt, speed, keep_going, seed, model, sampling } = live.choices;
  const choices = Object.entries({ prompt, speed, keep_going, seed, model, sampling });
  return {
    state,
    mode,
    window: timeline.window,
    typed: { prompt: $("prompt").value, "edit-prompt": $("edit-prompt").value },
    boxes: Object.fromEntries(BOXES.map((id) => [id, $(id).checked])),
    choices: Object.fromEntries(choices.filter(([, value]) => value !== undefined)),
    time: studio.player.time,
  };
}

// `change` events tell the page what each box means.
function putBack(studio, kept) {
  for (const [id, checked] of Object.entries(kept.boxes)) {
    if (!$(id) || $(id).checked === checked) continue;
    $(id).checked = checked;
    $(id).onchange?.();
  }
  for (const [id, words] of Object.entries(kept.typed)) $(id).value = words;
  Object.assign(studio.live.choices, kept.choices);
  studio.live.restored = true;
  $("speed").value = kept.choices.speed;
  $("speed").nextElementSibling.textContent = `${kept.choices.speed}×`;
  studio.story.restore(kept.rows);
  studio.act({ type: "restore", state: kept.state });
  studio.setMode(kept.mode);
  studio.timeline.window = kept.window;
  if (kept.mode === "story") studio.seek(kept.time);
}

/** Puts back what this tab, or one that was closed, has made, and keeps it from now on. */
export async function restoreSession(studio) {
  const keeper = (studio.keeper = new Keeper(
    () => snapshot(studio),
    () => studio.story.toKeep(),
  ));
  const kept = await keeper.open();
  const { blocks, past } = kept?.state?.project ?? {};
  if (kept) {
    try {
      putBack(studio, kept);
      studio.makeSoon(); // what was being made
      if (blocks.length || past) {
        const when = new Date(kept.saved).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
        studio.notes.tell(`your project is back as it was at ${when}; New starts an empty one`, false);
      }
    } catch (error) {
      studio.notes.tell(`what this browser has kept cannot be read (${error.message}); saved files can be opened`, true);
    }
  }
  if (!keeper.works)
    studio.notes.tell("this browser keeps nothing: save your project to a file before you leave", true, "storage");
  document.addEventListener("input", () => keeper.changed());
  document.addEventListener("change", () => keeper.changed());
  for (const event of ["pagehide", "visibilitychange"]) addEventListener(event, () => keeper.save());
  // Something runs, or is kept nowhere.
  studio.leaving = () =>
    Boolean(studio.story.busy) || studio.panels.exporting || keeper.pending || (!keeper.works && studio.panels.unsaved);
  addEventListener("beforeunload", (event) => {
    if (!studio.leaving()) return;
    keeper.save();
    event.preventDefault();
  });
}
