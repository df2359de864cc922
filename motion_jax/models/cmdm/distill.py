"""A student of a trained denoiser that samples in fewer steps, without a second pass for guidance.

The student learns, at the noise levels that frame-wise sampling visits with its own few steps, to go in one step where
the teacher goes in several, guided or not (progressive distillation: Salimans and Ho 2022, eq. 8; guidance folded in:
Meng et al. 2023, section 3.1). On a staircase of levels the window moves along one path: the blocks that are under way
take a step together, the others stay (docs/training.md#fewer-steps). Halving the number of steps and the lag between
blocks together keeps the rows of the staircase, so a student of few steps stands where its teacher would.
"""
from typing import Any

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax.diffusion import paths
from motion_jax.diffusion.guidance import combine
from motion_jax.models.cmdm import stages
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.nets.masks import block_causal_mask
from motion_jax.shapes import Array, Bool, Int, Latents, Net
from motion_jax.training.stage import Stage

TEACHER = "teacher"  # of a student's frozen parts


def staircase_rows(keys: Array, num_blocks: int, num_steps: int, lag: int
                   ) -> tuple[Int[Array, "b n"], Bool[Array, "b n"]]:
  """One row of the staircase per key (B,): (level of each block, 0..num_steps, which blocks take the next step).

  Rows are drawn evenly among those in which some block moves.
  """
  rows = jax.vmap(lambda key: jax.random.randint(key, (), 0, num_steps + lag * (num_blocks - 1)))(keys)
  done = rows[:, None] - lag * jnp.arange(num_blocks)
  return jnp.clip(done, 0, num_steps), (done >= 0) & (done < num_steps)


def teacher_step(velocity: Any, x: Latents, level: Int[Array, "b l"], moves: Bool[Array, "b l"],
                 num_steps: int, teacher_steps: int) -> Latents:
  """The velocity (B, L, C) that takes x from its level one of num_steps steps further, as the teacher gets there in
  teacher_steps Euler steps. velocity(x, t) -> (B, L, C); where latents do not move it is 0."""
  now = x
  for i in range(teacher_steps):
    t = (level + moves * (i / teacher_steps)) / num_steps
    step = velocity(now, t) / (num_steps * teacher_steps)
    now = jnp.where(moves[..., None], now + step, now)
  return (now - x) * num_steps


def student_stage(config: ConfigDict) -> Stage:
  """Trains a few-step student of the denoiser config.distill.teacher, whose parameters frozen holds as "teacher".

  Batch and predict as `stages.denoiser_stage`. The loss is the mean squared error of the student's velocity against
  the teacher's over a step, with the ordinary forcing loss as config.distill.forcing_share of it.
  """
  vae, given = CausalVAE(**config.tokenizer), config.distill
  dit = stages.make_denoiser(config)
  if dit.predicts != "velocity":
    raise ValueError(f"got a denoiser that predicts {dit.predicts!r}, expected 'velocity': no other's are distilled")
  plain = stages.denoiser_stage(config)

  def loss(params, frozen, batch, step, rng):
    row_rng, latent_rng = jax.random.split(jax.random.fold_in(rng, 1))
    z1, latent_mask, _, noise, _ = stages.forcing_inputs(config, vae, dit, frozen, batch, latent_rng)
    blocks = -(-z1.shape[1] // dit.block)
    keys = jax.vmap(lambda i: jax.random.fold_in(row_rng, i))(batch["index"])
    level, moves = (jnp.repeat(a, dit.block, axis=1)[:, :z1.shape[1]]
                    for a in staircase_rows(keys, blocks, given.num_steps, given.lag))
    attn_mask = block_causal_mask(z1.shape[1], dit.block) & latent_mask[:, None, None, :]
    shared = dit.block if z1.shape[1] % dit.block == 0 else 1
    run = _velocity(dit, batch, attn_mask, shared, stages.time_left_of(config, batch, rng))
    t = level / given.num_steps
    x = paths.add_noise(z1, noise, t)
    target = teacher_step(run(frozen[TEACHER], given.guidance_scale), x, level, moves, given.num_steps,
                          given.teacher_steps)
    error = (run(params, 1.0)(x, t) - jax.lax.stop_gradient(target)) ** 2
    error = error.astype(jnp.float32).mean(-1)
    counted = moves & latent_mask
    # Motions count by their length, as in the forcing loss, however few of their latents move in this row.
    part = latent_mask.sum(1) / jnp.maximum(counted.sum(1), 1)
    learned = (jnp.where(counted, error, 0.0).sum(1) * part).sum()
    if not given.forcing_share:
      return {"loss": learned}, latent_mask.sum()
    forcing, weight = plain.loss(params, frozen, batch, step, rng)
    share = given.forcing_share
    return {"loss": (1 - share) * learned + share * forcing["loss"], "distill": learned, "forcing": forcing["loss"]
            }, weight

  return plain._replace(loss=loss)


def _velocity(dit: Net, batch: Any, attn_mask: Any, shared: int, left: Any = None) -> Any:
  """velocity_of(params, scale)(x, t): guided by the scale, 1 is without a second pass."""
  text, mask = batch["text_emb"], batch["text_mask"]

  def of(params, scale):
    def velocity(x, t):
      t = t[:, ::shared]
      if scale == 1.0:
        return dit.apply(params, x, t, text, attn_mask, mask, left=left)
      twice = lambda a: jnp.concatenate([a, a])
      both = dit.apply(params, twice(x), twice(t), jnp.concatenate([text, jnp.zeros_like(text)]), twice(attn_mask),
                       twice(mask), left=None if left is None else twice(left))
      with_text, without = jnp.split(both, 2)
      return combine(with_text, without, scale)

    return velocity

  return of
