"""Motion from captions with MDM: all frames at once, or, as DiP, block after block."""
from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from motion_jax.diffusion import ddpm, guidance
from motion_jax.shapes import Array, Bool, Float, Net

SCHEDULES = {"cosine": ddpm.cosine_schedule, "linear": ddpm.linear_schedule}


class Plan(NamedTuple):
  """Static choices of sampling; hashable. train_steps: steps of training; num_steps: steps of sampling
  (`ddpm.spaced_steps`)."""
  train_steps: int = 1000
  num_steps: int | str = 1000
  solver: str = "ancestral"  # or "ddim"
  guided: bool = True
  schedule: str = "cosine"


def schedule_of(plan: Plan) -> ddpm.Schedule:
  return ddpm.respace(SCHEDULES[plan.schedule](plan.train_steps), plan.num_steps)


class Condition(NamedTuple):
  """Inputs of the network besides the noisy frames; each may be None but text_emb. See `nets.motion_denoiser`."""
  text_emb: Any
  text_mask: Any = None
  frame_mask: Any = None
  prefix: Any = None
  goals: Any = None


def predictor(net: Net, plan: Plan, params: Any, condition: Condition, scale: Any) -> Callable:
  """predict(x (B, T, F), step ()) -> clean features, guided by scale () or (B,), both branches in one batch of 2 B."""
  text = condition.text_emb
  if plan.guided:
    condition = jax.tree.map(lambda a: jnp.concatenate([a, a]), condition)
    # Parity: no caption is a vector of zeros in front of the layer, whose bias stays; words keep their mask.
    condition = condition._replace(text_emb=jnp.concatenate([text, jnp.zeros_like(text)]))
  return guidance.two_branches(lambda x, step: net.apply(params, x, step, *condition), plan.guided, scale)


def denoise(net: Net, plan: Plan, params: Any, condition: Condition, scale: Any, draw: Callable,
            known: Float[Array, "b t f"] | None = None, known_mask: Bool[Array, "b t f"] | None = None
            ) -> Float[Array, "b t f"]:
  """Clean features (B, T, F); draw(0) is the noise to begin with, draw(m) that of the m-th step. Pure.

  known, where known_mask, is painted over the clean features that the network predicts, in every step; the noisy
  features are left as they are.
  """
  replace = (lambda x1: x1) if known is None else lambda x1: jnp.where(jnp.asarray(known_mask), jnp.asarray(known), x1)
  predict, schedule = predictor(net, plan, params, condition, scale), schedule_of(plan)
  if plan.solver == "ddim":
    return ddpm.ddim(lambda x, t: replace(predict(x, t)), schedule, draw(0), predicts="x1")
  return ddpm.ancestral(predict, schedule, draw(0), lambda m: draw(m + 1), predicts="x1", replace=replace)


def next_block(net: Net, plan: Plan, params: Any, condition: Condition, scale: Any, draw: Callable
               ) -> tuple[Float[Array, "b t f"], Float[Array, "b p f"]]:
  """DiP: the block (B, T, F) after the clean frames condition.prefix (B, P, F), and the prefix of the one after it."""
  block = denoise(net, plan, params, condition, scale, draw)
  prefix = condition.prefix
  return block, jnp.concatenate([prefix, block], axis=1)[:, -prefix.shape[1]:]
