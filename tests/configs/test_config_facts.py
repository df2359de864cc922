"""Every size of every config: full sizes against the papers and the released code, the others against themselves.

Sources of the numbers: docs/papers/cmdm.md and docs/papers/cdamd.md, by the heading that each row names; the paper's
own side is configs/ablations/*_paper.py.
"""
import contextlib
import re
import runpy
import types

import pytest

from motion_jax import fit, runs
from motion_jax.motion.representations import get_layout
from motion_jax.training import setup
from motion_jax.training.optimizers import make_schedule
from motion_jax.utils import config_files
from tests.conftest import ROOT, load_config


def facts(**sections):
  """{"section.field": value}; a dict within a section is a section of its own."""
  return {f"{name}.{field}" if field else name: value for name, fields in sections.items() for field, value in (
      facts(**fields).items() if isinstance(fields, dict) else [("", fields)])}


CMDM_DATA = ("essential", "kit", "snapmogen", "babel")
ADAMW = facts(optimizer=dict(beta1=0.9, beta2=0.99))
CMDM_TOKENIZER = ADAMW | facts(  # cmdm.md#tokenizer-training, #loss, #alignment
    train=dict(num_epochs=50, best="min held_out_fid|held_out_mm"), data=dict(batch_size=256, window=64, stride=10),
    loss=dict(micro_batch=128, kl_weight=0.01, kl_ramp=2_000, root_weight=0.05, align=0.1, align_fall=0.9),
    optimizer=dict(learning_rate=2e-4, warmup_steps=2_000, boundaries=(150_000, 250_000), gamma=0.1,
    weight_decay=0.0, clip_norm=1.0, ema_decay=0.0), model=dict(width=1024, latent_dim=64, dilations=(9, 3, 1),
    teacher_dim=256), seed=5427)
CMDM_DENOISER = ADAMW | facts(  # cmdm.md#denoiser-training, #sampling
    train=dict(num_epochs=500, best=""), data=dict(batch_size=64), optimizer=dict(learning_rate=2e-4,
    warmup_steps=2_000, gamma=0.1, weight_decay=1e-5, clip_norm=0.0, ema_decay=0.9999, skip_loss=10.0),
    loss=dict(drop_rate=0.1, level_block=3), model=dict(block=3, width=512, depth=8, num_heads=4, ff_width=1024),
    sampler=dict(num_steps=50, lag=2, guidance_scale=3.0, schedule="fss", solver="euler"), seed=5427)
PART_TMR = facts(  # cmdm.md#part-tmr
    train=dict(num_epochs=50, best="max back_r1"), data=dict(batch_size=128), optimizer=dict(learning_rate=1e-4,
    schedule="half_cosine", rates=dict(text=0.1, logit_scale=0.0), warmup_steps=0, beta2=0.999, clip_norm=0.0),
    model=dict(width=512, depth=4, num_heads=4, mlp_width=1024, dim=256, dropout=0.1, head_dropout=0.5))
AUTOENCODER = ADAMW | facts(  # cdamd.md#autoencoder
    train=dict(num_epochs=50, best=""), data=dict(batch_size=256, window=64), optimizer=dict(learning_rate=2e-4,
    warmup_steps=2_000, boundaries=(152_000, 252_000), gamma=0.05, weight_decay=0.0, ema_decay=0.0, clip_norm=0.0),
    model=dict(width=512, latent_dim=512, dropout=0.2), loss=dict(position_weight=1.0))
RVQ = AUTOENCODER | facts(  # cdamd.md#rvq
    data=dict(window=0), loss=dict(position_weight=0.1, velocity_weight=0.1, commitment_weight=0.02),
    quantizer=dict(num_levels=4, num_codes=512, decay=0.99, drop_rate=0.2))
