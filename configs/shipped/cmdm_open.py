"""cmdm-open, the text-to-motion model that may be used commercially: trained from scratch on cmu, cmu2 and hdm05.

  motion-jax train --config shipped/cmdm_open --workdir runs/cmdm-open
  python tools/export_model.py runs/cmdm-open/new runs/cmdm-open-exported

Times and measurements: docs/lab/cmdm-open.md, motion_jax/pretrained/cmdm-open/README.md.

What cannot be recovered: tok0 was planned as 3,600 steps at another rate and prolonged; den2 and decoder3 began from
the model that shipped then, in float16, here from the runs themselves; `sampler.side_guidance` 1 was set in the
exported config by hand.
"""
from motion_jax.configs.shipped import recipe

ARCHIVES = ("cmu", "cmu2", "hdm05")
NO_TEACHER = dict(frozen={"teacher": ""}, model={"teacher_dim": 0})


def decoder(name, start, num_steps, cooldown, rate, ema_decay, loss, warmup=50, balance=0.5, seed=None, **data):
  """A pass of the decoder; the encoder is frozen, so that the latents stay what they are."""
  names = ("acceleration", "extremity_velocity", "foot_contact", "brief_contact", "bone_length")
  return recipe.train(
      name, "cmdm_tokenizer:small", ARCHIVES, **NO_TEACHER,
      train={"start": start, "freeze": ("encoder",), "num_steps": num_steps},
      loss={"kl_ramp": 0} | dict(zip(names, loss)), data={"balance": balance} | data,
      optimizer={"learning_rate": rate, "cooldown_steps": cooldown, "ema_decay": ema_decay} | (
          {} if warmup is None else {"warmup_steps": warmup}),
      **({} if seed is None else {"seed": seed}))


def denoiser(name, num_steps, rate, cooldown, warmup, bent_paths, start="", tokenizer="{tok}"):
  """A pass of the denoiser on captions by kinematics and clips made of others."""
  augment = dict(stitched=0.4, bent_paths=bent_paths, idle=0.2, counted=0.3, time_warp=0.3, excerpts=0.5, seats=0.15)
  return recipe.train(
      name, "cmdm_denoiser:small", ARCHIVES, frozen={"tokenizer": tokenizer, "text": "cmdm-small"},
      data={"kinematic_captions": True, "per_segment_captions": 0.5} | {f"augment.{k}": n for k, n in augment.items()},
      train={"num_steps": num_steps, "start": start},
      optimizer={"learning_rate": rate, "cooldown_steps": cooldown, "warmup_steps": warmup, "ema_decay": 0.998},
      sampler={"num_steps": 20, "guidance_scale": 2.0})


def get_config(size="small"):
  short = dict(short_window=24, batch_size=64)
  return recipe.get_config([
      recipe.train("tok0", "cmdm_tokenizer:small", ARCHIVES, **NO_TEACHER, data={"balance": 0.5},
                   train={"num_steps": 9_500},
                   optimizer={"ema_decay": 0.998, "learning_rate": 6e-4, "cooldown_steps": 3_000}),
      decoder("tok", "{tok0}", 1_000, 700, 3e-4, 0.995, (0.15, 2.0, 0.5), warmup=None),
      denoiser("den", 4_000, 5e-4, 2_000, 300, bent_paths=0.2),
      decoder("decoder", "{tok}", 2_000, 1_300, 4e-4, 0.995, (0.03, 1.0, 0.5), **short),
      decoder("decoder2", "{decoder}", 5_000, 4_000, 7e-4, 0.997, (0.004, 0.2, 0.2, 0.3, 0.1), **short),
      recipe.combine("open", "exchange_decoder", "{den}", "{decoder2}"),
      denoiser("den2", 2_400, 4e-4, 1_600, 50, bent_paths=0.6, start="{open}", tokenizer="{open}"),
      recipe.combine("mean", "average", "{open}", "{den2}"),
      decoder("decoder3", "{open}", 3_000, 2_500, 6e-4, 0.997, (0.003, 0.6, 0.25, 0.3, 0.05), balance=0.6, seed=15,
              **short),
      recipe.combine("new", "exchange_decoder", "{mean}", "{decoder3}"),
  ], size)
