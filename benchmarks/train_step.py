"""How fast a training step is beside plain PyTorch of the same sizes, and how far from this machine's limit.

  python benchmarks/train_step.py                          denoiser M, tokenizer and generator, each beside its peer
  python benchmarks/train_step.py --stages denoiser --batch 64 --rounds 5

Needs the extra `convert` for torch. Each step is a whole one: forward, backward, gradient norm, AdamW, an average of
the parameters where the config keeps one. The denoiser trains on stored distributions of latents (`data encode`), the
generator encodes its own. Both sides take turns, round after round, on the same number of threads. Printed are the
smallest and the median wall time and the smallest processor time of a step, and the ratio of PyTorch's to ours: above
1, ours is faster. On a machine that does other work, too, processor time is the steadier number; PyTorch's threads
sleep when they wait, or it would count that. Weights and data are random, which changes no time.

"Products" is the processor time that the matrix products and convolutions of our step need alone at the rate of one
product of 2048 x 2048 matrices, measured in the same run: the limit of the step, which no other code can pass
(benchmarks/counting.py counts them). What remains up to the measured time are smaller products that do not reach that
rate, norms, activations, random numbers, and reading and writing weights, moments and the average.
"""
import argparse
import os
import statistics
import time

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # read when torch is loaded

import counting  # benchmarks/counting.py and torch_peers.py, beside this file
import jax
import jax.numpy as jnp
import numpy as np
import torch
from torch_peers import torch_denoiser, torch_generator, torch_step, torch_tokenizer

from motion_jax.latents import AutoencoderCodec
from motion_jax.models.cdamd import losses
from motion_jax.models.cdamd import stages as cdamd
from motion_jax.models.cmdm import stages as cmdm
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.training import mesh, optimizers, train_step
from motion_jax.training.setup import untrained
from motion_jax.training.stage import DEVICES
from motion_jax.utils import config_files


def peak_rate(size=2048, rounds=5):
  """Operations a second of processor time of one large product of float32 matrices."""
  x = jnp.ones((size, size))
  product = jax.jit(jnp.dot)
  product(x, x).block_until_ready()
  best = float("inf")
  for _ in range(rounds):
    began = time.process_time()
    product(x, x).block_until_ready()
    best = min(best, time.process_time() - began)
  return 2 * size ** 3 / best


def our_step(config, stage, frozen, batch):
  """(step(), a whole one through the wrapper that training takes; the operations of its products)."""
  where = mesh.make_mesh(config.mesh)
  tx = optimizers.make_optimizer(config.optimizer, 1000)
  average = config.optimizer.ema_decay > 0
  state = where.init(lambda batch, key: train_step.init_state(stage, tx, batch, key, average), batch, jax.random.key(0))
  frozen, rng = where.put(jax.tree.map(jnp.asarray, frozen)), jax.random.key(1)
  whole = train_step.make_train_step(stage, tx, config.optimizer.ema_decay, config.optimizer.skip_loss)
  run = where.compiled(whole)
  on_one = jax.vmap(whole, (None, None, 0, None), axis_name=DEVICES, axis_size=1)
  one = jax.tree.map(lambda a: np.asarray(a)[None], batch)
  flops = counting.work(on_one, state, frozen, one, rng, loops=losses.MOST_PARTS).flops  # a generator's: all masked
  held = [state]

  def step():
    held[0], metrics = run(held[0], frozen, where.rows(batch), rng)
    return jax.block_until_ready((held[0], metrics))[1]

  return step, flops


