// The page: a prompt, a body that moves, what there is to choose.
import {bvh} from './bvh.js';
import {glb} from './glb.js';

const $ = (id) => document.getElementById(id);
const SIMD = new Uint8Array([0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11]);
const MOST = 20 * 60 * 10; // frames that are kept for a download: ten minutes
const state = {frames: 0, run: 0, time: 0, playing: true, begun: false, last: 0, starved: 0, blocks: [], prompts: [], said: null};
let worker, files, view, body, joints = new Float32Array(0), constants = {fps: 20, frames_per_block: 12};

function note(text, error = false) {
  $('note').textContent = text;
  $('note').hidden = !text;
  $('note').classList.toggle('error', error);
}

function stage(text, share = null) {
  $('loading').hidden = !text;
  $('doing').textContent = text;
  if (share !== null) $('bar').value = share;
}

function failed(text, again = true) {
  worker?.terminate();
  state.begun = false;
  stage('');
  note(`${text[0].toUpperCase()}${text.slice(1)}.`, true);
  $('again').hidden = !again;
  document.body.dataset.state = 'failed';
}

// What this browser lacks; '' for nothing.
function missing() {
  if (typeof WebAssembly !== 'object' || !WebAssembly.validate(SIMD) || new URLSearchParams(location.search).has('nosimd')) {
    return 'this browser lacks WebAssembly with SIMD, which the model needs; try a current Firefox, Chrome, Edge or Safari';
  }
  if (typeof DecompressionStream !== 'function') return 'this browser cannot unpack the model; try a newer version of it';
  return '';
}

function threads() {
  const wanted = Number(new URLSearchParams(location.search).get('threads') ?? $('threads').value);
  return globalThis.crossOriginIsolated ? wanted || Math.min(4, Math.max(1, (navigator.hardwareConcurrency ?? 2) >> 1)) : 1;
}

async function fetched(url, kind) {
  const response = await fetch(url).catch(() => null);
  if (!response?.ok) throw new Error(`the file ${url.replace(/\?.*/, '')} did not arrive${response ? ` (${response.status})` : ''}`);
  return response[kind]();
}

async function begin() {
  worker?.terminate();
  Object.assign(state, {begun: false, frames: 0, time: 0, said: null, began: performance.now()});
  note('');
  $('again').hidden = true;
  document.body.dataset.state = 'loading';
  stage('loading the model', 0);
  const lack = missing();
  if (lack) return failed(lack, false);
  try {
    files = await fetched('model/files.json', 'json');
    worker = new Worker('worker.js', {type: 'module'});
    worker.onerror = (event) => failed(`the model did not start (${event.message || 'its script did not arrive'})`);
    worker.onmessage = ({data}) => on[data.type]?.(data);
    worker.postMessage({type: 'begin', engine: $('engine').value, threads: threads(), files});
    body ??= await fetched(`model/body.json?v=${files.version}`, 'json');
    view ??= new View($('stage'), body); // takes long without a graphics card; the model starts meanwhile
  } catch (error) {
    failed(`${error.message}; check the connection`);
  }
}

const on = {
  progress: ({done, total}) => stage(`loading the model: ${(done / 1e6).toFixed(1)} of ${(total / 1e6).toFixed(1)} MB`, done / total),
  stage: ({text}) => stage(text, 1),
  ready(message) {
    constants = message.constants;
    state.begun = true;
    state.ready = {...message, loaded: performance.now() - state.began};
    stage('');
    document.body.dataset.state = 'ready';
    say($('prompt').value, true);
  },
  read: ({note: text}) => note(text),
  said({prompt, from, run, fresh}) {
    state.run = run;
    state.frames = from * constants.frames_per_block;
    if (fresh) Object.assign(state, {time: 0, prompts: []});
    state.prompts = [...state.prompts.filter((one) => one.from < state.frames), {prompt, from: state.frames}];
    state.said = {at: state.sent, from: state.frames};
  },
  block({joints: made, milliseconds, run}) {
    if (run !== state.run) return;
    room(state.frames * 66 + made.length);
    joints.set(made, state.frames * 66);
    if (state.said && state.frames === state.said.from) state.first = performance.now() - state.said.at;
    state.frames += made.length / 66;
    state.blocks = [...state.blocks.slice(-40), milliseconds];
    if (state.frames >= MOST) setPlaying(false);
  },
  step: ({milliseconds}) => { state.warm = milliseconds; },
  failed: ({text}) => failed(text.includes('did not arrive') ? `${text}; check the connection` : `the model stopped: ${text}`),
  pieces: ({pieces}) => { state.pieces = pieces; },
};

