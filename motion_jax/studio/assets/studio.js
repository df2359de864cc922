// The page: one stream, drawn as it comes, and words that change it.
import { open } from "./stream.js";

const $ = (id) => document.getElementById(id);
const token = new URLSearchParams(location.search).get("token") || "";
const state = { frames: [], first: 0, time: 0, run: 0, parents: null, fps: 20, paused: false, told: "", blocks: [], words: {} };
window.__studio = state;
let stream, last = performance.now();

const tell = (text) => { state.told = text; $("told").textContent = text; };

function connect() {
  stream = open(token, {
    opened: () => stream.send({ type: "start", prompt: $("prompt").value, seed: 1 }),
    closed: () => { tell("the studio has gone; trying to reach it again"); setTimeout(connect, 1000); },
    message: (message) => {
      if (message.type === "started") Object.assign(state, message, { type: undefined, frames: [], first: 0, time: 0, blocks: [] });
      if (message.type === "words") {
        state.words[message.words] = message.prompt;
        tell(message.unknown.length ? `the model does not know: ${message.unknown.join(", ")}` : message.prompt);
      }
      if (message.type === "state") {
        state.paused = message.state === "paused";
        if (message.doing) tell(`${message.state}: ${message.doing} (${message.seconds.toFixed(0)} s)`);
      }
      if (message.type === "error") tell(message.message);
    },
    block: (block) => {
      if (block.run !== state.run) return;
      state.blocks.push({ sequence: block.sequence, past: block.firstFrame + block.frames });
      for (let i = 0; i < block.frames; i++) {
        state.frames.push(block.positions.subarray(3 * block.joints * i, 3 * block.joints * (i + 1)));
      }
    },
  });
}

function draw(now) {
  const passed = (now - last) / 1000;
  last = now;
  const end = state.first + state.frames.length - 1;
  if (!state.paused && end > 0) state.time = Math.min(state.time + passed, end / state.fps);
  const at = Math.floor(state.time * state.fps);
  while (state.blocks.length && state.blocks[0].past <= at + 1) {  // what has been played makes room
    stream.send({ type: "ack", sequence: state.blocks.shift().sequence });
  }
  while (state.first < at - 200) { state.frames.shift(); state.first += 1; }
  const canvas = $("stage"), pen = canvas.getContext("2d"), body = state.frames[at - state.first];
  canvas.width = canvas.clientWidth * devicePixelRatio;
  canvas.height = canvas.clientHeight * devicePixelRatio;
  if (body && state.parents) {
    const scale = canvas.height / 2.6, turn = Math.PI / 5;
    const place = (j) => {
      const x = body[3 * j] - body[0], y = body[3 * j + 1], z = body[3 * j + 2] - body[2];
      return [canvas.width / 2 + scale * (x * Math.cos(turn) + z * Math.sin(turn)), canvas.height * 0.9 - scale * y];
    };
    pen.strokeStyle = getComputedStyle(document.documentElement).getPropertyValue("--accent");
    pen.lineWidth = 6 * devicePixelRatio;
    pen.lineCap = "round";
    pen.beginPath();
    state.parents.forEach((parent, j) => { if (parent >= 0) { pen.moveTo(...place(parent)); pen.lineTo(...place(j)); } });
    pen.stroke();
  }
  requestAnimationFrame(draw);
}

$("say").onsubmit = (event) => {
  event.preventDefault();
  stream.send({ type: "prompt", prompt: $("prompt").value });
};
$("pause").onclick = () => stream.send({ type: state.paused ? "resume" : "pause" });
$("restart").onclick = () => stream.send({ type: "restart", prompt: $("prompt").value });
connect();
requestAnimationFrame(draw);
