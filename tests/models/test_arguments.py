"""Calls of a model: seed and seeds in each, wrong names get the right hint, a missing ability names who has it."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.loading import load
from motion_studio import cli


@pytest.fixture(scope="module")
def models(tiny_run, tiny_generator):
  return load(tiny_run), load(tiny_generator)


def test_seed_and_seeds_are_taken_by_every_call(models):
  """seed alone is that of the first motion, seed + 1 that of the second."""
  model, editor = models
  clip = synthetic_clips(0, 1, num_frames=40)[0]
  fast = dict(num_steps=2, lag=1)
  calls = [lambda **how: model.generate("a person walks", 12, **how, **fast)[0].joints,
           lambda **how: model.multi_prompt([("a person walks", 0.6)], **how, **fast).joints,
           lambda **how: model.multi_prompts([[("a person walks", 0.6)]], **how, **fast)[0].joints,
           lambda **how: model.extend(clip, "a person walks", 12, **how, **fast).joints,
           lambda **how: np.concatenate(list(model.stream("a person walks", num_frames=12, **how, **fast))),
           lambda **how: editor.edit(clip, "a person waves", "prefix", num_iterations=1, num_steps=1,
                                     **how).joints]
  for call in calls:
    np.testing.assert_array_equal(call(seed=5), call(seeds=[5]))
    with pytest.raises(ValueError, match="more than one of rng, seeds and seed"):
      call(seed=5, seeds=[5])
    with pytest.raises(TypeError, match="got the seed 'x'"):
      call(seed="x")
  one, two = model.generate(["a person walks"] * 2, 12, seed=4, **fast)
  assert (one.meta["seed"], two.meta["seed"]) == (4, 5)


@pytest.mark.parametrize("which, call, name, hint", [
    (0, "generate", "frames", "num_frames"), (0, "generate", "duration", "seconds"),
    (0, "generate", "cfg_scale", "guidance_scale"), (0, "generate", "steps", "num_steps"),
    (0, "generate", "num_samples", "seeds"), (0, "generate", "sedes", "seeds"), (0, "stream", "frames", "num_frames"),
    (0, "extend", "duration", "seconds"), (0, "multi_prompt", "guidance", "guidance_scale"),
    (1, "edit", "spans", "change"),
    (1, "generate", "iterations", "num_iterations")])
def test_wrong_names_get_the_right_hint(models, which, call, name, hint):
  clip = synthetic_clips(0, 1, num_frames=40)[0]
  given = {"edit": (clip, "a person waves"), "edits": ([clip], ["a person waves"]), "extend": (clip, "a person walks"),
           "multi_prompt": ([("a person walks", 1.0)],)}.get(call, ("a person walks",))
  with pytest.raises(TypeError, match=rf"has no argument '{name}'; did you mean {hint}\?$"):
    getattr(models[which], call)(*given, **{name: 3})


def test_what_a_model_cannot_do_names_those_that_can(models, tmp_path, capsys, tiny_run):
  model, editor = models
  for call in ("edit", "edits"):
    with pytest.raises(AttributeError, match=r"has no 'edit' \(.*\); cdamd-small has: load such a model"):
      getattr(model, call)
  with pytest.raises(AttributeError, match="has no 'stream' .*; cmdm-open, cmdm-small, cmdm-small-fast have"):
    editor.stream("a person walks")
  with pytest.raises(AttributeError, match="has no attribute 'genrate'"):
    model.genrate("a person walks")
  assert not hasattr(model, "edit") and hasattr(editor, "edit")
  np.save(tmp_path / "in.npy", synthetic_clips(0, 1, num_frames=40)[0].joints)
  assert cli.main(["edit", str(tmp_path / "in.npy"), "--prompt", "a person waves", "--task", "prefix", "--model",
                   str(tiny_run), "--out", str(tmp_path / "out.npz")]) == 1
  assert "has no 'edit'" in (said := capsys.readouterr().err) and "cdamd-small has" in said
