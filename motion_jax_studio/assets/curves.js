// Curves of a motion below the timeline, on its scale of time.

import { curves, part } from "./motion.js";

const LIVE_SECONDS = 60; // of a stream whose curves are drawn
const NAMES = { speed: "speed", feet: "feet", jerk: "jerk", heading: "heading" };

/** found: of motion.js' curves(); window: {start, end} in seconds; at: seconds of the play head. */
function drawCurves(canvas, found, fps, window, at, look) {
  const ratio = devicePixelRatio,
    { clientWidth: width, clientHeight: height } = canvas;
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  const pen = canvas.getContext("2d");
  pen.scale(ratio, ratio);
  pen.font = "11px system-ui, sans-serif";
  const names = Object.keys(NAMES).filter((name) => found?.[name]),
    tall = height / Math.max(names.length, 1);
  const place = (second) => ((second - window.start) / (window.end - window.start)) * width;
  names.forEach((name, row) => {
    const { unit, lines } = found[name],
      top = row * tall;
    const first = Math.max(0, Math.floor(window.start * fps));
    const past = Math.min(lines[0].length, Math.ceil(window.end * fps) + 1);
    let low = Infinity,
      high = -Infinity;
    for (const line of lines) {
      for (const value of line) {
        low = Math.min(low, value);
        high = Math.max(high, value);
      }
    }
    if (name !== "heading") low = Math.min(low, 0);
    const room = Math.max(high - low, 1e-6);
    lines.forEach((line, i) => {
      pen.strokeStyle = lines.length > 1 ? [look.left, look.right][i] : look.accent;
      pen.lineWidth = 1.3;
      pen.beginPath();
      for (let t = first; t < past; t++) {
        pen[t === first ? "moveTo" : "lineTo"](place(t / fps), top + tall - 4 - ((line[t] - low) / room) * (tall - 20));
      }
      pen.stroke();
    });
    const frame = Math.max(0, Math.min(Math.round(at * fps), lines[0].length - 1));
    const values = lines.map((line) => shortNumber(line[frame])).join(" / ");
    pen.fillStyle = look.soft;
    pen.fillText(`${NAMES[name]} ${values} ${unit}`, 6, top + 12);
    pen.fillStyle = look.line;
    pen.fillRect(0, top + tall - 1, width, 1);
  });
  pen.fillStyle = look.head;
  pen.fillRect(place(at) - 0.75, 0, 1.5, height);
}

function shortNumber(value) {
  const size = Math.abs(value);
  return size >= 100 ? value.toFixed(0) : size >= 10 ? value.toFixed(1) : value.toFixed(2);
}

/** Draws the curves of the motion that is shown; they are computed once per motion. */
export function showCurves(studio) {
  const { live, multiPrompt, timeline } = studio,
    inLive = studio.mode === "live",
    whole = inLive ? live : multiPrompt.shown;
  if (!whole?.frames) return;
  const from = inLive ? Math.max(0, live.frames - LIVE_SECONDS * live.fps) : 0;
  const key = inLive ? `${live.run} ${live.end}` : whole;
  if (studio.curves?.key !== key) {
    studio.curves = { key, found: curves(inLive ? part(live, from, live.frames) : whole) };
  }
  const style = getComputedStyle(document.documentElement),
    names = ["accent", "left", "right", "soft", "line", "head"];
  const look = Object.fromEntries(names.map((name) => [name, style.getPropertyValue(`--${name}`)]));
  const before = inLive ? (live.first + from) / live.fps : 0,
    { start, end } = timeline.window;
  const window = { start: start - before, end: end - before };
  drawCurves(document.getElementById("curves"), studio.curves.found, whole.fps, window, studio.time() - before, look);
}
