"""A trained denoiser that learns from its own samples, which were scored: one round of DiffusionNFT.

  motion-jax data compose scored --model runs/denoiser --group 16 --number 96 --seed 1 --apart EVALUATION_SENTENCES
  motion-jax train --config cmdm_scored:small --workdir runs/round1 --data scored \\
      --config.train.start=runs/denoiser --config.scored.sampler=runs/denoiser \\
      --config.scored.reference=runs/denoiser --config.frozen.tokenizer=runs/denoiser

The next round samples from runs/round1 and keeps the reference. The reward is the share of a prompt's requirements that
hold, 0 for motion with unsound bones or feet (`data compose`). Source: arXiv 2509.16117; beta 1 as in its runs on
GenEval. Has not been run to a result.
"""
from motion_jax import paper_tables
from motion_jax.configs import cmdm_denoiser, common


def get_config(size="full"):
  _, size = common.data_and_size(size, {}, ("full", "small", "tiny"))
  config = cmdm_denoiser.get_config(size).unlock()
  start = "random-init" if size == "tiny" else ""
  # sampler: the run that made the samples; reference: the run from which the first round started.
  config.scored = dict(sampler=start, reference=start, beta=1.0, pull=1e-4)
  config.data.update(mirror=False, kinematic_captions=False, paraphrases=0, balance=0.0)
  config.loss.update(drop_rate=0.0, contrast=0.0, pyramid_levels=0.0)
  if size != "tiny":
    config.optimizer.update(learning_rate=1e-4, schedule="wsd", warmup_steps=10, cooldown_steps=20, ema_decay=0.9)
    config.train.update(num_steps=72, num_epochs=0, log_every=10, save_every=72, sample_every=0)
  return paper_tables.with_rows(config, {}).lock()
