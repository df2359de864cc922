"""Records hold what the folders hold, are read one clip at a time, and train the same."""
import json
import re
import sys

import numpy as np
import pytest

from motion_jax import fit
from motion_jax.data import doctor, records, sources
from motion_jax.data.datasets import humanml3d
from motion_jax.data.datasets.records import RecordedFeatures
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.utils.errors import InputError
from motion_jax.utils.install import pip_install
from motion_jax_studio import cli
from tests.conftest import load_config

tfds = pytest.importorskip("tensorflow_datasets")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
  """A HumanML3D-layout folder of a few clips, with mirrored ones."""
  out = tmp_path_factory.mktemp("data") / "mine"
  splits = ("train",) * 3 + ("val", "test")
  clips = [clip.replace(split=split) for clip, split in zip(synthetic_clips(5, 5, 70), splits)]
  humanml3d.write_folder(clips, out, "corrected", True)
  return out


@pytest.fixture(scope="module")
def recorded(folder):
  out = folder.parent / "records"
  told = records.write([folder], out)
  assert "train 6" in told and "val 2" in told
  return out


def _config(folder, name="cmdm_denoiser"):
  config = load_config(name, "tiny")
  with config.unlocked():
    config.data.update(name="humanml3d", folder=str(folder), mode="corrected", mirror=False)
  return fit.resolve(config)[0]


def test_they_are_what_the_folder_is(folder, recorded):
  a, b = (sources.load_features(_config(one).data) for one in (folder, recorded))
  assert (a.captions, a.ids, a.groups) == (b.captions, b.ids, b.groups)
  for x, y in zip(a.features, b.features):
    assert isinstance(y, RecordedFeatures) and len(y) == len(x) and y.shape == x.shape
    np.testing.assert_allclose(y[3:20], x[3:20], atol=1e-5)
  np.testing.assert_allclose(a.stats.mean, b.stats.mean, atol=1e-6)


def test_a_part_of_the_features_can_be_read_and_no_other(recorded):
  config = _config(recorded)
  with config.unlocked():
    config.data.layout = "essential"
  data = sources.load_features(config.data)
  assert data.features[0].shape[1] == data.stats.mean.shape[0] == 67
  full = sources.load_features(_config(recorded).data)
  np.testing.assert_allclose(np.asarray(data.features[0]), np.asarray(full.features[0])[:, :67], atol=1e-6)
  with config.unlocked():
    config.data.layout = "snapmogen"
  with pytest.raises(InputError, match="holds 'full' features, this config reads 'snapmogen'; make the records again"):
    sources.load_features(config.data)


def test_other_programs_read_them(recorded):
  found = tfds.builder_from_directory(str(recorded / "motions/1.0.0")).as_data_source(split="train")
  index = json.loads((recorded / "index.json").read_text())["splits"]["train"]
  assert [one["id"].decode() if isinstance(one["id"], bytes) else one["id"] for one in found] == [
      row["id"] for row in index]
  assert [one["features"].shape for one in found] == [(row["frames"], 263) for row in index]


@pytest.mark.slow
def test_the_doctor_and_the_command_line(folder, recorded, tmp_path, capsys):
  report = doctor.examine(recorded)
  assert report.ok and "records" in doctor.format_report(report)
  assert not cli.main(["data", "records", str(folder), "--out", str(tmp_path / "out"), "--layout", "coordinates"])
  assert "clips of coordinates features" in capsys.readouterr().out
  assert not cli.main(["train", "--config", "cdamd_autoencoder:tiny", "--data", str(tmp_path / "out"), "--workdir",
                       str(tmp_path / "run")])
  assert cli.main(["data", "records", str(folder), "--out", str(tmp_path / "out")])
  assert "exists already" in capsys.readouterr().err


def test_without_the_package_it_says_what_to_install(folder, tmp_path, monkeypatch):
  monkeypatch.setitem(sys.modules, "tensorflow_datasets", None)
  with pytest.raises(InputError, match=re.escape(pip_install("data"))):
    records.write([folder], tmp_path / "out")
  assert not (tmp_path / "out").exists()
