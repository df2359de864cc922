"""What training reads of several archives: whose licences agree, and how often each is drawn."""
import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax.configs.shipped import cdamd_small, cmdm_open, cmdm_small, cmdm_small_fast
from motion_jax.data import sources
from motion_jax.data.batches import TextItems, Windows
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion.stats import biased_std
from tests.data.test_build import write_archive


@pytest.fixture(scope="module")
def archives(tmp_path_factory):
  """Folders by their names, each with two clips to train on."""
  folders = {}
  for seed, name in enumerate(("cmu", "bandai", "hdm05", "gameclips")):
    folders[name] = tmp_path_factory.mktemp("data") / name
    write_archive(folders[name], clips=[clip.replace(split="train") for clip in synthetic_clips(seed, 2, 60)])
  return folders


def _config(*folders, **fields):
  return ConfigDict(dict(name="archive", folders=tuple(map(str, folders)), layout="coordinates", mode="corrected",
                         mirror=False, balance=0.0) | fields)


def test_no_model_learns_from_noncommercial_and_sharealike_clips(archives):
  with pytest.raises(ValueError, match=r"got bandai \(NonCommercial\) and hdm05 \(ShareAlike\)"):
    sources.load_items(_config(archives["bandai"], archives["hdm05"]))
  assert len(sources.load_items(_config(archives["cmu"], archives["bandai"], archives["gameclips"]))) == 6
  assert len(sources.load_items(_config(archives["cmu"], archives["hdm05"]))) == 4


@pytest.mark.parametrize("recipe", [cmdm_small, cmdm_open, cmdm_small_fast, cdamd_small])
def test_no_recipe_mixes_them_over_its_passes(recipe):
  names = {name for one in recipe.get_config().passes for name in one.get("archives", ())}
  assert names and not {"bandai", "hdm05"} <= names


def test_clips_of_an_archive_are_drawn_more_seldom(archives):
  """Alike by clips with captions and by windows."""
  config = _config(archives["cmu"], archives["gameclips"], source_weights=(("gameclips", 0.25),))
  data = sources.load_features(config)
  assert data.sources == ["cmu"] * 2 + ["gameclips"] * 2
  items = TextItems(data.features, data.captions, min_frames=40, max_frames=64, lengths=(64,),
                    weights=data.draw_weights(config))
  windows = Windows(data.features, 24, 10, groups=data.groups, factors=data.source_factors(config))
  for drawn in ([i for step in range(40) for i in items.draw(32, 0, step).clip],
                [windows.starts[windows.upto.searchsorted(at / 1000), 0] for at in range(1000)]):
    assert sum(i >= 2 for i in drawn) / len(drawn) == pytest.approx(0.2, abs=0.03)
  assert sources.load_features(_config(archives["cmu"])).draw_weights(_config(archives["cmu"])) is None
  with pytest.raises(ValueError, match="got data.source_weights for 'kaykit', expected one of the archives"):
    data.draw_weights(_config(archives["cmu"], source_weights=(("kaykit", 0.5),)))


def test_an_archive_has_the_share_of_draws_that_the_config_says(archives):
  config = _config(archives["cmu"], archives["gameclips"], source_shares=(("gameclips", 0.25),))
  data = sources.load_features(config)
  weights = data.draw_weights(config)
  assert weights[2:].sum() == pytest.approx(0.25) and weights.sum() == pytest.approx(1)
  for shares, error in (((("kaykit", 0.5),), "got data.source_shares for 'kaykit'"),
                        ((("gameclips", 1.0),), "expected shares above 0, below 1 together")):
    with pytest.raises(ValueError, match=error):
      data.draw_weights(_config(archives["cmu"], source_shares=shares))


def test_statistics_are_those_that_the_config_names():
  """Of each column, of each axis, or with a bias; those of a run that is built upon stay."""
  config = ConfigDict(dict(name="synthetic", num_clips=2, layout="full", mode="corrected"))
  plain = sources.load_features(config)
  frames = np.concatenate(plain.features)
  assert np.abs(frames.mean(0)).max() < 1e-4
  config.feature_bias = 25.0
  np.testing.assert_allclose(sources.load_features(config).stats.std, biased_std(plain.stats.std, 25.0))
  np.testing.assert_array_equal(sources.load_features(config, stats=plain.stats).stats.std, plain.stats.std)
  config.update(layout="coordinates", feature_bias=0.0)
  assert len(np.unique(sources.load_features(config).stats.std)) > 60
  config.per_axis = True
  data = sources.load_features(config)
  assert np.array_equal(data.stats.std, np.tile(data.stats.std[:3], 22))
  assert np.abs(np.concatenate(data.features).reshape(-1, 3).std(0) - 1).max() < 1e-4
