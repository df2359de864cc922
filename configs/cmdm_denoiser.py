"""CMDM's causal diffusion transformer on latents of a trained tokenizer.

  motion-jax train --config cmdm_denoiser --workdir runs/denoiser --data HumanML3D \
      --config.frozen.tokenizer=runs/tokenizer --config.frozen.text=distilbert-base-uncased
  ... --config cmdm_denoiser:small          the size that ships, on archives; also laptop, mini, tiny
  ... --config cmdm_denoiser:snapmogen      essential (HumanML3D's first 67 numbers), kit, snapmogen, babel, with a
                                            tokenizer of the same data; as in snapmogen_tiny with a size behind

How sizes are written: docs/configs.md. `full` is the released code's configuration
(docs/papers/cmdm.md#denoiser-training), size M of the paper: 38.7 M parameters. S is width 512, depth 4, 2 heads; L
768, 12, 6; XL 1024, 16, 8. `frozen.text` is a folder in Hugging Face layout, a published name, or "words", the small
encoder that ships; `frozen.text_level` says whether a caption is a row per word piece ("words") or one row in all
("sentence").

Expected: `full` has not been run; the paper prints R@1 0.588 and FID 0.068 on HumanML3D (Table 4). `small`: about an
hour on two cores of an AMD EPYC; the model that ships went on from there (pretrained/cmdm-small/README.md): R@1
0.723 +- 0.021 and FID 0.573 +- 0.123 on our own benchmark, which compares with nothing on HumanML3D.
"""
from motion_jax import paper_tables
from motion_jax.configs import common

# Numbers a frame and what the data section says (docs/papers/cmdm.md#data-sets, a table that is ours by analogy for all
# but the first). 320 frames are 80 latents, 200 are 50: padded to whole blocks of 3, 81 and 51.
DATASETS = {
    "essential": (67, dict(layout="essential")),
    "kit": (251, dict(layout="full_kit", min_frames=24)),
    "snapmogen": (296, dict(name="snapmogen", layout="snapmogen", min_frames=128, crop_frames=320, max_frames=324,
                            lengths=(324,), keep_long=True, shorten_rate=0.0, max_words=512)),
    "babel": (135, dict(name="babel", layout="babel", kind="pairs", min_frames=30, crop_frames=200, max_frames=204,
                        lengths=(204,), shorten_rate=0.0)),
}
FALLS = 50_000 / 190_000  # of the steps that 500 epochs of HumanML3D are (docs/papers/cmdm.md#denoiser-training)
# The rows of the paper's tables that each data set's model is in.
PRINTED = {"": paper_tables.CMDM, "essential": {"cmdm 6": "CMDM w/ FSS"}, "kit": {},
           "snapmogen": {"cmdm 2": "CMDM w/ FSS", "cmdm 3-snapmogen": "CMDM"}, "babel": {"cmdm 5": "CMDM"}}


