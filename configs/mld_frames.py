"""MLD without a VAE: a denoiser of frames, the released code's comparison.

  motion-jax train --config mld_frames --workdir runs/mld_frames --data HumanML3D --config.frozen.text=CLIP-LARGE-FOLDER
  ... --config mld_frames:kit               KIT's 251 numbers; 67: HumanML3D's first 67
  ... --config mld_frames:small             on archives; laptop: fewer steps; tiny: two steps on procedural motion

How sizes are written: docs/configs.md; as in kit_tiny with a size behind. `full` is the released code's configuration
(docs/papers/mld.md#without-a-vae): 2,000 epochs of batches of 64, sampled in all 1,000 steps.

Expected: none of these sizes but `tiny` has been run.
"""
from motion_jax.configs import common, mld_vae

SIZES, DATA = mld_vae.SIZES, mld_vae.DATA


def get_config(name="full"):
  size, data, _ = common.words_of(name, SIZES, DATA, ())
  config = common.experiment("mld.frames", seed=1234)
  config.frozen = dict(text="clip-vit-large-patch14", text_level="sentence")
  vae = mld_vae.get_config(name)
  config.model = dict(features=vae.model.features, width=512, depth=9, num_heads=4, mlp_width=1024, text_dim=768,
                      num_steps=1_000, dropout=0.1)
  config.diffusion = dict(num_steps=1_000, predicts="noise")
  # mask_frames: whether frames attend to no padding, as they do while a motion is sampled.
  config.loss = dict(drop_rate=0.1, mask_frames=False)
  config.data = vae.data.to_dict() | dict(batch_size=64, max_words=64, vary_subject=0.0)
  config.optimizer = common.optimizer(learning_rate=1e-4, weight_decay=0.01)
  config.train = common.epochs(2_000, log_every=100, num_saves=20, sample_every=20_000)
  config.sampler = dict(guidance_scale=7.5, num_steps=1_000, solver="ancestral")
  if size in ("small", "laptop"):
    config.frozen.text, config.loss.mask_frames = "words", True
    config.model.update(width=192, depth=4, mlp_width=512, text_dim=384)
    config.diffusion.num_steps = config.model.num_steps = 100
    config.sampler.update(num_steps=50, solver="ancestral")
    common.archives(config, batch_size=32, vary_subject=0.5, max_words=24)
    config.optimizer.update(learning_rate=5e-4, schedule="wsd", warmup_steps=100, cooldown_steps=1_000, clip_norm=1.0,
                            ema_decay=0.995)
    config.train.update(num_steps=4_000 if size == "laptop" else 12_000, log_every=20, save_every=500,
                        sample_every=2_000)
  elif size == "tiny":
    config.frozen.text = "random-init"
    config.model.update(width=16, depth=2, num_heads=2, mlp_width=16, text_dim=32, num_steps=8)
    config.diffusion.num_steps, config.sampler.num_steps = 8, 8
    common.tiny(config)
  return config.lock()
