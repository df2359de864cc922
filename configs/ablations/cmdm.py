"""Every row of CMDM's ablation tables, each as a small change of the base configs.

  python launch.py --config configs/ablations/cmdm.py:c-vae/tokenizer --workdir runs/ablations/c-vae/tokenizer ...
  python launch.py --config configs/ablations/cmdm.py:c-vae --workdir runs/ablations/c-vae/denoiser ...
  ... --config configs/ablations/cmdm.py:c-vae/denoiser/small      sizes: full, small and mini (the archives), tiny

ROW[/STAGE[/SIZE]]: the stage is teacher, tokenizer or denoiser (the default). A row that changes nothing of a stage
gives the base config of it, and its denoiser looks for the tokenizer of the row that shares it. Rows of sampling (K
steps, lag L) change config.sampler alone and need no training. Numbers of the paper stand in facts: cmdm 6.6.

At sizes small and mini the widths of Tables 8 and 10 are their own: latents of 32, 16, 8 stand for 64, 32, 16, and
S, L, XL are as far from it as the paper's from M; the text encoders of Table 11 are the one that ships, by words or by
sentence, for no others fit here.
"""
import pathlib
import runpy

SIZES = {"full": {"s": (2, 4, 512), "l": (6, 12, 768), "xl": (8, 16, 1024)},
         "small": {"s": (2, 3, 192), "l": (6, 8, 384), "xl": (8, 10, 512)},
         "mini": {"s": (2, 2, 96), "l": (6, 6, 192), "xl": (8, 8, 256)},
         "tiny": {"s": (1, 1, 8), "l": (2, 2, 24), "xl": (2, 2, 32)}}
LATENTS = {"full": {64: 64, 32: 32, 16: 16}, "small": {64: 32, 32: 16, 16: 8},
           "mini": {64: 32, 32: 16, 16: 8}, "tiny": {64: 4, 32: 3, 16: 2}}

# row -> (table, {stage: {field: value}}); a stage that several rows share is trained once.
ROWS = {
    "default": (4, {}),
    # Table 4 and 9: tokenizers.
    "vae": (4, {"tokenizer": {"frozen.teacher": "", "model.teacher_dim": 0, "model.causal": False},
                "denoiser": {"tokenizer.causal": False}}),
    "c-vae": (4, {"tokenizer": {"frozen.teacher": "", "model.teacher_dim": 0}}),
    # Table 4: the denoiser.
    "one-level": (4, {"denoiser": {"loss.level_block": 0}}),
    "no-adaln": (4, {"denoiser": {"model.use_adaln": False}}),
    "no-rope": (4, {"denoiser": {"model.use_rope": False}}),
    "no-adaln-no-rope": (4, {"denoiser": {"model.use_adaln": False, "model.use_rope": False}}),
    # Table 9: teachers.
    "teacher-tmr": (9, {"teacher": {"model.kind": "tmr", "model.pool": "token"}, "tokenizer": {}}),
    "teacher-motion-patches": (9, {"teacher": {"model.kind": "motion_patches", "model.pool": "token"},
                                   "tokenizer": {}}),
    # Table 10: sizes; M is the default.
    **{f"size-{size}": (10, {"denoiser": {"model.size": size}}) for size in ("s", "l", "xl")},
    # Table 11: text encoders; words of DistilBERT are the default.
    "text-clip-words": (11, {"denoiser": {"frozen.text": "openai/clip-vit-base-patch32", "model.text_dim": 512,
                                          "data.max_words": 77}}),
    "text-clip-sentence": (11, {"denoiser": {"frozen.text": "openai/clip-vit-base-patch32", "model.text_dim": 512,
                                             "frozen.text_level": "sentence"}}),
    "text-sentence-t5": (11, {"denoiser": {"frozen.text": "sentence-transformers/sentence-t5-base",
                                           "model.text_dim": 768, "frozen.text_level": "sentence"}}),
    # Facts: cmdm 7, rows 1 and 2: what the network gives, and a level per latent as the paper's text has it.
    "predict-eps": (None, {"denoiser": {"model.predicts": "eps"}}),
    "predict-x1": (None, {"denoiser": {"model.predicts": "x1"}}),
    "block-1": (None, {"denoiser": {"model.block": 1, "loss.level_block": 1}}),
}
# Table 8: latent size and rate; 64 at 1/4 is the default.
for _latent, _rate in ((32, 4), (16, 4), (64, 8), (32, 8), (16, 8)):
  _halvings = 2 if _rate == 4 else 3
  ROWS[f"latent-{_latent}-{_rate}"] = (8, {
      "tokenizer": {"model.latent_dim": _latent, "model.num_halvings": _halvings},
      "denoiser": {"tokenizer.latent_dim": _latent, "tokenizer.num_halvings": _halvings, "model.latent_dim": _latent}})
# Table 4: frame-wise sampling with K steps and lag L; K50 L2 is the default. AR is L = K.
for _steps, _lag in ((50, 1), (50, 5), (50, 10), (20, 1), (20, 5), (20, 10), (50, 50)):
  ROWS[f"fss-{_steps}-{_lag}" if _lag < _steps else "ar"] = (4, {"denoiser": {"sampler.num_steps": _steps,
                                                                            "sampler.lag": _lag}})
BASES = {"teacher": "part_tmr", "tokenizer": "cmdm_tokenizer", "denoiser": "cmdm_denoiser"}


def get_config(name="default"):
  row, stage, size = (name.split("/") + ["denoiser", "full"][name.count("/"):])[:3]
  if row not in ROWS:
    raise ValueError(f"got row {row!r}, expected one of {', '.join(ROWS)}")
  if stage not in BASES:
    raise ValueError(f"got stage {stage!r}, expected one of {', '.join(BASES)}")
  base = runpy.run_path(str(pathlib.Path(__file__).parents[1] / f"{BASES[stage]}.py"))
  config = base["get_config"](size).unlock()
  changes = ROWS[row][1]
  # Tiny runs keep untrained frozen parts, which need no other run.
  if size != "tiny":
    home = lambda part: f"runs/ablations/{row if part in changes else 'default'}/{part}"
    if stage == "tokenizer":
      config.frozen.teacher = home("teacher")
    elif stage == "denoiser":
      config.frozen.tokenizer = home("tokenizer")
  for path, value in changes.get(stage, {}).items():
    _change(config, path, value, size)
  return config.lock()


def _change(config, path, value, size):
  section, field = path.split(".")
  if path == "model.size":
    heads, depth, width = SIZES[size][value]
    config.model.update(num_heads=heads, depth=depth, width=width, ff_width=2 * width)
  elif field == "latent_dim":
    config[section].latent_dim = LATENTS[size][value]
  elif path in ("frozen.text", "model.text_dim", "data.max_words") and size != "full":
    pass
  else:
    config[section][field] = value