def get_config(size="full"):
  dataset, size = common.data_and_size(size, DATASETS, ("full", "small", "laptop", "mini", "tiny"))
  config = common.experiment("cmdm.denoiser", seed=5427)
  config.frozen = dict(tokenizer="runs/tokenizer", text="distilbert-base-uncased", text_level="words")
  config.distill = dict(teacher="")  # a student's teacher, and how it learns: configs/cmdm_student.py
  config.alignment_teacher = dict()  # what the tokenizer was aligned with; the run takes it from there
  config.tokenizer = dict(features=263, latent_dim=64, width=1024, num_halvings=2, dilations=(9, 3, 1), causal=True)
  config.model = dict(latent_dim=64, width=512, depth=8, num_heads=4, ff_width=1024, block=3, text_dim=768,
                      control=0,  # numbers that tell a latent of constraints; data.control sets it
                      time_left=False)  # not of the paper: tokens know how many latents their caption has left
  # self_forcing: share of the clips that begin with what the network made itself (docs/training.md#denoisers).
  # pyramid_levels: share of the clips whose times are those of a moment of sampling, not drawn for each block.
  # decoded_from: errors of the decoded motion count for frames whose latents' time is above it (0 noise, 1 clean).
  # control: weight of the distance of the decoded motion from the constraints that it gets (data.control).
  # time_left_drop: share of the clips whose time that is left is unknown, as it is in a stream (model.time_left).
  config.loss = dict(drop_rate=0.1, time_left_drop=0.2, unit_latents=False, level_block=3, mean_latents=False,
                     self_forcing=0.0, pyramid_levels=0.0, decoded_from=0.5, control=0.0, **common.contrast(),
                     **common.motion_errors())
  config.data = common.captioned_data(layout="full", batch_size=64, min_frames=40, max_frames=192, lengths=(192,),
                                      max_words=64, balance=0.0, vary_subject=0.0, per_segment_captions=0.0, store="",
                                      control=0.0)  # share of the motions with constraints (docs/training.md)
  if dataset:
    config.tokenizer.features, data = DATASETS[dataset]
    config.data.update(data)
  config.optimizer = common.optimizer(learning_rate=2e-4, schedule="step", boundaries=(50_000,), gamma=0.1,
                                      warmup_steps=2_000, beta2=0.99, weight_decay=1e-5, ema_decay=0.9999,
                                      skip_loss=10.0)
  if dataset and dataset != "essential":  # the rate falls at the same place of the whole of training
    config.optimizer.update(boundaries=(FALLS,), ema_debias=True)  # KIT has a fifth of the steps
  config.train = common.epochs(500, log_every=100, num_saves=40, remat=False, attention="xla",
                               scan_layers=False, sample_every=20_000)
  # schedule: "fss" (frame-wise, `lag` steps between blocks), "ar" (block after block) or "full" (all frames at once).
  config.cleanup = common.cleanup()
  # clauses, not of the paper: attention to the clause of a caption that is due (text/clauses.py).
  config.sampler = dict(schedule="fss", solver="euler", num_steps=50, lag=2, guidance_scale=3.0, clauses=False)
  if size in ("small", "mini", "laptop"):
    config.frozen.text = "words"
    config.tokenizer.update(latent_dim=32, width=192)
    config.model.update(latent_dim=32, width=256, depth=6, num_heads=4, ff_width=512, text_dim=128)
    config.loss.update(unit_latents=True)
    common.archives(config, min_frames=20, batch_size=32,
                       lengths=(72, 120, config.data.max_frames), max_words=24, balance=0.5, vary_subject=0.5)
    config.optimizer.update(learning_rate=5e-4, schedule="wsd", warmup_steps=300, cooldown_steps=1_800,
                            ema_decay=0.999, clip_norm=1.0)
    config.train.update(num_steps=4_500, log_every=50, save_every=500, sample_every=1_500)
    if size in ("mini", "laptop"):
      config.tokenizer.update(width=128)
      config.model.update(width=128, depth=4, ff_width=256)
      config.optimizer.update(learning_rate=1e-3, warmup_steps=50, cooldown_steps=300, ema_decay=0.99)
      config.train.update(num_steps=900, save_every=450, sample_every=0)
    if size == "laptop":
      config.optimizer.update(cooldown_steps=1_200, ema_decay=0.995)
      config.train.update(num_steps=4_000, log_every=10, save_every=500, sample_every=2_000)
  elif size == "tiny":
    config.frozen.update(tokenizer="random-init", text="random-init")  # nothing to download
    config.tokenizer.update(latent_dim=4, width=16, dilations=(1,))
    config.model.update(latent_dim=4, width=16, depth=1, num_heads=2, ff_width=32, text_dim=32)
    common.tiny(config, min_frames=min(40, config.data.min_frames))
    config.optimizer.update(warmup_steps=1, schedule="constant")
  rows = PRINTED[dataset]
  return paper_tables.with_rows(config, rows, exact=size == "full").lock()
