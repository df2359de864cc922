"""Frames a second, memory and cost against length of the library on this machine: one pass, words read, all compiled.

  python benchmarks/throughput.py OUT              every row that OUT (.jsonl) lacks; hours on two cores
  python benchmarks/throughput.py OUT --quick      small batches, short motions: about four minutes
  python benchmarks/throughput.py OUT --only length/

  batch/MODEL/B       B clips of 6 s at once: frames a second, memory beyond the model's, for each clip
  length/MODEL/S      one clip of S seconds in one call
  streams/MODEL/N     N streams that take turns, each next block of each
  endless/MODEL/M     one stream of M minutes of motion, as fast as it goes: time per block and memory, minute by minute
  plain/SIZE          the sampler beside one that recomputes everything, in turns: how many times faster

Models are those that ship, and M, the paper's size M with random weights. A row holds seconds on the clock and of
processors (medians of --repeats calls after one that compiles) and the cores that other work used meanwhile.
"""
import argparse
import functools
import pathlib
import statistics
import time

import jax
import jax.numpy as jnp
import machine  # like programs, results and sampling a file beside this one
import programs
import results
import sampling

from motion_jax import loading
from motion_jax.diffusion import schedules
from motion_jax.models.cmdm import streaming

FPS = 20
PROMPTS = ("a person walks forward", "a person jumps up", "a person waves the right hand", "a person turns left")
SHIPPED = ("cmdm-small", "cmdm-small-fast", "cmdm-open", "cdamd-small")
CLIP = 6  # seconds
load = functools.cache(loading.load)


def pieces(quick, repeats) -> dict:
  """{name: function() -> dict of numbers}."""
  batches, seconds, minutes = ((1, 8, 64), (2, 6, 30, 120), 5) if quick else (
      (1, 8, 64, 256), (2, 6, 30, 60, 120, 300, 600, 1200, 1800), 60)
  wanted = {"plain/small": functools.partial(against_plain, "small", repeats)}
  models = [name for name in SHIPPED if not quick or name != "cmdm-open"]
  for model in models:
    for size in batches:
      if not (quick and size > 8 and model == "cdamd-small"):
        wanted[f"batch/{model}/{size}"] = functools.partial(batch, model, size, repeats)
  for size in batches[:2] if quick else batches:
    wanted[f"batch/M/{size}"] = functools.partial(batch_of_size, "M", size, 1)
  for model in models[:1] if quick else ("cmdm-small", "cmdm-small-fast"):
    for length in seconds:
      wanted[f"length/{model}/{length}"] = functools.partial(one_length, model, length, repeats if length < 60 else 1)
    for count in (1, 2, 4, 8):
      wanted[f"streams/{model}/{count}"] = functools.partial(streams, model, count, 10 if quick else 40)
    wanted[f"endless/{model}/{minutes}"] = functools.partial(endless, model, minutes)
  return wanted if quick else wanted | {"plain/M": functools.partial(against_plain, "M", repeats)}


# --- rows -------------------------------------------------------------------------------------------------------------


def measured(call, repeats, frames) -> dict:
  """Medians of calls after a first one -> seconds, processor, fps, megabytes beyond what was held, others."""
  jax.block_until_ready(call())
  memory, costs = machine.Memory(), []
  for _ in range(repeats):
    with machine.cost() as cost:
      jax.block_until_ready(call())
    costs.append(cost)
  middle = lambda name: statistics.median(getattr(cost, name) for cost in costs)
  return dict(seconds=middle("wall"), processor=middle("processor"), fps=frames / middle("wall"), frames=frames,
              working_mb=memory.peak_mb(), others=None if costs[0].others is None else middle("others"))


def batch(name, size, repeats):
  model, frames = load(name), CLIP * FPS
  prompts = [PROMPTS[i % len(PROMPTS)] for i in range(size)]
  row = measured(lambda: model.generate(prompts, num_frames=frames, seeds=range(size)).joints, repeats, frames * size)
  return row | dict(batch=size)


