"""A run draws what it makes, after its saves, at the steps that it is asked for, and no picture ends a training."""
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from motion_jax import export, fit, pictures
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion.representations import FULL
from motion_jax.motion.stats import Stats
from motion_jax.training import checkpoint, loop
from motion_jax.training.metrics import read_metrics
from motion_jax.utils.errors import InputError
from tests.conftest import load_config
from tests.training.test_guards import _bad_from, _skipping
from tests.training.test_train import _config, _equal, _killed, _next_batch, _stage

pytestmark = pytest.mark.usefixtures("kept_features")


def _drawing(config, every):
  config.train.sample_every = every
  return config


def _drawer(drawn, folder):
  """A stand-in that notes what it is given, and that the state was saved and the weights written before."""
  def draw(params, path):
    assert list((folder / "checkpoints").iterdir()) and (folder / "params.safetensors").is_file()
    drawn.append((path.name, params))
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"")

  return draw


def test_pictures_come_after_saves_by_the_average_and_once(tmp_path):
  drawn = []
  train = lambda next_batch, **more: loop.train(_drawing(_config(9), 4), tmp_path, _stage(), next_batch,
                                                draw=_drawer(drawn, tmp_path), **more)
  with pytest.raises(MemoryError):
    train(lambda step: _killed(step) if step == 7 else _next_batch(step))
  state = train(_next_batch, resume=True)
  assert [name for name, _ in drawn] == ["step000004.png", "step000008.png", "step000009.png"]
  assert _equal(drawn[-1][1], state.ema_params)


def test_of_what_is_rolled_back_no_picture_is_left(tmp_path):
  drawn = []
  loop.train(_drawing(_skipping(10), 2), tmp_path, _stage(), _bad_from(5), draw=_drawer(drawn, tmp_path))
  names = [name for name, _ in drawn]
  assert names == sorted(path.name for path in (tmp_path / "samples").iterdir()) and len(set(names)) == len(names)


def test_a_picture_that_fails_is_told_and_training_goes_on(tmp_path, capsys):
  def draw(params, path):
    raise RuntimeError("no such colour")

  state = loop.train(_drawing(_config(4), 2), tmp_path, _stage(), _next_batch, draw=draw)
  assert int(state.step) == 4
  said = capsys.readouterr().out
  assert "step000002.png could not be drawn (RuntimeError: no such colour); training continues" in said


def test_a_tokenizers_picture_has_each_window_above_what_comes_back(monkeypatch):
  """Of a tokenizer that returns zeros, a body in one point comes back."""
  features = np.stack([FULL.extract(clip.joints, "benchmark")[:16] for clip in synthetic_clips(num=2, num_frames=20)])
  predict = lambda params, frozen, batch, rng: {"features": 0 * batch["features"]}
  setup = SimpleNamespace(next_batch=lambda step: {"features": features}, stage=SimpleNamespace(predict=predict),
                          stats=Stats(np.zeros(FULL.dim, np.float32), np.ones(FULL.dim, np.float32), FULL))
  saved = []
  monkeypatch.setattr(export, "save", lambda clips, path, **options: saved.extend(clips))
  pictures.drawer(_drawing(load_config("cmdm_tokenizer", "tiny").unlock(), 2), "", setup)({}, "a.png")
  assert [clip.captions[0].text for clip in saved] == ["source", "there and back"] * 2
  assert [clip.joints.max() > 0.5 for clip in saved] == [True, False] * 2


@pytest.mark.slow
@pytest.mark.parametrize("name, rows", [
    ("cmdm_denoiser", 4), pytest.param("cmdm_tokenizer", 8, marks=pytest.mark.exhaustive)])
def test_a_run_shows_what_it_makes(name, rows, tmp_path, capsys, unjudged):
  """Motions of captions, or windows above what comes back; in the report, too."""
  config = _drawing(load_config(name, "tiny").unlock(), 2)
  config.train.num_steps = 2
  fit.run(config, tmp_path)
  assert "could not be drawn" not in capsys.readouterr().out
  image = Image.open(tmp_path / "samples/step000002.png")
  assert image.height == rows * pictures.HEIGHT and np.asarray(image).std() > 5
  assert "data:image/png" in (tmp_path / "report.html").read_text()
  assert not [row for row in read_metrics(tmp_path) if row["step"] > 2] and checkpoint.load_params(tmp_path)


def test_a_stage_that_makes_no_motion_is_told(tmp_path, unjudged):
  with pytest.raises(InputError, match="cdamd.length makes no motion that could be drawn"):
    fit.run(_drawing(load_config("cdamd_length", "tiny").unlock(), 2), tmp_path)
