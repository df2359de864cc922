"""How the tiny method is trained."""
import flax.linen as nn
import jax
import jax.numpy as jnp

from motion_jax.data import batches, sources
from motion_jax.nets.masks import padding_mask
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint
from motion_jax.training.setup import TrainingSetup, caption_lengths, text_identity
from motion_jax.training.stage import Stage


class Regressor(nn.Module):
  """Normalized features (B, T, F) of T frames, from sentence vectors (B, 1, E)."""
  features: int
  text_dim: int
  num_waves: int

  @nn.compact
  def __call__(self, text_emb, num_frames):
    angles = jnp.arange(num_frames)[:, None] * 2.0 ** -jnp.arange(self.num_waves)
    waves = jnp.concatenate([jnp.sin(angles), jnp.cos(angles)], axis=-1)
    words = nn.Dense(waves.shape[-1], name="words")(text_emb)
    return nn.Dense(self.features, name="out")(words * waves)


def shapes(net):
  """Shapes of the parameters, to check a file against."""
  return jax.eval_shape(lambda: net.init(jax.random.key(0), jnp.zeros((1, 1, net.text_dim)), 4))


def regressor(config) -> TrainingSetup:
  """Squared error of the features of real frames; now and then of a sentence left out, for guidance."""
  data = sources.load_features(config.data)
  encoder = load_text_encoder(config.frozen.text, level=config.frozen.text_level)
  items = batches.TextItems(data.features, data.captions, config.data.min_frames, config.data.max_frames,
                            tuple(config.data.lengths))
  net = Regressor(**config.model)

  def next_batch(step, rows=batches.ALL):
    batch = items.batch(config.data.batch_size, config.seed, step, rows)
    return batch | {"text_emb": encoder(batch.pop("caption"), rows=rows)[0]}

  def init(batch, rng):
    return net.init(rng, batch["text_emb"], 4)

  def loss(params, frozen, batch, step, rng):
    drop = jax.vmap(lambda i: jax.random.bernoulli(jax.random.fold_in(rng, i), config.loss.drop_rate))(batch["index"])
    words = jnp.where(drop[:, None, None], 0.0, batch["text_emb"])
    real = padding_mask(batch["num_frames"], batch["features"].shape[1])
    error = ((net.apply(params, words, real.shape[1]) - batch["features"]) ** 2).mean(-1)
    return {"loss": jnp.where(real, error, 0.0).sum()}, real.sum()

  def predict(params, frozen, batch, rng):
    return {"features": net.apply(params, batch["text_emb"], batch["features"].shape[1])}

  files = {checkpoint.LENGTHS: caption_lengths(data), checkpoint.TEXT: text_identity(encoder)}
  return TrainingSetup(Stage(init, loss, predict), next_batch, {}, None, data.stats, files)


SETUPS, RESOLVED = {"tiny.regressor": regressor}, {}