function room(length) {
  if (length <= joints.length) return;
  const larger = new Float32Array(Math.max(length, 2 * joints.length));
  larger.set(joints);
  joints = larger;
}

/** A new prompt: from the next block on, or from the beginning. */
function say(prompt, fresh = false) {
  if (!state.begun) return;
  state.sent = performance.now();
  const keep = Math.ceil(state.time * constants.fps / constants.frames_per_block) + 1;
  worker.postMessage({type: 'say', prompt, seed: Number($('seed').value) >>> 0, keep, fresh});
  if (!state.playing) setPlaying(true);
}

function setPlaying(on) {
  state.playing = on;
  $('play').textContent = on ? 'Pause' : 'Play';
}

// --- the body ---------------------------------------------------------------------------------------------------

class View {
  constructor(element, body) {
    const {Stage, Figure, Turns, three} = window.motionParts, dark = matchMedia('(prefers-color-scheme: dark)');
    this.stage = new Stage(element, {dark: dark.matches, preserve: false});
    dark.onchange = () => {
      this.stage.theme(dark.matches);
      this.stale = true;
    };
    this.figure = new Figure(body, body.colors);
    this.turns = new Turns(body.names, body.parents, body.rest);
    this.places = body.rest.map((at) => new three.Vector3(...at));
    this.rotations = body.rest.map(() => new three.Quaternion());
    this.stage.scene.add(this.figure.group);
    this.stage.controls.target.set(0, 0.95, 0);
    this.stage.camera.position.set(3, 1.9, 4.6);
    this.stage.fog(12, 30);
    this.stage.light(3.5);
    this.stale = true; // drawn again only where the picture changes, so that a model that starts has the processor
    this.stage.controls.addEventListener('change', () => { this.stale = true; });
    new ResizeObserver(() => {
      this.stage.resize();
      this.stale = true;
    }).observe(element);
    this.stage.resize();
    this.draw(0);
  }

  // Joints at a frame that need not be whole.
  pose(at) {
    const t = Math.floor(at), n = Math.min(t + 1, state.frames - 1), w = at - t;
    this.places.forEach((place, j) => {
      const p = t * 66 + 3 * j, q = n * 66 + 3 * j;
      place.set(...[0, 1, 2].map((k) => joints[p + k] + (joints[q + k] - joints[p + k]) * w));
    });
    this.turns.set(this.places, this.rotations);
  }

  draw(passed) {
    const at = Math.min(state.time * constants.fps, state.frames - 1);
    if (at === this.at && !this.stale) return;
    Object.assign(this, {at, stale: false});
    if (state.frames) this.pose(at);
    this.figure.put(this.places, this.rotations);
    const {target} = this.stage.controls, easing = Math.min(1, passed * 5);
    this.stage.carry((this.places[0].x - target.x) * easing, (this.places[0].z - target.z) * easing);
    this.stage.draw();
  }
}

function tick(now) {
  const passed = Math.min((now - (state.last || now)) / 1000, 0.1); // a tab in the background goes on where it was
  state.last = now;
  if (state.playing && state.frames && view) {
    const end = (state.frames - 1) / constants.fps, next = state.time + passed;
    if (next > end) state.starved += Math.min(passed, next - end);
    state.time = Math.max(state.time, Math.min(next, end));
    const frame = Math.floor(state.time * constants.fps);
    if (frame !== state.shown) worker.postMessage({type: 'played', frame: (state.shown = frame)});
  }
  view?.draw(passed);
  const at = state.prompts.findLast((one) => one.from <= state.time * constants.fps);
  $('caption').textContent = at?.prompt ?? '';
  requestAnimationFrame(tick);
}