GENERATOR = ADAMW | facts(  # cdamd.md#training, #loss
    train=dict(num_epochs=500), data=dict(batch_size=64, min_frames=40, max_frames=196),
    optimizer=dict(learning_rate=2e-4, schedule="cosine", final_rate=1e-6, warmup_steps=2_000, weight_decay=1e-5),
    loss=dict(noise_rate=0.1, mask_rate=0.88, drop_rate=0.1, prior_drop_rate=0.7, copies=4),
    sampler=dict(num_iterations=10, guidance_scale=4.0), model=dict(transformer=dict(width=512, depth=4,
    num_heads=8, ff_width=1024, dropout=0.2), head=dict(width=1792, depth=16)))
KIT = facts(data=dict(batch_size=16, min_frames=24), sampler=dict(guidance_scale=2.0))
MARDM = facts(  # cdamd.md#mardm
    train=dict(num_epochs=500), data=dict(batch_size=64), optimizer=dict(schedule="step", boundaries=(50_000,),
    gamma=0.1, ema_decay=0.9999), sampler=dict(num_iterations=18, guidance_scale=4.5),
    model=dict(transformer=dict(width=1024, depth=1, num_heads=16, ff_width=4096)), loss=dict(prior_levels=0))
MOMASK_RVQ = ADAMW | facts(  # momask.md#rvq, #training
    train=dict(num_epochs=50), data=dict(batch_size=256, window=64, stride=1, feature_bias=25.0),
    optimizer=dict(learning_rate=2e-4, warmup_steps=2_000, boundaries=(151_999, 251_999), gamma=0.05),
    loss=dict(position_weight=0.5, commitment_weight=0.02, velocity_weight=0.0), quantizer=dict(num_levels=6,
    num_codes=512, drop_rate=0.2, temperature=0.5), model=dict(dropout=0.2), seed=3407)
MOMASK = ADAMW | facts(  # momask.md#transformers, #training
    train=dict(num_epochs=500), data=dict(batch_size=64, min_frames=40, feature_bias=25.0),
    optimizer=dict(learning_rate=2e-4, warmup_steps=2_000, boundaries=(50_000,), gamma=0.1, weight_decay=1e-5),
    model=dict(width=384, depth=8, num_heads=6, ff_width=1024, dropout=0.2), seed=3407)
MATCHING = facts(  # cdamd.md#matching-evaluator
    train=dict(num_epochs=300, best="min held_out_loss"), data=dict(batch_size=32, max_words=20),
    optimizer=dict(learning_rate=1e-4, clip_norm=0.5, beta2=0.999), loss=dict(margin=10.0))
MOVEMENT = facts(  # cdamd.md#matching-evaluator
    train=dict(num_epochs=270), data=dict(batch_size=128, window=40), optimizer=dict(learning_rate=1e-4),
    loss=dict(size=0.001, change=0.001))
