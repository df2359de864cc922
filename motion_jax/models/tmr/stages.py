"""Training of the teachers, as pure functions: by contrast alone, or as TMR (docs/papers/cmdm.md#part-tmr, #tmr)."""
import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.models.tmr.losses import info_nce, tmr_terms
from motion_jax.models.tmr.space import Space, embed_motion, embed_text, make_space
from motion_jax.nets.masks import padding_mask
from motion_jax.text.bert import Bert
from motion_jax.training.stage import DEVICES, Stage, mixed_precision

NOISE = 2**30  # folded into a step's key for the noise: apart from those of dropout


def contrastive_stage(config: ConfigDict, axis_name: str | None = DEVICES) -> Stage:
  """Trains the teacher. Batch: features (B, T, F), num_frames (B,), ids (B, S), text_mask (B, S), index (B,).

  The contrast is over the whole batch: embeddings of all devices are gathered, so that N devices learn the same as one.
  axis_name: the devices' axis of the train step, None outside of one. The text transformer's weights come with `init`
  from the named encoder (`setup`), and `params["text"]` has a learning rate of its own (optimizer.rates).
  """
  space = make_space(config)
  teacher, bert = mixed_precision(space.net, config), mixed_precision(Bert(**config.text), config)
  whole = (lambda a: a) if axis_name is None else (lambda a: jax.lax.all_gather(a, axis_name, tiled=True))

  def loss(params, frozen, batch, step, rng):
    # Dropout masks differ from device to device, as the batch they fall on does.
    drop_rng = jax.random.fold_in(rng, batch["index"][0])
    rngs = lambda i: {"dropout": jax.random.fold_in(drop_rng, i)}
    frame_mask = padding_mask(batch["num_frames"], batch["features"].shape[1])
    motion = embed_motion(teacher, params, batch["features"], frame_mask, False, rngs(0))
    text = embed_text(teacher, bert, params, batch["ids"], batch["text_mask"], config.loss.text_pool, False, rngs(1))
    ids = whole(batch["ids"])
    same = (ids[:, None] == ids[None]).all(-1) if config.loss.skip_same_caption else None
    scale = teacher.apply({"params": params["motion"]}, method="scale")
    value, logits = info_nce(whole(text), whole(motion), scale, same)
    hit = (logits.argmax(0) == jnp.arange(len(logits))).mean()
    return {"loss": value, "batch_recall": hit}, 1.0

  def predict(params, frozen, batch, rng):
    frame_mask = padding_mask(batch["num_frames"], batch["features"].shape[1])
    return {"motion": space.motion(params, batch["features"], frame_mask),
            "text": space.text(params, batch["ids"], batch["text_mask"])}

  return Stage(lambda batch, rng: space.init(rng), loss, predict,
               about_loss="cross-entropy of finding a motion's caption in its batch and back")


def tmr_stage(config: ConfigDict, space: Space, axis_name: str | None = DEVICES) -> Stage:
  """Trains a TMR. Batch: that of `tmr_terms`, and index (B,), the place in the whole batch.

  space: the motion-language space of the same config (`make_space`). Noise depends on a pair's place in the batch, so
  that, apart from dropout, N devices learn the same as one.
  """
  net = mixed_precision(space.net, config)
  whole = (lambda a: a) if axis_name is None else (lambda a: jax.lax.all_gather(a, axis_name, tiled=True))
  weights = {name: config.loss[name] for name in ("recons", "kl", "latent", "contrastive")}

  def loss(params, frozen, batch, step, rng):
    keys = jax.vmap(lambda i: jax.random.fold_in(jax.random.fold_in(rng, NOISE), i))(batch["index"])
    noise = jax.vmap(lambda key: jax.random.normal(key, (2, net.width)))(keys)
    drop_rng = jax.random.fold_in(rng, batch["index"][0])
    return tmr_terms(net, params["motion"], batch, (noise[:, 0], noise[:, 1]), weights, config.loss.temperature,
                     config.loss.threshold, False, lambda i: {"dropout": jax.random.fold_in(drop_rng, i)}, whole), 1.0

  def predict(params, frozen, batch, rng):
    frame_mask = padding_mask(batch["num_frames"], batch["features"].shape[1])
    return {"motion": space.motion(params, batch["features"], frame_mask),
            "text": space.text(params, batch["text_emb"], batch["text_mask"])}

  return Stage(lambda batch, rng: space.init(rng), loss, predict)
