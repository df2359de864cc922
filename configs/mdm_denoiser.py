"""MDM's denoiser of whole motions, and DiP's of the next frames.

  motion-jax train --config mdm_denoiser --workdir runs/mdm --data HumanML3D --config.frozen.text=CLIP-FOLDER
  ... --config mdm_denoiser:fast            50 steps, padding masked, averaged weights
  ... --config mdm_denoiser:words           the same, frames attending to words of DistilBERT
  ... --config mdm_denoiser:dip             DiP: 40 frames after 20, 10 steps
  ... --config mdm_denoiser:goals           DiP with goals: where a hand, a foot or the pelvis ends, and the heading
  ... --config mdm_denoiser:kit             KIT's 251 numbers; essential: HumanML3D's first 67; snapmogen: 296
  ... --config mdm_denoiser:small           on archives; laptop: fewer steps; tiny: two steps on procedural motion

How sizes are written: docs/configs.md; here words are joined by "_": one of fast, words, dip and goals, one of the
data, and a size, as in dip_tiny. `full` is the released code's configuration (docs/papers/mdm.md#training): 17.9 M
parameters, with words 26.4 M, 600,000 steps of 64.

Expected: none of these sizes but `tiny` has been run.
"""
from motion_jax import paper_tables
from motion_jax.configs import common

SIZES = ("full", "small", "laptop", "tiny")
DATA = {"kit": (251, dict(layout="full_kit", min_frames=24)), "essential": (67, dict(layout="essential")),
        "snapmogen": (296, common.SNAPMOGEN | dict(lengths=(320,), keep_long=True, shorten_rate=0.0))}
KINDS = ("fast", "words", "dip", "goals")
# Rows of the papers' tables, by what a name says beside its size.
PRINTED = {"": {"authors humanml3d": "MDM", "control 263-pelvis": "MDM"},
           "fast": {"cmdm 1": "MDM-50Steps", "cmdm 6": "MDM-50Step", "cdamd 1": "MDM-50Step",
                    "authors humanml3d": "MDM, 50 steps"},
           "words": {"authors humanml3d": "MDM, words"}, "dip": {"authors humanml3d": "DiP"},
           "goals": {"authors humanml3d": "DiP, target"},
           "essential": {"control 67-pelvis": "MDM"}, "fast essential": {"cmdm 6": "MDM-50Step"},
           "kit": {"cdamd 2": "MDM"}, "snapmogen": {"cmdm 2": "MDM"}}


def get_config(name="full"):
  size, data, kind = common.words_of(name, SIZES, DATA, KINDS)
  config = common.experiment("mdm.dip" if kind in ("dip", "goals") else "mdm.denoiser", seed=10)
  # text_pieces: of a caption, with the two special ones; 0 for all.
  config.frozen = dict(text="clip-vit-base-patch32", text_level="sentence", text_pieces=22)
  config.model = dict(features=263, width=512, depth=8, num_heads=4, mlp_width=1024, text_dim=512, kind="encoder",
                      time_token=False, num_goals=0, num_steps=1_000, dropout=0.1)
  # context: clean frames that the network reads in front of those that it denoises.
  config.diffusion = dict(num_steps=1_000, context=0, schedule="cosine")
  # drop_rate: of captions and, apart from these, of goals; velocity, positions, contacts: weights of the geometric
  # terms, 0 in the text models; goals: that of how far a motion ends from its goals; mask_frames: padding is not
  # attended to, in sampling either.
  config.loss = dict(drop_rate=0.1, mask_frames=False, velocity=0.0, positions=0.0, contacts=0.0, goals=0.0)
  config.data = common.captioned_data(layout="full", batch_size=64, min_frames=40, max_frames=196, lengths=(196,),
                                      max_words=64, balance=0.0, vary_subject=0.0)
  config.optimizer = common.optimizer(learning_rate=1e-4)
  config.train = common.train(600_000, log_every=1_000, save_every=50_000, sample_every=50_000)
  config.sampler = dict(guidance_scale=2.5, num_steps=1_000, solver="ancestral")
  if kind:
    steps = 10 if kind in ("dip", "goals") else 50
    config.model.num_steps = config.diffusion.num_steps = config.sampler.num_steps = steps
    config.loss.mask_frames = True
    config.optimizer.ema_decay = 0.9999
  if kind in ("words", "dip", "goals"):
    config.frozen.update(text="distilbert-base-uncased", text_level="words", text_pieces=0)
    config.model.update(kind="decoder", text_dim=768)
  if kind in ("dip", "goals"):
    config.diffusion.context = 20
    config.data.update(min_frames=60, max_frames=60, lengths=(60,), keep_long=True, shorten_rate=0.0)
    config.sampler.guidance_scale = 7.5
  if kind == "goals":
    config.model.num_goals, config.loss.goals = 8, 1.0
  if data:
    config.model.features = DATA[data][0]
    config.data.update(DATA[data][1])
  if size in ("small", "laptop"):
    config.frozen.update(text="words", text_level="words" if config.model.kind == "decoder" else "sentence",
                         text_pieces=0)
    config.model.update(width=256, depth=6, mlp_width=512, text_dim=128 if config.model.kind == "decoder" else 384)
    common.archives(config, batch_size=32, balance=0.5, vary_subject=0.5, max_words=24)
    if kind not in ("dip", "goals"):
      config.data.update(min_frames=20)
      config.model.num_steps = config.diffusion.num_steps = config.sampler.num_steps = 50
      config.loss.mask_frames = True
    config.optimizer.update(learning_rate=5e-4, schedule="wsd", warmup_steps=100, cooldown_steps=1_000,
                            ema_decay=0.995, clip_norm=1.0)
    config.train.update(num_steps=4_000 if size == "laptop" else 12_000, log_every=20, save_every=500,
                        sample_every=2_000)
  elif size == "tiny":
    config.frozen.update(text="random-init", text_pieces=0)
    config.model.update(width=16, depth=1, num_heads=2, mlp_width=16, text_dim=32, num_steps=4)
    config.diffusion.num_steps = config.sampler.num_steps = 4
    common.tiny(config)
  return paper_tables.with_rows(config, PRINTED.get(f"{kind} {data}".strip(), {}), exact=size == "full").lock()
