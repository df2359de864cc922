"""Training of the autoencoders that several methods share (`nets.autoencoder`), with and without a quantizer, as pure
functions: their losses and stages.
"""
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax import shapes
from motion_jax.latents import RvqCodec
from motion_jax.models.shared import motion_errors
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.masks import padding_mask
from motion_jax.quant import rvq, vq
from motion_jax.shapes import Array, Float
from motion_jax.training.checkpoint import CRITIC
from motion_jax.training.stage import DEVICES, Stage, mixed_precision

# --- losses -------------------------------------------------------------------------------------------------------


def smooth_l1(prediction: Float[Array, "b t f"], target: Float[Array, "b t f"]) -> Float[Array, ""]:
  """Mean of d^2 / 2 where the difference d is below 1, of |d| - 1/2 elsewhere."""
  shapes.check(prediction=(prediction, "BTF"), target=(target, "BTF"))
  import optax  # only training needs it
  return optax.huber_loss(prediction, target).mean()


def l1(prediction: Float[Array, "b t f"], target: Float[Array, "b t f"]) -> Float[Array, ""]:
  """Mean absolute error of all numbers of a batch."""
  shapes.check(prediction=(prediction, "BTF"), target=(target, "BTF"))
  return jnp.abs(prediction - target).mean()


DISTANCES = {"smooth_l1": smooth_l1, "l1": l1}


def autoencoder_terms(y: Float[Array, "b t f"], x: Float[Array, "b t f"], distance: str = "smooth_l1",
                      position_weight: float = 1.0, columns: Sequence[int] = (4, 67)) -> dict[str, Array]:
  """Loss terms of features x (B, T, F) and their reconstruction y: rec, positions, and their weighted sum, loss."""
  # Parity: the paper says L1. The columns that count twice are the joint positions of 67 columns (22 joints; 4:64 for
  # 21); of coordinates the code takes the same columns, all but the first four numbers.
  measure, part = DISTANCES[distance], slice(*columns)
  y = y.astype(x.dtype)
  terms = {"rec": measure(y, x), "positions": measure(y[..., part], x[..., part]), "mse": ((y - x) ** 2).mean()}
  terms["loss"] = terms["rec"] + position_weight * terms["positions"]
  return terms


def rvq_terms(y: Float[Array, "b t f"], x: Float[Array, "b t f"], commitment: Any, velocity_weight: float = 0.1,
              commitment_weight: float = 0.02, position_weight: float = 0.1, **reconstruction: Any) -> dict[str, Array]:
  """`autoencoder_terms` and, for the RVQ-VAE, the error of frame differences and the distance of latents to their
  codes."""
  # Parity: the paper's eq. (10) has a codebook loss, which `rvq.learn` gives; the code moves the codebooks by running
  # means instead.
  terms = autoencoder_terms(y, x, position_weight=position_weight, **reconstruction)
  terms["velocity"] = ((jnp.diff(y.astype(x.dtype), axis=1) - jnp.diff(x, axis=1)) ** 2).mean()
  terms["commitment"] = commitment
  terms["loss"] += velocity_weight * terms["velocity"] + commitment_weight * commitment
  return terms


def with_motion_errors(terms: dict[str, Array], errors: Mapping[str, Float[Array, " b"]], weights: Mapping[str, float]
                       ) -> dict[str, Array]:
  """Adds `motion_errors`, mean squares (B,) per clip, to the terms, and their weighted sum to the loss."""
  means = {name: squares.mean() for name, squares in errors.items()}
  return {**terms, **means, "loss": terms["loss"] + sum(weights[name] * mean for name, mean in means.items())}


# --- stages -------------------------------------------------------------------------------------------------------


def empty_codebooks(net: Autoencoder, quantizer: Any) -> dict[str, Any]:
  """The RVQ-VAE's collection "codebooks" before training: a dict of the fields of `vq.Codebook`, each (Q, ...)."""
  book = vq.empty_codebook(quantizer.num_codes, net.latent_dim, (quantizer.num_levels,))
  return {"codebooks": book._asdict()}


