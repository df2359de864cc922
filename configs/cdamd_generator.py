"""CDAMD's masked transformer with its diffusion MLP, on latents of a trained autoencoder, with codes as a prior.

  python launch.py --config configs/cdamd_generator.py --workdir runs/generator --config.data.folder=HumanML3D \
      --config.frozen.tokenizer=runs/autoencoder --config.frozen.prior=runs/rvq --config.frozen.text=CLIP-FOLDER
  ... --config configs/cdamd_generator.py:kit         21 joints, millimetres
  ... --config configs/cdamd_generator.py:large       8 layers of width 1024, the paper's size as far as it can exist
  ... --config configs/cdamd_generator.py:263         full features instead of coordinates (Table V); 67: essential ones
  ... --config configs/cdamd_generator.py:mardm       the baseline: MARDM-SiT-XL; mardm_ddpm: MARDM-DDPM-XL
  ... --config configs/cdamd_generator.py:small       the model for the archives: 13 M parameters
  ... --config configs/cdamd_generator.py:mini        for studies of many runs (benchmarks/study.py), minutes each
  ... --config configs/cdamd_generator.py:tiny        two steps on formulas, seconds

`full` is the released training command's size (facts: cdamd 10), 290,023,424 parameters. Ablations of the paper:

  Table I   --config.loss.prior_levels=1 (first VQ), 2 (two VQ, the default: its best FID), 4 (all VQ)
  Table IV  --config.loss.mask=dccm (the default), causal (CM), bcm
  Table V   --config.loss.prior_levels=0 (without CMP); --config.loss.mask=causal (without DCCA)

MARDM's own data are the 67 columns: --config.tokenizer.features=67 --config.data.layout=essential. On KIT its rate
falls at 20,000 steps, its guidance is 2.5. How levels are put together: --config.model.transformer.separate_levels.
"""
import ml_collections

SIZES = ("kit", "large", "67", "263", "mardm", "mardm_ddpm", "full", "small", "mini", "tiny")


