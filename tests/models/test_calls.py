"""What a user sees at the prompt and in a notebook: names, short reprs, a viewer; seeds in every call; errors that say
what to pass, which name was meant, and who has a missing ability."""
import numpy as np
import pytest

import motion_jax as mj
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.loading import load
from motion_jax.models.results import Motion, Motions
from motion_jax_studio import cli

FAST = dict(num_steps=2, lag=1)


@pytest.fixture(scope="module")
def models(tiny_run, random_run):
  """One that streams and one that edits."""
  return load(tiny_run), load(random_run("momask"))


@pytest.fixture(scope="module")
def clip():
  return synthetic_clips(0, 1, num_frames=40)[0]


@pytest.fixture(scope="module")
def motion(clip):
  return Motion(clip.joints, clip.fps, (Caption('a "person" waves & </iframe>'),), id="wave")


def test_dir_lists_what_there_is():
  assert mj.load is load and {"load", "Model", "Motion", "Clip", "export", "motion", "__version__"} <= set(dir(mj))
  for name in dir(mj):
    getattr(mj, name)
  assert mj.__version__.count(".") == 2
  with pytest.raises(AttributeError, match="generate"):
    mj.generate  # noqa: B018


def test_reprs_are_short(motion, clip, models):
  assert repr(motion).startswith("Motion('wave': 40 frames, 2.0 s at 20 a second, 22 joints, ")
  assert repr(clip).startswith("Clip('000000': 40 frames, 2.0 s")
  many = Motions(np.zeros((9, 40, 22, 3)), np.ones((9, 40), bool), np.zeros((9, 40, 263)), (motion,) * 9)
  assert repr(many).startswith("Motions(9:\n  Motion('wave'") and "... 1 more" in repr(many) and len(repr(many)) < 1200
  assert repr(models[0]).startswith("CmdmModel('denoiser': ") and len(repr(models[0])) < 120
  assert repr(models[0].stream("a person walks", **FAST)).startswith("LiveStream('a person walks': 0 frames")


def test_a_notebook_shows_the_viewer(motion):
  """Whole and offline: in a frame of its own, whose page is one attribute that nothing in it can end."""
  shown = motion._repr_html_()
  page = shown[len('<iframe srcdoc="'):shown.index('" width=')]
  assert shown.startswith('<iframe srcdoc="') and '"' not in page and "<" not in page
  assert "&lt;script" in page and "http-equiv" not in page and shown.count("</iframe>") == 1
  both = Motions(motion.joints[None], np.ones((1, 40), bool), np.zeros((1, 40, 263)), (motion,))._repr_html_()
  assert both == shown


@pytest.mark.parametrize("arguments, words", [
    ((5,), "a person waves"), ((None,), "list of them"), (("walks", "x"), "num_frames, expected a number"),
    (("walks", ["x"]), "such as 120"), (dict(seconds="x"), "such as 6.0"), (dict(rng=5), "jax.random.key(5)"),
    (dict(seeds=5), "seeds=[5]"), (dict(seeds=["x"]), "expected an integer"),
    (dict(guidance_scale="x"), "from -100 to 100"),
    (dict(rng=np.zeros((2, 2), np.uint32)), "expected a key")])
def test_the_wrong_type_says_what_to_pass(models, arguments, words):
  given, named = (arguments, {}) if isinstance(arguments, tuple) else (("a person walks",), arguments)
  with pytest.raises(TypeError) as error:
    models[0].generate(*given, **named)
  assert words in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize("folder, words", [(None, "cmdm-small"), (5, "run folder")])
def test_what_is_no_folder_says_what_to_load(folder, words):
  with pytest.raises(TypeError, match=words):
    load(folder)


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


@pytest.mark.slow
def test_seed_and_seeds_are_taken_by_every_call(models, clip):
  """seed alone is that of the first motion, seed + 1 that of the second."""
  model, editor = models
  calls = [lambda **how: model.generate("a person walks", 12, **how, **FAST)[0].joints,
           lambda **how: model.multi_prompts([[("a person walks", 0.6)]], **how, **FAST)[0].joints,
           lambda **how: model.extend(clip, "a person walks", 12, **how, **FAST).joints,
           lambda **how: np.concatenate(list(model.stream("a person walks", num_frames=12, **how, **FAST))),
           lambda **how: editor.edit(clip, "a person waves", "prefix", num_iterations=1, **how).joints]
  for call in calls:
    np.testing.assert_array_equal(call(seed=5), call(seeds=[5]))
    with pytest.raises(ValueError, match="more than one of rng, seeds and seed"):
      call(seed=5, seeds=[5])
    with pytest.raises(TypeError, match="got the seed 'x'"):
      call(seed="x")
  two = model.generate(["a person walks"] * 2, 12, seed=4, **FAST)
  assert [motion.meta["seed"] for motion in two] == [4, 5]


@pytest.mark.parametrize("which, call, name, hint", [
    (0, "generate", "frames", "num_frames"), (0, "generate", "cfg_scale", "guidance_scale"),
    (0, "generate", "num_samples", "seeds"), (0, "generate", "sedes", "seeds"), (0, "stream", "frames", "num_frames"),
    (0, "extend", "duration", "seconds"), (0, "multi_prompt", "guidance", "guidance_scale"),
    (1, "edit", "spans", "change"), (1, "generate", "iterations", "num_iterations")])
def test_wrong_names_get_the_right_hint(models, clip, which, call, name, hint):
  given = {"edit": (clip, "a person waves"), "extend": (clip, "a person walks"),
           "multi_prompt": ([("a person walks", 1.0)],)}.get(call, ("a person walks",))
  with pytest.raises(TypeError, match=rf"has no argument '{name}'; did you mean {hint}\?$"):
    getattr(models[which], call)(*given, **{name: 3})


def test_what_a_model_cannot_do_names_those_that_can(models, clip, tmp_path, capsys, tiny_run):
  model, editor = models
  for call in ("edit", "edits"):
    with pytest.raises(AttributeError, match=r"has no 'edit' \(.*\); cdamd-small has: load such a model"):
      getattr(model, call)
  with pytest.raises(AttributeError, match="has no 'stream' .*; cmdm-open, cmdm-small, cmdm-small-fast have"):
    editor.stream("a person walks")
  with pytest.raises(AttributeError, match="has no attribute 'genrate'"):
    model.genrate("a person walks")
  assert not hasattr(model, "edit") and hasattr(editor, "edit")
  np.save(tmp_path / "in.npy", clip.joints)
  assert cli.main(["edit", str(tmp_path / "in.npy"), "--prompt", "a person waves", "--task", "prefix", "--model",
                   str(tiny_run), "--out", str(tmp_path / "out.npz")]) == 1
  assert "has no 'edit'" in (said := capsys.readouterr().err) and "cdamd-small has" in said
