"""CDAMD's masked transformer with its diffusion MLP, on latents of a trained autoencoder, with codes as a prior.

  motion-jax train --config cdamd_generator --workdir runs/generator --data HumanML3D --config.frozen.text=CLIP-FOLDER \
      --config.frozen.tokenizer=runs/autoencoder --config.frozen.prior=runs/rvq
  ... --config cdamd_generator:small        the size that ships, on archives, 9.3 M parameters; also laptop, mini, tiny
  ... --config cdamd_generator:large        8 layers of width 1024, the paper's size as far as it can exist
  ... --config cdamd_generator:263          full features instead of coordinates (Table V); 67: essential ones; kit:
                                            KIT's 21 joints, in millimetres; steps: coordinates whose pelvis goes by
                                            steps
  ... --config cdamd_generator:mardm        the baseline on coordinates, MARDM-SiT-XL; mardm_ddpm: DDPM-XL
  ... --config cdamd_generator:mardm_67     MARDM on its own 67 columns, mardm_kit on KIT's 64, mardm_263 on full
                                            features and mardm_snapmogen on SnapMoGen's 296 (CMDM's Tables 1 to 3)

How sizes are written: docs/configs.md; here words are joined by "_": mardm, ddpm, one of the data (kit, 67, 263,
steps) and a size, as in mardm_ddpm_67 or kit_tiny.

`full` is the released training command's size (docs/papers/cdamd.md#sizes), 290,023,424 parameters. Ablations of the
paper, each with a name in ablations/cdamd:

  Table I   --config.loss.prior_levels=1 (first VQ), 2 (two VQ, the default: its best FID), 4 (all VQ)
  Table IV  --config.loss.mask=dccm (the default), causal (CM), bcm; sampled under the same mask, as the paper's text
            says, with --config.sampler.mask, or by an evaluation's --sampling mask=dccm
  Table V   --config.loss.prior_levels=0 (without CMP); --config.loss.mask=causal (without DCCA)

How levels are put together: --config.model.transformer.separate_levels.

Expected: `full`, `large` and MARDM at these sizes have not been run. `small`: 82 minutes of one shared core of an AMD
EPYC (pretrained/cdamd-small/README.md): R@1 0.720 +- 0.028 and FID 0.319 +- 0.042 on our own benchmark, which compares
with nothing on HumanML3D. `mini`, cut to 400 steps, and its MARDM: docs/benchmark/study_cdamd.md.
"""
from motion_jax import paper_tables
from motion_jax.configs import common

SIZES = ("large", "full", "small", "laptop", "mini", "tiny")
DATA = {"kit": (63, "coordinates_kit"), "67": (67, "essential"), "263": (263, "full"),
        "steps": (70, "steps"), "snapmogen": (296, "snapmogen")}
# MARDM has no depth to spare: its one wide layer has about the parameters of the four narrow ones with cross-attention.
MARDM = {"full": dict(width=1024, depth=1, num_heads=16, ff_width=4096),
         "small": dict(width=512, depth=1, num_heads=8, ff_width=2048),
         "mini": dict(width=256, depth=1, num_heads=4, ff_width=1024),
         "tiny": dict(width=16, depth=1, num_heads=2, ff_width=16)}
# Rows of the papers' tables, by what a name says beside its size. Those of essential features are MARDM's own.
PRINTED = {"": paper_tables.CDAMD, "kit": {"cdamd 2": "CDAMD"},
           "mardm": {"cdamd 1": "MARDM-SiT-XL", "cdamd 3": "MARDM"},
           # Parity: on which columns the baseline of CMDM's Table 1 stands is not said; the evaluator there reads 259
           # of the 263, and MARDM's own 67 are too few for it.
           "mardm_263": {"cmdm 1": "MARDM", "cmdm 3-humanml3d": "MARDM"},
           "mardm_snapmogen": {"cmdm 2": "MARDM", "cmdm 3-snapmogen": "MARDM"},
           "mardm_67": {"cmdm 6": "MARDM-SiT"}, "mardm_ddpm_67": {"cmdm 6": "MARDM-DDPM"}}


