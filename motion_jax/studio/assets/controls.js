// The buttons and boxes of the page, and the line that says how it goes.
import { isPath } from "./control.js";

const $ = (id) => document.getElementById(id);
const LOOKS = ["follow", "path", "steps", "ghosts", "sticks"];

function stored(name, value) {
  try {
    if (value === undefined) return localStorage.getItem(name);
    localStorage.setItem(name, value);
  } catch {
    // a browser that keeps nothing
    return null;
  }
}

function theme(studio, dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  studio.view?.stage.theme(dark);
  studio.dirty = true;
}

export function bind(studio) {
  const { live, story, player, act, timeline, notes } = studio;
  const again = () => {
    studio.laidAgain = studio.dirty = true;
  };

  const dark = stored("theme") ?? (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
  theme(studio, dark === "dark");
  $("theme").onclick = () => {
    const next = document.documentElement.dataset.theme === "dark" ? "light" : "dark";
    stored("theme", next);
    theme(studio, next === "dark");
  };
  $("help").onclick = () => $("help-panel").showModal();
  $("mode-live").onclick = () => {
    studio.setMode("live");
    again();
  };
  $("mode-story").onclick = () => {
    studio.setMode("story");
    again();
  };

  studio.look = () => Object.fromEntries(LOOKS.map((name) => [name, $(name).checked]));
  for (const name of LOOKS) {
    $(name).onchange = () => {
      if (studio.view) studio.view.options[name] = $(name).checked;
      again();
    };
  }
  $("centre").onclick = () => {
    const root = studio.view?.figures[0]?.places[0];
    studio.view?.frame(root?.x, root?.z);
  };

  $("say").onsubmit = (event) => {
    event.preventDefault();
    const prompt = $("prompt").value.trim();
    if (!prompt) return notes.tell("say what the person does, as in “a person waves”", true);
    if (!live.connected) return notes.tell("the studio is not connected; the words stay here until it is", true);
    live.say(prompt);
  };
  $("play").onclick = studio.play;
  $("restart").onclick = () => live.restart();
  $("new-seed").onclick = () =>
    live.send({ type: "restart", prompt: live.choices.prompt, seed: Math.floor(Math.random() * 2 ** 31) });
  $("speed").oninput = () => {
    live.speed(Number($("speed").value));
    $("speed").nextElementSibling.textContent = `${Number($("speed").value)}×`;
  };
  $("keep-going").onchange = () => live.keepGoing($("keep-going").checked);
  $("to-timeline").onclick = studio.toTimeline;

  $("make").onclick = () => {
    const { seeds } = studio.state.project;
    story.make(studio.side ? seeds.map((_, take) => take) : undefined);
  };
  $("auto").onchange = () => $("auto").checked && studio.state.project.blocks.length && story.make();
  $("undo").onclick = () => act({ type: "undo" });
  $("redo").onclick = () => act({ type: "redo" });
  $("repeat").onchange = () => {
    player.repeat = $("repeat").checked;
  };
  $("cleanup").onchange = () => act({ type: "set", fields: { cleanup: $("cleanup").checked } });
  $("side").onchange = () => {
    studio.side = $("side").checked;
    if (studio.side && studio.state.project.blocks.length)
      story.make(studio.state.project.seeds.map((_, take) => take));
    again();
  };
  $("mark-in").onclick = () => studio.markIn();
  $("mark-out").onclick = () => studio.markOut();

  $("draw-path").onclick = () => {
    studio.tool.toggle();
    if (studio.tool.active)
      notes.tell("click on the floor: way points; drag moves one, right click or Delete removes it, Esc ends", false);
  };
  $("follow-path").onclick = () => studio.follow();
  $("keep-pose").onclick = () => studio.keepPose();
  $("asked").onclick = ({ target }) => {
    const { index, time } = target.dataset;
    if (index !== undefined) {
      const path = isPath(studio.state.project.control[index]);
      act({ type: "unask", index: Number(index) });
      if (path && studio.mode === "live") studio.follow();
    } else if (time) {
      studio.seek(Number(time));
      timeline.reveal(studio.time());
    }
  };

  $("show-curves").onchange = () => {
    $("curves").hidden = !$("show-curves").checked;
    studio.dirty = true;
  };
  $("zoom-in").onclick = () => timeline.zoom(0.7, studio.time());
  $("zoom-out").onclick = () => timeline.zoom(1 / 0.7, studio.time());
  $("zoom-fit").onclick = () => timeline.fit();
  addEventListener("resize", () => {
    studio.dirty = true;
  });

  // The models that can tell a story, once they are known.
  studio.modelsCame = () => {
    const able = studio.models.filter((model) => model.abilities?.includes("multi_prompt"));
    const { model } = studio.state.project;
    const known = able.find((one) => one.name === model.name) ?? (model.name ? null : able[0]);
    if (known && known.id !== model.id) act({ type: "model", model: { name: known.name, id: known.id ?? "" } });
    for (const failed of studio.models.filter((one) => one.state === "failed")) {
      const sentence = `${failed.name} cannot be used: ${failed.error}`;
      if (!notes.all.includes(sentence)) notes.tell(sentence, true);
    }
    studio.dirty = true;
  };

  let old = {};
  const put = (id, text) => {
    if (old[id] !== text) $(id).textContent = old[id] = text;
  };
  studio.status = (moved) => {
    if (!moved) return;
    const inLive = studio.mode === "live",
      { state, progress } = live;
    const loading = studio.models.find((model) => !["ready", "failed"].includes(model.state));
    const how =
      !live.connected && live.reconnects
        ? "the studio has gone; trying to reach it again"
        : story.busy && !inLive
          ? story.busy
          : progress
            ? `${progress.state}: ${progress.doing} (${progress.done} of ${progress.of}, ${progress.seconds.toFixed(0)} s)`
            : !inLive && loading
              ? `${loading.name}: ${loading.doing || loading.state}`
              : inLive
                ? ({ running: "live", waiting: "the words are done; say others", lost: "connecting" }[state] ?? state)
                : story.stale && studio.state.project.blocks.length
                  ? "changed, not made yet"
                  : "ready";
    const line = $("state"),
      is = !live.connected ? "bad" : progress || story.busy || loading ? "busy" : "good";
    if (old.how !== how || old.is !== is) {
      line.lastElementChild.textContent = old.how = how;
      line.dataset.is = old.is = is;
    }
    const playing = inLive ? state === "running" : player.playing;
    put("play", playing ? "❚❚" : "▶");
    put("time", inLive ? `${live.time.toFixed(1)} s` : `${player.time.toFixed(2)} s, frame ${player.frame}`);
    put("caption", inLive ? (live.frames ? (live.at(live.time * live.fps)?.prompt ?? "") : progress ? how : "") : captionAt(story.shown, player.time));
    const flight = Math.max(0, live.begun - live.committed) / live.fps;
    put(
      "numbers",
      inLive && live.blocks
        ? `${live.lead.toFixed(1)} s ahead, ${flight.toFixed(1)} s in flight, block ${live.sampling.toFixed(0)} ms` +
            (live.latency === null ? "" : `, words after ${live.latency.toFixed(1)} s`)
        : !inLive && story.reply?.same_frames
          ? `${story.reply.same_frames} frames as before`
          : "",
    );
    $("undo").disabled = !studio.state.past.length;
    $("redo").disabled = !studio.state.future.length;
    if ($("cleanup").checked !== studio.state.project.cleanup) $("cleanup").checked = studio.state.project.cleanup;
  };
}

function captionAt(motion, second) {
  const captions = motion?.captions ?? [];
  return (
    (
      captions.find(({ start, end }) => start <= second && second < end) ??
      captions.find(({ start, end }) => !start && !end) ??
      captions.at(-1)
    )?.text ?? ""
  );
}
