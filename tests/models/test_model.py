"""A run folder is all it takes; a motion depends on its prompt, length and seed, not on its neighbours."""
import json
import shutil
import warnings

import jax
import numpy as np
import pytest

import motion_jax as mj
from motion_jax.control.compiling import compile
from motion_jax.control.constraints import RootPath
from motion_jax.loading import load
from motion_jax.models.base import keys_of
from motion_jax.motion.representations import to_joints
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax.training import checkpoint
from tests.conftest import load_config


@pytest.fixture(scope="module")
def model(tiny_run):
  return load(tiny_run)


def test_shapes_and_what_a_motion_knows(model):
  motions = model.generate(["a person walks", "a person waves"], num_frames=[30, 47], seeds=[3, 4], cleanup=False)
  assert motions.joints.shape == (2, 47, 22, 3) and motions.frame_mask.sum(1).tolist() == [30, 47]
  assert (motions.joints[0, 30:] == 0).all()
  first = motions[0]
  assert first.joints.shape == (30, 22, 3) and first.features.shape == (30, 263) and first.fps == 20
  assert first.captions[0].text == "a person walks" and first.meta["seed"] == 3 and first.meta["model"] == model.id
  assert np.allclose(to_joints(first.features), first.joints, atol=1e-5)


def test_a_motion_does_not_know_its_batch_mates_nor_its_end(model):
  """Alone, in a batch and as the start of a longer one: the same motion."""
  alone = model.generate("a person waves", num_frames=40, seeds=[5])[0].joints
  batch = model.generate(["a person runs", "a person waves"], num_frames=[47, 40], seeds=[1, 5])[1].joints
  assert np.abs(alone - batch).max() < 1e-5
  raw = lambda frames: model.generate("a person waves", num_frames=frames, seeds=[5], cleanup=False)[0].joints
  assert np.abs(raw(40) - raw(100)[:40]).max() < 1e-5
  other = model.generate("a person waves", num_frames=40, seeds=[6])[0].joints
  assert np.abs(alone - other).max() > 1e-4


def test_rng_key_gives_each_prompt_its_own(model):
  key = jax.random.key(0)
  two = model.generate(["a person waves"] * 2, num_frames=47, rng=key)
  assert np.abs(two.joints[0] - two.joints[1]).max() > 1e-4
  assert (model.generate(["a person waves"] * 2, num_frames=47, rng=key).joints == two.joints).all()


@pytest.mark.parametrize("cleanup, lengths", [(False, [12] * 8 + [4]), (True, [2] + [12] * 7 + [14])])
def test_stream_is_generate(model, cleanup, lengths):
  whole = model.generate("a person walks", num_frames=100, seeds=[2], cleanup=cleanup)[0].joints
  parts = list(model.stream("a person walks", seed=2, num_frames=100, cleanup=cleanup))
  assert [len(part) for part in parts] == lengths
  assert np.abs(np.concatenate(parts) - whole).max() < 1e-4


def test_cleaned_up_motion_has_canonical_bones(model):
  joints = model.generate("a person walks", num_frames=40, seeds=[0], cleanup=True)[0].joints
  assert np.abs(bone_lengths(joints, HUMANML3D) - HUMANML3D.bone_lengths).max() < 1e-3


@pytest.mark.parametrize("schedule", ["ar", "full"])
def test_other_schedules(model, schedule):
  joints = model.generate("a person walks", num_frames=24, seeds=[0], schedule=schedule, num_steps=6)[0].joints
  assert np.isfinite(joints).all()


def test_guidance_changes_the_motion_and_scale_one_needs_no_second_branch(model):
  make = lambda scale: model.generate("a person walks", num_frames=40, seeds=[0], guidance_scale=scale)[0].joints
  one, three = make(1.0), make(3.0)
  assert np.isfinite(one).all() and np.abs(make(1.0000001) - one).max() < 1e-4
  assert np.isfinite(three).all()


def test_reconstruct(model):
  features = model.generate("a person walks", num_frames=40, seeds=[0])[0].features
  assert model.reconstruct(features).shape == (40, 263)


@pytest.mark.parametrize("arguments, words", [
    (dict(prompts="", num_frames=20), "say what the person does"),
    (dict(prompts="   ", num_frames=20), "say what the person does"),
    (dict(prompts=[], num_frames=20), "no prompt"),
    (dict(prompts=["a", 3], num_frames=20), "got the prompt 3"),
    (dict(prompts="walk", num_frames=0), "length of 0"),
    (dict(prompts="walk", num_frames=-5), "length of -5"),
    (dict(prompts="walk", seconds=1e9), "expected"),
    (dict(prompts="walk", seconds=float("nan")), "nan"),
    (dict(prompts="walk", num_frames=20, seconds=1), "one of them"),
    (dict(prompts=["walk", "run"], num_frames=[20]), "1 lengths for 2"),
    (dict(prompts="walk", num_frames=20, seeds=[1, 2]), "2 seeds for 1"),
    (dict(prompts="walk", num_frames=20, schedule="pyramid"), "fss, ar, full"),
    (dict(prompts="walk", num_frames=20, guidance_scale=float("inf")), "from -100 to 100"),
    (dict(prompts="walk", num_frames=20, lag=99), "lag 99"),
    (dict(prompts="walk", num_frames=20, lag=0), "lag 0"),
    (dict(prompts="walk", num_frames=20, num_steps=0), "num_steps 0"),
    (dict(prompts="walk", num_frames=20, num_steps=4294967295), "num_steps 4294967295, expected .* 1 to 1,000"),
    (dict(prompts="walk", num_frames=20, context=10**20), "context 1000.*, expected .* from 1 to 18,000"),
    (dict(prompts="walk", num_frames=20, seeds=[2**40]), "seed 1099511627776, expected"),
    (dict(prompts="walk", num_frames=10**400), "length of inf frames"),
    (dict(prompts="walk", seconds=1e308), "length of inf frames"),
    (dict(prompts="wal\udcff", num_frames=20), "no UTF-8 text"),
    (dict(prompts="walk " * 5000, num_frames=20), "prompt of 25,000 characters, expected at most 5,000"),
])
def test_bad_input_is_told(model, arguments, words):
  with pytest.raises(ValueError, match=words):
    model.generate(**arguments)


