"""A student of a trained denoiser, which samples in fewer steps and without a second pass for guidance.

  motion-jax train --config cmdm_student:8_small --workdir runs/fast --data ARCHIVES --config.distill.teacher=cmdm-small

8, without a number in front too, learns to go in one step where its teacher goes in two guided ones of 16: 17 passes of
the network for 6 seconds instead of the 76 of 20 guided steps. 16 only folds guidance in, 4 goes in one step where the
teacher goes in four. Sizes are those of `cmdm_denoiser`: full, small, tiny. The network, its words and its latents are
the teacher's, and so are the parameters to begin with. What comes out is a run of `cmdm_denoiser`.

Times and measurements of the one that ships: pretrained/cmdm-small-fast/README.md. The others were not run.
"""
from motion_jax import paper_tables
from motion_jax.configs import cmdm_denoiser, common

# Steps of the student: how many lie between blocks, and how many of its teacher's are one.
STEPS = {"16": (2, 1), "8": (1, 2), "4": (1, 4)}


def get_config(size="full"):
  steps, size = common.data_and_size(size, STEPS, ("full", "small", "tiny"))
  num_steps = int(steps or 8)
  lag, teacher_steps = STEPS[str(num_steps)]
  config = cmdm_denoiser.get_config(size).unlock()
  # teacher: a denoiser's run, a name that ships, or "random-init" to try things out. A step is what teacher_steps of it
  # give, guided by guidance_scale (1 for a teacher that is a student itself). forcing_share of the loss is that of
  # diffusion forcing, which is not guided, and so pulls against what is folded in.
  config.distill = dict(teacher="random-init" if size == "tiny" else "", num_steps=num_steps, lag=lag,
                        teacher_steps=teacher_steps, guidance_scale=2.0, forcing_share=0.0)
  config.sampler.update(num_steps=num_steps, lag=lag, guidance_scale=1.0)
  if size != "tiny":
    config.optimizer.update(learning_rate=2e-4, schedule="cosine", warmup_steps=50, final_rate=2e-5, ema_decay=0.995)
    config.train.update(num_steps=1_600, num_epochs=0, log_every=20, save_every=200)
  return paper_tables.with_rows(config, {}).lock()
