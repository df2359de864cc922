"""cdamd-small, the text-to-motion model that also edits: autoencoder, decoder, length estimator, generator, one pass
each.

  motion-jax train --config shipped/cdamd_small --workdir runs/cdamd-small --config.archives=FOLDER_OF_THE_ARCHIVES
  python tools/export_model.py runs/cdamd-small/generator runs/cdamd-small-exported

The text encoder is that of cmdm-small. The generator learns without the codes of an RVQ-VAE, as the last 8,000 steps of
the model before did; whether they would help was not measured. Times and measurements: docs/lab/cdamd-small.md,
motion_jax/pretrained/cdamd-small/README.md.

It has made no shipped model yet: the weights that ship came from the recipe of commit 39e51fd and a last pass of the
decoder (motion_jax/pretrained/cdamd-small/README.md).
"""
from motion_jax.configs.shipped import recipe


def get_config(size="small"):
  data = recipe.NON_COMMERCIAL
  windows = {"batch_size": 128, "short_window": 24}
  return recipe.get_config([
      recipe.train("autoencoder", "cdamd_autoencoder:steps_small", data, 4,
                   data=recipe.DATA | windows | {"balance": 0.3}, loss={"position_weight": 0.3},
                   train=recipe.steps(20_000), optimizer=recipe.rates(1.2e-3, 3_000)),
      recipe.train("decoder", "cdamd_autoencoder:steps_small", data, 4,
                   data=recipe.DATA | windows | {"balance": 0.5},
                   train=recipe.steps(20_000, start="{autoencoder}", freeze=("encoder",)),
                   loss={"position_weight": 0.3, "latent_noise": 0.15, "acceleration": 0.0005,
                         "extremity_velocity": 0.4, "foot_contact": 6.0, "brief_contact": 2.0, "bone_length": 1.0,
                         "dynamics": 0.1, "limb_direction": 0.3}, optimizer=recipe.rates(8e-4, 8_000, warmup=50)),
      recipe.train("length", "cdamd_length:small", data, frozen={"text": "cmdm-small"},
                   data=recipe.CAPTIONED, train=recipe.steps(2_000)),
      recipe.train("generator", "cdamd_generator:steps_small", data, 10,
                   frozen={"tokenizer": "{decoder}", "prior": "", "length": "{length}", "text": "cmdm-small"},
                   data=recipe.CAPTIONED | {"balance": 0.35, "batch_size": 128, "lengths": (196,)},
                   loss=recipe.CONTRAST | {"prior_levels": 0},
                   train=recipe.steps(20_000), optimizer=recipe.rates(1e-3, 3_000), cleanup=recipe.UNSMOOTHED),
  ], size)
