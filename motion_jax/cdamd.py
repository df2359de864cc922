"""CDAMD on one page: coordinates to latents and codes, a masked transformer with a diffusion MLP on the latents.

The paper is "Coordinate-based Dual-constrained Autoregressive Motion Generation"; facts and numbers follow the
released code, see the comments that start with "Parity".
"""
import jax
import jax.numpy as jnp

from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.quant import rvq, vq
from motion_jax.stage import DEVICES, Stage

# --- losses of the autoencoders ----------------------------------------------------------------------------------


def smooth_l1(prediction, target):
  """Mean of d^2 / 2 where the difference d is below 1, of |d| - 1/2 elsewhere."""
  distance = jnp.abs(prediction - target)
  return jnp.where(distance < 1, distance ** 2 / 2, distance - 0.5).mean()


def l1(prediction, target):
  return jnp.abs(prediction - target).mean()


DISTANCES = {"smooth_l1": smooth_l1, "l1": l1}


def autoencoder_terms(y, x, distance="smooth_l1", position_weight=1.0, columns=(4, 67)):
  """Loss terms of features x (B, T, F) and their reconstruction y: rec, positions, and their weighted sum, loss."""
  # Parity: the paper says L1. The columns that count twice are the joint positions of 67 columns (22 joints; 4:64 for
  # 21); of coordinates the code takes the same columns, all but the first four numbers.
  measure, part = DISTANCES[distance], slice(*columns)
  y = y.astype(x.dtype)
  terms = {"rec": measure(y, x), "positions": measure(y[..., part], x[..., part]), "mse": ((y - x) ** 2).mean()}
  terms["loss"] = terms["rec"] + position_weight * terms["positions"]
  return terms


def rvq_terms(y, x, commitment, velocity_weight=0.1, commitment_weight=0.02, position_weight=0.1, **reconstruction):
  """The same for the RVQ-VAE, with the error of frame differences and the distance of latents to their codes."""
  # Parity: the paper's eq. (10) has a codebook loss; the code moves the codebooks by running means instead.
  terms = autoencoder_terms(y, x, position_weight=position_weight, **reconstruction)
  terms["velocity"] = ((jnp.diff(y.astype(x.dtype), axis=1) - jnp.diff(x, axis=1)) ** 2).mean()
  terms["commitment"] = commitment
  terms["loss"] += velocity_weight * terms["velocity"] + commitment_weight * commitment
  return terms


# --- autoencoders ------------------------------------------------------------------------------------------------


def encode_codes(net, variables, x):
  """Features (B, T, F) to code indices (B, L, Q) and the code vectors of each level (Q, B, L, C).

  The RVQ-VAE is an Autoencoder `net` with variables {"params", "codebooks"}, as its run folder holds them.
  """
  return rvq.encode(variables["codebooks"]["codes"], net.apply(variables, x, method="encode"))


def decode_codes(net, variables, indices, num_levels=None):
  """Code indices (B, L, Q) to features (B, T, F), from the first num_levels levels only if that is given."""
  return net.apply(variables, rvq.decode(variables["codebooks"]["codes"], indices, num_levels), method="decode")


def empty_codebooks(net, quantizer):
  """The RVQ-VAE's collection "codebooks" before training: a dict of the fields of `vq.Codebook`, each (Q, ...)."""
  book = vq.empty_codebook(quantizer.num_codes, net.latent_dim, (quantizer.num_levels,))
  return {"codebooks": book._asdict()}


def autoencoder_shapes(net, quantizer=None):
  """Shapes of the variables of an autoencoder or, with a quantizer section, an RVQ-VAE, to check a file against."""
  x = jnp.zeros((1, net.frames_per_latent, net.features))
  codebooks = (lambda: empty_codebooks(net, quantizer)) if quantizer else dict
  return jax.eval_shape(lambda: {**net.init(jax.random.key(0), x), **codebooks()})


def _item_keys(rng, batch):
  """One key per item, by its place in the whole batch: the same noise on one device as on many."""
  return jax.vmap(lambda i: jax.random.fold_in(rng, i))(batch["index"])


def _with_dropout(net, params, method, x, keys):
  run = lambda item, key: net.apply(params, item[None], False, method=method, rngs={"dropout": key})[0]
  return jax.vmap(run)(x, keys)


def autoencoder_stage(config) -> Stage:
  """Trains the deterministic autoencoder on windows: batch["features"] (B, T, F), normalized."""
  net = Autoencoder(**config.model)

  def init(batch, rng):
    return net.init(rng, batch["features"][:1])

  def loss(params, frozen, batch, step, rng):
    x = batch["features"]
    terms = autoencoder_terms(_with_dropout(net, params, "__call__", x, _item_keys(rng, batch)), x, **config.loss)
    return jax.tree.map(lambda term: term * len(x), terms), float(len(x))

  def predict(params, frozen, batch, rng):
    latents = net.apply(params, batch["features"], method="encode")
    return {"features": net.apply(params, latents, method="decode"), "latents": latents}

  return Stage(init, loss, predict)


def rvq_stage(config, axis_name=DEVICES) -> Stage:
  """Trains the RVQ-VAE: batch["features"] (B, T, F), normalized, windows or whole clips padded with zeros.

  The codebooks learn without a gradient, so they are the stage's extra state. axis_name: None to run the loss on one
  device outside of the training loop.
  """
  # Parity: padding takes part in the loss and in the codebooks, as in the released code; windows have none.
  net, quantizer = Autoencoder(**config.model), config.quantizer

  def init(batch, rng):
    return net.init(rng, batch["features"][:1])

  def init_extra(batch, rng):
    return empty_codebooks(net, quantizer)

  def loss(params, frozen, batch, step, rng, extra):
    x, books = batch["features"], vq.Codebook(**extra["codebooks"])
    encoder_rng, decoder_rng, code_rng, tile_rng, active_rng = jax.random.split(rng, 5)
    latents = _with_dropout(net, params, "encode", x, _item_keys(encoder_rng, batch))
    noise = rvq.draw_noise(tile_rng, _item_keys(code_rng, batch), latents.shape[1], books)
    num_active = rvq.draw_active(active_rng, quantizer.num_levels, quantizer.drop_rate)
    made, books = rvq.train(books, latents, num_active, noise, quantizer.decay, quantizer.temperature,
                            quantizer.gain_once, axis_name)
    y = _with_dropout(net, params, "decode", made.quantized, _item_keys(decoder_rng, batch))
    terms = rvq_terms(y, x, made.commitment, **config.loss)
    terms |= {"perplexity": made.perplexity, "usage": made.usage, "dead": vq.num_dead(books).mean(dtype=x.dtype)}
    return jax.tree.map(lambda term: term * len(x), terms), float(len(x)), {"codebooks": books._asdict()}

  def predict(variables, frozen, batch, rng):
    indices, _ = encode_codes(net, variables, batch["features"])
    return {"features": decode_codes(net, variables, indices), "indices": indices}

  return Stage(init, loss, predict, init_extra)


STAGES = {"cdamd.autoencoder": autoencoder_stage, "cdamd.rvq": rvq_stage}