def get_config(name="full"):
  size, data, mardm, ddpm = _words_of(name)
  config = common.experiment("cdamd.generator", seed=3407)
  config.frozen = dict(tokenizer="runs/autoencoder", prior="runs/rvq", text="clip-vit-base-patch32",
                       text_level="sentence", length="")
  config.length = dict()  # fields of the length estimator; the run takes them from frozen.length
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
  config.loss = dict(mask="dccm", noise_rate=0.1, mask_rate=0.88, drop_rate=0.1, mask_draw="count",
                     prior_levels=2, prior_drop_rate=0.7, prior_drop="batch", copies=4, diffusion="flow", ddpm_steps=50,
                     unit_latents=False, **common.contrast())
  config.data = common.captioned_data(layout="coordinates", per_axis=False, batch_size=64, min_frames=40,
                                      max_frames=196, lengths=(196,), balance=0.0, vary_subject=0.0, max_words=77,
                                      store="")
  # ema_decay 0 is the released code's of CDAMD; MARDM's is 0.9999.
  config.optimizer = common.optimizer(learning_rate=2e-4, schedule="cosine", final_rate=1e-6,
                                      warmup_steps=2_000, beta2=0.99, weight_decay=1e-5, ema_decay=0.9999)
  config.train = common.epochs(500, log_every=100, num_saves=40, remat=False, attention="xla", sample_every=20_000)
  # The benchmark's own: solver dopri5, unmasked_only False. Edits are sampled under the mask of training.
  config.cleanup = common.cleanup()
  config.sampler = dict(num_iterations=10, guidance_scale=4.0, order="random", mask="causal", solver="midpoint",
                        num_steps=10, unmasked_only=True)
  if size == "large":
    config.model.transformer.update(width=1024, depth=8, ff_width=4096, dropout=0.1)
  elif size in ("small", "mini", "laptop"):
    config.frozen.text = "words"
    config.tokenizer.update(latent_dim=64, width=192, dropout=0.0, hide_padding=True)
    config.prior.update(latent_dim=64, width=128, dropout=0.0, hide_padding=True)
    config.quantizer.num_codes = 256
    config.model.transformer.update(latent_dim=64, width=256, depth=3, num_heads=4, ff_width=512, text_dim=384,
                                    text_scale=20.0, num_codes=256, max_length=50, dropout=0.0)
    config.model.head.update(width=400, depth=6)
    # Both masks, so that one model can be sampled with either: a gap sees what follows it under BCM alone.
    config.loss.update(mask="dccm+bcm", unit_latents=True, copies=1)
    common.archives(config, batch_size=32, min_frames=20,
                       lengths=(72, 120, 196), balance=0.5, vary_subject=0.5)
    config.optimizer.update(learning_rate=7e-4, schedule="wsd", warmup_steps=300, cooldown_steps=900,
                            ema_decay=0.999, clip_norm=1.0)
    config.train.update(num_steps=3_000, log_every=25, save_every=300, sample_every=1_500)
    # Chosen by measurement: docs/lab/cdamd-small.md.
    config.sampler.update(order="left_to_right", guidance_scale=3.0)
    if data == "steps":  # one latent after the other: each step continues those before it
      config.sampler.update(num_iterations=50, guidance_scale=2.0, solver="euler", num_steps=4)
    if size in ("mini", "laptop"):
      config.tokenizer.update(width=128)
      config.prior.update(width=96)
      config.model.transformer.update(width=128, depth=2, ff_width=256)
      config.model.head.update(width=224, depth=4)
      config.sampler.update(order="random")  # as the paper
      config.optimizer.update(learning_rate=1e-3, warmup_steps=50, cooldown_steps=300, ema_decay=0.99)
      config.train.update(num_steps=900, save_every=450, sample_every=0)
    if size == "laptop":
      config.optimizer.update(cooldown_steps=900, ema_decay=0.995)
      config.train.update(num_steps=3_000, log_every=10, save_every=500)
  elif size == "tiny":
    config.frozen.update(tokenizer="random-init", prior="random-init", text="random-init")  # nothing to download
    config.tokenizer.update(latent_dim=4, width=16, dilations=(1,))
    config.prior.update(latent_dim=4, width=16, dilations=(1,))
    config.quantizer.num_codes = 8
    config.model.transformer.update(latent_dim=4, width=16, depth=1, num_heads=2, ff_width=16, text_dim=32, num_codes=8,
                                    max_length=50)
    config.model.head.update(width=16, depth=1)
    common.tiny(config)
    config.optimizer.update(warmup_steps=1, schedule="constant")
  if data:
    config.tokenizer.features = config.prior.features = DATA[data][0]
    config.data.layout = DATA[data][1]
  if data == "kit":
    config.data.update(min_frames=24, batch_size=16 if size in ("full", "large") else config.data.batch_size)
    config.sampler.guidance_scale = 2.0
  if data == "snapmogen" and size in ("full", "large"):  # clips as CMDM's own there (configs/cmdm_denoiser.py)
    config.data.update(name="snapmogen", min_frames=128, max_frames=320, lengths=(320,), keep_long=True,
                       shorten_rate=0.0)
  if mardm:
    _make_mardm(config, size, data, ddpm)
  what = "_".join(["mardm"] * mardm + ["ddpm"] * ddpm + [data] * bool(data))
  return paper_tables.with_rows(config, PRINTED.get(what, {}), exact=size == "full").lock()


