"""How fast the fast sampler is: window, cache and tables against recomputing everything, in one run on this machine.

  python benchmarks/sampling.py                              shipped size and the paper's M, 6 seconds of motion
  python benchmarks/sampling.py --sizes small --blocks 3 --tokens 30,150 --schedules fss

Columns: plain = whole recompute in every step, two guidance passes; fast = `streaming.Sampler`, the same numbers; first
and next = seconds until a stream has its first block, and between blocks after that; memory = working memory that the
compiled plain and fast samplers ask for beside the weights. Latents only, four frames each; weights are random, which
changes no time. Where the plain loop is long, --max-plain of its steps are timed and scaled (marked *).
"""
import argparse
import os
import platform
import resource
import statistics
import sys
import time

import jax
import jax.numpy as jnp

from motion_jax.diffusion import guidance, samplers, schedules
from motion_jax.evaluation.report import tables
from motion_jax.models.cmdm import streaming
from motion_jax.nets import causal_dit
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.masks import sliding_mask

FRAMES_PER_TOKEN = 4
SHIPPED = dict(latent_dim=32, width=256, depth=6, num_heads=4, ff_width=512, text_dim=128)  # configs/cmdm_denoiser.py


def make_denoiser(size, block, dtype):
  fields = SHIPPED if size == "small" else causal_dit.size(size)
  dit = CausalDiT(**fields, block=block, dtype=dtype)
  shapes = jax.eval_shape(lambda: dit.init(
      jax.random.key(0), jnp.zeros((1, block, dit.latent_dim)), jnp.zeros((1, block)), jnp.zeros((1, 2, dit.text_dim)),
      jnp.ones((1, 1, block, block), bool), jnp.ones((1, 2), bool)))
  leaves, tree = jax.tree.flatten(shapes)
  keys = jax.random.split(jax.random.key(1), len(leaves))
  return dit, tree.unflatten([0.02 * jax.random.normal(key, a.shape) for key, a in zip(keys, leaves)])


def plain_sampler(dit, context, scale):
  """(params, text_emb, text_mask, noise, times) -> latents: the loop that a first implementation would have."""
  def sample(params, text_emb, text_mask, noise, times):
    attn_mask = sliding_mask(noise.shape[1], dit.block, context)

    def velocity(x, t):
      t = jnp.broadcast_to(t, x.shape[:2])
      with_text, without = (dit.apply(params, x, t, emb, attn_mask, text_mask) for emb in (text_emb, 0 * text_emb))
      return guidance.combine(with_text, without, scale)

    return samplers.euler(velocity, noise, times)
  return jax.jit(sample)


def fast_sampler(dit, plan, num_blocks, scale):
  def sample(params, text_emb, text_mask, keys):
    sampler = streaming.bind(dit, plan, params, text_emb=text_emb, text_mask=text_mask, scale=scale, keys=keys)
    return sampler.sample(num_blocks)
  return jax.jit(sample)


def seconds_of(run, repeats):
  """Median time of a compiled call."""
  times = []
  for _ in range(repeats):
    start = time.perf_counter()
    jax.block_until_ready(run())
    times.append(time.perf_counter() - start)
  return statistics.median(times)


def compile_(function, *args):
  """-> (compiled function, seconds it took, MB of working memory)."""
  start = time.perf_counter()
  compiled = function.lower(*args).compile()
  memory = compiled.memory_analysis()
  return compiled, time.perf_counter() - start, (memory.temp_size_in_bytes / 1e6 if memory else float("nan"))


def stream_times(dit, plan, params, text_emb, text_mask, keys, scale, num_further):
  """Seconds to the first block of a stream, and the median between further ones, once compiled."""
  bind = jax.jit(lambda params, text_emb, text_mask, keys: streaming.bind(
      dit, plan, params, text_emb=text_emb, text_mask=text_mask, scale=scale, keys=keys))
  sampler, step, init = bind(params, text_emb, text_mask, keys), jax.jit(streaming.Sampler.step), jax.jit(
      streaming.Sampler.init)
  for warm in (True, False):
    start, state, times = time.perf_counter(), init(sampler), []
    for _ in range(plan.age + (3 if warm else num_further)):
      state, block, done = step(sampler, state)
      jax.block_until_ready(block)
      if done:
        times.append(time.perf_counter() - start)
  between = [b - a for a, b in zip(times, times[1:])]
  # The first block after the ramp finds an empty cache; the steady pace is that of the later ones.
  return times[0], statistics.median(between[1:] or between)


