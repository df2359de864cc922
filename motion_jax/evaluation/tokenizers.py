"""Tokenizers of any kind of run, alone or inside a generator's: motion there and back."""
import dataclasses
import pathlib
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.evaluation.candidates import folder_of
from motion_jax.models import cdamd, cmdm
from motion_jax.models.base import plain_fields
from motion_jax.motion.stats import Stats, load_stats
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.causal_vae import CausalVAE, sample_latent
from motion_jax.nets.masks import padding_mask
from motion_jax.training import checkpoint

STAGES = ("cmdm.tokenizer", "cmdm.denoiser", "cdamd.autoencoder", "cdamd.rvq", "cdamd.generator")


@dataclasses.dataclass(frozen=True, eq=False)
class Tokenizer:
  """Made by `load_tokenizer`; what an evaluation asks of a model, less words."""
  folder: pathlib.Path
  config: Any
  stats: Stats
  num_params: int
  params_file: str
  _run: Any

  def round_trip(self, x, num_frames, seeds=None):
    """Normalized features x (B, T, F), padded with zeros, there and back. seeds (B,): of latents that are drawn; None
    takes their means."""
    keys = None if seeds is None else jnp.stack([jax.random.key(seed) for seed in seeds])
    return np.asarray(self._run(jnp.asarray(x), jnp.asarray(num_frames), keys))


def load_tokenizer(run, raw=False) -> Tokenizer:
  """The tokenizer of a run folder, or of a model that ships. raw: as `model.load`, where the run is a tokenizer's own.

  Raises ValueError for a run that has none.
  """
  folder = folder_of(run)
  config = checkpoint.load_config(folder)
  stage = config.get("stage")
  if stage not in STAGES:
    raise ValueError(f"{folder} holds a {stage!r} run, expected one with a tokenizer: {', '.join(STAGES)}")
  inside = stage in ("cmdm.denoiser", "cdamd.generator")
  fields = plain_fields(config.tokenizer if inside else config.model)
  name = checkpoint.FROZEN if inside else checkpoint.RAW if raw else checkpoint.PARAMS
  if stage.startswith("cmdm"):
    net = CausalVAE(**fields)
    shapes, run_it = cmdm.frozen_shapes(net)["tokenizer"], _vae
  else:
    net, run_it = Autoencoder(**fields), _codes if stage == "cdamd.rvq" else _plain
    shapes = cdamd.autoencoder_shapes(net, config.get("quantizer") if stage == "cdamd.rvq" else None)
  params = checkpoint.load_params(folder, name=name)
  params = params["tokenizer"] if inside else params
  checkpoint.check_fits(params, shapes, f"{folder / name} does not fit its config")
  params = jax.tree.map(jnp.asarray, params)
  return Tokenizer(folder, config, load_stats(folder, config.data.layout),
                   sum(leaf.size for leaf in jax.tree.leaves(params)), name, jax.jit(partial(run_it, net, params)))


def _vae(net, params, x, num_frames, keys):
  # Parity: the released evaluation draws latents; rows of padding are encoded and decoded like all others.
  mean, logvar = net.apply(params, x, method="encode")
  if keys is not None:
    noise = jax.vmap(lambda key: jax.random.normal(key, mean.shape[1:]))(keys)
    mean = sample_latent(mean, logvar, noise)
  return net.apply(params, mean, method="decode")


def _plain(net, params, x, num_frames, keys):
  frames, latents = _masks(net, x, num_frames)
  z = net.apply(params, x, real_mask=frames, method="encode")
  return net.apply(params, z, real_mask=latents, method="decode")


def _codes(net, params, x, num_frames, keys):
  indices, _ = cdamd.encode_codes(net, params, x, _masks(net, x, num_frames)[0])
  return cdamd.decode_codes(net, params, indices)


def _masks(net, x, num_frames):
  unit = net.frames_per_latent
  return padding_mask(num_frames, x.shape[1]), padding_mask(num_frames // unit, x.shape[1] // unit)
