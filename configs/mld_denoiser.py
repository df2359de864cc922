"""MLD's denoiser of the token of a trained VAE.

  motion-jax train --config mld_denoiser --workdir runs/mld --data HumanML3D --config.frozen.tokenizer=runs/mld_vae \
      --config.frozen.text=CLIP-LARGE-FOLDER
  ... --config mld_denoiser:kit             KIT's 251 numbers; 67: HumanML3D's first 67
  ... --config mld_denoiser:v2              on MotionLCM's latents (docs/papers/mld.md#v2)
  ... --config mld_denoiser:small           on archives; laptop: fewer steps; tiny: two steps on procedural motion

How sizes are written: docs/configs.md; as in kit_tiny with a size behind. `full` is the released code's configuration
(docs/papers/mld.md#denoiser, #training): 8.3 M parameters, 2,000 epochs of batches of 64.

Expected: none of these sizes but `tiny` has been run.
"""
from motion_jax import paper_tables
from motion_jax.configs import common, mld_vae

SIZES, DATA, KINDS = mld_vae.SIZES, mld_vae.DATA, mld_vae.KINDS
PRINTED = {"": {"cmdm 6": "MLD", "authors humanml3d": "MLD"}, "67": {"cmdm 6": "MLD"}, "v2": {"cmdm 1": "MLD V2"}}


def get_config(name="full"):
  size, data, kind = common.words_of(name, SIZES, DATA, KINDS)
  config = common.experiment("mld.denoiser", seed=1234)
  config.frozen = dict(tokenizer="runs/mld_vae", text="clip-vit-large-patch14", text_level="sentence")
  vae = mld_vae.get_config(name)
  config.tokenizer = vae.model.to_dict()
  config.model = dict(width=256, depth=9, num_heads=4, mlp_width=1024, text_dim=768, num_steps=1_000, dropout=0.1,
                      latent_width=config.tokenizer.latent_width)
  # predicts: the noise, or the clean latent, x1.
  config.diffusion = dict(num_steps=1_000, predicts="noise")
  config.loss = dict(drop_rate=0.1)
  config.data = vae.data.to_dict() | dict(batch_size=64, max_words=64, vary_subject=0.0)
  config.optimizer = common.optimizer(learning_rate=1e-4, weight_decay=0.01)
  config.train = common.epochs(2_000, log_every=100, num_saves=20, sample_every=20_000)
  config.sampler = dict(guidance_scale=7.5, num_steps=50, solver="ddim")
  if size in ("small", "laptop"):
    config.frozen.text = "words"
    config.model.update(width=128, depth=5, mlp_width=384, text_dim=384)
    common.archives(config, batch_size=32, vary_subject=0.5, max_words=24)
    config.optimizer.update(learning_rate=5e-4, schedule="wsd", warmup_steps=100, cooldown_steps=1_000, clip_norm=1.0,
                            ema_decay=0.995)
    config.train.update(num_steps=4_000 if size == "laptop" else 12_000, log_every=20, save_every=500,
                        sample_every=2_000)
  elif size == "tiny":
    config.frozen.update(tokenizer="random-init", text="random-init")  # nothing to download
    config.model.update(width=16, depth=3, num_heads=2, mlp_width=16, text_dim=32, num_steps=8)
    config.diffusion.num_steps, config.sampler.num_steps = 8, 4
    common.tiny(config)
  # What is known of V2 are numbers of its configuration, so it is not the printed model.
  rows = PRINTED.get(f"{kind} {data}".strip(), {})
  return paper_tables.with_rows(config, rows, exact=size == "full" and not kind).lock()
