"""A student of a trained denoiser, which samples in fewer steps and without a second pass for guidance.

  motion-jax train --config cmdm_student:32_small --workdir runs/s32 --data ARCHIVES --config.distill.teacher=cmdm-small
  motion-jax train --config cmdm_student:16_small --workdir runs/s16 ... --config.distill.teacher=runs/s32
  motion-jax train --config cmdm_student:8_small --workdir runs/s8 ... --config.distill.teacher=runs/s16

32 folds guidance into one pass at 32 steps, four of them between blocks; 16 and 8 halve both. Sizes are those of
`cmdm_denoiser`: full, small, tiny; without a number in front it is 8. The network, its words and its latents are the
teacher's, and so are the parameters to begin with. What comes out is a run of `cmdm_denoiser`.

Expected: not run to its end yet.
"""
from motion_jax import paper_rows
from motion_jax.configs import cmdm_denoiser, common

STEPS = {"32": (32, 4), "16": (16, 2), "8": (8, 1)}  # steps, and how many lie between blocks


def get_config(size="full"):
  steps, size = common.data_and_size(size, STEPS, ("full", "small", "tiny"))
  num_steps, lag = STEPS[steps or "8"]
  config = cmdm_denoiser.get_config(size).unlock()
  # teacher: a denoiser's run, a name that ships, or "random-init" to try things out. A step is what teacher_steps of it
  # give, guided by guidance_scale; forcing_share of the loss stays that of diffusion forcing.
  folds = steps == "32"
  config.distill = dict(teacher="random-init" if size == "tiny" else "", num_steps=num_steps, lag=lag,
                        teacher_steps=1 if folds else 2, guidance_scale=2.0 if folds else 1.0, forcing_share=0.25)
  config.sampler.update(num_steps=num_steps, lag=lag, guidance_scale=1.0)
  if size != "tiny":
    config.optimizer.update(learning_rate=1e-4, schedule="cosine", warmup_steps=50, final_rate=2e-5, ema_decay=0.995)
    config.train.update(num_steps=800, log_every=20, save_every=200)
  return paper_rows.named(config, {}).lock()
