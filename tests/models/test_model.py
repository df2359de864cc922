"""A run folder is all it takes; a motion depends on its prompt, length and seed, not on its neighbours."""
import json
import shutil
import subprocess
import sys
import warnings

import jax
import numpy as np
import pytest

from motion_jax.control.compiling import compile
from motion_jax.control.constraints import RootPath
from motion_jax.loading import load
from motion_jax.models.keys import keys_of, random_keys, select_keys
from motion_jax.motion.representations import to_joints
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax.training import checkpoint
from motion_jax.utils.numerals import SEEDS
from tests.conftest import ROOT, load_config


@pytest.fixture(scope="module")
def model(tiny_run):
  """With random weights: gates that begin at 0 would let any mistake pass."""
  loaded, draw = load(tiny_run), np.random.default_rng(0)
  loaded.params = jax.tree.map(lambda a: a + 0.1 * draw.standard_normal(a.shape, np.float32), loaded.params)
  return loaded


@pytest.fixture(scope="module")
def motions(model):
  return model.generate(["a person walks", "a person waves"], num_frames=[30, 47], seeds=[3, 4], cleanup=False)


def test_shapes_and_what_a_motion_knows(model, motions):
  assert motions.joints.shape == (2, 47, 22, 3) and motions.frame_mask.sum(1).tolist() == [30, 47]
  assert (motions.joints[0, 30:] == 0).all()
  first = motions[0]
  assert first.joints.shape == (30, 22, 3) and first.features.shape == (30, 263) and first.fps == 20
  assert first.captions[0].text == "a person walks" and first.meta["seed"] == 3 and first.meta["model"] == model.id
  assert np.allclose(to_joints(first.features), first.joints, atol=1e-5)


def test_a_motion_does_not_know_its_batch_mates_nor_its_end(model):
  """Alone, in a batch and, but for a last block that is not whole, as the start of a longer one: the same motion. Scale
  1 is a network without guidance."""
  make = lambda frames, seed, **sampling: model.generate("a person waves", frames, seeds=[seed], **sampling)[0].joints
  alone = make(40, 5)
  batch = model.generate(["a person runs", "a person waves"], num_frames=[47, 40], seeds=[1, 5])[1].joints
  assert np.abs(alone - batch).max() < 1e-5
  assert np.abs(alone[:36] - make(100, 5)[:36]).max() < 1e-5 and np.abs(alone - make(40, 6)).max() > 1e-4
  unguided = make(40, 5, guidance_scale=1.0)
  assert np.abs(make(40, 5, guidance_scale=1.0000001) - unguided).max() < 1e-4 < np.abs(unguided - alone).max()


def test_a_key_gives_each_prompt_its_own(model):
  """Random keys made in numpy are those of JAX, of any seed and of the old kind."""
  key = jax.random.key(0)
  two = model.generate(["a person waves"] * 2, num_frames=47, rng=key)
  assert np.abs(two.joints[0] - two.joints[1]).max() > 1e-4
  assert (model.generate(["a person waves"] * 2, num_frames=47, rng=key).joints == two.joints).all()
  seeds = [0, 1, -1, 2**31 - 1, 2**31, -2**31, SEEDS[1], -SEEDS[1]]
  keys = random_keys(seeds)
  expected = np.stack([jax.random.key_data(jax.random.key(seed)) for seed in seeds])
  np.testing.assert_array_equal(jax.random.key_data(keys), expected)
  assert keys.dtype == key.dtype
  np.testing.assert_array_equal(jax.random.key_data(select_keys(keys, [2, 0])), expected[[2, 0]])
  old = jax.device_put(expected)
  np.testing.assert_array_equal(select_keys(old, [2, 0]), expected[[2, 0]])


def test_a_cleaned_up_stream_is_the_motion_on_canonical_bones(model):
  whole = model.generate("a person walks", num_frames=64, seeds=[2], cleanup=True)[0].joints
  parts = list(model.stream("a person walks", seed=2, num_frames=64, cleanup=True))
  assert [len(part) for part in parts] == [2, 12, 12, 12, 12, 14]
  assert np.abs(np.concatenate(parts) - whole).max() < 1e-4
  assert np.abs(bone_lengths(whole, HUMANML3D) - HUMANML3D.bone_lengths).max() < 1e-3


