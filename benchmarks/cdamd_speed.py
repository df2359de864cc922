"""Processor time of one 6 s clip by CDAMD's generator of 290 M parameters, beside PyTorch's for the reference's loop.

  python benchmarks/cdamd_speed.py                      needs PyTorch (extra `convert`); on one core, in turns

The reference samples all latents that are still masked in each of ten decoding iterations, by dopri5; with random
weights that is 254 evaluations of the network for a clip, 9,664 rows (docs/papers/cdamd.md#timings). The peer is its
diffusion head in PyTorch with the rows of each iteration; one evaluation is timed and multiplied, the solver's own
arithmetic, the transformer and the decoder are left out, in PyTorch's favour. Ours is the whole program, `--solvers`.
"""
import argparse
import functools
import statistics
import time

import jax
import machine
import numpy as np
import programs
import torch
from torch import nn

from motion_jax.latents import AutoencoderCodec
from motion_jax.models import cdamd
from motion_jax.models.cdamd import draws, unmasking
from motion_jax.models.shared import mask_schedule as masking

EVALUATIONS = 254
LATENTS, ITERATIONS, SCALE = 30, 10, 4.0


class Block(nn.Module):
  def __init__(self, width):
    super().__init__()
    self.norm, self.film = nn.LayerNorm(width, eps=1e-6), nn.Linear(width, 3 * width)
    self.ff_in, self.ff_out = nn.Linear(width, width), nn.Linear(width, width)

  def forward(self, x, y):
    shift, scale, gate = self.film(nn.functional.silu(y)).chunk(3, dim=-1)
    return x + gate * self.ff_out(nn.functional.silu(self.ff_in(self.norm(x) * (1 + scale) + shift)))


class Head(nn.Module):
  """The diffusion head of one latent, as `nets.diffusion_mlp`."""

  def __init__(self, channels=512, condition=512, width=1792, depth=16):
    super().__init__()
    self.time = nn.Sequential(nn.Linear(256, width), nn.SiLU(), nn.Linear(width, width))
    self.condition, self.x = nn.Linear(condition, width), nn.Linear(channels, width)
    self.blocks = nn.ModuleList(Block(width) for _ in range(depth))
    self.norm = nn.LayerNorm(width, eps=1e-6, elementwise_affine=False)
    self.film, self.out = nn.Linear(width, 2 * width), nn.Linear(width, channels)

  def forward(self, x, t, condition):
    y, x = self.time(t) + self.condition(condition), self.x(x)
    for block in self.blocks:
      x = block(x, y)
    shift, scale = self.film(nn.functional.silu(y)).chunk(2, dim=-1)
    return self.out(self.norm(x) * (1 + scale) + shift)


def busy(run):
  start = time.process_time()
  run()
  return time.process_time() - start


def reference():
  """A function that returns the processor seconds of the peer."""
  torch.set_num_threads(1)
  head, per_iteration = Head().eval(), EVALUATIONS / ITERATIONS
  rows = [2 * int(count) for count in masking.masked_counts(ITERATIONS, [LATENTS])[:, 0]]

  @torch.no_grad()
  def measure():
    return sum(per_iteration * busy(lambda count=count: head(torch.randn(count, 512), torch.randn(count, 256),
                                                             torch.randn(count, 512))) for count in rows)

  return measure


def ours(solvers):
  """{name: function that returns the processor seconds of a compiled call} for solvers such as "euler:4"."""
  _, net, autoencoder, parts = programs.generator("float32", False)
  params, codec = programs.filled(cdamd.generator_shapes(net)), AutoencoderCodec.of(autoencoder, programs.filled(parts))
  keys, length = programs.keys_of(1), 49  # padded, as all lengths are
  counts = masking.masked_counts(ITERATIONS, [LATENTS])
  schedule = unmasking.schedule(masking.masked_table(draws.draw_order(keys, [LATENTS], length), counts))
  most = 2 * -(-unmasking.most_unmasked(counts) // 2)
  text, real = np.random.default_rng(0).standard_normal((1, 1, 512), np.float32), np.arange(length)[None] < LATENTS

  @functools.partial(jax.jit, static_argnums=0)
  def run(plan, params, codec, schedule, steps):
    return cdamd.generate(net, plan, params, codec, text_emb=text, real_mask=real, schedule=schedule, scale=SCALE,
                          steps=steps, draw=draws.make_draw(keys, net.transformer.latent_dim))

  def measured(solver, num_steps):
    plan, steps = cdamd.make_plan(solver=solver, num_steps=int(num_steps), num_rows=most).split()
    call = lambda: jax.block_until_ready(run(plan, params, codec, schedule, steps))
    if not np.isfinite(call()).all():
      raise FloatingPointError(f"{solver} gave numbers that are not finite")
    return lambda: busy(call)

  return {f"ours, {name.replace(':', ', ')} steps": measured(*name.split(":")) for name in solvers}


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("--solvers", nargs="*", default=["midpoint:10", "euler:10", "euler:4"])
  parser.add_argument("--repeats", type=int, default=3)
  args = parser.parse_args()
  rows = {"PyTorch, all masked latents, dopri5": reference()}
  rows |= ours(args.solvers)
  times = {name: [] for name in rows}
  for _ in range(args.repeats):  # in turns, so that a busy machine slows all
    for name, measure in rows.items():
      times[name].append(measure())
  first = statistics.median(next(iter(times.values())))
  print(f"{machine.today()}, {machine.words(machine.describe())}\n")
  print("| one clip of 6 s | processor s | the reference's share |\n| --- | --- | --- |")
  for name, found in times.items():
    print(f"| {name} | {statistics.median(found):.2f} | 1/{first / statistics.median(found):.1f} |")


if __name__ == "__main__":
  main()
