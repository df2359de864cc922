"""A newcomer's first minutes work: every config trains two steps, the README says nothing that does not run."""
import pathlib
import re
import shlex
import subprocess
import sys

import jax
import numpy as np
import pytest

from motion_jax import cli
from motion_jax import fit as training
from motion_jax.inputs import config_files
from motion_jax.training import checkpoint
from motion_jax.training.metrics import read_metrics
from tests.conftest import ROOT, load_config

CONFIGS = [name for name in config_files.names() if "/" not in name]


@pytest.mark.parametrize("name", CONFIGS)
def test_every_config_trains_two_steps(name, tmp_path):
  config = load_config(name, "tiny")
  state = training.run(config, tmp_path)
  assert int(state.step) == 2
  assert np.isfinite([row["loss"] for row in read_metrics(tmp_path) if "loss" in row]).all()
  for file in (checkpoint.CONFIG, checkpoint.PARAMS, "Mean.npy", "Std.npy", "loss.png"):
    assert (tmp_path / file).is_file(), file


@pytest.mark.parametrize("name", CONFIGS)
def test_full_and_small_configs_are_whole_and_locked(name):
  for size in ("full", "small"):
    config = load_config(name, size)
    with pytest.raises(AttributeError):
      config.model.widht = 3
  with pytest.raises(ValueError, match="full, small.* or tiny"):
    load_config(name, "huge")


def test_resume_through_the_stage_is_exact(tmp_path):
  """Data order, noise, optimizer and average all go on: 2 + 2 steps are 4, bit for bit."""
  config = load_config("cmdm_tokenizer", "tiny").unlock()
  config.optimizer.ema_decay = 0.5
  training.run(config, tmp_path / "parts")
  config.train.num_steps = 4
  parts = training.run(config, tmp_path / "parts", resume=True)
  whole = training.run(config, tmp_path / "whole")
  assert all(np.array_equal(a, b) for a, b in zip(jax.tree.leaves(parts), jax.tree.leaves(whole), strict=True))


def test_resume_with_another_model_is_told(tmp_path):
  config = load_config("cmdm_tokenizer", "tiny").unlock()
  training.run(config, tmp_path)
  config.model.width = 32
  with pytest.raises(ValueError, match="another model"):
    training.run(config, tmp_path, resume=True)


def test_resume_on_other_ground_is_told(tmp_path):
  """Statistics, tokenizer and weights of a run are its own: exchanged or damaged, they are not silently taken over."""
  config = load_config("cmdm_denoiser", "tiny")
  training.run(config, tmp_path)
  mean, frozen = tmp_path / "Mean.npy", tmp_path / checkpoint.FROZEN
  kept = mean.read_bytes(), frozen.read_bytes()
  np.save(mean, np.load(mean) + 1)
  with pytest.raises(ValueError, match="other data"):
    training.run(config, tmp_path, resume=True)
  mean.write_bytes(kept[0][:200])
  with pytest.raises(ValueError, match="should hold 1052 bytes .* has 72"):
    training.run(config, tmp_path, resume=True)
  mean.write_bytes(kept[0])
  params = checkpoint.load_params(tmp_path, name=checkpoint.FROZEN)
  checkpoint.save_params(tmp_path, jax.tree.map(lambda a: a + 0.1, params), name=checkpoint.FROZEN)
  with pytest.raises(ValueError, match="another tokenizer"):
    training.run(config, tmp_path, resume=True)
  frozen.write_bytes(kept[1][:-10])
  with pytest.raises(ValueError, match="no whole safetensors"):
    training.run(config, tmp_path, resume=True)


def test_launch_py(tmp_path):
  """The command itself, with an override and a misspelled one."""
  command = [sys.executable, str(ROOT / "launch.py"), f"--config={ROOT}/configs/cmdm_tokenizer.py:tiny",
             f"--workdir={tmp_path / 'run'}"]
  done = subprocess.run([*command, "--config.train.num_steps=1"], capture_output=True, text=True, check=False, cwd=ROOT)
  assert done.returncode == 0, done.stderr
  assert len(read_metrics(tmp_path / "run")) >= 1
  done = subprocess.run([*command, "--config.train.num_stepz=1"], capture_output=True, text=True, check=False, cwd=ROOT)
  assert done.returncode != 0 and "num_stepz" in done.stderr


def _readme_blocks(language):
  text = (ROOT / "README.md").read_text()
  return re.findall(rf"```{language}\n(.*?)```", text, flags=re.DOTALL)


def test_readme_commands_exist():
  """Every motion-jax, launch.py and eval.py command line of the README parses."""
  lines = [line.strip() for block in _readme_blocks("bash") for line in block.replace("\\\n", " ").splitlines()]
  commands = [line.split("motion-jax ", 1)[1] for line in lines if "motion-jax " in line and "pip" not in line]
  assert commands
  for command in commands:
    for part in command.split(" && "):
      words = shlex.split(part.split(" #")[0])
      assert cli.parse(words[1:] if words[0] == "motion-jax" else words)
  for script, command in (("launch.py", "train"), ("eval.py", "evaluate")):
    for line in lines:
      if line.startswith(f"python {script} "):
        assert cli.parse(shlex.split(line.split(" #")[0])[2:], command, script)


@pytest.mark.slow
def test_readme_python_runs(tmp_path, monkeypatch):
  monkeypatch.chdir(tmp_path)
  blocks = _readme_blocks("python")
  assert blocks
  scope = {}  # read from top to bottom, as a person would
  for block in blocks:
    exec(compile(block, "README.md", "exec"), scope)


def test_readme_names_files_that_exist():
  text = (ROOT / "README.md").read_text()
  for name in re.findall(r"\]\(([\w./-]+)\)", text) + re.findall(r'src="([\w./-]+)"', text):
    if not name.startswith("http"):
      assert pathlib.Path(ROOT / name).exists(), name