@pytest.mark.parametrize("arguments, words", [
    (dict(prompts="   ", num_frames=20), "say what the person does"), (dict(prompts=[], num_frames=20), "no prompt"),
    (dict(prompts=["a", 3], num_frames=20), "got the prompt 3"), (dict(prompts="walk", num_frames=0), "length of 0"),
    (dict(prompts="walk", seconds=1e9), "expected"), (dict(prompts="walk", seconds=float("nan")), "nan"),
    (dict(prompts="walk", num_frames=20, seconds=1), "one of them"),
    (dict(prompts=["walk", "run"], num_frames=[20]), "1 lengths for 2"),
    (dict(prompts="walk", num_frames=20, seeds=[1, 2]), "2 seeds for 1"),
    (dict(prompts="walk", num_frames=20, schedule="pyramid"), "fss, ar, full"),
    (dict(prompts="walk", num_frames=20, guidance_scale=float("inf")), "from -100 to 100"),
    (dict(prompts="walk", num_frames=20, lag=99), "lag 99"), (dict(prompts="walk", num_frames=20, lag=0), "lag 0"),
    (dict(prompts="walk", num_frames=20, num_steps=0), "num_steps 0"),
    (dict(prompts="walk", num_frames=20, num_steps=4294967295), "num_steps 4294967295, expected .* 1 to 1,000"),
    (dict(prompts="walk", num_frames=20, context=10**20), "context 1000.*, expected .* from 1 to 18,000"),
    (dict(prompts="walk", num_frames=20, seeds=[2**40]), "seed 1099511627776, expected"),
    (dict(prompts="walk", num_frames=10**400), "length of inf frames"),
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


@pytest.mark.slow
def test_broken_run_folders_are_told(tiny_run, tmp_path):
  def refused(words, error=ValueError):
    with pytest.raises(error, match=words):
      load(copy)

  def write(file, **fields):
    (copy / file).write_text(json.dumps(fields))

  copy = tmp_path / "nothing"
  refused("neither a run folder", FileNotFoundError)
  copy = shutil.copytree(tiny_run, tmp_path / "run", ignore=shutil.ignore_patterns("checkpoints"))
  config = json.loads((copy / "config.json").read_text())
  for name in ("config.json", "params.safetensors", "frozen.safetensors", "Mean.npy"):
    kept = (copy / name).rename(tmp_path / name)
    refused(name, FileNotFoundError)
    kept.rename(copy / name)
  np.save(copy / "Mean.npy", np.zeros(67, np.float32))
  refused("67")
  shutil.copyfile(tiny_run / "Mean.npy", copy / "Mean.npy")
  write("config.json", **config | {"model": config["model"] | {"width": 32}})
  refused("does not fit its config")
  checkpoint.save_params(copy, {"params": {"head": np.zeros(3, np.float32)}})
  refused("of which 0 are among the .* the weights of another network, method or version")
  shutil.copyfile(tiny_run / "params.safetensors", copy / "params.safetensors")
  write("config.json", **config)
  write("text.json", name="random-init", fingerprint="0")
  refused("another version of the text encoder")
  (copy / "config.json").write_text("{")
  refused("no valid JSON")
  checkpoint.save_config(copy, load_config("cmdm_tokenizer", "tiny"))
  refused("cmdm.denoiser")  # a tokenizer's run cannot generate


def test_a_length_that_is_not_given_is_six_seconds(model):
  """At the model's rate; a model that knows only shorter motions gives its longest."""
  assert model.frames_of(["a person walks"], None, None) == [120] == [model.default_frames("a person walks")]
  assert model.frames_of(["walks", "runs"], None, [1.0, 2.5]) == [20, 50]
  assert model.frames_of(["walks"], None, model.max_seconds) == [round(20 * model.max_seconds)]


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


MODULES = {"models.base": 40, "models.cmdm.model": 70, "loading": 100}


@pytest.mark.slow
def test_entrances_bring_few_modules():
  """What a model does not need until it is used is imported then: export, text encoders, streams. One process imports
  JAX, its forks our rooms."""
  code = f"""
import importlib, os, sys, jax, flax.linen
for name in {list(MODULES)}:
  if not os.fork():
    importlib.import_module("motion_jax." + name)
    print(name, *(module for module in sys.modules if module.startswith("motion_jax")), flush=True)
    os._exit(0)
  os.wait()
"""
  run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
  loaded = {name: modules for name, *modules in map(str.split, run.stdout.splitlines())}
  assert set(loaded) == set(MODULES)
  for name, modules in loaded.items():
    assert f"motion_jax.{name}" in modules and len(modules) <= MODULES[name], (name, sorted(modules))


def test_the_base_class_reads_in_one_sitting():
  assert len((ROOT / "motion_jax" / "models" / "base.py").read_text().splitlines()) <= 150
