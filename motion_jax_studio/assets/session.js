// Restores the work after a reload from this browser's storage, and warns before unsaved work is lost.
import { Autosave } from "./autosave.js";

const $ = (id) => document.getElementById(id);
const BOXES = ["auto", "repeat", "side", "keep-going", "follow", "path", "steps", "ghosts", "sticks", "edits",
  "posing", "pose-whole", "show-curves", "details"]; // prettier-ignore

// The work as plain data, for the storage.
function snapshot(studio) {
  const { state, mode, live, timeline } = studio;
  const { prompt, speed, keep_going, seed, model, sampling, without } = live.choices;
  const choices = Object.entries({ prompt, speed, keep_going, seed, model, sampling, without });
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
function restore(studio, kept) {
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
  studio.multiPrompt.restore(kept.rows);
  studio.act({ type: "restore", state: kept.state });
  studio.setMode(kept.mode);
  studio.timeline.window = kept.window;
  if (kept.mode === "timeline") studio.seek(kept.time);
}

/** Restores the work of this tab, or of a closed one, and saves it from now on. */
export async function restoreSession(studio) {
  const autosave = (studio.autosave = new Autosave(
    () => snapshot(studio),
    () => studio.multiPrompt.toKeep(),
  ));
  const kept = await autosave.open();
  const { blocks, past } = kept?.state?.project ?? {};
  if (kept) {
    try {
      restore(studio, kept);
      studio.makeSoon(); // what was being generated
      if (blocks.length || past) {
        const when = new Date(kept.saved).toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
        studio.notes.tell(`your project was restored from ${when}; New starts an empty one`, false);
      }
    } catch (error) {
      studio.notes.tell(`the work stored in this browser cannot be read (${error.message}); open a saved project instead`, true);
    }
  }
  if (!autosave.works)
    studio.notes.tell("this browser stores nothing: save your project to a file before you leave", true, "storage");
  document.addEventListener("input", () => autosave.changed());
  document.addEventListener("change", () => autosave.changed());
  for (const event of ["pagehide", "visibilitychange"]) addEventListener(event, () => autosave.save());
  // Something is running or not stored yet.
  studio.leaving = () =>
    Boolean(studio.multiPrompt.busy) || studio.panels.exporting || autosave.pending || (!autosave.works && studio.panels.unsaved);
  addEventListener("beforeunload", (event) => {
    if (!studio.leaving()) return;
    autosave.save();
    event.preventDefault();
  });
}
