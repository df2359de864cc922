// Status texts of the page. Needs no browser.

export const GONE = "the studio does not answer; this page reconnects when it runs again, and your work is kept";

/** The progress of a request: {doing, of, seconds} as GET /v1/progress gives it, and its share (shares.js). */
export function workText({ doing, of, seconds, share = 0 }) {
  return `${of > 1 ? "" : "about "}${Math.round(100 * share)} %, ${Math.round(seconds)} s: ${doing || "working"}`;
}

const STATES = { waiting: "waiting for another model", loading: "reading the model", compiling: "preparing the model" };

/** {text, short, nearest} of {notes, unknown, nearest}: what to know of a prompt, also as one line, and the caption to use
    instead; or null. */
export function remarkOf({ notes = [], unknown = [], nearest = "" }) {
  if (!notes.length && !unknown.length) return null;
  const words = `the model has not learned: ${unknown.join(", ")}`;
  return { text: notes.join("\n") || words, short: unknown.length ? words : notes[0], nearest };
}

/** A model that is not ready: {name, state, seconds} of /v1/models or of a stream. */
export function modelText({ name, state, seconds }) {
  const first = state === "compiling" && seconds > 5 ? "; the first start takes about a minute" : "";
  return `${STATES[state] ?? state} ${name ?? ""} (${Math.round(seconds ?? 0)} s)${first}`.replace("  ", " ");
}

const LIVE = {
  running: "live",
  waiting: "done; type the next prompt",
  paused: "paused",
  ended: "ended",
  stopped: "stopped",
  connecting: "connecting",
};

const ABSENT = { blocked: "no live motion: a proxy passes no WebSockets", gone: "not connected: waiting for the studio", refused: "not connected: open the new address" };

/** {text, is: "good", "busy" or "bad", share} for the line at the top; share: what is done, 0 to 1, or undefined. */
export function statusOf({ mode, live, multiPrompt, models, blocks }) {
  const inLive = mode === "live",
    unready = models.find((model) => !["ready", "failed"].includes(model.state));
  if (live.absence && (inLive || live.absence !== "blocked")) return { text: ABSENT[live.absence], is: "bad" };
  const loading = (model) => ({ text: modelText(model), is: "busy", share: model.of ? model.done / model.of : undefined });
  if (!inLive && multiPrompt.busy) return { text: multiPrompt.busy, is: "busy", share: multiPrompt.share };
  if (inLive && live.progress) return loading(live.progress);
  if (!inLive && unready) return loading(unready);
  if (inLive) return { text: LIVE[live.state] ?? live.state, is: live.connected ? "good" : "busy" };
  if (multiPrompt.stale && blocks) return { text: "changed; press Make", is: "busy" };
  return { text: "ready", is: "good" };
}

/** The state of a stream for the user; empty if there is nothing to report. */
export function liveText(live) {
  if (!live.blocks || live.state !== "running") return "";
  if (live.starved) return "waiting for the next part of the motion";
  if (live.pendingPrompt) return "the new prompt takes effect in a moment";
  if (live.recentlyMissed) return "this computer generates motion slower than it plays: expect pauses";
  return "";
}

/** Figures of a stream, for details. */
export function liveDetails(live) {
  if (!live.blocks) return "";
  const flight = Math.max(0, live.begun - live.committed) / live.fps;
  return (
    `${live.lead.toFixed(1)} s ahead, ${flight.toFixed(1)} s in flight, block ${live.sampling.toFixed(0)} ms` +
    `, ${live.missed} pauses` +
    (live.latency === null ? "" : `, prompt after ${live.latency.toFixed(1)} s`)
  );
}

/** What each step did to a motion: the records of its meta, one after the other or, joined by "\n", one a line. */
export function stepsText(motion, joint = " · ") {
  const rows = Array.isArray(motion?.meta?.steps) ? motion.meta.steps : [];
  return rows.map(({ step, did, cm }) => `${step}: ${did}${cm ? ` (up to ${cm} cm)` : ""}`).join(joint);
}

/** The legend of the strip below the blocks: [[kind, text]]. */
export function legendOf(pieces) {
  const names = { kept: "kept", new: "regenerated", there: "generated", flight: "in progress" };
  const kinds = new Set(pieces.filter(({ start, end }) => end > start).map(({ kind }) => kind));
  return Object.entries(names).filter(([kind]) => kinds.has(kind));
}