def autoencoder_shapes(net: Autoencoder, quantizer: Any = None) -> Any:
  """Shapes of the variables of an autoencoder or, with a quantizer section, an RVQ-VAE, to check a file against."""
  x = jnp.zeros((1, net.frames_per_latent, net.features))
  codebooks = (lambda: empty_codebooks(net, quantizer)) if quantizer else dict
  return jax.eval_shape(lambda: {**net.init(jax.random.key(0), x), **codebooks()})


def item_keys(rng: jax.Array, batch: Mapping[str, Any]) -> jax.Array:
  """One key per item, by its place in the whole batch: the same noise on one device as on many."""
  return jax.vmap(lambda i: jax.random.fold_in(rng, i))(batch["index"])


def _with_dropout(net, params, method, x, items, rng):
  return net.apply(params, x, items, method=method, rngs={"dropout": rng})


def _terms(config):
  """(the fields of config.loss for terms on features, a function that adds the terms on decoded motion)."""
  weights = motion_errors.weights(config.loss)
  others = (*motion_errors.NAMES, "latent_noise")
  fields = {name: value for name, value in config.loss.items() if name not in others and not name.startswith(CRITIC)}

  def add(terms, y, x, frozen, batch):
    errors = motion_errors.of_features(config, frozen)
    if errors is None:
      return terms
    frame_mask = padding_mask(batch["num_frames"], x.shape[1]) if "num_frames" in batch else None
    return with_motion_errors(terms, errors(y.astype(x.dtype), x, frame_mask), weights)

  return fields, add


def _blurred(latents, amount, rng, batch, axis_name):
  """Latents (B, L, C) with noise of `amount` standard deviations of each channel, over the batch of all devices."""
  mean_of = lambda a: jax.lax.pmean(a.mean((0, 1)), axis_name)
  scale = jax.lax.stop_gradient(jnp.sqrt(mean_of((latents - mean_of(latents)) ** 2)))
  noise = jax.vmap(lambda key: jax.random.normal(key, latents.shape[1:]))(item_keys(rng, batch))
  return latents + amount * scale * noise


_ABOUT_RECONSTRUCTION = ("mean error of normalized numbers, below 1 from the start; held_out_mm at each save is the "
                         "joint error in millimetres")


def autoencoder_stage(config: ConfigDict) -> Stage:
  """Trains the deterministic autoencoder on windows: batch["features"] (B, T, F), normalized.

  With config.loss.latent_noise the decoder gets latents with added noise, as a generator's latents are inexact, and
  learns to infer the path of a motion from all latents around, not from each one alone. The scale of the noise is that
  of the batch, so the items of a batch are then no longer independent in the loss.
  """
  net, noise = mixed_precision(Autoencoder(**config.model), config), config.loss.latent_noise
  fields, add_errors = _terms(config)

  def init(batch, rng):
    return net.init(rng, batch["features"][:1])

  def loss(params, frozen, batch, step, rng):
    x = batch["features"]
    if noise:
      encoder_rng, noise_rng, decoder_rng = jax.random.split(rng, 3)
      latents = _with_dropout(net, params, "encode", x, batch["index"], encoder_rng)
      y = _with_dropout(net, params, "decode", _blurred(latents, noise, noise_rng, batch, DEVICES), batch["index"],
                        decoder_rng)
    else:
      y = _with_dropout(net, params, "__call__", x, batch["index"], rng)
    terms = add_errors(autoencoder_terms(y, x, **fields), y, x, frozen, batch)
    return jax.tree.map(lambda term: term * len(x), terms), float(len(x))

  def predict(params, frozen, batch, rng):
    latents = net.apply(params, batch["features"], method="encode")
    return {"features": net.apply(params, latents, method="decode"), "latents": latents}

  return Stage(init, loss, predict, in_parts=not noise, about_loss=_ABOUT_RECONSTRUCTION)


