"""cmdm-small, the text-to-motion model that ships: four passes with a teacher, captions and clips that grow, eleven of
its decoder, two of its adapters for constraints.

  motion-jax train --config shipped/cmdm_small --workdir runs/cmdm-small
  python tools/export_model.py runs/cmdm-small/adapters runs/cmdm-small-exported

The teacher is `part-tmr-small` (shipped/part_tmr_small.py). Times and measurements of each pass:
docs/lab/cmdm-small.md, motion_jax/pretrained/cmdm-small/README.md.

What cannot be recovered, so that this recipe makes a model like the shipped one and not its bytes:
- The text encoder of den1, den3 and den5 was trained between the passes (docs/lab/words.md),
  with captions and pairs of sentences that are not recorded; here it is the shipped one from den1 on.
- Two runs between den3 and den5, of 1,500 and 1,250 steps with constraints at the network's beginning, were given up.
- Decoder passes and adapters began from the model that shipped at the time, in float16; here from the runs themselves.
- `sampler.side_guidance` 1 was set in the exported config by hand.
"""
from motion_jax.configs.shipped import recipe

TWO, THREE = ("cmu", "bandai"), ("cmu", "cmu2", "bandai")
NO_TEACHER = dict(frozen={"teacher": ""}, model={"teacher_dim": 0})
ENCODER = ("encoder",)


def denoiser(name, start, tokenizer, text, num_steps, rate, cooldown, warmup, augment, **data):
  """A further pass of the denoiser, on captions by kinematics and clips made of others."""
  return recipe.train(
      name, "cmdm_denoiser:small", THREE, train={"start": start, "num_steps": num_steps},
      frozen={"tokenizer": tokenizer, "text": text},
      data={"kinematic_captions": True, **{f"augment.{kind}": share for kind, share in augment.items()}, **data},
      optimizer={"learning_rate": rate, "cooldown_steps": cooldown, "warmup_steps": warmup, "ema_decay": 0.998},
      sampler={"num_steps": 20, "guidance_scale": 2.0})


def decoder(name, start, num_steps, cooldown, rate, loss, ema_decay=0.997, balance=0.5, seed=None, **data):
  """A further pass of the decoder; the encoder is frozen, so that the latents stay what they are."""
  acceleration, extremity_velocity, foot_contact, *more = loss
  names = dict(zip(("brief_contact", "bone_length"), more))
  return recipe.train(
      name, "cmdm_tokenizer:small", THREE, **NO_TEACHER,
      train={"start": start, "freeze": ENCODER, "num_steps": num_steps},
      loss={"kl_ramp": 0, "acceleration": acceleration, "extremity_velocity": extremity_velocity,
            "foot_contact": foot_contact, **names},
      data={"balance": balance, "batch_size": 64} | (data or {"short_window": 24}),
      optimizer={"learning_rate": rate, "cooldown_steps": cooldown, "warmup_steps": 50, "ema_decay": ema_decay},
      **({} if seed is None else {"seed": seed}))


def adapters(name, start, cooldown, augment, depth):
  """The adapters for constraints alone: all else is frozen, so that motions without constraints stay the same."""
  frozen = ("x_in", "text_in", "time_in", "time_out", "out", *(f"block{i}" for i in range(depth)))
  return recipe.train(
      name, "cmdm_denoiser:small", TWO, train={"start": start, "freeze": frozen, "num_steps": 2_400},
      frozen={"tokenizer": "{new}", "text": "cmdm-small"},
      data={"kinematic_captions": True, "control": 1.0} | {f"augment.{kind}": n for kind, n in augment.items()},
      loss={"control": 10.0, "decoded_from": 0.0, "pyramid_levels": 1.0, "drop_rate": 0.5},
      optimizer={"learning_rate": 1e-3, "cooldown_steps": cooldown, "warmup_steps": 50, "ema_decay": 0.99},
      sampler={"num_steps": 20, "guidance_scale": 2.0})


def get_config(size="small"):
  depth = 1 if size == "tiny" else 6
  joined = dict(stitched=0.5, bent_paths=0.2, idle=0.15)
  return recipe.get_config([
      recipe.train("tok0", "cmdm_tokenizer:small", TWO, **NO_TEACHER),
      recipe.train("den0", "cmdm_denoiser:small", TWO, frozen={"tokenizer": "{tok0}"}),
      recipe.train("tok", "cmdm_tokenizer:small", TWO, frozen={"teacher": "part-tmr-small"},
                   train={"start": "{tok0}", "num_steps": 2_500}, loss={"kl_ramp": 0},
                   optimizer={"learning_rate": 3e-4, "cooldown_steps": 1_200, "warmup_steps": 100}),
      recipe.train("den", "cmdm_denoiser:small", TWO, frozen={"tokenizer": "{tok}"},
                   train={"start": "{den0}", "num_steps": 1_600},
                   optimizer={"learning_rate": 4e-4, "cooldown_steps": 900, "warmup_steps": 100, "ema_decay": 0.998}),
      denoiser("den1", "{den}", "{tok}", "cmdm-small", 2_400, 4e-4, 1_200, 100, joined),
      denoiser("den3", "{den1}", "{tok}", "cmdm-small", 1_600, 3e-4, 900, 50,
               joined | dict(counted=0.25, time_warp=0.15, excerpts=0.4), per_segment_captions=0.5),
      denoiser("den5", "{den3}", "{den3}", "cmdm-small", 3_600, 3.5e-4, 2_000, 100,
               joined | dict(counted=0.3, time_warp=0.15, excerpts=0.5, seats=0.15), per_segment_captions=0.5),
      # loss: acceleration, extremity_velocity, foot_contact, brief_contact, bone_length
      decoder("dec1", "{den5}", 1_400, 900, 3e-4, (0.05, 1.0, 0.5), 0.995, window=24),
      decoder("dec2", "{dec1}", 2_000, 1_300, 4e-4, (0.015, 0.5, 0.4), 0.995),
      decoder("dec3", "{dec2}", 2_500, 1_700, 5e-4, (0.004, 0.2, 0.3), 0.995),
      decoder("dec4", "{dec3}", 5_000, 3_500, 6e-4, (0.004, 0.2, 0.3)),
      decoder("dec5", "{dec4}", 3_000, 2_200, 6e-4, (0.004, 0.2, 0.2, 0.2)),
      decoder("dec6", "{dec5}", 4_000, 3_000, 7e-4, (0.004, 0.2, 0.2, 0.3)),
      decoder("dec7", "{dec6}", 4_000, 3_000, 7e-4, (0.004, 0.2, 0.2, 0.3, 0.3)),
      decoder("dec8", "{dec7}", 4_000, 3_400, 7e-4, (0.004, 0.2, 0.2, 0.3, 0.04)),
      decoder("dec9", "{dec8}", 4_000, 3_000, 7e-4, (0.003, 0.6, 0.3, 0.3, 0.04), balance=0.7, seed=12),
      decoder("dec10", "{dec9}", 4_000, 3_400, 7e-4, (0.003, 0.35, 0.2, 0.3, 0.04), balance=0.4, seed=14),
      decoder("dec11", "{dec10}", 3_000, 2_500, 6e-4, (0.002, 0.8, 0.25, 0.3, 0.04), balance=0.55, seed=15),
      recipe.combine("new", "exchange_decoder", "{den5}", "{dec11}"),
      adapters("adapters0", "{new}", 1_300, dict(wandering=1.0), depth),
      adapters("adapters", "{adapters0}", 1_500, dict(wandering=1.5, stitched=0.25, idle=0.2, time_warp=0.2), depth),
  ], size)
