"""A run folder is found and loaded in one place; fields that its config leaves out have defaults."""
import json
import shutil

import jax
import pytest

from motion_jax import fit, runs
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint
from motion_jax.utils.errors import InputError
from tests.conftest import ROOT, load_config

CONFIGS = sorted(path.stem for path in (ROOT / "configs").glob("*.py") if path.stem not in ("common", "__init__"))


def strip(config):
  """The dict of a config without the fields that have the values of `runs.DEFAULTS`."""
  fields = config.to_dict()
  for path in {**runs.DEFAULTS[""], **runs.DEFAULTS[config.stage]}:
    section, _, field = path.rpartition(".")
    place = fields[section] if section else fields
    value = place.pop(field)
    new = runs.with_defaults(type(config)(fields)).to_dict()
    if (new[section] if section else new)[field] != value:  # the config's own choice
      place[field] = value
  return fields


@pytest.mark.parametrize("name", CONFIGS)
def test_a_config_without_the_fields_that_have_defaults_is_the_same(name):
  config = load_config(name, "full")
  old = type(config)(strip(config))
  fields = old.to_dict()
  new = runs.with_defaults(old.lock())
  assert new.is_locked and old.to_dict() == fields and runs.with_defaults(new) == new
  assert new.to_dict() == config.to_dict() == runs.with_defaults(config).to_dict()


@pytest.mark.slow
def test_a_run_without_them_is_resumed(tiny_run, tmp_path, capsys):
  folder, config = shutil.copytree(tiny_run, tmp_path / "run"), load_config("cmdm_denoiser", "tiny").unlock()
  (folder / "config.json").write_text(json.dumps(strip(checkpoint.load_config(folder))))
  config.train.num_steps = 3
  fit.run(config.lock(), folder, resume=True)
  assert "at step 3" in capsys.readouterr().out
  config.unlock().loss.level_block = 1
  with pytest.raises(ValueError, match="--resume with another loss"):
    fit.run(config.lock(), folder, resume=True)
  fit.run(config, folder, resume=True, allow_changes=True)  # it is at its end already
  assert "continues with other settings: loss.level_block was" in capsys.readouterr().out


def test_runs_that_ship_open_by_name_and_by_folder():
  assert {"cmdm-small", "cdamd-small"} <= set(runs.shipped_names())
  for name in runs.shipped_names():
    run = runs.load_run(name)
    assert run.folder == runs.resolve_run(run.folder) == runs.PRETRAINED / name
    assert run.stage == run.config.stage and len(run.stats.mean) == run.stats.layout.dim and run.params()
    assert run.config == runs.with_defaults(run.config)


def test_what_is_no_run_or_another_one_is_told(tmp_path):
  with pytest.raises(FileNotFoundError, match=r"neither a run folder 'cmdm-smal' \(did you mean cmdm-small\?\) nor "):
    runs.load_run("cmdm-smal")
  with pytest.raises(FileNotFoundError, match="that ships: part-tmr-small"):
    runs.load_run(tmp_path / "none", "tmr.teacher")
  with pytest.raises(TypeError, match=r"got 3 \(int\) to load, expected a run folder"):
    runs.load_run(3)
  with pytest.raises(InputError, match="cmdm-small holds a 'cmdm.denoiser' run, expected one of stage tmr.teacher"):
    runs.load_run("cmdm-small", "tmr.teacher")
  (tmp_path / "config.json").write_text("{}")
  with pytest.raises(InputError, match="holds a NoneType as the stage of a run"):
    runs.load_run(tmp_path)


@pytest.mark.parametrize("features", [262, 264])
def test_a_network_of_another_width_than_the_layout_is_refused(features):
  config = load_config("cmdm_denoiser", "tiny").unlock()
  config.tokenizer.features = features
  with pytest.raises(InputError, match=f"tokenizer.features = {features}, layout 'full' has 263 numbers a frame"):
    fit.resolve(config)


def test_a_model_that_ships_may_share_anothers_tokenizer_and_words(tmp_path):
  ours, theirs = runs.load_run("cmdm-small-fast"), runs.load_run("cmdm-small")
  assert not (ours.folder / "frozen.safetensors").is_file() and not (ours.folder / "text_encoder").is_dir()
  assert jax.tree.all(jax.tree.map(lambda a, b: (a == b).all(), ours.frozen(), theirs.frozen()))
  encoder = load_text_encoder("cmdm-small-fast")
  assert encoder.fingerprint == load_text_encoder("cmdm-small").fingerprint == ours.fingerprint
  shutil.copytree(ours.folder, tmp_path / "copy")  # a copy of it elsewhere finds them, too
  assert runs.load_run(tmp_path / "copy").frozen().keys() == theirs.frozen().keys()
  (shutil.copytree(theirs.folder, tmp_path / "damaged") / "frozen.safetensors").unlink()
  with pytest.raises(FileNotFoundError, match="damaged"):
    runs.load_run(tmp_path / "damaged").frozen()


@pytest.mark.parametrize("name", ["a" * 300, "a\0b", "x/" * 3000])
def test_a_name_that_no_folder_has(name):
  with pytest.raises(FileNotFoundError, match="found neither a run folder") as error:
    runs.resolve_run(name)
  assert len(str(error.value)) < 600
