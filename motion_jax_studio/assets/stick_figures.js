// Small moving stick figures: suggestions.json's int8 points, drawn on canvases while they are visible.

const REST = 400; // milliseconds between two rounds of a figure

/** Float32Array of frames * joints * 2, metres, from the base64 of a suggestion. */
export function unpackFigure(text, scale) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  return Float32Array.from(new Int8Array(bytes.buffer), (value) => value / scale);
}

/** Where the joints are at a second, between frames: Float32Array of joints * 2. */
export function poseAt(points, joints, fps, second) {
  const frames = points.length / (2 * joints),
    at = Math.max(0, Math.min(second * fps, frames - 1)),
    first = Math.min(Math.floor(at), frames - 1),
    next = Math.min(first + 1, frames - 1);
  return Float32Array.from({ length: 2 * joints }, (_, i) => {
    const a = points[first * 2 * joints + i];
    return a + (points[next * 2 * joints + i] - a) * (at - first);
  });
}

// x of the body lies in the middle; two metres and a little fill the height.
function draw(canvas, pose, parents, color) {
  const { width, height } = canvas,
    pen = canvas.getContext("2d"),
    size = height / 2.15;
  const x = (j) => width / 2 + pose[2 * j] * size,
    y = (j) => height - 4 - pose[2 * j + 1] * size;
  pen.clearRect(0, 0, width, height);
  pen.strokeStyle = pen.fillStyle = color;
  pen.lineWidth = height / 22;
  pen.lineCap = "round";
  pen.beginPath();
  parents.forEach((parent, j) => {
    if (parent < 0) return;
    pen.moveTo(x(parent), y(parent));
    pen.lineTo(x(j), y(j));
  });
  pen.stroke();
  pen.beginPath();
  pen.arc(x(15), y(15), height / 18, 0, 7); // the head
  pen.fill();
}

/** Moves the figures of canvases until it is stopped. rows: [{canvas, points}]; head: {fps, parents}. */
export function play(rows, { fps, parents }) {
  let running = true;
  const joints = parents.length,
    still = matchMedia("(prefers-reduced-motion: reduce)").matches,
    began = performance.now();
  const tick = (now) => {
    if (!running) return;
    for (const { canvas, points } of rows) {
      const box = canvas.getBoundingClientRect(),
        list = canvas.closest("[role=listbox]").getBoundingClientRect();
      if (box.bottom < list.top || box.top > list.bottom) continue;
      const seconds = points.length / (2 * joints) / fps,
        second = still ? seconds / 2 : ((now - began) % (1000 * seconds + REST)) / 1000;
      draw(canvas, poseAt(points, joints, fps, second), parents, getComputedStyle(canvas).color);
    }
    if (!still) setTimeout(() => requestAnimationFrame(tick), 60);
  };
  requestAnimationFrame(tick);
  return () => {
    running = false;
  };
}