FACTS = {
    **{("cmdm_tokenizer", size): CMDM_TOKENIZER for size in ("full", *CMDM_DATA)},
    ("cmdm_denoiser", "full"): CMDM_DENOISER | {"optimizer.boundaries": (50_000,), "data.max_frames": 192,
                                                "data.min_frames": 40},
    ("cmdm_denoiser", "essential"): CMDM_DENOISER | {"optimizer.boundaries": (50_000,)},
    ("cmdm_denoiser", "kit"): CMDM_DENOISER | {"data.min_frames": 24},
    ("cmdm_denoiser", "snapmogen"): CMDM_DENOISER | {"data.min_frames": 128, "data.crop_frames": 320},
    ("cmdm_denoiser", "babel"): CMDM_DENOISER | {"data.min_frames": 30, "data.crop_frames": 200},
    **{("part_tmr", size): PART_TMR for size in ("full", *CMDM_DATA)},
    ("tmr", "full"): {"train.num_epochs": 500, "data.batch_size": 32, "optimizer.learning_rate": 1e-4,  # cmdm.md#tmr
                      "optimizer.weight_decay": 0.01, "optimizer.schedule": "constant", "loss.kl": 1e-5,
                      "loss.contrastive": 0.1, "loss.temperature": 0.1, "loss.threshold": 0.8, "seed": 1234},
    ("tmr", "kit"): {"train.num_epochs": 500, "data.batch_size": 32},
    ("motion_patches", "full"): {"train.num_epochs": 50, "data.batch_size": 128,  # cmdm.md#motionpatches
                                 "optimizer.learning_rate": 1e-4, "optimizer.rates.text": 0.1, "seed": 42},
    ("motion_patches", "kit"): {"train.num_epochs": 50, "data.batch_size": 128, "optimizer.learning_rate": 1e-5,
                                "optimizer.rates.text": 1.0, "model.head_dropout": 0.0},
    **{("cdamd_autoencoder", size): AUTOENCODER for size in ("full", "67", "263", "steps", "snapmogen")},
    **{("cdamd_autoencoder", size): AUTOENCODER | {"data.batch_size": 512, "optimizer.gamma": 0.1}
       for size in ("kit", "64")},
    **{("cdamd_rvq", size): RVQ | {"data.min_frames": 40} for size in ("full", "67", "263", "steps")},
    ("cdamd_rvq", "kit"): RVQ | {"data.min_frames": 24},
    **{("cdamd_generator", size): GENERATOR for size in ("full", "67", "263", "steps")},
    ("cdamd_generator", "kit"): GENERATOR | KIT,
    ("cdamd_generator", "large"): GENERATOR | {"model.transformer.width": 1024, "model.transformer.depth": 8,
                                               "model.transformer.ff_width": 4096, "model.transformer.dropout": 0.1},
    **{("cdamd_generator", size): MARDM for size in ("mardm", "mardm_67", "mardm_263")},
    **{("cdamd_generator", size): MARDM | {"loss.diffusion": "ddpm", "sampler.num_steps": 50}
       for size in ("mardm_ddpm", "mardm_ddpm_67")},
    ("cdamd_generator", "mardm_kit"): MARDM | KIT | {"optimizer.boundaries": (20_000,), "sampler.guidance_scale": 2.5},
    ("cdamd_generator", "mardm_snapmogen"): MARDM | {"data.min_frames": 128, "data.max_frames": 320,
                                                     "data.keep_long": True},
    ("momask_rvq", "full"): MOMASK_RVQ,
    ("momask_rvq", "kit"): MOMASK_RVQ | {"train.num_epochs": 500, "data.batch_size": 512, "quantizer.drop_rate": 0.5,
                                         "optimizer.gamma": 0.1},
    **{(f"momask_{name}", size): MOMASK | ({} if size == "full" else {
        "optimizer.boundaries": (20_000,), "data.batch_size": 16, "data.min_frames": 24})
       for name in ("masked", "residual") for size in ("full", "kit")},
    ("momask_rvq", "snapmogen"): MOMASK_RVQ | {"data.feature_bias": 0.0},
    **{(f"momask_{name}", "snapmogen"): MOMASK | {"data.min_frames": 128, "data.max_frames": 320,
                                                  "data.keep_long": True, "data.feature_bias": 0.0}
       for name in ("masked", "residual")},
    ("cdamd_length", "full"): {"train.num_epochs": 300, "data.batch_size": 64, "optimizer.learning_rate": 1e-4,
                               "optimizer.clip_norm": 0.5, "data.min_frames": 40},  # cdamd.md#length
    **{(name, "kit"): {"train.num_epochs": 300, "data.batch_size": 64, "data.min_frames": 24}
       for name in ("cdamd_length", "momask_length")},
    ("momask_length", "full"): {"train.num_epochs": 300, "data.min_frames": 40, "data.layout": "full"},
    **{("evaluator_movement", size): MOVEMENT for size in ("full", "66", "67", "kit", "64", "63")},
    **{("evaluator_matching", size): MATCHING for size in ("full", "66", "67", "kit", "64", "63")},
    **{("evaluator_clip", size): {"train.num_epochs": 150, "data.batch_size": 128, "model.depth": 8}
       for size in ("67", "66", "full", "kit", "64", "63")},
}



