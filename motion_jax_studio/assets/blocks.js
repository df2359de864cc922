// Blocks of the timeline: editing the prompt, length and position of one.
import { indexAt } from "./scale.js";
import { LONGEST_PROMPT } from "./state.js";

export const make = (kind, name, ...children) => {
  const element = Object.assign(document.createElement(kind), { className: name });
  element.append(...children);
  return element;
};

/** Opens a field for the prompt of a block, or of a new one. Enter accepts it, Escape cancels. */
export function ask(timeline, id) {
  timeline.track.querySelector(".words")?.remove();
  const row = timeline.shown.rows.find((one) => one.id === id);
  const input = make("input", "words");
  Object.assign(input, { maxLength: LONGEST_PROMPT, value: row?.prompt ?? "", placeholder: "what does the person do?" });
  input.setAttribute("aria-label", "prompt of the block");
  input.style.left = `${Math.max(4, Math.min(timeline.place(row?.start ?? timeline.shown.end), timeline.width - 230))}px`;
  if (row) input.style.width = `${Math.max(220, timeline.place(row.end) - timeline.place(row.start))}px`;
  let over = false;
  const done = (take) => {
    if (over) return;
    over = true;
    const words = input.value.trim();
    input.remove();
    if (!take || !words) return;
    if (id === null) timeline.on.add(words);
    else timeline.on.edit(id, words);
  };
  input.onkeydown = (event) => {
    event.stopPropagation();
    if (event.key === "Enter") done(true);
    if (event.key === "Escape") done(false);
  };
  input.onblur = () => done(true);
  timeline.track.append(input);
  timeline.on.typing?.(input, (words) => {
    input.value = words;
    done(true);
  });
  input.focus();
  input.select();
}

// A block's element: its right edge sets the length, the rest moves it.
export function makeBlock(timeline, id) {
  const mark = Object.assign(make("button", "mark", "!"), { type: "button", tabIndex: -1, hidden: true });
  const element = make("div", "block", make("span", ""), mark, make("div", "edge"));
  element.dataset.id = id;
  element.setAttribute("role", "option");
  mark.onclick = () => timeline.on.explain(id);
  element.addEventListener("pointerdown", (event) => {
    if (event.button || event.target === mark || timeline.shown.fixed || id === "import") return;
    event.stopPropagation();
    const edge = event.target.className === "edge",
      from = event.clientX,
      row = timeline.shown.rows.find((one) => one.id === id);
    element.setPointerCapture(event.pointerId);
    let by = 0;
    const step = (next) => {
      const dx = next.clientX - from;
      if (Math.abs(dx) < 4 && !by) return;
      by = (dx / timeline.width) * (timeline.window.end - timeline.window.start);
      element.classList.toggle("moving", !edge);
      timeline.dragging = id;
      const left = edge ? row.start : row.start + by,
        length = row.end - row.start + (edge ? by : 0);
      timeline.showTip(`${row.prompt} (${Math.max(0, length).toFixed(1)} s)`, timeline.place(left));
      if (edge) element.style.width = `${Math.max(8, timeline.place(row.end + by) - timeline.place(row.start) - 2)}px`;
      else element.style.left = `${timeline.place(row.start + by)}px`;
    };
    const end = (last) => {
      element.removeEventListener("pointermove", step);
      element.classList.remove("moving");
      timeline.dragging = null;
      timeline.showTip(null);
      if (last.type === "pointerup" && by && edge) timeline.on.resize(id, row.end - row.start + by);
      else if (last.type === "pointerup" && by)
        timeline.on.move(id, indexAt(timeline.shown.among, id, timeline.second(last.clientX)));
      else if (last.type === "pointerup") timeline.on.select(id);
      timeline.draw(timeline.shown);
    };
    element.addEventListener("pointermove", step);
    element.addEventListener("pointerup", end, { once: true });
    element.addEventListener("pointercancel", end, { once: true });
  });
  timeline.track.append(element);
  timeline.blocks.set(id, element);
  return element;
}
