"""Recipes of the shipped models: their passes fit one another, train end to end, and continue where they stopped."""
import pathlib
import string

import jax
import numpy as np
import pytest

from motion_jax import fit, runs
from motion_jax.data import sources
from motion_jax.training import checkpoint
from motion_jax.utils import config_files, stopping
from motion_jax.utils.errors import InputError
from tests.configs.test_tiny_sizes import traced_training
from tests.conftest import light_training, load_config, some_of

RECIPES = config_files.recipes()


def _references(one):
  """The names of the passes that a pass refers to."""
  texts = [value for value in one.get("fields", {}).values() if isinstance(value, str)] + list(one.get("runs", ()))
  return {name for text in texts for _, name, *_ in string.Formatter().parse(text) if name}


def test_each_shipped_model_has_a_recipe():
  assert {pathlib.PurePath(name).name.replace("_", "-") for name in RECIPES} == set(runs.shipped_names())


@pytest.mark.parametrize("name", RECIPES)
@pytest.mark.parametrize("size", ["small", "tiny"])
def test_passes_name_earlier_ones_and_fields_that_exist(name, size):
  config, before = config_files.load(f"{name}:{size}"), []
  for one in config.passes:
    assert _references(one) <= set(before) and one["name"] not in before
    if "combine" in one:
      assert one["combine"] in runs.COMBINATIONS
    else:
      found = fit.config_of_pass(one, {earlier: f"runs/{earlier}" for earlier in before}, "archives")
      assert list(found.data.folders) == [f"archives/{archive}" for archive in one["archives"]]
    before.append(one["name"])


@pytest.mark.parametrize("name", [recipe for recipe in RECIPES if "cmdm_small" in recipe or "cdamd" in recipe
                                  or "open" in recipe])
def test_the_last_pass_makes_the_network_that_ships(name):
  """Its sizes, its tokenizer's, and how it is sampled; the weights may have been trained by an older recipe."""
  shipped = runs.load_run(name.rpartition("/")[2].replace("_", "-")).config.to_dict()
  one = config_files.load(name).passes[-1]
  made = fit.config_of_pass(one, dict.fromkeys((one["name"] for one in config_files.load(name).passes), "")).to_dict()
  assert made["sampler"].items() <= shipped["sampler"].items()
  assert {key: value for key, value in shipped["model"].items() if key != "control"} == {
      key: value for key, value in made["model"].items() if key != "control"}
  assert {key: tuple(value) if isinstance(value, list) else value for key, value in shipped["tokenizer"].items()} == (
      made["tokenizer"])


def finished(config, workdir, *args):
  """In the place of `train.train`: what a run leaves when it is finished, its step only traced."""
  state = traced_training(config, workdir, *args)
  (workdir / "checkpoints" / str(config.train.num_steps)).mkdir(parents=True)
  (workdir / "loss.png").touch()
  return state


@pytest.mark.parametrize("name", some_of(RECIPES, quick=["shipped/clip_evaluator_small"],
                                         slow=["shipped/cmdm_small"]))
def test_the_passes_of_a_recipe_fit_each_other(name, tmp_path, capsys, monkeypatch):
  """Each takes the folders of those before it and its share of the time; a finished recipe has nothing left to do."""
  monkeypatch.setattr(fit.loop, "train", finished)
  config = config_files.load(f"{name}:tiny").unlock()
  config.seconds = 100.0
  fit.run(config, tmp_path / "run")
  shares = {one["name"]: one["share"] for one in config.passes if one.get("share")}
  for one in config.passes:
    assert (tmp_path / "run" / one["name"] / checkpoint.PARAMS).is_file(), one["name"]
    seconds = checkpoint.load_config(tmp_path / "run" / one["name"]).train.seconds
    assert "config" not in one or seconds == 100 * shares.get(one["name"], 0) / max(sum(shares.values()), 1)
  capsys.readouterr()
  fit.run(config, tmp_path / "run", resume=True)
  assert capsys.readouterr().out.count(" is finished") == sum("config" in one for one in config.passes)


@pytest.mark.slow
def test_a_recipe_continues_in_the_pass_that_was_stopped(tmp_path, capsys):
  """Stopped in the first of two passes; a folder with passes in it is not begun again."""
  config = config_files.load("shipped/evaluator_small:tiny")
  with light_training(judged=True):
    fit.run(config, tmp_path / "run", max_seconds=1e-6, stop=stopping.Stop())
    assert not (tmp_path / "run" / "evaluator").exists()
    assert checkpoint.load_config(tmp_path / "run" / "movement").train.num_steps == 2
    with pytest.raises(ValueError, match="is there already; --resume continues the recipe"):
      fit.run(config, tmp_path / "run")
    capsys.readouterr()
    fit.run(config, tmp_path / "run", resume=True)
  assert "starting" not in capsys.readouterr().out.partition("pass 2")[0]
  assert (tmp_path / "run" / "evaluator" / checkpoint.PARAMS).is_file()


def test_the_mean_of_two_runs(tmp_path):
  run = runs.load_run("cmdm-small-fast")
  runs.average("cmdm-small-fast", "cmdm-small", tmp_path / "mean")
  mean, one, other = (runs.load_run(name).params() for name in (tmp_path / "mean", "cmdm-small-fast", "cmdm-small"))
  jax.tree.map(lambda m, a, b: np.testing.assert_allclose(m, (a + b) / 2, rtol=1e-6), mean, one, other)
  assert runs.load_run(tmp_path / "mean").stage == run.stage
  with pytest.raises(InputError, match="is there already"):
    runs.average("cmdm-small-fast", "cmdm-small", tmp_path / "mean")


def test_passes_on_the_same_data_make_its_features_once():
  data = load_config("cmdm_tokenizer", "tiny").data
  with sources.keep_features():
    train = sources.load_features(data)
    assert sources.load_features(data, stats=train.stats) is train
    val = sources.load_features(data, "val", train.stats)
    assert sources.load_features(data, "val", train.stats, False) is val and val is not train
  assert sources.load_features(data) is not train, "only while it lasts"