def captioned_batch(config, size, features, frames, words, text_dim):
  draw = np.random.default_rng(0)
  return dict(features=draw.standard_normal((size, frames, features), np.float32),
              num_frames=draw.integers(frames // 2, frames // 4 * 4 + 1, size).astype(np.int32) // 4 * 4,
              text_emb=draw.standard_normal((size, words, text_dim), np.float32),
              text_mask=np.arange(words) < draw.integers(1, min(words, 20) + 1, size)[:, None], index=np.arange(size))


def denoiser(args):
  config = config_files.load("cmdm_denoiser:full")  # its size is M
  batch = captioned_batch(config, args.batch or 16, config.tokenizer.features, 192, 64, config.model.text_dim)
  batch["distribution"] = batch.pop("features")[:, ::4, :2 * config.tokenizer.latent_dim]
  frozen = untrained(cmdm.frozen_shapes(CausalVAE(**config.tokenizer)))
  return config, cmdm.denoiser_stage(config), frozen, batch, torch_denoiser(config, batch)


def tokenizer(args):
  config = config_files.load("cmdm_tokenizer:small").copy_and_resolve_references().unlock()
  config.model.width = args.width
  config.frozen.teacher = ""
  config.data.batch_size = args.batch or 32
  batch = dict(features=np.random.default_rng(0).standard_normal((config.data.batch_size, 64, config.model.features),
                                                                 np.float32), index=np.arange(config.data.batch_size))
  return config, cmdm.tokenizer_stage(config), {}, batch, torch_tokenizer(config, batch)


def generator(args):
  """The released sizes of the transformer, a narrower head, no prior: memory for 290 M parameters is not everywhere."""
  config = config_files.load("cdamd_generator:full").copy_and_resolve_references().unlock()
  config.loss.prior_levels = 0
  config.model.head.update(width=512, depth=8)
  config.tokenizer.update(latent_dim=64, width=64)
  config.model.transformer.latent_dim = 64
  transformer = config.model.transformer
  batch = captioned_batch(config, args.batch or 32, config.tokenizer.features, 196, 1, transformer.text_dim)
  del batch["text_mask"]
  net = Autoencoder(**config.tokenizer)
  frozen = untrained(cdamd.frozen_shapes(net))
  frozen = jax.tree.map(np.asarray, AutoencoderCodec.of(net, frozen).parts)
  return config, cdamd.generator_stage(config), frozen, batch, torch_generator(config, batch)


STAGES = {"denoiser": denoiser, "tokenizer": tokenizer, "generator": generator}


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("--stages", default=",".join(STAGES), help="of " + ", ".join(STAGES))
  parser.add_argument("--batch", type=int, default=0, help="rows; 0: 16 of the denoiser, 32 of the others")
  parser.add_argument("--width", type=int, default=512, help="of the tokenizer; the paper's is 1024")
  parser.add_argument("--rounds", type=int, default=5)
  args = parser.parse_args()
  torch.set_num_threads(os.cpu_count())
  print(f"jax {jax.__version__} on {jax.device_count()} {jax.default_backend()} device(s), torch {torch.__version__}, "
        f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
  rate = peak_rate()
  print(f"one product of 2048 x 2048: {rate / 1e9:.0f} GFLOP/s of processor time")
  columns = ("jax wall min / median, cpu", "torch wall min / median, cpu")
  print(f"{'stage':10s} {'parameters':>10s} {columns[0]:>32s} {columns[1]:>32s}   ratio wall min / median, cpu   "
        "products alone, cpu, share of ours")
  for name in args.stages.split(","):
    config, stage, frozen, batch, (network, loss) = STAGES[name](args)
    ours, flops = our_step(config, stage, frozen, batch)
    steps = {"jax": ours, "torch": torch_step(config, network, loss)}
    times = {side: [] for side in steps}
    for step in steps.values():
      step()  # compiles, and fills caches
    for _ in range(args.rounds):
      for side, step in steps.items():
        wall, cpu = time.perf_counter(), time.process_time()
        step()
        times[side].append((time.perf_counter() - wall, time.process_time() - cpu))
    found = {}
    for side, rows in times.items():
      wall, cpu = zip(*rows)
      found[side] = min(wall), statistics.median(wall), min(cpu)
    values = {side: "{:.3f} / {:.3f} s, {:.3f} s".format(*row) for side, row in found.items()}
    ratios = [b / a for a, b in zip(found["jax"], found["torch"])]
    count = sum(p.numel() for p in network.parameters()) / 1e6
    print(f"{name:10s} {count:9.1f}M {values['jax']:>32s} {values['torch']:>32s}   "
          "{:.2f} / {:.2f}, {:.2f}   ".format(*ratios) +
          f"{flops / 1e9:.0f} GFLOP, {flops / rate:.2f} s, {flops / rate / found['jax'][2]:.0%}", flush=True)


if __name__ == "__main__":
  main()
