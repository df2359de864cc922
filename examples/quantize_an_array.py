"""Residual vector quantization of any array: learn codebooks, encode to indices, decode with more and more levels."""
import jax
import jax.numpy as jnp

from motion_jax.quant import rvq, vq

LEVELS, CODES, CHANNELS = 4, 64, 8
mix = jax.random.normal(jax.random.key(0), (CHANNELS, CHANNELS))
data = lambda rng: jax.random.normal(rng, (16, 64, CHANNELS)) ** 3 @ mix  # (B, L, C), not Gaussian


@jax.jit
def train_step(codebooks, rng):
  data_rng, noise_rng, item_rng = jax.random.split(rng, 3)
  x = data(data_rng)
  noise = rvq.draw_noise(noise_rng, jax.random.split(item_rng, len(x)), x.shape[1], codebooks)
  made, codebooks = rvq.train(codebooks, x, LEVELS, noise, temperature=0.1)
  return codebooks, made


codebooks = vq.empty_codebook(CODES, CHANNELS, (LEVELS,))
for step in range(200):
  codebooks, made = train_step(codebooks, jax.random.key(step))
print(f"perplexity {made.perplexity:.1f} of {CODES} codes, {made.usage:.0%} of them in use")

x = data(jax.random.key(1_000_000))
indices, _ = rvq.encode(codebooks.codes, x)  # (B, L, Q)
for count in range(1, LEVELS + 1):
  error = jnp.square(rvq.decode(codebooks.codes, indices, count) - x).mean() / jnp.square(x).mean()
  print(f"{count} level(s): relative error {error:.3f}")