def _field(config, path):
  for name in path.split("."):
    config = config[name]
  return tuple(config) if isinstance(config, list) else config


@pytest.mark.parametrize("name, size", FACTS, ids=map("-".join, FACTS))
def test_full_sizes_are_what_paper_and_code_say(name, size):
  config = load_config(name, size)
  wrong = {path: (_field(config, path), expected) for path, expected in FACTS[name, size].items()
           if _field(config, path) != expected}
  assert not wrong and config.train.num_steps == 0


def sizes_of(name):
  """{what is written behind a config's colon: the config}: words of its refusal and of FACTS, also with "_tiny"."""
  with pytest.raises(ValueError, match="expected") as refusal:
    load_config(name, "huge")
  words, found = {*re.findall(r"\w+", str(refusal.value)), *(size for known, size in FACTS if known == name)}, {}
  for size in [*words, *(f"{word}_tiny" for word in words)]:
    with contextlib.suppress(ValueError):
      found[size] = load_config(name, size)
  return found


@pytest.mark.parametrize("name", [name for name in config_files.names() if "/" not in name])
def test_every_full_size_has_facts_and_the_fields_of_each_size_fit_each_other(name):
  sizes = sizes_of(name)
  for size, config in sizes.items():
    check_fields(config)
    assert config.train.num_steps or (name, size) in FACTS or name not in {known for known, _ in FACTS}, size