def get_config(size="full"):
  if size not in SIZES:
    raise ValueError(f"got size {size!r}, expected {', '.join(SIZES[:-4])}, full, small, mini or tiny")
  config = ml_collections.ConfigDict()
  config.stage = "cdamd.generator"
  config.seed = 3407
  config.frozen = dict(tokenizer="runs/autoencoder", prior="runs/rvq", text="clip-vit-base-patch32",
                       text_level="sentence", length="")
  config.tokenizer = dict(features=66, latent_dim=512, width=512, num_halvings=2, dilations=(9, 3, 1), dropout=0.2,
                          hide_padding=False)
  config.prior = dict(features=66, latent_dim=512, width=512, num_halvings=2, dilations=(9, 3, 1), dropout=0.2,
                      hide_padding=False)
  config.quantizer = dict(num_levels=4, num_codes=512)
  config.model = dict(
      transformer=dict(kind="cdamd", latent_dim=512, width=512, depth=4, num_heads=8, ff_width=1024, text_dim=512,
                       text_scale=1.0, num_codes=1027, num_levels=4, separate_levels=False, max_length=200,
                       dropout=0.2),
      head=dict(width=1792, depth=16))
  # hide_padding: clips end where they end, to the autoencoders; not so in the released code.
  # frozen.text_level "words" puts the words of a caption behind its sentence vector, data.max_words of them.
  # copies: rows at the diffusion head for each masked latent. prior_drop: "batch", one draw for all, or "item". mask:
  # one of nets.masks, or several, of which each item draws one: "dccm+bcm".
  config.loss = dict(mask="dccm", noise_rate=0.1, mask_rate=0.88, drop_rate=0.1, prior_levels=2, prior_drop_rate=0.7,
                     prior_drop="batch", copies=4, diffusion="flow", ddpm_steps=50, unit_latents=False)
  config.data = dict(name="humanml3d", folder="", folders=(), layout="coordinates", mode="benchmark", mirror=False,
                     per_axis=False, batch_size=64, min_frames=40, max_frames=196, lengths=(196,), balance=0.0,
                     vary_subject=0.0, max_words=77)
  # ema_decay 0 is the released code's of CDAMD; MARDM's is 0.9999.
  config.optimizer = dict(learning_rate=2e-4, schedule="cosine", final_rate=1e-6, boundaries=(), gamma=0.1,
                          cooldown_steps=0, warmup_steps=2_000, beta1=0.9, beta2=0.99, weight_decay=1e-5, clip_norm=0.0,
                          ema_decay=0.9999, skip_loss=0.0)
  config.train = dict(num_steps=180_000, log_every=100, save_every=5_000)
  # The benchmark's own: solver dopri5, revealed_only False.
  config.sampler = dict(num_rounds=10, guidance_scale=4.0, order="random", mask="causal", edit_mask="bcm",
                        solver="midpoint", num_steps=10, revealed_only=True)
  if size == "kit":
    config.tokenizer.features = config.prior.features = 63
    config.data.update(layout="coordinates_kit", batch_size=16, min_frames=24)
    config.sampler.guidance_scale = 2.0
  elif size == "large":
    config.model.transformer.update(width=1024, depth=8, ff_width=4096, dropout=0.1)
  elif size in ("67", "263"):
    config.tokenizer.features = config.prior.features = int(size)
    config.data.layout = "essential" if size == "67" else "full"
  elif size in ("mardm", "mardm_ddpm"):
    config.frozen.prior = ""
    config.model.transformer = dict(kind="mardm", latent_dim=512, width=1024, depth=1, num_heads=16, ff_width=4096,
                                    text_dim=512, text_scale=1.0, dropout=0.2)
    config.loss.update(mask="bidirectional", prior_levels=0, diffusion="ddpm" if size == "mardm_ddpm" else "flow")
    config.optimizer.update(schedule="step", boundaries=(50_000,))
    config.sampler.update(num_rounds=18, guidance_scale=4.5, mask="bidirectional", edit_mask="bidirectional")
    if size == "mardm_ddpm":
      config.sampler.update(solver="ddpm", num_steps=50)
  elif size in ("small", "mini"):
    config.frozen.text = "words"
    config.tokenizer.update(latent_dim=64, width=192, dropout=0.0, hide_padding=True)
    config.prior.update(latent_dim=64, width=128, dropout=0.0, hide_padding=True)
    config.quantizer.num_codes = 256
    config.model.transformer.update(latent_dim=64, width=256, depth=3, num_heads=4, ff_width=512, text_dim=384,
                                    text_scale=20.0, num_codes=256, max_length=50, dropout=0.0)
    config.model.head.update(width=400, depth=6)
    # Both masks, so that one model can be asked by either: a hole sees its right side under BCM alone.
    config.loss.update(mask="dccm+bcm", unit_latents=True, copies=1)
    config.data.update(name="archive", mode="corrected", mirror=True, batch_size=32, min_frames=20,
                       lengths=(72, 120, 196), balance=0.5, vary_subject=0.5)
    config.optimizer.update(learning_rate=7e-4, schedule="trapezoid", warmup_steps=300, cooldown_steps=900,
                            ema_decay=0.999, clip_norm=1.0)
    config.train.update(num_steps=3_000, log_every=25, save_every=300)
    # Measured on it (benchmarks/cdamd_choices.py): see the card of pretrained/cdamd-small.
    config.sampler.update(order="left_to_right", guidance_scale=3.0)
    if size == "mini":
      config.tokenizer.update(width=128)
      config.prior.update(width=96)
      config.model.transformer.update(width=128, depth=2, ff_width=256)
      config.model.head.update(width=224, depth=4)
      config.sampler.update(order="random")  # as the paper
      config.optimizer.update(learning_rate=1e-3, warmup_steps=50, cooldown_steps=300, ema_decay=0.99)
      config.train.update(num_steps=900, save_every=450)
  elif size == "tiny":
    config.frozen.update(tokenizer="fresh", prior="fresh", text="fresh")  # random weights: nothing to download
    config.tokenizer.update(latent_dim=4, width=16, dilations=(1,))
    config.prior.update(latent_dim=4, width=16, dilations=(1,))
    config.quantizer.num_codes = 8
    config.model.transformer.update(latent_dim=4, width=16, depth=1, num_heads=2, ff_width=16, text_dim=32, num_codes=8,
                                    max_length=50)
    config.model.head.update(width=16, depth=1)
    config.data.update(name="synthetic", mode="corrected", batch_size=4)
    config.optimizer.update(warmup_steps=1, schedule="constant")
    config.train.update(num_steps=2, log_every=1, save_every=2)
  return config.lock()
