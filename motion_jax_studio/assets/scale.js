// The visible window of the timeline: zoom, pan, ruler marks. Needs no browser.

const NEAREST = 0.5,
  FARTHEST = 3600; // seconds across

/** {start, end} after zooming by a factor around a second that stays where it is. */
export function zoomed(window, factor, around) {
  const width = window.end - window.start,
    wide = Math.min(FARTHEST, Math.max(NEAREST, width * factor));
  const start = Math.max(0, around - ((around - window.start) * wide) / width);
  return { start, end: start + wide };
}

/** Moved by seconds, but not before 0. */
export function panned(window, seconds) {
  const start = Math.max(0, window.start + seconds);
  return { start, end: start + window.end - window.start };
}

/** The window with this second in it. */
export function showing(window, second) {
  const width = window.end - window.start;
  if (second >= window.start && second <= window.end) return window;
  const start = Math.max(0, second - width * (second > window.end ? 0.15 : 0.5));
  return { start, end: start + width };
}

/** Seconds between two marks of a ruler of this width in pixels. */
export function between(window, width) {
  const least = ((window.end - window.start) / Math.max(width, 1)) * 60;
  return [0.1, 0.2, 0.5, 1, 2, 5, 10, 30, 60, 300, 600].find((step) => step >= least) ?? 1800;
}

/** Where a block that is dragged to a second belongs among the others: its index. rows: of placed(). */
export function indexAt(rows, id, second) {
  let index = 0;
  for (const { block, start, end } of rows) {
    if (block.id !== id && second > (start + end) / 2) index += 1;
  }
  return index;
}