def test_a_stream_checks_its_input_too(model):
  for arguments in (dict(prompt=""), dict(prompt="walk", num_frames=0), dict(prompt="walk", guidance_scale=np.nan)):
    with pytest.raises(ValueError):
      next(model.stream(**arguments))


def test_broken_run_folders_are_told(tiny_run, tiny_generator, tmp_path):
  with pytest.raises(FileNotFoundError, match="neither a run folder"):
    load(tmp_path / "nothing")
  for name, error, words in (("config.json", FileNotFoundError, "config.json"),
                             ("params.safetensors", FileNotFoundError, "params.safetensors"),
                             ("frozen.safetensors", FileNotFoundError, "frozen.safetensors"),
                             ("Mean.npy", FileNotFoundError, "Mean.npy")):
    copy = tmp_path / name.replace(".", "_")
    shutil.copytree(tiny_run, copy, ignore=shutil.ignore_patterns("checkpoints"))
    (copy / name).unlink()
    with pytest.raises(error, match=words):
      load(copy)
  copy = tmp_path / "wrong"
  shutil.copytree(tiny_run, copy, ignore=shutil.ignore_patterns("checkpoints"))
  np.save(copy / "Mean.npy", np.zeros(67, np.float32))
  with pytest.raises(ValueError, match="67"):
    load(copy)
  shutil.copyfile(tiny_run / "Mean.npy", copy / "Mean.npy")
  config = json.loads((copy / "config.json").read_text())
  config["model"]["width"] = 32
  (copy / "config.json").write_text(json.dumps(config))
  with pytest.raises(ValueError, match="does not fit its config"):
    load(copy)
  shutil.copyfile(tiny_generator / "params.safetensors", copy / "params.safetensors")
  with pytest.raises(ValueError, match="of which 0 are among the .* the weights of another network, method or version"):
    load(copy)
  shutil.copyfile(tiny_run / "params.safetensors", copy / "params.safetensors")
  config["model"]["width"] = 16
  (copy / "config.json").write_text(json.dumps(config))
  (copy / "text.json").write_text(json.dumps({"name": "random-init", "fingerprint": "0"}))
  with pytest.raises(ValueError, match="another version of the text encoder"):
    load(copy)
  (copy / "config.json").write_text("{")
  with pytest.raises(ValueError, match="no valid JSON"):
    load(copy)


def test_a_tokenizer_run_cannot_generate(tiny_run, tmp_path):
  folder = shutil.copytree(tiny_run, tmp_path / "run", ignore=shutil.ignore_patterns("checkpoints"))
  checkpoint.save_config(folder, load_config("cmdm_tokenizer", "tiny"))
  with pytest.raises(ValueError, match="cmdm.denoiser"):
    load(folder)


def test_top_level_names():
  assert mj.load is load and mj.Clip and mj.export and mj.nets
  with pytest.raises(AttributeError, match="it has"):
    mj.generate  # noqa: B018


def test_a_length_that_is_not_given_is_six_seconds(model):
  assert model.frames_of(["a person walks"], None, None) == [120] == [model.default_frames("a person walks")]
  assert model.generate("a person walks", seed=0, num_steps=2, lag=1)[0].num_frames == 120


def test_generate_is_one_pass_of_the_prompt_as_given(model):
  """Two actions are one prompt, a strange word warns nobody, and nothing is cleaned up."""
  prompt = "a flibbertigibbet walks, then waves twice"
  with warnings.catch_warnings():
    warnings.simplefilter("error")
    made = model.generate(prompt, 40, seed=3)[0]
  keys, seeds = keys_of(None, [3], 1)
  np.testing.assert_array_equal(made.joints, model.sample([prompt], [40], keys, seeds, False, {})[0].joints)
  assert [one.text for one in made.captions] == [prompt] and made.meta["cleanup"] is False
  assert "attempts" not in made.meta and "understood" not in made.meta


@pytest.mark.slow
def test_control_guides_and_does_not_project(model):
  """The motion begins where its path does; how near it comes is the network's."""
  path = RootPath([[1, 0], [1.5, 0.5], [2.5, 0.5]])
  guided = model.generate(["a person walks", "a person waves"], 36, seeds=[3, 4], control=[[path], None])
  plain = model.generate("a person waves", 36, seeds=[4])
  assert np.abs(guided.joints[0, 0, 0, [0, 2]] - [1, 0]).max() < 0.05
  way = compile([path], 36).positions[0, :, 0]
  assert 1e-3 < np.abs(guided.joints[0, :, 0] - way)[:, [0, 2]].max()
  np.testing.assert_allclose(guided.joints[1], plain.joints[0], atol=1e-4)
