// The rows of the timeline, in seconds. Needs no browser.
import { isPath, named, ofTimeline } from "./control.js";
import { MOST_BLOCKS, placed, snapped } from "./state.js";

/** The rows of a stream: its prompts, committed frames and frames in flight. */
export function liveRows(live) {
  const second = (frame) => frame / live.fps,
    end = second(Math.max(live.begun, live.end));
  const rows = live.words
    .filter((one) => second(one.from) < Math.max(end, 0.01))
    .map((one, i, all) => ({
      id: one.words,
      prompt: one.prompt,
      remark: one.remark,
      start: second(Math.max(one.from, live.first)),
      end: all[i + 1] ? Math.min(second(all[i + 1].from), end) : end,
    }))
    .filter((row) => row.end > row.start);
  const pieces = [
    { start: second(live.first), end: second(live.committed), kind: "there" },
    { start: second(live.committed), end: second(Math.max(live.begun, live.committed)), kind: "flight" },
  ];
  return { rows, among: [], end, time: live.time, span: null, selected: null, pieces, fixed: true };
}

// Where a constraint is on the track: [{start, end, kind, remark}], none for one without times.
function controlRow(one, end) {
  const remark = named(one, end),
    [first, last] = [one.times?.[0] ?? one.time, one.times?.at(-1) ?? one.time];
  if (isPath(one)) return [{ start: first ?? 0, end: last ?? end, kind: "path", remark }];
  return first === undefined ? [] : [{ start: first, end: last, kind: "pose", remark }];
}

/** The rows of a project: the imported motion, its blocks, and the generated spans. */
export function timelineRows({ project, selected, span }, multiPrompt, time) {
  const among = placed(project),
    fps = multiPrompt.shown?.fps ?? 20,
    stale = multiPrompt.stale;
  const rows = among.map(({ block, start, end }) => ({ id: block.id, prompt: block.prompt, start, end, stale,
    remark: multiPrompt.remark(block.prompt) })); // prettier-ignore
  if (project.past) {
    const end = project.past.shape[0] / project.past.fps;
    rows.unshift({ id: "import", prompt: project.past.captions?.[0]?.text || "imported motion", start: 0, end });
  }
  return {
    rows,
    among,
    end: rows.at(-1)?.end ?? 0,
    time,
    span: span?.map((frame) => frame / fps),
    selected,
    pieces: multiPrompt.pieces(),
    controls: ofTimeline(project.control).flatMap((one) => controlRow(one, rows.at(-1)?.end ?? 0)),
    fixed: false,
  };
}

/** The live prompts as a project: the same prompts, lengths, seed and model give the same motion. */
export function liveProject(live, project) {
  const step = live.blockFrames / live.fps;
  const blocks = live
    .motion()
    .captions.map(({ text, start, end }) => ({ prompt: text, seconds: snapped(end - start, step) }));
  const seeds = [live.choices.seed ?? 0],
    model = live.model ?? project.model,
    { sampling = {}, without = [] } = live.choices;
  const made = { blocks: blocks.slice(-MOST_BLOCKS), seeds, chosen: 0, cleanup: true, sampling, without, model };
  return { ...project, ...made, edits: [], past: null, control: null };
}
