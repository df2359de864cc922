"""What CDAMD's loop wastes: one clip at the released size, by the reference's loop and by ours, in one run.

  python benchmarks/decoding_iterations.py                 6 s of motion, released size (290 M parameters): ten minutes
  python benchmarks/decoding_iterations.py --size small    the model that ships, in seconds

The reference makes every latent that is still masked in each of ten decoding iterations and throws most of them away
again; ours makes those that the iteration unmasks. dopri5 chooses its own steps (rtol 1e-3, atol 1e-6), the others
take --steps. The weights are random, as in docs/papers/cdamd.md#timings, so dopri5's number of steps is that of an
untrained network.
Times are of a compiled call, decoding included, the least of --repeats. Ratios are to the first row: of processor
seconds on a CPU, which other work may share, of seconds elsewhere.
"""
import argparse
import os
import platform
import runpy
import time

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.latents import AutoencoderCodec
from motion_jax.models import cdamd
from motion_jax.models.cdamd import draws
from motion_jax.models.cdamd import mask_schedule as masking
from motion_jax.models.cdamd.unmasking import most_unmasked
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.utils.config_files import module_fields

CONFIGS = os.path.join(os.path.dirname(__file__), "..", "configs", "cdamd_generator.py")
EVALUATIONS = {"euler": 1, "midpoint": 2, "heun": 2}  # of the network in a step
FRAMES_PER_LATENT = 4


def random_like(shapes, rng):
  draw = np.random.default_rng(rng)
  fill = lambda a: jnp.asarray(0.02 * draw.standard_normal(a.shape, np.float32))
  return jax.tree.map(fill, shapes)


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("--size", default="full", help="a size of configs/cdamd_generator.py; full is the released one")
  parser.add_argument("--frames", type=int, default=120)
  parser.add_argument("--steps", type=int, default=10)
  parser.add_argument("--repeats", type=int, default=2)
  args = parser.parse_args()
  config = runpy.run_path(CONFIGS)["get_config"](args.size)
  net, autoencoder = cdamd.make_generator(config.model), Autoencoder(**module_fields(config.tokenizer))
  params = random_like(cdamd.generator_shapes(net), 0)
  codec = AutoencoderCodec(autoencoder, random_like(cdamd.autoencoder_shapes(autoencoder), 1)).unscaled()
  length, num_iterations = args.frames // FRAMES_PER_LATENT, config.sampler.num_iterations
  counts = masking.masked_counts(num_iterations, [length])
  keys = jax.random.split(jax.random.key(0), 1)
  masked = masking.masked_table(draws.draw_order(keys, [length], length), counts)
  text = jnp.asarray(np.random.default_rng(2).standard_normal((1, 1, net.transformer.text_dim), np.float32))
  real, few = jnp.ones((1, length), bool), most_unmasked(counts)
  num_params = sum(x.size for x in jax.tree.leaves(params))
  print(f"{num_params:,} parameters, {args.frames} frames, {num_iterations} iterations, guidance "
        f"{config.sampler.guidance_scale:g}; {jax.devices()[0].device_kind} ({platform.machine()}), "
        f"{len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[0]:.1f}, jax {jax.__version__}\n")
  print("| latents solved for | solver | rows of a network evaluation x evaluations | seconds | processor s | ratio |")
  print("| --- | --- | --- | --- | --- | --- |")
  plans = [("all", "dopri5"), ("all", "midpoint"), ("all", "euler"), ("unmasked", "dopri5"), ("unmasked", "midpoint"),
           ("unmasked", "euler")]
  first = None
  for which, solver in plans:
    plan = cdamd.make_plan(solver=solver, num_steps=args.steps, num_rows=few if which == "unmasked" else None)
    run = jax.jit(lambda params, codec, plan=plan: cdamd.generate(
        net, plan, params, codec, text_emb=text, masked=masked, real_mask=real, scale=config.sampler.guidance_scale,
        draw=draws.make_draw(keys, length, net.transformer.latent_dim)))
    compiled = run.lower(params, codec).compile()
    times = []
    for _ in range(args.repeats):
      wall, busy = time.perf_counter(), time.process_time()
      made = jax.block_until_ready(compiled(params, codec))
      times.append((time.perf_counter() - wall, time.process_time() - busy))
    if not np.isfinite(made).all():
      raise FloatingPointError(f"{solver} gave numbers that are none")
    wall, busy = min(times)
    cost = busy if jax.default_backend() == "cpu" else wall
    first = first or cost
    rows = 2 * (few if which == "unmasked" else length)
    asked = f"{EVALUATIONS[solver] * args.steps} x {num_iterations}" if solver in EVALUATIONS else "its own"
    print(f"| {which} | {solver} | {rows} x {asked} | {wall:.2f} | {busy:.2f} | {first / cost:.1f} |", flush=True)


if __name__ == "__main__":
  main()