def batch_of_size(size, count, repeats):
  program = programs.sample_cmdm(size, "float32", count, programs.LAG)
  arguments = jax.jit(program.arguments)()
  return measured(lambda: program.function(*arguments), repeats, count * program.frames) | dict(batch=count)


def one_length(name, seconds, repeats):
  model, frames = load(name), seconds * FPS
  make = lambda: model.generate([PROMPTS[0]], num_frames=frames, seeds=[0]).joints
  return measured(make, repeats, frames) | dict(length=seconds)


def streams(name, count, blocks):
  model = load(name)
  live = [iter(model.stream(PROMPTS[i % len(PROMPTS)], seed=i)) for i in range(count)]
  for _ in range(3):  # each stream past its first blocks
    frames = sum(len(jax.block_until_ready(next(stream))) for stream in live)
  row = measured(lambda: [next(stream) for stream in live for _ in range(blocks)], 1, frames * blocks)
  return row | dict(streams=count, block_seconds=row["seconds"] / count / blocks)


def endless(name, minutes):
  stream, memory, rows = iter(load(name).stream(PROMPTS[0], seed=0)), machine.Memory(), []
  for _ in range(3):
    frames = len(jax.block_until_ready(next(stream)))
  blocks = 60 * FPS // frames
  with machine.cost() as cost:
    for minute in range(minutes):
      start = time.perf_counter()
      for _ in range(blocks):
        jax.block_until_ready(next(stream))
      rows.append([minute + 1, (time.perf_counter() - start) / blocks, memory.held_mb()])
  return dict(minutes=minutes, by_minute=rows, processor=cost.processor, others=cost.others)


def against_plain(size, repeats):
  """Clips of 6 s by the sampler and by a loop that recomputes everything, taking turns; latents only."""
  dit, params = sampling.make_denoiser(size, 3, jnp.dtype("float32"))
  blocks = CLIP * FPS // 4 // dit.block
  length, scale = blocks * dit.block, jnp.float32(programs.GUIDANCE)
  text_emb, text_mask = programs.words(dit.text_dim, 1)
  times = jnp.asarray(schedules.staircase(programs.STEPS, length, programs.LAG, dit.block))
  plan = streaming.make_plan(programs.STEPS, programs.LAG, dit.block, programs.CONTEXT, blocks)
  noise = jax.random.normal(jax.random.key(3), (1, length, dit.latent_dim))
  given = params, text_emb, text_mask
  plain = functools.partial(sampling.plain_sampler(dit, programs.CONTEXT, scale), *given, noise, times)
  fast = functools.partial(sampling.fast_sampler(dit, plan, blocks, scale), *given, programs.keys_of(1))
  turns = [[measured(run, 1, CLIP * FPS) for run in (plain, fast)] for _ in range(repeats)]
  middle = lambda side, key: statistics.median(turn[side][key] for turn in turns)
  return dict(plain_processor=middle(0, "processor"), processor=middle(1, "processor"), seconds=middle(1, "seconds"),
              plain_seconds=middle(0, "seconds"), ratio=middle(0, "processor") / middle(1, "processor"),
              others=turns[0][0]["others"] and middle(1, "others"))


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("out", type=pathlib.Path)
  parser.add_argument("--quick", action="store_true")
  parser.add_argument("--repeats", type=int, default=3)
  parser.add_argument("--seconds", type=float, default=1e9, help="begin no row after this time")
  parser.add_argument("--only", default="", help="rows whose names begin so")
  args = parser.parse_args()
  args.out.parent.mkdir(parents=True, exist_ok=True)
  about = dict(machine=machine.describe(), date=machine.today(), commit=machine.commit(pathlib.Path(__file__).parent),
               jax=jax.__version__)
  wanted = {name: run for name, run in pieces(args.quick, args.repeats).items() if name.startswith(args.only)}
  if not wanted:
    parser.error(f"no row begins with {args.only!r}; they are {', '.join(pieces(args.quick, args.repeats))}")
  raise SystemExit(0 if results.measure(args.out, wanted, args.seconds, about) else 75)


if __name__ == "__main__":
  main()
