"""Adversarial training of an autoencoder's decoder: a stage of any method with a critic of the decoded motion.

Squared errors make decoded motion smoother than real motion, and upsampling adds jitter; a critic learns to see both
(docs/lab/believed.md). Hinge losses, feature matching, and a weight by the ratio of gradients at the decoder's last
layer, as in VQGAN (arXiv 2012.09841).
"""
from typing import Any

import flax.traverse_util
import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.metrics.physics import in_body_frame
from motion_jax.models.shared import motion_errors
from motion_jax.motion.representations import get_layout
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.nets.motion_critic import MotionCritic
from motion_jax.shapes import Array, Float
from motion_jax.training.checkpoint import CRITIC
from motion_jax.training.stage import Stage

_LAST = ("params", "decoder", "conv_out", "conv", "kernel")
_MOST = 1e4  # of the ratio of gradients
_SIZES = (0.5, 1.0, 10.0)  # m, m/s, m/s^2: what positions, velocities and accelerations are divided by


def seen(joints: Float[Array, "b t j 3"], skeleton: Skeleton = HUMANML3D) -> Float[Array, "b t-2 n"]:
  """What the critic sees of joints (B, T, J, 3): positions in the body's frame with the pelvis's height, and their
  first two differences, which of the pelvis are those over the ground; (B, T - 2, 9 J)."""
  metres, fps = joints * skeleton.unit, skeleton.fps
  local = jax.vmap(lambda clip: in_body_frame(clip, skeleton))(metres)
  local = local.at[:, :, 0, 1].set(metres[:, :, 0, 1])
  velocity = jnp.diff(local, axis=1).at[:, :, 0].set(jnp.diff(metres[:, :, 0], axis=1)) * fps
  acceleration = jnp.diff(velocity, axis=1) * fps
  parts = [part / size for part, size in zip((local[:, 2:], velocity[:, 1:], acceleration), _SIZES)]
  return jnp.concatenate([part.reshape(*part.shape[:2], -1) for part in parts], axis=-1)


def with_critic(stage: Stage, config: ConfigDict) -> Stage:
  """The stage with the critic's terms; the stage itself if config.loss.critic is 0.

  config.loss: critic, the weight of the adversarial term after the step critic_after; critic_matching, that of feature
  matching; frozen["stats"] holds mean and std of the features. The critic is trained by the same optimizer from the
  first step on, by terms that have no gradient for the network; config.optimizer.rates gives it a rate of its own.
  """
  choices = config.loss
  if not choices.get(CRITIC):
    return stage
  critic, layout = MotionCritic(width=choices.critic_width), get_layout(config.data.layout)

  def init(batch, rng):
    params = stage.init(batch, rng)
    joints = layout.to_joints(batch["features"][:1])
    return params | {"params": params["params"] | {
        CRITIC: critic.init(jax.random.fold_in(rng, 7), seen(joints, layout.skeleton))["params"]}}

  def judge(params, frozen, features):
    stats = frozen[motion_errors.STATS]
    joints = layout.to_joints(features * stats["std"] + stats["mean"])
    return critic.apply({"params": params}, seen(joints, layout.skeleton))

  def loss(params, frozen, batch, step, rng):
    flat = flax.traverse_util.flatten_dict(params)
    judging = {path: value for path, value in flat.items() if path[1] == CRITIC}
    network = {path: value for path, value in flat.items() if path[1] != CRITIC}
    own = flax.traverse_util.unflatten_dict({path[2:]: value for path, value in judging.items()})
    real = judge(own, frozen, batch["features"])

    def of_kernel(kernel, network=network):
      """(the stage's sums, its weight, the adversarial term, that of matching, the decoded features)."""
      changed = flax.traverse_util.unflatten_dict({**network, _LAST: kernel})
      sums, weight = stage.loss(changed, frozen, batch, step, rng)
      decoded = stage.predict(changed, frozen, batch, None)["features"]
      towers = judge(jax.lax.stop_gradient(own), frozen, decoded)
      return sums, weight, deceiving(towers), matching(jax.lax.stop_gradient(real), towers), decoded

    sums, weight, adversarial, match, decoded = of_kernel(network[_LAST])
    constant = jax.lax.stop_gradient(network)
    of_terms = lambda kernel: (lambda sums, weight, *terms: (sums["loss"] / weight, *terms[:2]))(
        *of_kernel(kernel, constant))
    terms, pull = jax.vjp(of_terms, constant[_LAST])
    unit = lambda place: tuple(jnp.asarray(float(i == place), term.dtype) for i, term in enumerate(terms))
    size = [jnp.linalg.norm(pull(unit(place))[0]) for place in range(3)]
    ratios = [jax.lax.stop_gradient(jnp.clip(size[0] / jnp.maximum(size[i], 1e-8), 0, _MOST)) for i in (1, 2)]
    on = step >= choices.critic_after
    judged = telling(real, judge(own, frozen, jax.lax.stop_gradient(decoded)))
    added = on * (choices.critic * ratios[0] * adversarial + choices.critic_matching * ratios[1] * match) + judged
    return sums | {"loss": sums["loss"] + weight * added, "deceiving": weight * adversarial, "matching": weight * match,
                   "telling": weight * judged}, weight

  return stage._replace(init=init, loss=loss, in_parts=False)


def telling(real: Any, decoded: Any) -> Float[Array, ""]:
  """The critic's hinge loss: max(0, 1 - D(real)) + max(0, 1 + D(decoded)), the mean over towers."""
  return jnp.stack([jax.nn.relu(1 - a[-1]).mean() + jax.nn.relu(1 + b[-1]).mean()
                    for a, b in zip(real, decoded)]).mean()


def deceiving(decoded: Any) -> Float[Array, ""]:
  """The decoder's adversarial loss: -D(decoded), the mean over towers."""
  return -jnp.stack([tower[-1].mean() for tower in decoded]).mean()


def matching(real: Any, decoded: Any) -> Float[Array, ""]:
  """Feature matching: mean absolute differences of all hidden layers, each divided by the layer's mean size."""
  pairs = [(a, b) for tower, other in zip(real, decoded) for a, b in zip(tower[:-1], other[:-1])]
  return jnp.stack([jnp.abs(a - b).mean() / jnp.maximum(jnp.abs(a).mean(), 1e-6) for a, b in pairs]).mean()
