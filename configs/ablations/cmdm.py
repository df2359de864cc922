"""Every row of CMDM's ablation tables, each as a small change of the base configs.

  motion-jax train --config ablations/cmdm:c-vae/tokenizer --workdir runs/ablations/c-vae/tokenizer ...
  motion-jax train --config ablations/cmdm:c-vae --workdir runs/ablations/c-vae/denoiser ...
  ... --config ablations/cmdm:c-vae/denoiser/small      sizes: full, small and mini (the archives), tiny

ROW[/STAGE[/SIZE]]: the stage is teacher, tokenizer or denoiser (the default). A row that changes nothing of a stage
gives the base config of it, and its denoiser looks for the tokenizer of the row that shares it. Rows of sampling (K
steps, lag L) change config.sampler alone and need no training. config.paper_row names the printed
rows, whose numbers stand in evaluation/report/paper_tables (docs/papers/cmdm.md#printed-numbers).

At sizes small and mini the widths of Tables 8 and 10 are their own: latents of 32, 16, 8 stand for 64, 32, 16, and
S, L, XL are as far from it as the paper's from M; the text encoders of Table 11 are the one that ships, by words or by
sentence, for no others fit here.

Expected: at full size no row has been run. At size mini, cut to 300 steps, those of benchmarks/study.py have, with
their numbers in docs/benchmark/study_cmdm.md.
"""
from motion_jax import paper_tables
from motion_jax.configs import cmdm_denoiser, cmdm_tokenizer, common, motion_patches, part_tmr, tmr
from motion_jax.configs.ablations import cmdm_paper

# Levels as in sampling and a window of two blocks, 6 latents, that is done after 10 steps, as in FloodDiffusion: of 5.
WINDOW = {"loss.pyramid_levels": 1.0, "sampler.num_steps": 10, "sampler.lag": 5}
SIZES = {"full": {"s": (2, 4, 512), "l": (6, 12, 768), "xl": (8, 16, 1024)},
         "small": {"s": (2, 3, 192), "l": (6, 8, 384), "xl": (8, 10, 512)},
         "mini": {"s": (2, 2, 96), "l": (6, 6, 192), "xl": (8, 8, 256)},
         "tiny": {"s": (1, 1, 8), "l": (2, 2, 24), "xl": (2, 2, 32)}}
LATENTS = {"full": {64: 64, 32: 32, 16: 16}, "small": {64: 32, 32: 16, 16: 8},
           "mini": {64: 32, 32: 16, 16: 8}, "tiny": {64: 4, 32: 3, 16: 2}}

