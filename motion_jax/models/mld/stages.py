"""Training stages of MLD, as pure functions: transformer VAE and denoiser, of latents or, without a VAE, of frames."""
from typing import Any, cast

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.diffusion import ddpm
from motion_jax.latents import TOKENIZER
from motion_jax.models.mld.losses import prediction_error, vae_terms
from motion_jax.models.mld.sampling import FrameDenoiser
from motion_jax.models.shared.captioned_batches import NO_CAPTION
from motion_jax.models.shared.motion_errors import STATS
from motion_jax.motion.representations import get_layout
from motion_jax.nets.initial import initial_as_pytorch
from motion_jax.nets.latent_diffusion import TokenDenoiser, TokenVAE
from motion_jax.nets.masks import padding_mask
from motion_jax.training.stage import Stage, mixed_precision

VAE = TOKENIZER  # the name of the VAE among the frozen parts of a denoiser


def vae_stage(config: ConfigDict) -> Stage:
  """Trains the VAE on whole padded clips: features (B, T, F), num_frames (B,), index (B,). frozen["stats"]: mean and
  std of the features."""
  plain, layout = TokenVAE(**config.model), get_layout(config.data.layout)
  net, weights = mixed_precision(plain, config), {name: config.loss[name] for name in ("features", "joints", "kl")}
  shape = (plain.num_tokens, plain.latent_dim)

  def init(batch, rng):
    x = jnp.asarray(batch["features"][:1])
    params = plain.init(rng, x, jnp.zeros((1, *shape)), jnp.ones(x.shape[:2], bool))
    return initial_as_pytorch(params, rng, xavier=True)

  def loss(params, frozen, batch, step, rng):
    x, real = batch["features"], padding_mask(batch["num_frames"], batch["features"].shape[1])
    noise = jax.vmap(lambda i: jax.random.normal(jax.random.fold_in(rng, i), shape))(batch["index"])
    more: dict[str, Any] = dict(items=batch["index"], rngs={"dropout": rng}) if config.model.dropout else {}
    made, mean, logvar = net.apply(params, x, noise, real, **more)
    stats = frozen[STATS]
    joints = tuple(layout.to_joints(one * stats["std"] + stats["mean"]) * layout.skeleton.unit for one in (made, x))
    terms = vae_terms(made, x, joints, mean, logvar, weights)
    return {name: value.sum() for name, value in terms.items()}, x.shape[0]

  def predict(params, frozen, batch, rng):
    real = padding_mask(batch["num_frames"], batch["features"].shape[1])
    return {"features": reconstruct(plain, params, batch["features"], real)}

  return Stage(init, loss, predict, in_parts=True,
               about_loss="smooth L1 of features and of joints in metres, and a little of the KL divergence")


def reconstruct(vae: TokenVAE, params: Any, x: Any, real: Any) -> Any:
  """Features (B, T, F) encoded and decoded, by the mean of the latent."""
  return vae.apply(params, vae.apply(params, x, real, method="encode")[0], real, method="decode")


def denoiser_stage(config: ConfigDict) -> Stage:
  """Trains the denoiser on draws of the frozen VAE. Batch: features (B, T, F), num_frames (B,), text_emb (B, 1, E),
  index (B,). frozen: `VAE`, and `NO_CAPTION` (1, E)."""
  plain, vae = TokenDenoiser(**config.model), TokenVAE(**config.tokenizer)
  net = mixed_precision(plain, config)

  def init(batch, rng):
    params = plain.init(rng, jnp.zeros((1, vae.num_tokens, vae.latent_dim)), jnp.zeros(1, int), batch["text_emb"][:1])
    return initial_as_pytorch(params, rng, xavier=True)

  def loss(params, frozen, batch, step, rng):
    keys = _keys(batch, rng)
    real = padding_mask(batch["num_frames"], batch["features"].shape[1])
    mean, logvar = cast(Any, vae.apply)(frozen[VAE], batch["features"], real, method="encode")
    z = mean + jnp.exp(logvar / 2) * _normal(keys[:, 0], mean.shape[1:])
    return _denoising(net, config, params, frozen, batch, rng, z, keys)

  def predict(params, frozen, batch, rng):
    real = padding_mask(batch["num_frames"], batch["features"].shape[1])
    return {"latents": vae.apply(frozen[VAE], batch["features"], real, method="encode")[0]}

  return Stage(init, loss, predict, in_parts=True, about_loss="squared error of the noise in latents, 1 at first")


