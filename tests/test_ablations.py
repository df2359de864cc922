"""Every row of the papers' ablation tables has a config that trains."""
import runpy

import numpy as np
import pytest

from motion_jax import training
from motion_jax.train import read_metrics
from tests.conftest import ROOT

CMDM = runpy.run_path(str(ROOT / "configs" / "ablations" / "cmdm.py"))
# Rows that differ in sampling alone are the default to train.
TRAINED = [(row, stage) for row, (_, changes) in CMDM["ROWS"].items() for stage, change in changes.items()
           if not all(path.startswith("sampler.") for path in change)]


def test_every_row_of_cmdms_tables_is_there():
  rows = {table: {row for row, (of, _) in CMDM["ROWS"].items() if of == table} for table in (4, 8, 9, 10, 11)}
  assert rows[4] == {"default", "vae", "c-vae", "one-level", "no-adaln", "no-rope", "no-adaln-no-rope", "ar",
                     "fss-50-1", "fss-50-5", "fss-50-10", "fss-20-1", "fss-20-5", "fss-20-10"}
  assert len(rows[8]) == 5 and len(rows[9]) == 2 and len(rows[10]) == 3 and len(rows[11]) == 3


@pytest.mark.parametrize("row, stage", TRAINED, ids=["-".join(pair) for pair in TRAINED])
@pytest.mark.slow
def test_rows_train_two_steps(row, stage, tmp_path):
  state = training.run(CMDM["get_config"](f"{row}/{stage}/tiny"), tmp_path)
  assert int(state.step) == 2
  assert np.isfinite([line["loss"] for line in read_metrics(tmp_path) if "loss" in line]).all()


@pytest.mark.parametrize("row", CMDM["ROWS"])
def test_rows_at_full_and_small_size_say_where_their_parts_are(row):
  for size in ("full", "small"):
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
  for name, told in (("vea", "expected one of default"), ("vae/vae", "teacher, tokenizer, denoiser"),
                     ("vae/tokenizer/big", "full, small or tiny")):
    with pytest.raises(ValueError, match=told):
      CMDM["get_config"](name)
