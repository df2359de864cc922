"""Training stages of MoMask, as pure functions: both transformers; for its RVQ-VAE see `shared.autoencoders`."""
from typing import Any

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.latents import TOKENIZER, RvqCodec
from motion_jax.models.momask.losses import draw_step, masked_loss, residual_loss
from motion_jax.models.shared.autoencoders import item_keys
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.token_transformers import MaskedCodeTransformer, ResidualCodeTransformer
from motion_jax.training.stage import Stage, mixed_precision
from motion_jax.utils.config_files import module_fields


def init_masked(net: MaskedCodeTransformer, rng: jax.Array) -> Any:
  """Random parameters."""
  return net.init(rng, jnp.zeros((1, 1), int), jnp.zeros((1, net.text_dim)), jnp.ones((1, 1), bool))


def init_residual(net: ResidualCodeTransformer, rng: jax.Array) -> Any:
  """Random parameters."""
  history = jnp.zeros((1, 1, net.code_dim))
  return net.init(rng, history, jnp.ones(1, int), jnp.zeros((1, net.text_dim)), jnp.ones((1, 1), bool))


def masked_shapes(net: MaskedCodeTransformer) -> Any:
  """Shapes of the parameters, to check a file against."""
  return jax.eval_shape(lambda: init_masked(net, jax.random.key(0)))


def residual_shapes(net: ResidualCodeTransformer) -> Any:
  """The same of the residual transformer."""
  return jax.eval_shape(lambda: init_residual(net, jax.random.key(0)))


def masked_stage(config: ConfigDict) -> Stage:
  """Trains the masked transformer on codes of level 0 of the frozen RVQ-VAE.

  Batch: features (B, T, F) padded, num_frames (B,), text_emb (B, 1, E), index (B,) place in the whole batch. frozen:
  tokenizer, the RVQ-VAE's variables.
  """
  net = mixed_precision(MaskedCodeTransformer(**module_fields(config.model)), config)
  return _stage(config, net, init_masked, masked_loss, lambda codes: codes[..., 0],
                "cross-entropy of a hidden code, ln of the number of codes at the start")


def residual_stage(config: ConfigDict) -> Stage:
  """Trains the residual transformer: codes of one level of each motion from those of the levels below."""
  net = mixed_precision(ResidualCodeTransformer(**module_fields(config.model)), config)
  return _stage(config, net, init_residual, residual_loss, lambda codes: codes,
                "cross-entropy of a code of a residual level, ln of the number of codes at the start")


def _stage(config, net, init_of, loss_of, pick, about_loss):
  tokenizer = Autoencoder(**module_fields(config.tokenizer))

  def inputs(frozen, batch):
    length = batch["features"].shape[1] // tokenizer.frames_per_latent
    real_mask = padding_mask(batch["num_frames"] // tokenizer.frames_per_latent, length)
    codec = RvqCodec(tokenizer, frozen[TOKENIZER])
    # Parity: the released code encodes padding like motion, as does a tokenizer without hide_padding.
    codes = codec.encode(batch["features"], codec.real_frames(real_mask))[0]
    return pick(codes), real_mask, batch["text_emb"][:, 0]

  def init(batch, rng):
    return init_of(net, rng)

  def loss(params, frozen, batch, step, rng):
    draw_rng, dropout_rng = jax.random.split(rng)
    codes, real_mask, text_emb = inputs(frozen, batch)
    draws = draw_step(item_keys(draw_rng, batch), real_mask.shape[1], net.num_codes)
    return loss_of(net, params, codes, real_mask, text_emb, draws, config.loss, (dropout_rng, batch["index"]))

  def predict(params, frozen, batch, rng):
    """Sums of the loss and accuracy with captions and without dropout, and their weight."""
    codes, real_mask, text_emb = inputs(frozen, batch)
    draws = draw_step(item_keys(rng, batch), real_mask.shape[1], net.num_codes)
    fields = ConfigDict(config.loss.to_dict() | dict(drop_rate=0.0))
    sums, weight = loss_of(net, params, codes, real_mask, text_emb, draws, fields)
    return sums | {"weight": weight}

  return Stage(init, loss, predict, in_parts=True, about_loss=about_loss)
