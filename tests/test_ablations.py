"""Every row of the papers' ablation tables has a config that trains."""
import runpy

import numpy as np
import pytest

from motion_jax import training
from motion_jax.train import read_metrics
from tests.conftest import ROOT

CMDM = runpy.run_path(str(ROOT / "configs" / "ablations" / "cmdm.py"))
CDAMD = runpy.run_path(str(ROOT / "configs" / "ablations" / "cdamd.py"))
# Rows that differ in sampling alone are the default to train.
TRAINED = [(row, stage) for row, (_, changes) in CMDM["ROWS"].items() for stage, change in changes.items()
           if not all(path.startswith("sampler.") for path in change)]

TRAINED_CDAMD = [(row, "generator") for row, (_, _, changes) in CDAMD["ROWS"].items()
                 if not all(path.startswith("sampler.") for path in changes) and row != "no-dcca"]  # "cm" again
TRAINED_CDAMD += [("263", "autoencoder"), ("263", "rvq"), ("67", "autoencoder"), ("67", "rvq")]


def test_every_row_of_cmdms_tables_is_there():
  rows = {table: {row for row, (of, _) in CMDM["ROWS"].items() if of == table} for table in (4, 8, 9, 10, 11)}
  assert rows[4] == {"default", "vae", "c-vae", "one-level", "no-adaln", "no-rope", "no-adaln-no-rope", "ar",
                     "fss-50-1", "fss-50-5", "fss-50-10", "fss-20-1", "fss-20-5", "fss-20-10"}
  assert len(rows[8]) == 5 and len(rows[9]) == 2 and len(rows[10]) == 3 and len(rows[11]) == 3


BOTH = [(CMDM, *pair) for pair in TRAINED] + [(CDAMD, *pair) for pair in TRAINED_CDAMD]


@pytest.mark.parametrize("paper, row, stage", BOTH, ids=["-".join(pair) for pair in TRAINED + TRAINED_CDAMD])
@pytest.mark.slow
def test_rows_train_two_steps(paper, row, stage, tmp_path, unjudged):
  state = training.run(paper["get_config"](f"{row}/{stage}/tiny"), tmp_path)
  assert int(state.step) == 2
  assert np.isfinite([line["loss"] for line in read_metrics(tmp_path) if "loss" in line]).all()


def test_cdamds_rows_are_those_of_its_tables():
  rows = {table: {row for row, (of, *_) in CDAMD["ROWS"].items() if of == table} for table in ("I", "IV", "V")}
  assert rows == {"I": {"default", "one-vq", "all-vq"}, "IV": {"cm", "bcm"},
                  "V": {"no-prior", "no-dcca", "263", "263-no-prior", "263-no-dcca", "67"}}
  loss = lambda row: CDAMD["get_config"](row).loss
  assert [loss(row).prior_levels for row in ("one-vq", "default", "all-vq", "no-prior")] == [1, 2, 4, 0]
  assert [loss(row).mask for row in ("default", "cm", "bcm", "mardm")] == ["dccm", "causal", "bcm", "bidirectional"]


@pytest.mark.parametrize("row", CDAMD["ROWS"])
def test_cdamds_rows_share_the_parts_of_their_representation(row):
  for size in ("full", "small", "mini"):
    config = CDAMD["get_config"](f"{row}/generator/{size}")
    columns = config.tokenizer.features
    home = {66: "default", 263: "263", 67: "67"}[columns]
    assert config.frozen.tokenizer == f"runs/ablations/{home}/autoencoder"
    assert config.frozen.prior == (f"runs/ablations/{home}/rvq" if config.loss.prior_levels else "")
    for stage in ("autoencoder", "rvq"):
      part = CDAMD["get_config"](f"{home}/{stage}/{size}")
      assert (part.model.features, part.data.layout) == (columns, config.data.layout)


@pytest.mark.parametrize("row", CMDM["ROWS"])
def test_rows_at_full_and_small_size_say_where_their_parts_are(row):
  for size in ("full", "small", "mini"):
    config = CMDM["get_config"](f"{row}/denoiser/{size}")
    _, changes = CMDM["ROWS"][row]
    assert config.frozen.tokenizer == f"runs/ablations/{row if 'tokenizer' in changes else 'default'}/tokenizer"
    assert config.model.latent_dim == config.tokenizer.latent_dim


def test_sampling_rows_change_sampling_alone():
  config, base = (CMDM["get_config"](f"{row}/denoiser/full") for row in ("fss-20-5", "default"))
  assert config.sampler.to_dict() == {"num_steps": 20, "lag": 5, "guidance_scale": 3.0}
  with config.unlocked():
    config.sampler = base.sampler
  assert config.to_dict() == base.to_dict()


def test_mistakes_are_told():
  for name, told in (("bcn", "expected one of default"), ("bcm/vae", "autoencoder, rvq, generator"),
                     ("bcm/rvq/big", "full, small, mini, tiny")):
    with pytest.raises(ValueError, match=told):
      CDAMD["get_config"](name)
  for name, told in (("vea", "expected one of default"), ("vae/vae", "teacher, tokenizer, denoiser"),
                     ("vae/tokenizer/big", "full, small, mini or tiny")):
    with pytest.raises(ValueError, match=told):
      CMDM["get_config"](name)