# row -> ({table: its printed row there}, {stage: {field: value}}); a stage that several rows share is trained once.
ROWS = {
    "default": ({table.removeprefix("cmdm "): row for table, row in paper_tables.CMDM.items()}, {}),
    # Table 4, 8 and 9: tokenizers.
    "vae": ({"4": "VAE w/o MA", "8": "VAE 64, 1/4", "9": "VAE"},
            {"tokenizer": {"frozen.teacher": "", "model.teacher_dim": 0, "model.causal": False},
             "denoiser": {"tokenizer.causal": False}}),
    "c-vae": ({"4": "C-VAE w/o MA", "8": "C-VAE 64, 1/4", "9": "C-VAE"},
              {"tokenizer": {"frozen.teacher": "", "model.teacher_dim": 0}}),
    # Table 4: the denoiser. One level for the whole sequence is sampled as it is trained, all frames at once.
    "one-level": ({"4": "w/ Full-Seq. Diff."}, {"denoiser": {"loss.level_block": 0, "sampler.schedule": "full"}}),
    "no-adaln": ({"4": "w/o adaLN"}, {"denoiser": {"model.use_adaln": False}}),
    "no-rope": ({"4": "w/o ROPE"}, {"denoiser": {"model.use_rope": False}}),
    "no-adaln-no-rope": ({"4": "w/o adaLN + ROPE"},
                         {"denoiser": {"model.use_adaln": False, "model.use_rope": False}}),
    # Table 9: teachers, with base configs of their own. Features of frames are what teaches, and no loss of the
    # published TMR touches its: here their mean is what captions are compared with
    # (docs/papers/cmdm.md#frame-features).
    "teacher-tmr": ({"9": "TMR"}, {"teacher": {"model.pool": "real"}, "tokenizer": {}}),
    "teacher-motion-patches": ({"9": "MotionPatches"}, {"teacher": {}, "tokenizer": {}}),
    # Table 10: sizes; M is the default.
    **{f"size-{size}": ({"10": size.upper()}, {"denoiser": {"model.size": size}}) for size in ("s", "l", "xl")},
    # Table 11: text encoders; words of DistilBERT are the default.
    "text-clip-words": ({"11": "CLIP words"},
                        {"denoiser": {"frozen.text": "openai/clip-vit-base-patch32", "model.text_dim": 512,
                                      "data.max_words": 77}}),
    "text-clip-sentence": ({"11": "CLIP sentence"},
                           {"denoiser": {"frozen.text": "openai/clip-vit-base-patch32", "model.text_dim": 512,
                                         "frozen.text_level": "sentence"}}),
    "text-sentence-t5": ({"11": "Sentence-T5"},
                         {"denoiser": {"frozen.text": "sentence-transformers/sentence-t5-base", "model.text_dim": 768,
                                       "frozen.text_level": "sentence"}}),
    # In no table (docs/papers/paper-and-code.md#cmdm): what the network gives, and a level per latent as in the text.
    "predict-eps": ({}, {"denoiser": {"model.predicts": "eps"}}),
    "predict-x1": ({}, {"denoiser": {"model.predicts": "x1"}}),
    "block-1": ({}, {"denoiser": {"model.block": 1, "loss.level_block": 1}}),
    # FloodDiffusion's objection: latents of the window that is being denoised see one another both ways, beside the
    # same levels and sampler with the causal mask.
    "window-two-way": ({}, {"denoiser": {"model.two_way": True, **WINDOW}}),
    "window-causal": ({}, {"denoiser": WINDOW}),
}
# Table 8: latent size and rate; 64 at 1/4 is the default.
for _latent, _rate in ((32, 4), (16, 4), (64, 8), (32, 8), (16, 8)):
  _halvings = 2 if _rate == 4 else 3
  ROWS[f"latent-{_latent}-{_rate}"] = ({"8": f"MAC-VAE {_latent}, 1/{_rate}"}, {
      "tokenizer": {"model.latent_dim": _latent, "model.num_halvings": _halvings},
      "denoiser": {"tokenizer.latent_dim": _latent, "tokenizer.num_halvings": _halvings, "model.latent_dim": _latent,
                   "data.frames_per_latent": 2 ** _halvings}})
# Table 4: frame-wise sampling with K steps and lag L; K50 L2 is the default. AR is L = K.
for _steps, _lag in ((50, 1), (50, 5), (50, 10), (20, 1), (20, 5), (20, 10)):
  ROWS[f"fss-{_steps}-{_lag}"] = ({"4": f"FSS K={_steps}, L={_lag}"},
                                  {"denoiser": {"sampler.num_steps": _steps, "sampler.lag": _lag}})
ROWS["ar"] = ({"1": "CMDM w/ AR", "4": "w/o FSS", "6": "CMDM w/ AR", "speed": "CMDM w/ AR"},
              {"denoiser": {"sampler.num_steps": 50, "sampler.lag": 50}})
BASES = {"teacher": part_tmr, "tokenizer": cmdm_tokenizer, "denoiser": cmdm_denoiser}
TEACHERS = {"teacher-tmr": tmr, "teacher-motion-patches": motion_patches}

PARTS = cmdm_paper.PARTS


def get_config(name="default"):
  if name.startswith("paper"):
    return cmdm_paper.get_config(name)
  row, stage, size = common.row_stage_size(name, ROWS, BASES)
  base = TEACHERS.get(row, part_tmr) if stage == "teacher" else BASES[stage]
  config = base.get_config(size).unlock()
  printed, changes = ROWS[row]
  # Tiny runs keep untrained frozen parts, which need no other run.
  if size != "tiny":
    common.take_parts(config, row, changes, PARTS[stage])
  elif stage == "tokenizer" and row in TEACHERS:  # so is its teacher, but of the row's kind
    teacher = TEACHERS[row].get_config(size)
    fields = teacher.model.to_dict()
    config.teacher = dict(fields, layout=teacher.data.layout)
    config.model.teacher_dim = fields.get("dim", fields["width"])
  for path, value in changes.get(stage, {}).items():
    _change(config, path, value, size)
  rows = {f"cmdm {table}": name for table, name in printed.items()}
  return paper_tables.with_rows(config, rows, exact=size == "full").lock()


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
