// Noise of JAX: jax.random.normal(jax.random.fold_in(jax.random.key(seed), block)), by Threefry-2x32 and Giles' inverse
// of the error function, in float32.
const TURNS = [[13, 15, 26, 6], [17, 29, 16, 24]];
const SMALL = [2.81022636e-8, 3.43273939e-7, -3.5233877e-6, -4.39150654e-6, 0.00021858087, -0.00125372503, -0.00417768164,
  0.246640727, 1.50140941].map(Math.fround);
const LARGE = [-0.000200214257, 0.000100950558, 0.00134934322, -0.00367342844, 0.00573950773, -0.0076224613, 0.00943887047,
  1.00167406, 2.83297682].map(Math.fround);
const LOW = Math.fround(-1 + 2 ** -24); // the smallest number above -1
const SPAN = Math.fround(1 - LOW);
const ROOT = Math.fround(Math.SQRT2);
const f = Math.fround;

/** The 20 rounds of Threefry-2x32 of the counter (x, y) under a key [a, b]: two numbers of 32 bits. */
export function threefry([a, b], x, y) {
  const keys = [a | 0, b | 0, a ^ b ^ 0x1bd11bda];
  x = (x + keys[0]) | 0;
  y = (y + keys[1]) | 0;
  for (let i = 0; i < 5; i++) {
    for (const turn of TURNS[i % 2]) {
      x = (x + y) | 0;
      y = x ^ ((y << turn) | (y >>> (32 - turn)));
    }
    x = (x + keys[(i + 1) % 3]) | 0;
    y = (y + keys[(i + 2) % 3] + i + 1) | 0;
  }
  return [x, y];
}

// A number of the normal distribution from 32 random bits.
function normalOf(bits) {
  const unit = ((bits >>> 9) * 2 ** -23); // 0 to 1 in steps of 2^-23
  const x = Math.max(f(f(unit * SPAN) + LOW), LOW);
  const w = f(-f(Math.log1p(f(-x * x))));
  const table = w < 5 ? SMALL : LARGE, at = w < 5 ? f(w - 2.5) : f(f(Math.sqrt(w)) - 3);
  let value = table[0];
  for (let i = 1; i < table.length; i++) value = f(f(value * at) + table[i]);
  return f(ROOT * f(value * x));
}

/** Float32Array of `count` normal numbers: the noise of a block of a stream. */
export function normal(seed, block, count) {
  const key = threefry([0, seed >>> 0], 0, block);
  return Float32Array.from({length: count}, (_, i) => {
    const [x, y] = threefry(key, 0, i);
    return normalOf(x ^ y);
  });
}
