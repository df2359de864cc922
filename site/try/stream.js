// The loop of docs/onnx.md: graphs in, blocks of joints out. `run` is onnxruntime's, so this file knows no browser.
import {normal} from './noise.js';

const KEPT = 24; // blocks from which motion can go on, newest last
const PAST = 2;  // blocks that a new prompt goes on from: more of them hold it back
const ANY = -(2 ** 30);
const ARRAYS = {float32: Float32Array, int32: Int32Array, bool: Uint8Array};

export class Stream {
  // about: model.json; run(graph, {name: {data, type, dims}}) -> {name: {data, type, dims}}; words: a `Words`.
  constructor(about, run) {
    Object.assign(this, {about, run, c: about.constants});
    const {captions, words} = this.c, shape = this.inputs('step').text_k.shape;
    this.size = shape.slice(1).reduce((a, b) => a * b, 1);
    this.bank = {text_k: new Float32Array(captions * this.size), text_v: new Float32Array(captions * this.size),
      text_mask: new Uint8Array(captions * words)};
    this.restart(0);
  }

  inputs(name) {
    return Object.fromEntries(this.about.graphs[name].inputs.map((one) => [one.name, one]));
  }

  tensor(name, key, data) {
    const {type, shape} = this.inputs(name)[key];
    return {data: data instanceof ARRAYS[type] ? data : ARRAYS[type].from(data), type, dims: shape};
  }

  // What a graph's state begins with.
  start(name) {
    const {state} = this.about.graphs[name];
    return Object.fromEntries(Object.entries(state).map(([key, {start}]) => {
      const {type, shape} = this.inputs(name)[key], data = new ARRAYS[type](shape.reduce((a, b) => a * b, 1));
      if (start) data.set([start].flat(Infinity));
      return [key, {data, type, dims: shape}];
    }));
  }

  /** A motion from the beginning, of a seed; `say` has to follow. */
  restart(seed) {
    Object.assign(this, {seed, changes: 0, made: 0, kept: []});
    this.begin([]);
    this.decoder = this.start('decoder');
    this.path = this.start('joints');
  }

  // A window behind these clean blocks.
  begin(past) {
    Object.assign(this, {past, steps: -past.length, script: [], window: this.start('step')});
  }

  /** The prompt of the blocks to come: pieces of `Words.read`. keep: how many blocks of the motion stay, the newest by
      default; those after them are made again. */
  async say(ids, keep = this.made) {
    const before = this.script.at(-1)?.slot ?? -1;
    if (this.made) {
      this.kept = this.kept.filter((one) => one.number < keep);
      const last = this.kept.at(-1);
      if (!last) throw new Error(`block ${keep - 1} is not kept any more`);
      this.made = last.number + 1;
      Object.assign(this, {decoder: last.decoder, path: last.path});
      this.changes += 1;
      this.begin(this.kept.slice(-PAST).map((one) => one.clean));
      this.script.push({from: this.steps, slot: before});
    } else {
      this.begin([]);
    }
    const slot = (before + 1) % this.c.captions, {words} = this.c;
    const row = new Int32Array(words), mask = new Uint8Array(words).fill(1, 0, ids.length);
    row.set(ids);
    const made = await this.run('text', {ids: this.tensor('text', 'ids', row), mask: this.tensor('text', 'mask', mask)});
    this.bank.text_k.set(made.text_k.data, slot * this.size);
    this.bank.text_v.set(made.text_v.data, slot * this.size);
    this.bank.text_mask.set(mask, slot * words);
    this.script.push({from: 0, slot});
  }

  // Runs a graph on its state and inputs: {outputs, state} with the state of its next run.
  async advance(name, state, inputs) {
    const made = await this.run(name, {...inputs, ...state});
    const next = Object.entries(this.about.graphs[name].state).map(([key, one]) => [key, made[one.next]]);
    return {made, state: Object.fromEntries(next)};
  }

  /** One block further: {number, joints (frames * J * 3)}, or null while nothing is clean. */
  async step() {
    const {age, width, block, latent_dim: channels} = this.c, {steps} = this;
    const oldest = steps < 0 ? steps : Math.max(steps - age, 0);
    const slots = Array.from({length: width}, (_, i) => this.script.findLast((one) => one.from <= oldest + i)?.slot ?? this.script[0].slot);
    const noise = steps < 0 ? this.past[steps + this.past.length] : normal(this.seed + this.changes, steps, block * channels);
    const inputs = {noise, steps: [steps], past: [this.past.length * block], length: [-ANY], caption: slots, since: Array(width).fill(ANY), ...this.bank};
    const tensors = Object.fromEntries(Object.entries(inputs).map(([key, data]) => [key, this.tensor('step', key, data)]));
    const {made, state} = await this.advance('step', this.window, tensors);
    this.window = state;
    this.steps += 1;
    if (this.steps < age) return null;
    const clean = Float32Array.from(made.clean.data);
    const decoded = await this.advance('decoder', this.decoder, {latents: this.tensor('decoder', 'latents', clean)});
    this.decoder = decoded.state;
    const placed = await this.advance('joints', this.path, {features: decoded.made.features});
    this.path = placed.state;
    const number = this.made++;
    this.kept = [...this.kept, {number, clean, decoder: this.decoder, path: this.path}].slice(-KEPT);
    return {number, joints: Float32Array.from(placed.made.joints.data)};
  }
}
