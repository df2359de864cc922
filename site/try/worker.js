// The model, away from the page's own thread: loads the graphs, makes blocks ahead of what is played.
import {load, forgetOthers} from './files.js';
import {Stream} from './stream.js';
import {Words} from './words.js';

const AHEAD = 2; // blocks that are made before they are played
const ENGINES = {
  wasm: {module: './ort/ort.wasm.min.js', glue: 'ort-wasm-simd-threaded.js', binary: 'ort-wasm-simd-threaded.wasm.gz'},
  webgpu: {module: './ort/ort.webgpu.min.js', glue: 'ort-wasm-simd-threaded.asyncify.js', binary: 'ort-wasm-simd-threaded.asyncify.wasm.gz'},
};
let stream, words, ort, played = 0, run = 0, wanted = false, pumping = false, busy = Promise.resolve();
const tell = (type, more = {}, transfer = []) => postMessage({type, ...more}, transfer);

async function begin({engine, threads, files}) {
  const began = performance.now(), chosen = ENGINES[engine], at = (name) => `${name}?v=${files.version}`;
  const about = files.about, total = Object.values(about.graphs).reduce((sum, one) => sum + files.sizes[`${one.file}.gz`], files.sizes[chosen.binary]);
  let done = 0;
  const progress = (count) => tell('progress', {done: (done += count), total});
  const small = Object.keys(about.graphs).sort((a, b) => about.graphs[a].bytes - about.graphs[b].bytes);
  const [binary, ...graphs] = [`ort/${chosen.binary}`, ...small.map((name) => `model/${about.graphs[name].file}.gz`)]
    .map((name) => load(at(name), progress));
  let fetched = 0;
  Promise.all([binary, ...graphs]).then(() => {
    fetched = performance.now();
    tell('stage', {text: 'starting the model'});
  }, () => {}); // the loop below says which file is missing
  ort = await import(chosen.module);
  ort.env.wasm.wasmBinary = (await binary).buffer;
  ort.env.wasm.wasmPaths = {mjs: new URL(`./ort/${chosen.glue}`, self.location).href};
  ort.env.wasm.numThreads = threads;
  ort.env.logLevel = 'error';
  const sessions = {};
  for (const [i, name] of small.entries()) { // the small ones start while the large ones arrive
    // Only the large graph gains from a graphics card; the others would wait for its answers.
    const graphics = engine === 'webgpu' && name === 'step';
    // The graphs are simple already: looking for more takes longer than it saves.
    sessions[name] = await ort.InferenceSession.create(await graphs[i], {
      executionProviders: graphics ? ['webgpu', 'wasm'] : ['wasm'], graphOptimizationLevel: graphics ? 'basic' : 'disabled'});
  }
  words = new Words(about.tokenizer, about.known_words, about.constants.words);
  stream = new Stream(about, async (name, tensors) => {
    const feeds = Object.fromEntries(Object.entries(tensors).map(([key, {type, data, dims}]) => [key, new ort.Tensor(type, data, dims)]));
    return sessions[name].run(feeds);
  });
  forgetOthers(files.version);
  tell('ready', {constants: about.constants, skeleton: about.skeleton, license: about.license, model: about.model,
    fetched: fetched - began, started: performance.now() - fetched, threads: ort.env.wasm.numThreads, engine});
}

// One piece of work at a time: a step, or a new prompt between two steps.
function task(work) {
  busy = busy.then(work).catch((error) => tell('failed', {text: error.message}));
  return busy;
}

async function one() {
  const began = performance.now(), block = await stream.step(), milliseconds = performance.now() - began;
  if (block) tell('block', {...block, milliseconds, run}, [block.joints.buffer]);
  else tell('step', {milliseconds});
}

// Steps until enough is ahead of what is played; messages are read in between.
async function pump() {
  if (pumping) return;
  pumping = true;
  while (wanted && (stream.made - AHEAD) * stream.c.frames_per_block < played) {
    await task(one);
    await new Promise((resolve) => setTimeout(resolve, 0));
  }
  pumping = false;
}

const handle = {
  begin,
  async say({prompt, seed, keep, fresh}) {
    const {ids, note, prompt: read} = words.read(prompt);
    tell('read', {note});
    if (!ids) return;
    await task(async () => {
      if (fresh || !stream.made) {
        stream.restart(seed);
        played = 0;
      }
      const oldest = (stream.kept[0]?.number ?? 0) + 1;
      await stream.say(ids, Math.min(stream.made, Math.max(keep, oldest)));
      tell('said', {prompt: read, from: stream.made, run: ++run, fresh: !stream.made});
    });
    wanted = true;
    pump();
  },
  played({frame}) {
    played = frame;
    pump();
  },
  inspect({sentences}) { // for tests
    tell('pieces', {pieces: sentences.map((sentence) => words.encode(sentence))});
  },
};

onmessage = async ({data}) => {
  try {
    await handle[data.type](data);
  } catch (error) {
    tell('failed', {text: error.message});
  }
};