def rvq_stage(config: ConfigDict, axis_name: str | None = DEVICES) -> Stage:
  """Trains the RVQ-VAE: batch["features"] (B, T, F), normalized, windows or whole clips padded with zeros.

  The codebooks learn without a gradient, so they are the stage's extra state. axis_name: None to run the loss on one
  device outside of the training loop.
  """
  # Parity: padding takes part in the loss and in the codebooks, as in the released code; windows have none.
  net, quantizer = mixed_precision(Autoencoder(**config.model), config), config.quantizer
  if quantizer.learn == "gradient":
    return _rvq_by_gradient(net, config, axis_name)
  fields, add_errors = _terms(config)

  def init(batch, rng):
    return net.init(rng, batch["features"][:1])

  def init_extra(batch, rng):
    return empty_codebooks(net, quantizer)

  def loss(params, frozen, batch, step, rng, extra):
    x, books = batch["features"], vq.Codebook(**extra["codebooks"])
    encoder_rng, decoder_rng, code_rng, tile_rng, active_rng = jax.random.split(rng, 5)
    latents = _with_dropout(net, params, "encode", x, batch["index"], encoder_rng)
    noise = rvq.draw_noise(tile_rng, item_keys(code_rng, batch), latents.shape[1], books)
    num_active = rvq.draw_active(active_rng, quantizer.num_levels, quantizer.drop_rate)
    quantization, books = rvq.train(books, latents, num_active, noise, quantizer.decay, quantizer.temperature,
                                    quantizer.gain_once, axis_name)
    y = _with_dropout(net, params, "decode", quantization.quantized, batch["index"], decoder_rng)
    terms = add_errors(rvq_terms(y, x, quantization.commitment, **fields), y, x, frozen, batch)
    dead = vq.num_dead(books).mean(dtype=x.dtype, where=books.initialised)
    terms |= {"perplexity": quantization.perplexity, "usage": quantization.usage, "dead": dead}
    return jax.tree.map(lambda term: term * len(x), terms), float(len(x)), {"codebooks": books._asdict()}

  def predict(variables, frozen, batch, rng):
    codec = RvqCodec(net, variables)
    indices, _ = codec.encode(batch["features"])
    return {"features": codec.decode(indices), "indices": indices}

  return Stage(init, loss, predict, init_extra, about_loss=_ABOUT_RECONSTRUCTION)


def _rvq_by_gradient(net, config, axis_name):
  """`rvq_stage` by the paper's equations 8 to 10: nearest codes, which are parameters and learn by a loss of theirs."""
  quantizer = config.quantizer
  fields, add_errors = _terms(config)

  def init(batch, rng):
    net_rng, code_rng = jax.random.split(rng)
    params = net.init(net_rng, batch["features"][:1])
    latents = net.apply(params, batch["features"], method="encode")
    book = vq.codebook_of(rvq.first_codes(latents, quantizer.num_levels, quantizer.num_codes, code_rng))
    # The same collection as with running means, so that run folders are read alike; all floats, as gradients need.
    return {**params, "codebooks": jax.tree.map(lambda a: a.astype(latents.dtype), book._asdict())}

  def loss(params, frozen, batch, step, rng):
    x, codes = batch["features"], params["codebooks"]["codes"]
    encoder_rng, decoder_rng, active_rng = jax.random.split(rng, 3)
    latents = _with_dropout(net, params, "encode", x, batch["index"], encoder_rng)
    num_active = rvq.draw_active(active_rng, quantizer.num_levels, quantizer.drop_rate)
    quantization, codebook = rvq.learn(codes, latents, num_active, axis_name)
    y = _with_dropout(net, params, "decode", quantization.quantized, batch["index"], decoder_rng)
    terms = add_errors(rvq_terms(y, x, quantization.commitment, **fields), y, x, frozen, batch)
    terms |= {"loss": terms["loss"] + codebook, "codebook": codebook, "perplexity": quantization.perplexity,
              "usage": quantization.usage}
    return jax.tree.map(lambda term: term * len(x), terms), float(len(x))

  def predict(variables, frozen, batch, rng):
    codec = RvqCodec(net, variables)
    indices, _ = codec.encode(batch["features"])
    return {"features": codec.decode(indices), "indices": indices}

  return Stage(init, loss, predict, about_loss=_ABOUT_RECONSTRUCTION)