def check_fields(config):
  assert config.is_locked
  data, train, optimizer = config.data, config.train, config.optimizer
  assert train.num_steps or train.num_epochs > 0 and train.num_saves > 0
  columns = get_layout(data.layout).dim
  for part in ("model", "tokenizer", "prior"):
    found = (config.get(part) or {}).get("columns", (config.get(part) or {}).get("features", columns))
    assert found == columns or data.layout == "snapmogen_148", part
  if "lengths" in data:
    assert data.lengths[-1] == data.max_frames and list(data.lengths) == sorted(data.lengths)
    assert data.min_frames <= data.max_frames
  if data.get("crop_frames"):
    assert data.crop_frames <= data.max_frames and data.crop_frames % 4 == 0
  if config.stage == "cmdm.denoiser":
    assert all(length // 4 % config.model.block == 0 or config.model.block > length for length in data.lengths)
    assert config.model.latent_dim == config.tokenizer.latent_dim
  if config.stage == "cdamd.generator":
    assert config.model.transformer.latent_dim == config.tokenizer.latent_dim
    assert config.loss.prior_levels <= config.quantizer.num_levels
    assert config.quantizer.num_codes <= config.model.transformer.get("num_codes", 1027)
  if train.num_steps:
    assert 0 < train.save_every <= train.num_steps and optimizer.warmup_steps < train.num_steps
    assert optimizer.schedule != "wsd" or optimizer.cooldown_steps + optimizer.warmup_steps <= train.num_steps


# Captioned clips and their parts that an epoch of a data set has, about: enough to know how long a run is.
ITEMS = {"full_kit": 4_400, "essential_kit": 4_400, "coordinates_kit": 4_400, "steps_kit": 4_400, "snapmogen": 18_000,
         "snapmogen_148": 18_000, "babel": 6_000}


def share_of_the_start(config):
  """How much of the average that is evaluated is the random start, by `training.train_step`."""
  decay, steps = config.optimizer.ema_decay, config.train.num_steps
  if not steps:
    steps = setup.resolve_epochs(config, ITEMS.get(config.data.layout, 24_000)).train.num_steps
  return 0.0 if config.optimizer.ema_debias or not decay else decay ** steps


def rows_of(name):
  """{ROW/STAGE/SIZE: config} of a config of ablations."""
  module = runpy.run_path(str(ROOT / "configs" / f"{name}.py"))
  names = [f"{row}/{stage}/{size}" for row in module["ROWS"] for stage in module["BASES"]
           for size in ("full", "small", "mini", "tiny")]
  return {row: module["get_config"](row) for row in names}


@pytest.mark.parametrize("name", config_files.names())
def test_no_average_keeps_the_random_start(name):
  """Below 1 % of what is evaluated, and of the released code's own rows, which begin with a copy, as well."""
  configs = rows_of(name) if name.startswith("ablations/") else sizes_of(name)
  assert not {size: share for size, config in configs.items() if (share := share_of_the_start(config)) > 0.01}


@pytest.mark.parametrize("num_items, steps", [(4_400, 50 * 17), (23_384, 50 * 91), (100, 50)])
def test_steps_come_from_epochs_and_the_number_of_items(num_items, steps):
  config = setup.resolve_epochs(load_config("cdamd_rvq", "kit"), num_items)
  assert config.train.num_steps == steps and config.train.save_every == max(steps // 10, 1)
  assert f"{steps:,} steps of 256 items, 50 epochs of {num_items:,}" in setup.describe_length(config, num_items)


def test_steps_that_are_given_stay():
  config = load_config("cdamd_rvq", "kit").unlock()
  config.train.num_steps = 7
  assert setup.resolve_epochs(config, 4_400) is config
  config.train.update(num_steps=0, num_epochs=0)
  with pytest.raises(ValueError, match="num_steps 0 and train.num_epochs 0, expected one of them above 0"):
    setup.resolve_epochs(config, 4_400)


def test_a_run_that_goes_on_keeps_its_steps():
  config = load_config("cmdm_denoiser", "kit")
  before = setup.resolve_epochs(config, 5_000)
  assert setup.epochs_as_before(config, before).train.num_steps == before.train.num_steps == 500 * 78
  longer = config.copy_and_resolve_references().unlock()
  longer.train.num_epochs = 600
  longer = setup.epochs_as_before(longer, before)
  assert longer.train.num_steps == 0 and longer.train.save_every == before.train.save_every
  assert not list(setup.changes(before.to_dict(), longer.to_dict()))  # --resume goes on
  longer = setup.resolve_epochs(longer, 5_000)
  assert longer.train.num_steps == 600 * 78 and longer.train.save_every == before.train.save_every


@pytest.mark.parametrize("name, size, num_items", [
    ("cmdm_denoiser", "full", 24_000), ("cmdm_denoiser", "kit", 4_400), ("cmdm_denoiser", "snapmogen", 18_000),
    ("cdamd_generator", "mardm_kit", 4_400), ("part_tmr", "kit", 4_400), ("motion_patches", "kit", 4_400)])
def test_the_rate_falls_before_training_ends(name, size, num_items):
  """Of data of any size, where it falls on HumanML3D. It does not in the tokenizers' code on any."""
  config = setup.resolve_epochs(load_config(name, size), num_items)
  rate = make_schedule(config.optimizer, config.train.num_steps)
  peak = max(float(rate(step)) for step in range(0, config.train.num_steps, 1_000))
  assert peak == pytest.approx(config.optimizer.learning_rate, rel=1e-2)
  assert float(rate(config.train.num_steps - 1)) < 0.6 * peak


def test_the_first_lines_of_training_are_readable(tmp_path, monkeypatch, capsys):
  """The config a section a line and how long the run is; no dump of Python objects."""
  def train(config, workdir, *_):
    for name in ("params.safetensors", "metrics.jsonl"):
      (workdir / name).touch()
    return types.SimpleNamespace(step=2)

  monkeypatch.setattr(fit.loop, "train", train)
  config = load_config("cmdm_tokenizer", "tiny").unlock()
  config.train.update(num_steps=0, num_epochs=3, num_saves=2, save_every=0)
  fit.run(config.lock(), tmp_path)
  said = capsys.readouterr().out
  assert "!!" not in said and "  model: causal=True decoder_width=0 dilations=(1) features=263 latent_dim=4" in said
  steps, items = map(int, re.search(r"training: (\d+) steps of 4 items, 3 epochs of (\d+);", said).groups())
  assert steps == 3 * (items // 4) == runs.load_run(tmp_path).config.train.num_steps