def frames_stage(config: ConfigDict) -> Stage:
  """Trains the denoiser without a VAE, on batches as `denoiser_stage`. frozen: `NO_CAPTION` (1, E).

  Parity: padding is 0 in the prediction and counts in the mean, with no gradient of its own; frames attend to it,
  unless config.loss.mask_frames.
  """
  plain = TokenDenoiser(**config.model)
  net = mixed_precision(plain, config)

  def init(batch, rng):
    params = plain.init(rng, jnp.asarray(batch["features"][:1]), jnp.zeros(1, int), batch["text_emb"][:1])
    return initial_as_pytorch(params, rng, xavier=True)

  def loss(params, frozen, batch, step, rng):
    x = jnp.asarray(batch["features"])
    frames = FrameDenoiser(net, padding_mask(batch["num_frames"], x.shape[1]), config.loss.mask_frames)
    return _denoising(frames, config, params, frozen, batch, rng, x, _keys(batch, rng))

  return Stage(init, loss, lambda params, frozen, batch, rng: {}, in_parts=True,
               about_loss="squared error of the noise in features, 1 at first")


def _keys(batch, rng):
  """Four keys for each motion, (B, 4)."""
  return jax.vmap(lambda i: jax.random.split(jax.random.fold_in(rng, i), 4))(batch["index"])


def _normal(keys, shape):
  return jax.vmap(lambda key: jax.random.normal(key, shape))(keys)


def _denoising(net, config, params, frozen, batch, rng, clean, keys):
  """(sums, weight) of the error in what a denoiser makes of noisy latents or frames (B, N, D)."""
  steps, schedule = config.diffusion.num_steps, ddpm.scaled_linear_schedule(config.diffusion.num_steps)
  t = jax.vmap(lambda key: jax.random.randint(key, (), 0, steps))(keys[:, 1])
  noise = _normal(keys[:, 2], clean.shape[1:])
  drop = jax.vmap(lambda key: jax.random.bernoulli(key, config.loss.drop_rate))(keys[:, 3])
  text = jnp.where(drop[:, None, None], frozen[NO_CAPTION][None], batch["text_emb"])
  more: dict[str, Any] = dict(items=batch["index"], rngs={"dropout": rng}) if config.model.dropout else {}
  prediction = net.apply(params, ddpm.add_noise(schedule, clean, noise, t[:, None]), t, text, **more)
  errors = prediction_error(prediction, noise if config.diffusion.predicts == "noise" else clean)
  return {"loss": errors.sum()}, len(errors)


def vae_shapes(vae: TokenVAE) -> Any:
  """Shapes of the VAE's parameters."""
  x, noise = jnp.zeros((1, 2, vae.features)), jnp.zeros((1, vae.num_tokens, vae.latent_dim))
  return jax.eval_shape(lambda: vae.init(jax.random.key(0), x, noise, jnp.ones((1, 2), bool)))


def denoiser_shapes(net: TokenDenoiser, num_tokens: int) -> Any:
  """Shapes of the denoiser's parameters."""
  width = net.features or net.latent_width or net.width
  return jax.eval_shape(lambda: net.init(jax.random.key(0), jnp.zeros((1, num_tokens, width)), jnp.zeros(1, int),
                                         jnp.zeros((1, 1, net.text_dim))))


def frozen_shapes(vae: TokenVAE | None, text_dim: int) -> dict[str, Any]:
  """Shapes of what a denoiser's run keeps besides its parameters."""
  no_caption = {NO_CAPTION: jax.ShapeDtypeStruct((1, text_dim), jnp.float32)}
  return no_caption | ({VAE: vae_shapes(vae)} if vae else {})
