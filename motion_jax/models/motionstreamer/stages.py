"""Training stages of MotionStreamer, as pure functions: the causal autoencoder and, on its latents, the generator."""
from typing import Any

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.diffusion import ddpm
from motion_jax.latents import VaeCodec
from motion_jax.models.motionstreamer.losses import Draws, autoencoder_terms, num_replaced, two_forward_loss
from motion_jax.models.shared.captioned_batches import NO_CAPTION
from motion_jax.models.shared.likelihoods import sharing
from motion_jax.motion.representations import get_layout
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.nets.diffusion_mlp import DiffusionMLP
from motion_jax.nets.latent_llama import LatentGenerator, LatentLlama
from motion_jax.nets.masks import padding_mask
from motion_jax.training.stage import DEVICES, Stage, mixed_precision

END = "end_latent"  # the name, among the frozen parts, of the latent that ends a motion (C,)


def tokenizer_stage(config: ConfigDict) -> Stage:
  """Trains the causal autoencoder on windows: batch["features"] (B, T, F), normalized, index (B,).

  A sigma of the loss belongs to the whole batch in the released code; here to config.loss.micro_batch windows, so that
  it is the same on any number of devices.
  """
  vae = CausalVAE(**config.model)
  net, root = mixed_precision(vae, config), get_layout(config.data.layout).root
  weights = {"kl": config.loss.kl_weight, "root": config.loss.root_weight}
  shape = lambda x: (x.shape[-2] // vae.frames_per_latent, vae.latent_dim)

  def init(batch, rng):
    x = jnp.asarray(batch["features"][:1])
    return vae.init(rng, x, jnp.zeros((1, *shape(x))))

  def loss(params, frozen, batch, step, rng):
    x = batch["features"]
    size = min(config.loss.micro_batch, config.data.batch_size)
    shared = sharing(x.shape[0], size, config.data.batch_size // x.shape[0] // config.optimizer.accumulate_steps,
                     DEVICES)
    size = min(size, x.shape[0])
    keys = jax.vmap(lambda i: jax.random.fold_in(rng, i))(batch["index"])
    noise = jax.vmap(lambda key: jax.random.normal(key, shape(x)))(keys)
    split = lambda a: a.reshape((-1, size) + a.shape[1:])
    terms = [autoencoder_terms(net, params, part, e, weights, root, shared) for part, e in zip(split(x), split(noise))]
    return jax.tree.map(lambda *parts: sum(parts), *terms), len(terms) * shared.share

  def predict(params, frozen, batch, rng):
    codec = VaeCodec(vae, params)
    keys = None if rng is None else jax.random.split(rng, len(batch["features"]))
    return {"features": codec.reconstruct(batch["features"], keys)}

  return Stage(init, loss, predict, in_parts=True,
               about_loss="a sum, not a mean, over the numbers of a micro-batch; it falls below 0")


def make_generator(config: ConfigDict, dtype: Any = jnp.float32) -> LatentGenerator:
  """Transformer and head of a section model: transformer, head; dtype: what they compute in."""
  transformer = LatentLlama(**config.transformer, dtype=dtype)
  return LatentGenerator(transformer, DiffusionMLP(latent_dim=transformer.latent_dim, **config.head, dtype=dtype))


def generator_stage(config: ConfigDict) -> Stage:
  """Trains transformer and head with two forward passes, on latents of the frozen autoencoder.

  Batch: features (B, T, F), num_frames (B,), text_emb (B, 1, E), index (B,). frozen: parts of the codec, `END` (C,) and
  `NO_CAPTION` (1, E).
  """
  plain, vae = make_generator(config.model), CausalVAE(**config.tokenizer)
  schedule, copies = ddpm.cosine_schedule(config.diffusion.num_steps), config.loss.copies
  most, channels = config.model.transformer.max_length - 1, config.model.transformer.latent_dim
  net = make_generator(config.model, jnp.dtype(config.train.dtype))
  ramp = config.loss.replace_ramp or config.train.num_steps

  def init(batch, rng):
    return plain.init(rng, jnp.asarray(batch["text_emb"][:1, 0]), jnp.zeros((1, 1, channels)), jnp.zeros((1, 1), int))

  def sequences(frozen, batch, keys):
    """(latents (B, most, C) followed by the end latent, how many count (B,)): some lose their first or last."""
    codec = VaeCodec.of(vae, frozen)
    x = batch["features"]
    z = codec.encode(x) if config.loss.mean_latents else codec.sample(x, keys[:, 0])
    count = jnp.minimum(batch["num_frames"] // vae.frames_per_latent, z.shape[1])
    z = jnp.pad(z, ((0, 0), (0, max(most + 1 - z.shape[1], 1)), (0, 0)))
    place = jnp.arange(z.shape[1])[None]
    z = jnp.where((place == count[:, None])[..., None], frozen[END], jnp.where(
        (place < count[:, None])[..., None], z, 0.0))
    # Parity: one in three loses its first or its last latent, half each; the last one is the end.
    lot = jax.vmap(jax.random.uniform)(keys[:, 1])
    z = jnp.where((lot < config.loss.crop_rate / 2)[:, None, None], jnp.roll(z, -1, axis=1), z)
    count = count + 1 - (lot < config.loss.crop_rate)
    return z[:, :most], jnp.minimum(count, most)

  def loss(params, frozen, batch, step, rng):
    keys = jax.vmap(lambda i: jax.random.split(jax.random.fold_in(rng, i), 7))(batch["index"])
    z, count = sequences(frozen, batch, keys)
    real = padding_mask(count, most)
    total = len(schedule.betas)
    steps = lambda keys, *lead: jax.vmap(lambda key: jax.random.randint(key, (*lead, most), 0, total))(keys)
    normal = lambda keys, *lead: jax.vmap(lambda key: jax.random.normal(key, (*lead, most, channels)))(keys)
    draws = Draws(steps(keys[:, 2]), normal(keys[:, 3]), steps(keys[:, 4], copies).swapaxes(0, 1),
                  normal(keys[:, 5], copies).swapaxes(0, 1))
    # One choice of places for the whole batch, the same on all devices.
    order = jax.random.permutation(jax.random.fold_in(rng, 2**31 - 1), most)
    replaced = (jnp.argsort(order) < num_replaced(step, ramp, most))[None]
    drop = jax.vmap(lambda key: jax.random.bernoulli(key, config.loss.drop_rate))(keys[:, 6])
    text = jnp.where(drop[:, None], frozen[NO_CAPTION], batch["text_emb"][:, 0])
    return two_forward_loss(net, params, schedule, text, z, real, replaced, draws)

  def predict(params, frozen, batch, rng):
    """The sums and weight of the loss, all latents given and all captions."""
    key = jax.random.key(0) if rng is None else rng
    keys = jax.vmap(lambda i: jax.random.split(jax.random.fold_in(key, i), 7))(batch["index"])
    z, count = sequences(frozen, batch, keys)
    return {"latents": z, "num_latents": count}

  return Stage(init, loss, predict, in_parts=True, about_loss="squared error of the noise of latents, 1 at first")


def generator_shapes(net: LatentGenerator) -> Any:
  """Shapes of the parameters, to check a file against."""
  llama = net.transformer
  return jax.eval_shape(lambda: net.init(jax.random.key(0), jnp.zeros((1, llama.text_dim)),
                                         jnp.zeros((1, 1, llama.latent_dim)), jnp.zeros((1, 1), int)))


def tokenizer_shapes(vae: CausalVAE) -> Any:
  """Shapes of the autoencoder's parameters."""
  x, noise = jnp.zeros((1, vae.frames_per_latent, vae.features)), jnp.zeros((1, 1, vae.latent_dim))
  return jax.eval_shape(lambda: vae.init(jax.random.key(0), x, noise))


def frozen_shapes(vae: CausalVAE, text_dim: int) -> dict[str, Any]:
  """Shapes of what a generator's run keeps besides its parameters."""
  channel = jax.ShapeDtypeStruct((vae.latent_dim,), jnp.float32)
  return VaeCodec(vae, tokenizer_shapes(vae), channel, channel).parts | {
      END: channel, NO_CAPTION: jax.ShapeDtypeStruct((1, text_dim), jnp.float32)}
