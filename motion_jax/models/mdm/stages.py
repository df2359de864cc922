"""Training stage of MDM, as a pure function: the denoiser of whole motions or, as DiP, of the frames after a prefix."""
from typing import Any

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.diffusion import ddpm
from motion_jax.models.mdm.goals import conditions, drawn_goals, goal_error, places
from motion_jax.models.mdm.losses import TERMS, mdm_terms
from motion_jax.models.mdm.sampling import SCHEDULES
from motion_jax.models.shared.motion_errors import STATS
from motion_jax.motion.representations import get_layout
from motion_jax.nets.initial import initial_as_pytorch
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.motion_denoiser import MotionDenoiser
from motion_jax.shapes import Bool
from motion_jax.training.stage import Stage, mixed_precision


def reads_stats(config: ConfigDict) -> bool:
  """Whether its loss is taken on joints, too, so that its frozen parts hold mean and std of the features."""
  return bool(config.model.num_goals or any(config.loss[name] for name in TERMS[1:]))


def denoiser_stage(config: ConfigDict) -> Stage:
  """Trains the denoiser. Batch: features (B, T, F), num_frames (B,), text_emb (B, S, E), text_mask (B, S), index (B,).

  The first config.diffusion.context frames are given as they are, and carry no loss. A network with goals reads where
  the motion ends, by goals that are drawn for each item (`goals.TRAINED`) and left out as often as captions. With
  goals, or a weight for positions or contacts, frozen["stats"] holds mean and std of the features.
  """
  plain = MotionDenoiser(**config.model)
  net, layout = mixed_precision(plain, config), get_layout(config.data.layout)
  context = config.diffusion.context
  schedule = SCHEDULES[config.diffusion.get("schedule", "cosine")](config.diffusion.num_steps)
  weights = {name: config.loss[name] for name in TERMS if config.loss[name]}
  feet = (*layout.skeleton.left_feet, *layout.skeleton.right_feet)

  def split(x):
    return (x[:, :context], x[:, context:]) if context else (None, x)

  def init(batch, rng):
    prefix, x = split(jnp.asarray(batch["features"][:1]))
    params = plain.init(rng, x, jnp.zeros(1, int), batch["text_emb"][:1], batch["text_mask"][:1], prefix=prefix,
                        goals=no_goals(plain, 1))
    return initial_as_pytorch(params, rng, alike="layer")

  def errors(params, frozen, batch, rng, drop_rate, dropout):
    prefix, x1 = split(batch["features"])
    real = split(padding_mask(batch["num_frames"], batch["features"].shape[1])[..., None])[1][..., 0]
    keys = jax.vmap(lambda i: jax.random.split(jax.random.fold_in(rng, i), 3))(batch["index"])
    t = jax.vmap(lambda key: jax.random.randint(key, (), 0, config.diffusion.num_steps))(keys[:, 0])
    noise = jax.vmap(lambda key: jax.random.normal(key, x1.shape[1:], x1.dtype))(keys[:, 1])
    no_text, no_goal = left_out(keys[:, 2], drop_rate)
    text = jnp.where(no_text[:, None, None], 0.0, batch["text_emb"])
    more: dict[str, Any] = dict(items=batch["index"], rngs={"dropout": rng}) if dropout else {}
    joints_of = lambda x: layout.to_joints(x * frozen[STATS]["std"] + frozen[STATS]["mean"])
    if plain.num_goals:
      counts = drawn_goals(jax.vmap(lambda i: jax.random.fold_in(jax.random.fold_in(rng, i), 3))(batch["index"]))
      wanted = places(joints_of(x1), layout)  # seen from the first frame that is predicted, not from the prefix
      more["goals"] = conditions(jnp.where(counts[..., None], wanted, 0.0), counts)
      more["goals_mask"] = ~no_goal
    prediction = net.apply(params, ddpm.add_noise(schedule, x1, noise, t[:, None]), t, text, batch["text_mask"],
                           real if config.loss.mask_frames else None, prefix, **more)
    whole = lambda x: x if prefix is None else jnp.concatenate([prefix, x], axis=1)
    joints = (tuple(joints_of(whole(x))[:, context:] for x in (prediction, x1))
              if weights.keys() & {"positions", "contacts"} else None)
    terms = mdm_terms(prediction, x1, real, weights, joints=joints, feet=feet)
    if plain.num_goals:
      terms["goals"] = goal_error(places(joints_of(prediction), layout), wanted, counts)
      terms["loss"] = terms["loss"] + config.loss.goals * terms["goals"]
    return prediction, terms

  def loss(params, frozen, batch, step, rng):
    terms = errors(params, frozen, batch, rng, config.loss.drop_rate, config.model.dropout > 0)[1]
    return {name: value.sum() for name, value in terms.items()}, batch["index"].shape[0]

  def predict(params, frozen, batch, rng):
    """Clean features of noisy ones, all captions given, and the sums and weight of their loss."""
    prediction, terms = errors(params, frozen, batch, jax.random.key(0) if rng is None else rng, 0.0, False)
    return {"features": prediction, "loss": terms["loss"].sum(), "weight": batch["index"].shape[0]}

  return Stage(init, loss, predict, in_parts=True,
               about_loss="squared error of the clean features of real frames, in units of their deviation")


def left_out(keys: jax.Array, rate: float) -> tuple[Bool[jax.Array, " b"], Bool[jax.Array, " b"]]:
  """Which motions lose their caption and, drawn apart from these, their goals, by a key for each."""
  # Parity: goals that are left out keep their loss (docs/papers/mdm.md#goals).
  draw = jax.vmap(lambda key: jax.random.bernoulli(key, rate))
  return draw(keys), draw(jax.vmap(lambda key: jax.random.fold_in(key, 1))(keys))


def denoiser_shapes(net: MotionDenoiser) -> Any:
  """Shapes of the parameters, to check a file against."""
  x, text = jnp.zeros((1, 2, net.features)), jnp.zeros((1, 1, net.text_dim))
  return jax.eval_shape(lambda: net.init(jax.random.key(0), x, jnp.zeros(1, int), text, goals=no_goals(net, 1)))


def no_goals(net: MotionDenoiser, batch: int) -> Any:
  """The goals (B, num_goals, 4) of motions that have none; None for a network without goals."""
  return jnp.zeros((batch, net.num_goals, 4)) if net.num_goals else None