def measure(size, block, schedule, tokens, args):
  dit, params = make_denoiser(size, block, jnp.dtype(args.dtype))
  context = -(-args.context // block) * block
  num_blocks = -(-tokens // block)
  length = num_blocks * block
  lag = args.lag if schedule == "fss" else args.steps
  keys = jax.vmap(jax.random.key)(jnp.arange(args.batch))
  text_emb = jax.random.normal(jax.random.key(2), (args.batch, args.words, dit.text_dim))
  text_mask = jnp.ones((args.batch, args.words), bool)
  scale = jnp.float32(args.guidance)

  times = jnp.asarray(schedules.staircase(args.steps, length, lag, block))
  evaluations = len(times) - 1
  counted = min(evaluations, args.max_plain)
  noise = jax.random.normal(jax.random.key(3), (args.batch, length, dit.latent_dim))
  plain_args = (params, text_emb, text_mask, noise, times[:counted + 1])
  plain, _, plain_memory = compile_(plain_sampler(dit, context, scale), *plain_args)
  plan = streaming.make_plan(args.steps, lag, block, context, num_blocks)
  fast_args = (params, text_emb, text_mask, keys)
  fast, compile_time, fast_memory = compile_(fast_sampler(dit, plan, num_blocks, scale), *fast_args)
  jax.block_until_ready((plain(*plain_args), fast(*fast_args)))
  plain_times, fast_times = [], []
  for _ in range(args.repeats):  # in turns, so that a busy machine slows both
    plain_times.append(seconds_of(lambda: plain(*plain_args), 1) * evaluations / counted)
    fast_times.append(seconds_of(lambda: fast(*fast_args), 1))
  slow, quick = statistics.median(plain_times), statistics.median(fast_times)
  endless = streaming.make_plan(args.steps, lag, block, context)
  first, further = stream_times(dit, endless, params, text_emb, text_mask, keys, scale, args.further)
  frames = FRAMES_PER_TOKEN * length * args.batch
  pace = FRAMES_PER_TOKEN * block * args.batch / further
  return (f"{size:5s} {block:5d} {schedule:4s} {length:6d} {evaluations:6d} | {slow:7.2f}"
          f"{'*' if counted < evaluations else ' '}{frames / slow:7.1f} | {quick:7.2f} {frames / quick:7.1f} "
          f"{slow / quick:6.2f}x | {first:7.3f} {further * 1000:7.1f} {pace:7.1f} | {plain_memory:6.1f} "
          f"{fast_memory:6.1f} | {compile_time:6.1f}")


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  names = lambda text: text.split(",")
  numbers = lambda text: [int(part) for part in text.split(",")]
  parser.add_argument("--sizes", type=names, default=["small", "M"], help="small, S, M, L, XL")
  parser.add_argument("--blocks", type=numbers, default=[1, 3])
  parser.add_argument("--schedules", type=names, default=["fss", "ar"])
  parser.add_argument("--tokens", type=numbers, default=[30], help="latents, four frames each")
  parser.add_argument("--steps", type=int, default=50)
  parser.add_argument("--lag", type=int, default=2, help="of fss")
  parser.add_argument("--batch", type=int, default=1)
  parser.add_argument("--words", type=int, default=24)
  parser.add_argument("--context", type=int, default=48)
  parser.add_argument("--guidance", type=float, default=3.0)
  parser.add_argument("--dtype", default="float32")
  parser.add_argument("--repeats", type=int, default=3)
  parser.add_argument("--further", type=int, default=12, help="blocks of a stream to time after the first")
  parser.add_argument("--max-plain", type=int, default=150, help="steps of the plain loop to time")
  args = parser.parse_args()
  load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
  devices = f"{jax.local_device_count()} {jax.default_backend()} device(s), {os.cpu_count()} CPUs, {platform.machine()}"
  print(f"jax {jax.__version__} on {devices}, load {load:.1f}; {args.dtype}, K {args.steps}, fss lag {args.lag}, "
        f"context {args.context}, guidance {args.guidance:g}, batch {args.batch}, median of {args.repeats}")
  print("size  block kind tokens  steps |   plain     fps |    fast     fps  faster | first s next ms next fps |"
        " plain   fast MB | compile s")
  for size in args.sizes:
    for block in args.blocks:
      for schedule in args.schedules:
        for tokens in args.tokens:
          print(measure(size, block, schedule, tokens, args), flush=True)
  peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e3 if sys.platform != "darwin" else 1e6)
  print(f"peak memory of this process {peak:.0f} MB")
  print("\nPrinted, of another machine:\n" + tables.markdown(tables.printed_table("cmdm", "speed")))


if __name__ == "__main__":
  main()