function numbers() {
  const {ready, blocks, first} = state;
  if (!ready) return;
  const sorted = [...blocks].sort((a, b) => a - b), median = sorted[sorted.length >> 1];
  $('numbers').textContent = [`${ready.engine === 'webgpu' ? 'WebGPU' : `${ready.threads} thread${ready.threads > 1 ? 's' : ''}`}`,
    median && `a block of 0.6 s in ${median.toFixed(0)} ms`, first && `answer after ${(first / 1000).toFixed(1)} s`].filter(Boolean).join(' · ');
}

// --- files ------------------------------------------------------------------------------------------------------

// Roots and local rotations of all frames, by the turns that the picture shows.
function pose() {
  const {three} = window.motionParts, roots = [], turns = [], inverse = new three.Quaternion();
  for (let t = 0; t < state.frames; t++) {
    view.pose(t);
    roots.push(view.places[0].toArray());
    turns.push(view.rotations.map((own, j) => {
      const parent = body.parents[j];
      return (parent < 0 ? own.clone() : inverse.copy(view.rotations[parent]).invert().multiply(own)).toArray();
    }));
  }
  turns.forEach((frame, t) => t && frame.forEach((q, j) => { // the nearer of q and -q
    if (q.reduce((sum, value, k) => sum + value * turns[t - 1][j][k], 0) < 0) turns[t][j] = q.map((value) => -value);
  }));
  const offsets = body.rest.map((at, j) => at.map((value, k) => (body.parents[j] < 0 ? 0 : value - body.rest[body.parents[j]][k])));
  return {names: body.names, parents: body.parents, offsets, fps: constants.fps, roots, turns};
}

function made(kind) {
  const caption = state.prompts.map((one) => one.prompt).join(', then ');
  return kind === 'bvh' ? new Blob([bvh(pose())], {type: 'text/plain'}) : glb(body, pose(), {caption, license: state.ready.license});
}

function download(kind) {
  if (!state.frames) return note('There is no motion yet; type what the person does.');
  const name = (state.prompts.at(-1)?.prompt ?? 'motion').toLowerCase().replace(/[^a-z0-9]+/g, '-').slice(0, 40) || 'motion';
  const link = Object.assign(document.createElement('a'), {href: URL.createObjectURL(made(kind)), download: `${name}.${kind}`});
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

$('form').onsubmit = (event) => {
  event.preventDefault();
  say($('prompt').value);
};
for (const button of $('ideas').children) {
  button.onclick = () => {
    $('prompt').value = button.textContent;
    say(button.textContent);
  };
}
$('play').onclick = () => setPlaying(!state.playing);
$('restart').onclick = () => say($('prompt').value, true);
$('seed').onchange = () => say($('prompt').value, true);
$('engine').onchange = $('threads').onchange = begin;
$('again').onclick = () => {
  $('engine').value = 'wasm'; // which runs everywhere
  begin();
};
$('bvh').onclick = () => download('bvh');
$('glb').onclick = () => download('glb');
$('engine').querySelector('[value=webgpu]').disabled = !navigator.gpu;
if (navigator.gpu && new URLSearchParams(location.search).get('engine') === 'webgpu') $('engine').value = 'webgpu';
$('threads').parentElement.hidden = !globalThis.crossOriginIsolated;
$('prompt').value = new URLSearchParams(location.search).get('prompt') || $('prompt').value; // a link to a sentence
window.motionTry = {state, say, made, joints: () => joints.slice(0, state.frames * 66),
  inspect: (sentences) => worker.postMessage({type: 'inspect', sentences})};
navigator.serviceWorker?.register('sw.js').catch(() => {});
setInterval(numbers, 500);
requestAnimationFrame(tick);
begin();
