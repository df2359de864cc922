"""Training stages of CMDM, as pure functions: the causal tokenizer and, on its latents, the causal denoiser."""
import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import optax
from ml_collections import ConfigDict

from motion_jax.control import conditioning
from motion_jax.control.signal import ControlSignal
from motion_jax.diffusion import paths
from motion_jax.latents import VaeCodec
from motion_jax.models.cmdm import ddpm_forcing
from motion_jax.models.cmdm.losses import align_factor, pool_teacher, tokenizer_terms
from motion_jax.models.shared import motion_errors
from motion_jax.models.shared.likelihoods import sharing
from motion_jax.models.tmr.alignment import as_seen, frame_features
from motion_jax.models.tmr.space import make_teacher
from motion_jax.motion.representations import get_layout
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.causal_vae import CausalVAE, sample_latent
from motion_jax.nets.masks import block_causal_mask, padding_mask
from motion_jax.shapes import Array, Bool, Float, Int, Latents
from motion_jax.training.stage import DEVICES, Stage
from motion_jax.utils.errors import InputError


def tokenizer_stage(config: ConfigDict) -> Stage:
  """Trains the causal VAE on windows: batch["features"] (B, T, F), normalized.

  With config.frozen.teacher its latents are aligned with one: config.teacher holds its fields, frozen["teacher"] its
  parameters, and frozen["teacher_view"] both statistics, if it reads another layout or other statistics than these.
  With a weight for one of `motion_errors.NAMES` frozen["stats"] holds mean and std of the features.

  The sigma of the reconstruction loss belongs to a micro-batch, so the batch is cut into micro-batches of a fixed size,
  and the same ones arise on any number of devices: where one is more than a device's rows, devices share it.
  """
  vae = CausalVAE(**config.model, dtype=jnp.dtype(config.train.dtype))
  loss_config = config.loss
  teacher = make_teacher(config.teacher, config.data.layout) if config.frozen.teacher else None
  root_columns = get_layout(config.data.layout).root

  def latent_shape(x):
    return x.shape[:-2] + (x.shape[-2] // 2 ** vae.num_halvings, vae.latent_dim)

  def init(batch, rng):
    x = batch["features"][:1]
    return vae.init(rng, x, jnp.zeros(latent_shape(x)))

  def loss(params, frozen, batch, step, rng):
    x = batch["features"]
    size, shared = _micro_batches(config, x.shape[0])
    # One key per window, by its place in the whole batch: the same noise on one device as on many.
    keys = jax.vmap(lambda i: jax.random.fold_in(rng, i))(batch["index"])
    noise = jax.vmap(lambda key: jax.random.normal(key, latent_shape(x)[1:]))(keys)
    kl_weight = loss_config.kl_weight * (jnp.minimum(1.0, step / loss_config.kl_ramp) if loss_config.kl_ramp else 1.0)
    split = lambda a: a.reshape((-1, size) + a.shape[1:])
    guides = [None] * (x.shape[0] // size)
    if teacher is not None:
      guides = split(pool_teacher(_teacher_features(config, teacher, frozen, x), noise.shape[1]))
    align_weight = align_factor(step, loss_config, config.train.num_steps) if teacher is not None else 0.0
    choices = {name: loss_config[name] for name in ("reconstruction", "distance_pairs", "last_layer")}
    choices |= {"errors": motion_errors.of_features(config, frozen),
                "error_weights": motion_errors.weights(loss_config)}
    terms = [tokenizer_terms(vae, params, a, e, kl_weight, loss_config.root_weight, root_columns=root_columns,
                             teacher=g, align_weight=align_weight, adaptive=loss_config.adaptive_align, shared=shared,
                             **choices)
             for a, e, g in zip(split(x), split(noise), guides)]
    return jax.tree.map(lambda *parts: sum(parts), *terms), len(terms) * shared.share

  def predict(params, frozen, batch, rng):
    """Reconstructions by the mean of the latents; with rng also, as "drawn", by latents drawn around it."""
    encoded: Any = vae.apply(params, batch["features"], method="encode")
    mean, logvar = encoded
    outputs = {"features": vae.apply(params, mean, method="decode"), "mean": mean, "logvar": logvar}
    if rng is not None:
      z = sample_latent(mean, logvar, jax.random.normal(rng, mean.shape))
      outputs["drawn"] = vae.apply(params, z, method="decode")
    return outputs

  return Stage(init, loss, predict, in_parts=True, about_loss=_about_tokenizer(config))


def _micro_batches(config, rows):
  """(rows of a micro-batch on a device that has this number of rows, how devices share it)."""
  size, parts = min(config.loss.micro_batch, config.data.batch_size), config.optimizer.accumulate_steps
  if parts > 1 and rows % size:
    raise ValueError(f"got {rows} windows in each of optimizer.accumulate_steps = {parts} parts, expected a multiple "
                     f"of loss.micro_batch = {size}; take fewer parts")
  return min(size, rows), sharing(rows, size, config.data.batch_size // rows // parts, DEVICES)


def _teacher_features(config, teacher, frozen, x):
  """Features of the teacher for each frame of windows x, seen in its own layout and statistics."""
  layout = config.data.layout
  if "teacher_view" in frozen:
    x = as_seen(x, frozen["teacher_view"], layout, config.teacher.get("layout", layout))
  return frame_features(teacher, frozen["teacher"], x)


def _about_tokenizer(config):
  """Parity: the reference sums its reconstruction loss where others average it."""
  windows = min(config.loss.micro_batch, config.data.batch_size)
  numbers = windows * config.data.window * config.model.features
  return (f"a sum, not a mean, over the {numbers:,} numbers of {windows} windows: about as large as their count at "
          "first, below 0 once the reconstruction is good; held_out_mm at each save is the joint error in millimetres")


def forcing_inputs(config: ConfigDict, vae: CausalVAE, dit: CausalDiT, frozen: Any, batch: dict[str, Any],
                   rng: jax.Array) -> tuple[Any, Any, Any, Any, Any]:
  """Inputs of a step of diffusion forcing: (latents (B, L, C), which are real (B, L), times (B, L), noise
  (B, L, C), text_emb (B, S, E) with some dropped)."""
  encode_rng, level_rng, noise_rng, drop_rng = jax.random.split(rng, 4)
  keys = lambda key: jax.vmap(lambda i: jax.random.fold_in(key, i))(batch["index"])
  codec = VaeCodec.of(vae, frozen)
  known = batch["distribution"] if "distribution" in batch else codec.distribution(batch["features"])
  # Parity: the paper's algorithm 1 says E(x), the code draws. Not scaled in the released code, where the codec's mean
  # is 0 and its std 1.
  z1 = codec.drawn(known, None if config.loss.mean_latents else keys(encode_rng))
  latent_mask = padding_mask(batch["num_frames"] // vae.frames_per_latent, z1.shape[1])
  z1 = jnp.where(latent_mask[..., None], z1, 0.0)
  # Parity: the code draws one time per block of 3 latents, the paper one per latent; level_block says which.
  draw = (ddpm_forcing if dit.predicts == "ddpm" else paths).forcing_times
  t = jax.vmap(lambda key: draw(key, 1, z1.shape[1], config.loss.level_block)[0])(keys(level_rng))
  if config.loss.pyramid_levels:
    def ramped(key, t, real):
      chosen, times = jax.random.split(key)
      ramp = paths.ramp_times(times, z1.shape[1], config.loss.level_block, real=real)
      return jnp.where(jax.random.bernoulli(chosen, config.loss.pyramid_levels), ramp, t)

    t = jax.vmap(ramped)(keys(jax.random.fold_in(rng, 4)), t, latent_mask.sum(1))
  noise = jax.vmap(lambda key: jax.random.normal(key, z1.shape[1:]))(keys(noise_rng))
  drop = jax.vmap(lambda key: jax.random.bernoulli(key, config.loss.drop_rate))(keys(drop_rng))
  # Parity: the code zeroes the word features and keeps the mask; it also leaves the text encoder's dropout on while
  # training; ours is off, as the paper's frozen encoder has it, so that features can be cached.
  text_emb = jnp.where(drop[:, None, None], 0.0, batch["text_emb"])
  return z1, latent_mask, t, noise, text_emb


def control_of(config: ConfigDict, vae: CausalVAE, frozen: Any, batch: dict[str, Any], rng: jax.Array
               ) -> tuple[ControlSignal, Float[Array, "b l n"]] | tuple[None, None]:
  """(random constraints that a share config.data.control of the batch's motions meet, the control features of
  them); (None, None) where that is 0."""
  if not config.data.control:
    return None, None
  layout, stats = get_layout(config.data.layout), frozen[motion_errors.STATS]
  features = batch["features"] * stats["std"] + stats["mean"]
  turn, _ = layout.root_path(features)
  keys = jax.vmap(lambda i: jax.random.fold_in(jax.random.fold_in(rng, 3), i))(batch["index"])
  signal = conditioning.draw_constraints(layout.to_joints(features), -2 * jnp.arctan2(turn[..., 2], turn[..., 0]),
                         batch["num_frames"], keys, config.data.control)
  return signal, conditioning.features(signal, vae.frames_per_latent)


def time_left_of(config: ConfigDict, batch: dict[str, Any], rng: jax.Array) -> Int[Array, "b l"] | None:
  """How many latents its caption has left for each latent (`CausalDiT`), -1 for a share config.loss.time_left_drop of
  the motions; None for a network without time_left."""
  if "time_left" not in batch:
    return None
  drop = jax.vmap(lambda i: jax.random.bernoulli(jax.random.fold_in(jax.random.fold_in(rng, 6), i),
                                                 config.loss.time_left_drop))(batch["index"])
  return jnp.where(drop[:, None], -1, batch["time_left"])


def self_forced(velocity: Callable[..., Any], z1: Latents, latent_mask: Bool[Array, "b l"],
                  t: Float[Array, "b l"], noise: Latents, keys: Array, block: int, share: float
                  ) -> tuple[Latents, Float[Array, "b l"], Bool[Array, "b l"]]:
  """Self-forcing: (latents, times, which latents are predictions (B, L)). In a share of clips, drawn by keys (B,), the
  blocks before a random border are replaced by the network's predictions and count as clean, as when a motion
  continues from generated frames.

  They are predicted from noise that is more than half gone, without a gradient. A clip keeps at least one real block to
  learn from. Source: the two forward passes of MotionStreamer (arXiv 2503.15451), there of single frames.
  """
  length = z1.shape[1]
  places = -(-length // block)

  def draw(key, real):
    chosen, border, level = jax.random.split(key, 3)
    most = jnp.maximum(-(-real // block), 1)
    count = jax.random.randint(border, (), 0, most) * jax.random.bernoulli(chosen, share)
    return count * block, jnp.repeat(jax.random.uniform(level, (places,), minval=0.5), block)[:length]

  count, level = jax.vmap(draw)(keys, latent_mask.sum(1))
  forced = jnp.arange(length) < count[:, None]
  x = paths.add_noise(z1, noise, level.astype(z1.dtype))
  predicted = paths.velocity_to_x1(x, velocity(x, level.astype(z1.dtype)), level.astype(z1.dtype))
  predicted = jax.lax.stop_gradient(predicted.astype(z1.dtype))
  return jnp.where(forced[..., None], predicted, z1), jnp.where(forced, jnp.ones_like(t), t), forced


def decoded_errors(config: ConfigDict, codec: VaeCodec, frozen: Any, batch: dict[str, Any], latent_mask: Any,
                   counts: Any, t: Any, control: ControlSignal | None = None) -> Callable | None:
  """errors_of(clean latents (B, L, C)) -> {name: (B,)}, for `paths.forcing_loss`: the errors of the decoded motion,
  times their weights in config.loss; None where all weights are 0. latent_mask (B, L): real latents; counts: those
  whose frames count, if their time is over config.loss.decoded_from.

  "control" is the distance of joints from their constraints. Frames that do not count are replaced by real ones before
  it is measured, as the steps of all earlier frames add up to the place of a joint.
  """
  errors, weights = motion_errors.of_features(config, frozen), motion_errors.weights(config.loss)
  held = config.loss.control if control is not None else 0.0
  if errors is None and not held:
    return None
  if config.model.get("predicts") == "ddpm":
    raise InputError(f"got loss.{next(iter(weights), 'control')} and model.predicts='ddpm'; decoded motion is looked "
                     "at where the network's output means clean latents by the straight path: velocity, eps or x1")
  # From mostly noise the network predicts an average of motions, which need not move like any of them.
  frames = codec.real_frames(counts & (t > config.loss.decoded_from))

  def errors_of(clean):
    rebuilt = codec.decode(jnp.where(latent_mask[..., None], clean, 0.0))
    real = batch["features"][:, :rebuilt.shape[1]]
    terms = {name: weights[name] * value for name, value in errors(rebuilt, real, frames).items()} if errors else {}
    if control is not None and held:
      filled = jnp.where(frames[..., None], rebuilt, real)
      terms["control"] = held * _held_errors(config, frozen, filled, control, frames)
    return terms

  return errors_of


def _held_errors(config, frozen, features, control, frames):
  """Mean Huber errors (B,), squares up to half a metre, of the given coordinates at the frames that count."""
  layout, stats = get_layout(config.data.layout), frozen[motion_errors.STATS]
  off = layout.to_joints(features * stats["std"] + stats["mean"]) - control.positions[:, :features.shape[1]]
  counts = control.given[:, :features.shape[1]] & frames[..., None, None]
  loss = jnp.where(counts, optax.huber_loss(jnp.where(counts, off, 0.0), delta=0.5), 0.0).sum((1, 2, 3))
  return loss / jnp.maximum(counts.sum((1, 2, 3)), 1)


def make_denoiser(config: ConfigDict) -> CausalDiT:
  """The network as it is trained: config.model, computed as config.train says."""
  return CausalDiT(**config.model, dtype=jnp.dtype(config.train.dtype), remat=config.train.remat,
                   attention=config.train.attention, scan_layers=config.train.scan_layers)


def denoiser_stage(config: ConfigDict) -> Stage:
  """Trains the causal diffusion transformer by diffusion forcing on latents of the frozen tokenizer.

  Batch: features (B, T, F) or, of a store, distribution (B, L, 2 C) of their latents; num_frames (B,), text_emb
  (B, S, E), text_mask (B, S), index (B,) place in the whole batch; of a network with time_left also time_left (B, L).
  With a weight for one of `motion_errors.NAMES` the clean latents that the network means are decoded, and the motion of
  frames whose latents' time is over config.loss.decoded_from is held to the real one's; frozen["stats"] holds mean and
  std of the features, also with a share config.data.control of motions whose latents are conditioned on random
  constraints that the motion meets.

  With a weight config.loss.contrast the batch also holds captions that contradict the motions, `captioned_batches`, and
  with these the velocity of latents before the time config.loss.contrast_until must be off by contrast_margin more.
  """
  vae = CausalVAE(**config.tokenizer)
  dit = make_denoiser(config)
  block = dit.block
  inputs = functools.partial(forcing_inputs, config, vae, dit)

  def init(batch, rng):
    length = (batch["distribution"].shape[1] if "distribution" in batch else
              batch["features"].shape[1] // vae.frames_per_latent)
    x = jnp.zeros((1, length, vae.latent_dim))
    return dit.init(rng, x, jnp.zeros((1, length)), batch["text_emb"][:1], block_causal_mask(length, block),
                    batch["text_mask"][:1])

  def loss(params, frozen, batch, step, rng):
    z1, latent_mask, t, noise, text_emb = inputs(frozen, batch, rng)
    attn_mask = block_causal_mask(z1.shape[1], block) & latent_mask[:, None, None, :]
    # Equal times inside a block are modulated once.
    shared = block if block > 1 and config.loss.level_block % block == 0 and z1.shape[1] % block == 0 else 1
    signal, control = control_of(config, vae, frozen, batch, rng)
    left = time_left_of(config, batch, rng)
    velocity = lambda x, t, emb=text_emb, mask=batch["text_mask"]: dit.apply(
        params, x, t[:, ::shared], emb, attn_mask, mask, control, left)
    if dit.predicts == "ddpm":
      if loss_name := next((name for name in ("self_forcing", "pyramid_levels", "contrast") if config.loss[name]), ""):
        raise InputError(f"got loss.{loss_name} and model.predicts='ddpm'; it is a loss of the straight path: "
                         "velocity, eps or x1")
      # Parity: the paper's algorithm 1; the code, and our default, learn the velocity of a straight path.
      return ddpm_forcing.forcing_loss(velocity, z1, latent_mask, t, noise)
    counts = latent_mask
    if config.loss.pyramid_levels:
      counts &= t < 1  # what is finished teaches nothing: its noise is gone
    if config.loss.self_forcing:
      keys = jax.vmap(lambda i: jax.random.fold_in(jax.random.fold_in(rng, 2), i))(batch["index"])
      z1, t, forced = self_forced(velocity, z1, latent_mask, t, noise, keys, block, config.loss.self_forcing)
      counts &= ~forced
    errors = decoded_errors(config, VaeCodec.of(vae, frozen), frozen, batch, latent_mask, counts, t, signal)
    contrast = _contrast(config, velocity, batch, text_emb, counts, t) if config.loss.contrast else None
    return paths.forcing_loss(velocity, z1, counts, t, noise, dit.predicts, errors, contrast)

  def predict(params, frozen, batch, rng):
    z1, latent_mask, t, noise, text_emb = inputs(frozen, batch, rng)
    attn_mask = block_causal_mask(z1.shape[1], block) & latent_mask[:, None, None, :]
    ddpm = dit.predicts == "ddpm"
    x = (ddpm_forcing if ddpm else paths).add_noise(z1, noise, t)
    return {"velocity": dit.apply(params, x, t, text_emb, attn_mask, batch["text_mask"],
                                  left=time_left_of(config, batch, rng)),
            "target": noise if ddpm else z1 - noise}

  target = {"ddpm": "noise", "eps": "noise", "x1": "latents"}.get(dit.predicts, "velocity")
  return Stage(init, loss, predict, in_parts=True,
               about_loss=f"mean squared error of the predicted {target}, per number of a latent")


def _contrast(config, velocity, batch, text_emb, counts, t):
  """The velocity with contradicting captions, and the latents where it must be worse."""
  differs = batch["has_false"] & (text_emb != 0).any((1, 2))  # its caption was not dropped
  compared = counts & (t < config.loss.contrast_until) & differs[:, None]
  false = functools.partial(velocity, emb=batch["false_emb"], mask=batch["false_mask"])
  return paths.Contrast(false, compared, config.loss.contrast, config.loss.contrast_margin)


def denoiser_shapes(dit: CausalDiT) -> Any:
  """Shapes of the denoiser's parameters, to check a file against."""
  mask = jnp.ones((1, 1), bool)
  return jax.eval_shape(lambda: dit.init(jax.random.key(0), jnp.zeros((1, dit.block, dit.latent_dim)), jnp.zeros(
      (1, dit.block)), jnp.zeros((1, 1, dit.text_dim)), block_causal_mask(dit.block, dit.block), mask))


def frozen_shapes(vae: CausalVAE) -> dict[str, Any]:
  """Shapes of what the denoiser's run keeps of its tokenizer."""
  x, noise = jnp.zeros((1, vae.frames_per_latent, vae.features)), jnp.zeros((1, 1, vae.latent_dim))
  params = jax.eval_shape(lambda: vae.init(jax.random.key(0), x, noise))
  channel = jax.ShapeDtypeStruct((vae.latent_dim,), jnp.float32)
  return VaeCodec(vae, params, channel, channel).parts
