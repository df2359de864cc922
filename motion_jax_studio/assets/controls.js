// The buttons and check boxes of the page, and its status line.
import { isPath } from "./control.js";
import { stored } from "./stored.js";
import { liveDetails, liveText, statusOf, stepsText } from "./messages.js";

const $ = (id) => document.getElementById(id);
const LOOKS = ["follow", "path", "steps", "ghosts", "sticks", "edits"];

function theme(studio, dark) {
  document.documentElement.dataset.theme = dark ? "dark" : "light";
  studio.view?.stage.theme(dark);
  studio.dirty = true;
}

export function bind(studio) {
  const { live, multiPrompt, player, act, timeline, notes } = studio;
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
  $("show-notes").onclick = () => $("notes-panel").showModal();
  $("mode-live").onclick = () => {
    studio.setMode("live");
    again();
  };
  $("mode-timeline").onclick = () => {
    studio.setMode("timeline");
    again();
  };

  studio.look = () => Object.fromEntries(LOOKS.map((name) => [name, $(name).checked]));
  for (const name of LOOKS) {
    $(name).onchange = () => {
      if (studio.view) studio.view.options[name] = $(name).checked;
      again();
    };
  }
  $("centre").onclick = studio.centre = () => {
    const root = studio.view?.figures[0]?.places[0];
    studio.view?.frame(root?.x, root?.z);
  };

  $("prompt-form").onsubmit = (event) => {
    event.preventDefault();
    const prompt = $("prompt").value.trim();
    if (!prompt) return notes.tell("type what the person does, as in “a person waves”", true);
    if (!live.connected) return notes.tell("the studio is not connected; your prompt stays here until it is", true);
    live.say(prompt);
  };
  const { ideas } = studio,
    useIdea = (prompt) => {
      $("prompt").value = prompt;
      $("prompt-form").requestSubmit();
    };
  ideas.attach($("prompt"), useIdea);
  ideas.attach($("edit-prompt"), (prompt) => {
    $("edit-prompt").value = prompt;
  });
  $("ideas-button").onclick = () => {
    const open = !$("ideas").hidden;
    ideas.close();
    $("prompt").focus();
    if (!open) ideas.open($("prompt"), useIdea, true);
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
    multiPrompt.make(studio.side ? seeds.map((_, take) => take) : undefined);
  };
  $("cancel").onclick = () => multiPrompt.cancel();
  $("auto").onchange = () => {
    if ($("auto").checked && studio.state.project.blocks.length && multiPrompt.stale) multiPrompt.make();
  };
  $("undo").onclick = () => act({ type: "undo" });
  $("redo").onclick = () => act({ type: "redo" });
  $("repeat").onchange = () => {
    player.repeat = $("repeat").checked;
  };
  $("cleanup").onchange = () => act({ type: "set", fields: { cleanup: $("cleanup").checked } });
  $("side").onchange = () => {
    studio.side = $("side").checked;
    if (studio.side && studio.state.project.blocks.length)
      multiPrompt.make(studio.state.project.seeds.map((_, take) => take));
    again();
  };
  $("mark-in").onclick = () => studio.markIn();
  $("mark-out").onclick = () => studio.markOut();

  $("draw-path").onclick = () => {
    studio.tool.toggle();
    if (studio.tool.active)
      notes.tell("click on the floor to add points; drag moves one, right click or Delete removes it, Esc ends", false);
  };
  $("follow-path").onclick = () => studio.follow();
  $("keep-pose").onclick = () => studio.keepPose();
  $("constraints").onclick = ({ target }) => {
    const { index, time } = target.dataset;
    if (index !== undefined) {
      const path = isPath(studio.state.project.control[index]);
      act({ type: "removeConstraint", index: Number(index) });
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
  $("details").onchange = () => {
    studio.dirty = true;
  };
  $("zoom-in").onclick = () => timeline.zoom(0.7, studio.time());
  $("zoom-out").onclick = () => timeline.zoom(1 / 0.7, studio.time());
  $("zoom-fit").onclick = () => timeline.fit();
  addEventListener("resize", () => {
    studio.dirty = true;
  });

  // The models that can make a timeline, once they are known.
  studio.modelsChanged = () => {
    const able = studio.models.filter((model) => model.abilities?.includes("multi_prompt"));
    const { model } = studio.state.project;
    const known = able.find((one) => one.name === model.name) ?? (model.name ? null : able[0]);
    if (known && known.id !== model.id) act({ type: "model", model: { name: known.name, id: known.id ?? "" } });
    for (const failed of studio.models.filter((one) => one.state === "failed")) {
      const sentence = `${failed.name} cannot be used: ${failed.error}`;
      if (!notes.all.includes(sentence)) notes.tell(sentence, true, failed.name);
    }
    const ready = studio.models.filter((one) => one.state === "ready").length;
    if (ready !== studio.ready) ideas.forget(); // another model may know other prompts
    studio.ready = ready;
    studio.dirty = true;
  };

  let old = {};
  const put = (id, text) => {
    if (old[id] !== text) $(id).textContent = old[id] = text;
  };
  studio.status = (moved) => {
    if (!moved) return;
    const inLive = studio.mode === "live",
      { mode, models } = studio,
      { state, progress } = live;
    const { text, is, share } = statusOf({ mode, live, multiPrompt, models, blocks: studio.state.project.blocks.length });
    const line = $("state");
    if (old.how !== text || old.is !== is) {
      line.lastElementChild.textContent = old.how = text;
      line.dataset.is = old.is = is;
    }
    $("work").hidden = share === undefined;
    if (share !== undefined) $("work").value = share;
    $("cancel").hidden = inLive || !multiPrompt.busy;
    const playing = inLive ? state === "running" : player.playing;
    put("play", playing ? "❚❚" : "▶");
    put("time", inLive ? `${live.time.toFixed(1)} s` : `${player.time.toFixed(2)} s, frame ${player.frame}`);
    const prompt = live.frames ? (live.at(live.time * live.fps)?.prompt ?? "") : progress ? text : "";
    put("caption", inLive ? prompt : captionAt(multiPrompt.shown, player.time));
    const details = $("details").checked,
      same = multiPrompt.reply?.same_frames;
    put("numbers", inLive ? liveText(live) : "");
    const unchanged = same ? `${same} frames unchanged · ` : "";
    put("figures", !details ? "" : inLive ? liveDetails(live) : unchanged + stepsText(multiPrompt.shown));
    const about = details && !inLive ? stepsText(multiPrompt.shown, "\n") : "";
    if ($("figures").title !== about) $("figures").title = about;
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
