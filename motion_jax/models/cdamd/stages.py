"""Training stage of CDAMD's masked transformer, as a pure function; its autoencoders: `shared.autoencoders`."""
import functools
from typing import Any

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.latents import AutoencoderCodec, RvqCodec
from motion_jax.models.cdamd.draws import draw_step
from motion_jax.models.cdamd.losses import generator_loss
from motion_jax.models.shared.autoencoders import (
  DISTANCES,
  autoencoder_shapes,
  autoencoder_stage,
  autoencoder_terms,
  empty_codebooks,
  item_keys,
  l1,
  rvq_stage,
  rvq_terms,
  smooth_l1,
)
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.diffusion_mlp import DiffusionMLP, Generator
from motion_jax.nets.masked_transformer import TRANSFORMERS
from motion_jax.nets.masks import padding_mask
from motion_jax.shapes import Array, Bool, Float, Int
from motion_jax.training.stage import Stage
from motion_jax.utils.errors import InputError

# CDAMD's autoencoders are those that methods share.
__all__ = ["DISTANCES", "autoencoder_shapes", "autoencoder_stage", "autoencoder_terms", "empty_codebooks",
           "frozen_shapes", "generator_shapes", "generator_stage", "l1", "make_generator", "prior_codes", "rvq_stage",
           "rvq_terms", "smooth_l1"]


def make_generator(config: ConfigDict, dtype: Any = jnp.float32, remat: bool = False, attention: str = "xla"
                   ) -> Generator:
  """The module of a model section: transformer (kind "cdamd" or "mardm", and fields), head (fields).

  dtype: what it computes in; parameters, norms and softmax are float32. remat, attention: see the modules.
  """
  fields, head = ({"dtype": dtype, "remat": remat, **section} for section in (config.transformer, config.head))
  kind, fields = fields.pop("kind"), {"attention": attention, **fields}
  if kind not in TRANSFORMERS:
    raise ValueError(f"got transformer kind {kind!r}, expected one of {', '.join(TRANSFORMERS)}")
  transformer = TRANSFORMERS[kind](**fields)
  return Generator(transformer, DiffusionMLP(latent_dim=transformer.latent_dim, **head))


def generator_shapes(net: Generator) -> Any:
  """Shapes of the generator's parameters, to check a file against."""
  transformer = net.transformer
  x, text_emb = jnp.zeros((1, 1, transformer.latent_dim)), jnp.zeros((1, 1, transformer.text_dim))
  return jax.eval_shape(lambda: net.init(jax.random.key(0), x, text_emb, jnp.ones((1, 1, 1, 1), bool), jnp.zeros(())))


def frozen_shapes(autoencoder: Autoencoder) -> dict[str, Any]:
  """Shapes of what making motion needs of a generator's frozen parts; training needs the prior, too."""
  channel = jax.ShapeDtypeStruct((autoencoder.latent_dim,), jnp.float32)
  return AutoencoderCodec(autoencoder, autoencoder_shapes(autoencoder), channel, channel).parts


def prior_codes(prior: RvqCodec, features: Float[Array, "b t f"], real_mask: Bool[Array, "b l"], num_levels: int
                ) -> Int[Array, "b l *q"]:
  """Codes of the first levels (B, L, Q) by the codec of an RVQ-VAE, of one level (B, L)."""
  codes = prior.encode(features, prior.real_frames(real_mask))[0]
  # Parity: one level alone comes without the row that tells levels apart.
  return codes[..., 0] if num_levels == 1 else codes[..., :num_levels]


def _inputs(config, autoencoder, rvq_net, frozen, batch):
  """(latents (B, L, C), which are real (B, L), text_emb, codes of the prior or None, text_mask or None) of a batch."""
  stored = "latents" in batch
  length = batch["latents"].shape[1] if stored else batch["features"].shape[1] // autoencoder.frames_per_latent
  real_mask = padding_mask(batch["num_frames"] // autoencoder.frames_per_latent, length)
  if stored:
    codes: Any = batch["codes"][..., :config.loss.prior_levels] if config.loss.prior_levels else None
    codes = codes[..., 0] if config.loss.prior_levels == 1 else codes
    return batch["latents"], real_mask, batch["text_emb"], codes, batch.get("text_mask")
  codec, codes = AutoencoderCodec.of(autoencoder, frozen), None
  if rvq_net:
    prior = RvqCodec(rvq_net, frozen["prior"])
    codes = prior_codes(prior, batch["features"], real_mask, config.loss.prior_levels)
  # Parity: not scaled in the released code, where the codec's mean is 0 and its std 1.
  z1 = codec.encode(batch["features"], real_mask)
  return z1, real_mask, batch["text_emb"], codes, batch.get("text_mask")


def generator_stage(config: ConfigDict) -> Stage:
  """Trains the masked transformer and its diffusion head on latents of the frozen autoencoder.

  Batch: features (B, T, F) padded or, of a store, latents (B, L, C) and codes (B, L, Q); num_frames (B,), text_emb
  (B, S, E), of which the first is the whole caption's, text_mask (B, S) if S > 1, index (B,) place in the whole batch.
  frozen:
  the parts of the autoencoder's codec and, if loss.prior_levels, prior: the RVQ-VAE's variables.
  """
  autoencoder, net = Autoencoder(**config.tokenizer), make_generator(
      config.model, jnp.dtype(config.train.dtype), config.train.remat, config.train.attention)
  rvq_net = Autoencoder(**config.prior) if config.loss.prior_levels else None

  inputs = functools.partial(_inputs, config, autoencoder, rvq_net)

  def init(batch, rng):
    x = jnp.zeros((1, 1, net.transformer.latent_dim))
    return net.init(rng, x, batch["text_emb"][:1], jnp.ones((1, 1, 1, 1), bool), jnp.zeros(()))

  def loss(params, frozen, batch, step, rng):
    z1, real_mask, text_emb, codes, text_mask = inputs(frozen, batch)
    draw_rng, dropout_rng, prior_rng = jax.random.split(rng, 3)
    draws = draw_step(prior_rng, item_keys(draw_rng, batch), z1.shape[1], z1.shape[2], config.loss)
    false = None
    if config.loss.contrast:
      if config.loss.diffusion == "ddpm":
        raise InputError("got loss.contrast and loss.diffusion='ddpm'; it compares errors before a time of the "
                         "straight path, 'flow'")
      false = batch["false_emb"], batch.get("false_mask"), batch["has_false"]
    return generator_loss(net, params, z1, real_mask, text_emb, codes, draws, config.loss,
                          (dropout_rng, batch["index"]), text_mask, false)

  def predict(params, frozen, batch, rng):
    """The loss with the sampler's mask, captions given, no dropout: sums over the masked latents, and their weight.

    "loss" is without the prior, as motion is made; "with_prior" is the reference's validation, in which a latent to be
    made sees its own code.
    """
    z1, real_mask, text_emb, codes, text_mask = inputs(frozen, batch)
    fields = ConfigDict(config.loss.to_dict() | dict(mask=config.sampler.mask, drop_rate=0.0, prior_drop_rate=0.0))
    draws = draw_step(rng, item_keys(rng, batch), z1.shape[1], z1.shape[2], config.loss)
    measure = lambda codes: generator_loss(net, params, z1, real_mask, text_emb, codes, draws, fields,
                                           text_mask=text_mask)
    sums, weight = measure(None)
    losses = {"loss": sums["loss"], "weight": weight}
    return losses if codes is None else losses | {"with_prior": measure(codes)[0]["loss"]}

  return Stage(init, loss, predict, in_parts=True,
               about_loss="mean squared error of the diffusion head, per number of a masked latent")
