"""What a user sees at the prompt and in a notebook: names, short reprs, a viewer, errors that say what to pass."""
import jax
import numpy as np
import pytest

import motion_jax as mj
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.loading import load
from motion_jax.models.results import Motion, Motions


@pytest.fixture(scope="module")
def motion():
  clip = synthetic_clips(0, 1, num_frames=40)[0]
  return Motion(clip.joints, clip.fps, (Caption('a "person" waves & </iframe>'),), id="wave")


def test_dir_lists_what_there_is():
  assert {"load", "Model", "Motion", "Clip", "export", "motion", "__version__"} <= set(dir(mj))
  for name in dir(mj):
    getattr(mj, name)
  assert mj.__version__.count(".") == 2


def test_reprs_are_short(motion, tiny_run):
  assert repr(motion).startswith("Motion('wave': 40 frames, 2.0 s at 20 a second, 22 joints, ")
  assert repr(synthetic_clips(0, 1, num_frames=40)[0]).startswith("Clip('000000': 40 frames, 2.0 s")
  many = Motions(np.zeros((9, 40, 22, 3)), np.ones((9, 40), bool), np.zeros((9, 40, 263)), (motion,) * 9)
  assert repr(many).startswith("Motions(9:\n  Motion('wave'") and "... 1 more" in repr(many) and len(repr(many)) < 1200
  model = load(tiny_run)
  assert repr(model).startswith("CmdmModel('denoiser': ") and "M parameters" in repr(model) and len(repr(model)) < 120
  assert repr(model.stream("a person walks", num_steps=2, lag=1)).startswith("LiveStream('a person walks': 0 frames")


def test_a_notebook_shows_the_viewer(motion):
  """Whole and offline: in a frame of its own, whose page is one attribute that nothing in it can end."""
  shown = motion._repr_html_()
  page = shown[len('<iframe srcdoc="'):shown.index('" width=')]
  assert shown.startswith('<iframe srcdoc="') and '"' not in page and "<" not in page
  assert "&lt;script" in page and "http-equiv" not in page and shown.count("</iframe>") == 1
  both = Motions(motion.joints[None], np.ones((1, 40), bool), np.zeros((1, 40, 263)), (motion,))._repr_html_()
  assert both == shown


def test_the_wrong_type_says_what_to_pass(tiny_run):
  model = load(tiny_run)
  for act, words in ((lambda: model.generate(5), "a person waves"), (lambda: model.generate(None), "list of them"),
                     (lambda: model.generate("a person walks", num_frames="x"), "num_frames, expected a number"),
                     (lambda: model.generate("a person walks", num_frames=[20, "x"][1:]), "such as 120"),
                     (lambda: model.generate("a person walks", seconds="x"), "such as 6.0"),
                     (lambda: model.generate("a person walks", num_frames=20, rng=5), "jax.random.key(5)"),
                     (lambda: model.generate("a person walks", num_frames=20, seeds=5), "seeds=[5]"),
                     (lambda: model.generate("a person walks", num_frames=20, seeds=["x"]), "expected an integer"),
                     (lambda: model.generate("a person walks", 20, guidance_scale="x"), "such as 3"),
                     (lambda: load(None), "cmdm-small"), (lambda: load(5), "run folder")):
    with pytest.raises(TypeError) as error:
      act()
    assert words in str(error.value) and "\n" not in str(error.value)
  with pytest.raises(TypeError, match="expected a key"):
    model.generate("a person walks", num_frames=20, rng=jax.random.split(jax.random.key(0), 2))


def test_a_part_of_a_clip():
  clip = Clip(np.arange(100 * 66.0).reshape(100, 22, 3), captions=(
      Caption("walks", 0.0, 2.0), Caption("sits", 2.0, 5.0), Caption("all of it")), features=np.arange(99)[:, None])
  part = clip.cut(30, 70)
  assert part.num_frames == 40 and (part.joints == clip.joints[30:70]).all()
  assert (part.features == clip.features[30:70]).all()
  assert part.captions == (Caption("walks", 0.0, 0.5), Caption("sits", 0.5, 2.0), Caption("all of it"))
  assert [caption.text for caption in clip.cut(0, 20).captions] == ["walks", "all of it"]
  for first, past in ((5, 5), (-1, 5), (0, 101)):
    with pytest.raises(ValueError, match="expected at least one"):
      clip.cut(first, past)
