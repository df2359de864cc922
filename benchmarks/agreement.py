"""Whether a shipped model's motions agree on a device: made again, in a batch, streamed, by a CPU, in full precision.

Numbers are the largest distance of a joint in millimetres over 6 s, without cleanup: of the same seed made twice; alone
and in a batch of 8; streamed and made at once; by this device and by the CPU of this machine, in the device's default
precision of matrix products and in float32's own ("highest"). benchmarks/accelerator.py runs it.
"""
import jax
import numpy as np

from motion_jax import loading

PROMPT, FRAMES, SEED, BATCH = "a person walks forward", 120, 3, 8


def millimetres(name: str, prompt: str = PROMPT, frames: int = FRAMES) -> dict[str, float]:
  """{what is compared: largest distance in mm}."""
  model = loading.load(name)

  def make(seeds=(SEED,)):
    return np.asarray(model.generate([prompt] * len(seeds), num_frames=frames, seeds=list(seeds), cleanup=False)
                      [list(seeds).index(SEED)].joints)

  def streamed():
    blocks, count = [], 0
    for block in model.stream(prompt, seed=SEED):
      blocks.append(np.asarray(block))
      count += len(blocks[-1])
      if count >= frames:
        return np.concatenate(blocks)[:frames]

  apart = lambda a, b: 1000 * float(np.linalg.norm(a - b, axis=-1).max())
  alone = make()
  found = dict(again=apart(alone, make()), in_a_batch=apart(alone, make(range(BATCH))))
  if model.can("stream"):
    found["streamed"] = apart(alone, streamed())
  with jax.default_matmul_precision("highest"):
    exact = make()
    found["exact_in_a_batch"] = apart(exact, make(range(BATCH)))
  found["default_and_exact"] = apart(alone, exact)
  with jax.default_device(jax.devices("cpu")[0]):
    model = loading.load(name)
    on_cpu = make()
  return found | dict(default_and_cpu=apart(alone, on_cpu), exact_and_cpu=apart(exact, on_cpu))
