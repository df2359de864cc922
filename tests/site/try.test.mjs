// Parts of the page that need no browser, beside what Python says (expected.json): run by test_try.py.
import assert from 'node:assert/strict';
import {readFileSync} from 'node:fs';
import test from 'node:test';
import {bvh} from './bvh.js';
import {normal} from './noise.js';
import {Stream} from './stream.js';
import {Words} from './words.js';

const expected = JSON.parse(readFileSync('expected.json', 'utf8'));
const words = new Words(expected.tokenizer, expected.known, 64);

test('noise is that of JAX to the last bits', () => {
  for (const {seed, block, values} of expected.noise) {
    const made = normal(seed, block, values.length);
    const worst = Math.max(...values.map((value, i) => Math.abs(made[i] - value)));
    assert.ok(worst <= 5e-7, `seed ${seed}, block ${block}: ${worst}`);
    assert.ok(values.filter((value, i) => made[i] !== value).length < values.length / 8);
  }
});

test('word pieces are those of the tokenizer', () => {
  for (const [sentence, ids] of expected.pieces) assert.deepEqual(words.encode(sentence), ids, sentence);
});

test('each odd prompt gets one sentence, a plain one none', () => {
  for (const odd of ['', '  ', '\u{1f600}', '人が歩く', 'una persona camina hacia adelante', 'x'.repeat(2000)]) {
    const {ids, note} = words.read(odd);
    assert.match(note, /^[^.]+\.$/, odd.slice(0, 20));
    assert.equal(ids, null, odd.slice(0, 20));
  }
  const long = words.read('a person walks and '.repeat(105));
  assert.equal(long.ids.length, 64);
  assert.match(long.note, /long/);
  assert.match(words.read('a person floobles').note, /floobles/);
  assert.equal(words.read('a person walks \u{1f600}').note.split('.').length, 2);
  assert.equal(words.read('a person walks forward').note, '');
});

test('a stream keeps state, changes prompt behind clean blocks and goes on from the block it is given', async () => {
  const calls = [], tensor = (name, type, shape) => ({name, type, shape});
  const about = {constants: {captions: 2, words: 3, age: 2, width: 3, block: 1, latent_dim: 2, frames_per_block: 1}, graphs: {
    text: {state: {}, inputs: [tensor('ids', 'int32', [1, 3]), tensor('mask', 'bool', [1, 3])]},
    step: {state: {latents: {next: 'later', start: 0}}, inputs: [tensor('latents', 'float32', [1]), tensor('noise', 'float32', [1, 1, 2]),
      tensor('steps', 'int32', []), tensor('past', 'int32', []), tensor('length', 'int32', []), tensor('caption', 'int32', [1, 3]), tensor('since', 'int32', [1, 3]),
      tensor('text_k', 'float32', [2, 1]), tensor('text_v', 'float32', [2, 1]), tensor('text_mask', 'bool', [2, 3])]},
    decoder: {state: {}, inputs: [tensor('latents', 'float32', [1, 1, 2])]},
    joints: {state: {place: {next: 'next_place', start: [5]}}, inputs: [tensor('features', 'float32', [1]), tensor('place', 'float32', [1])]}}};
  const stream = new Stream(about, async (name, feeds) => {
    calls.push([name, feeds]);
    const place = feeds.place?.data[0] + 1, one = (value) => ({type: 'float32', dims: [1], data: Float32Array.from([value])});
    return {text_k: one(1), text_v: one(2), clean: {data: [feeds.steps?.data[0], 0]}, later: one(feeds.latents?.data[0] + 1),
      features: one(0), joints: one(place), next_place: one(place)};
  });
  await stream.say([1, 2, 3]);
  assert.equal(await stream.step(), null);
  const made = [await stream.step(), await stream.step(), await stream.step()];
  assert.deepEqual(made.map(({number, joints}) => [number, joints[0]]), [[0, 6], [1, 7], [2, 8]]);
  await stream.say([1, 3], 2);
  calls.length = 0;
  const later = [];
  for (let i = 0; i < 4; i++) later.push(await stream.step());
  const steps = calls.filter(([name]) => name === 'step').map(([, feeds]) => feeds);
  assert.deepEqual(steps.map((feeds) => feeds.steps.data[0]), [-2, -1, 0, 1]);
  assert.deepEqual(steps.map((feeds) => feeds.noise.data[0]).slice(0, 2), [1, 2]); // the clean blocks 0 and 1
  assert.deepEqual([...steps[0].caption.data], [0, 0, 1]);
  assert.equal(steps[0].past.data[0], 2);
  assert.deepEqual([later[3].number, later[3].joints[0]], [2, 8]); // in the place of the one that was dropped
});

test('a BVH says what was turned', () => {
  const half = Math.SQRT1_2, text = bvh({names: ['root', 'arm'], parents: [-1, 0], offsets: [[0, 0, 0], [0, 1, 0]], fps: 20,
    roots: [[0, 1, 0], [0, 1, 2]], turns: [[[0, 0, 0, 1], [0, 0, 0, 1]], [[0, half, 0, half], [half, 0, 0, half]]]});
  const rows = text.trim().split('\n').slice(-2).map((row) => row.split(' ').map(Number));
  assert.deepEqual(rows, [[0, 100, 0, 0, 0, 0, 0, 0, 0], [0, 100, 200, 90, 0, 0, 0, 0, 90]]);
});