def _make_mardm(config, size, data, ddpm):
  """MARDM as it is published (docs/papers/cdamd.md#mardm), at the size, on the data and by the text of the config."""
  kept = {key: config.model.transformer[key] for key in ("latent_dim", "text_dim", "text_scale", "dropout")}
  config.model.transformer = dict(kind="mardm", **kept, **MARDM[size])
  config.frozen.prior = ""
  config.loss.update(mask="bidirectional", prior_levels=0)
  # Smaller sizes: the rate falls at the same place of the whole of training, whatever its length.
  falls = 20_000 if data == "kit" else 50_000
  config.optimizer.update(schedule="step", boundaries=(falls if size == "full" else falls / 180_000,))
  config.sampler.update(num_iterations=18, guidance_scale=2.5 if data == "kit" else 4.5, order="random",
                        mask="bidirectional")
  if ddpm:
    config.loss.diffusion = "ddpm"
    config.sampler.update(solver="ddpm", num_steps=50)
  if data == "kit":  # MARDM's own representation there
    config.tokenizer.features = config.prior.features = 64
    config.data.layout = "essential_kit"


def _words_of(name):
  """(size, data or "", whether MARDM, whether with DDPM) of a name such as "mardm_ddpm_67" or "kit_tiny"."""
  words = name.split("_")
  sizes, data = [word for word in words if word in SIZES], [word for word in words if word in DATA]
  mardm, ddpm = words.count("mardm"), words.count("ddpm")
  size = sizes[0] if sizes else "full"
  if "snapmogen" in data and not mardm:
    raise ValueError(f"got size {name!r}: SnapMoGen's columns are those of the baseline alone, mardm_snapmogen")
  if max(map(words.count, words)) > 1 or len(sizes) > 1 or len(data) > 1 or ddpm > mardm or (
      len(sizes) + len(data) + mardm + ddpm < len(words)) or (mardm and size not in MARDM):
    raise ValueError(f"got size {name!r}, expected {', '.join(SIZES[:-1])} or {SIZES[-1]}, with mardm or mardm_ddpm "
                     f"and one of {', '.join(DATA)} before it where wanted, as in mardm_67 or kit_tiny")
  return size, data[0] if data else "", bool(mardm), bool(ddpm)
