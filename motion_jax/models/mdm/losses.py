"""Losses of MDM: the error of the clean features and, of motions whose joints are known, geometric terms.

Source: docs/papers/mdm.md#losses.
"""
from collections.abc import Mapping, Sequence
from typing import Any

import jax.numpy as jnp

from motion_jax.shapes import Array, Bool, Float

STANDS = 0.01  # a foot that moves less than this between two frames stands
TERMS = ("velocity", "positions", "contacts")  # besides the error of the features, each with a weight


def masked_l2(predicted: Float[Array, "b t n"], real: Float[Array, "b t n"], frame_mask: Bool[Array, "b t"]
              ) -> Float[Array, " b"]:
  """Squared error of the real frames, averaged over these and the columns, of each motion."""
  square = jnp.where(frame_mask[..., None], (predicted - real) ** 2, 0).sum((1, 2))
  return square / (frame_mask.sum(1) * predicted.shape[-1] + 1e-8)


def contact_error(predicted: Float[Array, "b t j 3"], real: Float[Array, "b t j 3"], frame_mask: Bool[Array, "b t"],
                  feet: Sequence[int]) -> Float[Array, " b"]:
  """Squared steps, in the decoded motion, of feet that stand in the real one; 0 where there is no contact."""
  velocity, real_velocity = (jnp.diff(joints[:, :, jnp.array(feet)], axis=1) for joints in (predicted, real))
  stands = jnp.sqrt((real_velocity ** 2).sum(-1, keepdims=True)) <= STANDS
  velocity = jnp.where(stands, velocity, 0.0).reshape(*velocity.shape[:2], -1)
  return masked_l2(velocity, jnp.zeros_like(velocity), frame_mask[:, 1:])


def mdm_terms(predicted: Float[Array, "b t f"], real: Float[Array, "b t f"], frame_mask: Bool[Array, "b t"],
              weights: Mapping[str, float], last: int = 1, joints: tuple[Any, Any] | None = None,
              feet: Sequence[int] = ()) -> dict[str, Float[Array, " b"]]:
  """{name: (B,)} of predicted and real features: "features", those of `TERMS` with a weight, and their sum "loss".

  last: columns at the end that the velocity term leaves out. joints: predicted and real (B, T, J, 3), for positions and
  contacts; feet: the joints that may stand.
  """
  terms = {"features": masked_l2(predicted, real, frame_mask)}
  if weights.get("velocity"):
    # Parity: the reference leaves out the last joint, where its action models keep the root's place; of text models'
    # features that is one column, a contact.
    terms["velocity"] = masked_l2(jnp.diff(predicted[..., :-last], axis=1), jnp.diff(real[..., :-last], axis=1),
                                  frame_mask[:, 1:])
  if joints is not None:
    flat = [a.reshape(*a.shape[:2], -1) for a in joints]
    if weights.get("positions"):
      terms["positions"] = masked_l2(flat[0], flat[1], frame_mask)
    if weights.get("contacts"):
      terms["contacts"] = contact_error(*joints, frame_mask, feet)
  terms["loss"] = terms["features"] + sum(weights[name] * terms[name] for name in TERMS if name in terms)
  return terms
