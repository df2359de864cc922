"""cdamd-small, the text-to-motion model that also edits: autoencoder, RVQ-VAE, length estimator, four passes of the
generator, four of the decoder.

  motion-jax train --config shipped/cdamd_small --workdir runs/cdamd-small
  python tools/export_model.py runs/cdamd-small/new runs/cdamd-small-exported

The text encoder is that of cmdm-small. Times and measurements: docs/lab/cdamd-small.md,
motion_jax/pretrained/cdamd-small/README.md. What cannot be recovered: generator4 and decoder3 began from the model that
shipped then, in float16, here from the runs themselves.
"""
from motion_jax.configs.shipped import recipe

ARCHIVES = ("cmu", "cmu2", "bandai")


def autoencoder(name, num_steps, cooldown, loss, balance=0.3, rate=None, start="", freeze=(), seed=None, **data):
  """A pass of the autoencoder, or with a frozen encoder of its decoder. loss: latent_noise, acceleration,
  extremity_velocity, foot_contact, brief_contact, bone_length."""
  names = ("latent_noise", "acceleration", "extremity_velocity", "foot_contact", "brief_contact", "bone_length")
  rates = {} if rate is None else {"learning_rate": rate, "warmup_steps": 50}
  return recipe.train(
      name, "cdamd_autoencoder:steps_small", ARCHIVES, loss={"position_weight": 0.3} | dict(zip(names, loss)),
      data={"short_window": 24, "balance": balance} | data,
      train={"num_steps": num_steps, "start": start, "freeze": freeze},
      optimizer={"cooldown_steps": cooldown, "ema_decay": 0.998} | rates, **({} if seed is None else {"seed": seed}))


def generator(name, num_steps, cooldown, augment, start="", tokenizer="{autoencoder}", prior="{rvq}", length="{length}",
              balance=None, loss=None, seed=None):
  """A pass of the generator on captions by kinematics and clips made of others."""
  further = {"learning_rate": 5e-4, "warmup_steps": 100} if start else {}
  data = {"kinematic_captions": True} | {f"augment.{kind}": share for kind, share in augment.items()}
  return recipe.train(
      name, "cdamd_generator:steps_small", ARCHIVES,
      frozen={"tokenizer": tokenizer, "prior": prior, "length": length, "text": "cmdm-small"},
      data=data | ({} if balance is None else {"balance": balance}), loss=loss or {},
      train={"num_steps": num_steps, "start": start},
      optimizer={"cooldown_steps": cooldown, "ema_decay": 0.998} | further, **({} if seed is None else {"seed": seed}))


def get_config(size="small"):
  encoder = ("encoder",)
  of_length = dict(counted=0.3, excerpts=0.3, seats=0.15, bent_paths=0.2)
  first = dict(stitched=0.25, bent_paths=0.2, idle=0.2, counted=0.3, time_warp=0.2, excerpts=0.5, seats=0.15)
  second = dict(stitched=0.15, bent_paths=0.1, idle=0.15, counted=0.3, time_warp=0.1, excerpts=0.5, seats=0.1)
  third = dict(stitched=0.15, bent_paths=0.05, idle=0.1, counted=0.2, time_warp=0.1, excerpts=0.3, seats=0.1)
  fourth = dict(stitched=0.1, bent_paths=0.1, idle=0.07, counted=0.25, time_warp=0.05, excerpts=0.25, seats=0.08)
  return recipe.get_config([
      autoencoder("autoencoder0", 4_500, 1_200, ()),
      autoencoder("autoencoder", 2_500, 1_500, (0.1, 0.004, 0.15, 1.0), rate=6e-4, start="{autoencoder0}"),
      recipe.train("rvq", "cdamd_rvq:steps_small", ARCHIVES, data={"short_window": 24, "balance": 0.3},
                   loss={"position_weight": 0.1}, train={"num_steps": 2_500}),
      recipe.train("length", "cdamd_length:small", ARCHIVES, frozen={"text": "cmdm-small"},
                   data={"kinematic_captions": True} | {f"augment.{kind}": n for kind, n in of_length.items()}),
      generator("generator", 5_000, 2_000, first),
      generator("generator2", 3_000, 1_800, second, start="{generator}", balance=0.6),
      generator("generator3", 5_000, 3_000, third, start="{generator2}", balance=0.4, seed=77),
      autoencoder("decoder", 3_000, 2_000, (0.35, 0.004, 0.15, 4.0), rate=6e-4, start="{autoencoder}", freeze=encoder),
      autoencoder("decoder2", 5_000, 3_500, (0.2, 0.001, 0.15, 4.0, 1.0), balance=0.4, rate=8e-4, start="{decoder}",
                  freeze=encoder, batch_size=64),
      recipe.combine("first", "exchange_decoder", "{generator3}", "{decoder2}"),
      generator("generator4", 8_000, 4_500, fourth, start="{first}", tokenizer="{first}", prior="", length="{first}",
                balance=0.25, loss={"prior_levels": 0}, seed=78),
      autoencoder("decoder3", 5_000, 3_500, (0.1, 0.0005, 0.5, 4.0, 1.0, 1.0), balance=0.7, rate=8e-4, start="{first}",
                  freeze=encoder, seed=11, batch_size=64),
      autoencoder("decoder4", 4_000, 3_200, (0.25, 0.001, 0.4, 6.0, 2.0, 1.0), balance=0.5, rate=7e-4,
                  start="{decoder3}", freeze=encoder, seed=13, batch_size=64),
      recipe.combine("new", "exchange_decoder", "{generator4}", "{decoder4}"),
  ], size)
