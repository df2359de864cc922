"""The scripts of examples/ run as they are, stay short enough to copy, and print what their docstrings say."""
import json
import re
import subprocess
import sys

import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from tests.conftest import ROOT

EXAMPLES = {path.stem: path for path in sorted((ROOT / "examples").glob("*.py"))}


def output_of(name, *arguments):
  run = subprocess.run([sys.executable, str(EXAMPLES[name]), *map(str, arguments)], capture_output=True, text=True)
  assert run.returncode == 0, run.stderr
  return run.stdout


def test_examples_are_short_enough_to_copy():
  assert not [name for name, path in EXAMPLES.items() if len(path.read_text().splitlines()) > 40]


@pytest.mark.slow
def test_masks_are_drawn():
  assert "CDAMD, dual-constrained, known 0, 2, 4\n  # . # . # .\n  # # . . . .\n" in output_of("draw_masks")


@pytest.mark.exhaustive
def test_sines_are_learned():
  radius = float(re.search(r"radius of the samples ([\d.]+)", output_of("causal_dit_on_sines"))[1])
  assert abs(radius - 1) < 0.15


@pytest.mark.exhaustive
def test_more_levels_quantize_better():
  errors = [float(error) for error in re.findall(r"relative error ([\d.]+)", output_of("quantize_an_array"))]
  assert len(errors) == 4 and errors == sorted(errors, reverse=True) and errors[-1] < 0.1


@pytest.mark.slow
def test_training_from_python(tmp_path):
  assert output_of("train_from_python", tmp_path).endswith("(1, 40, 22, 3)\n")
  assert (tmp_path / "denoiser" / "params.safetensors").is_file()


@pytest.mark.slow
def test_a_new_method_learns(tmp_path):
  output_of("train_a_new_method", tmp_path / "run")
  losses = [json.loads(line)["loss"] for line in (tmp_path / "run" / "metrics.jsonl").read_text().splitlines()]
  assert losses[-1] < 0.7 * losses[0]


@pytest.mark.slow
def test_folders_are_judged(tmp_path):
  clips = synthetic_clips(num=4, num_frames=60)
  for name, shift in (("real", 0.0), ("mine", 0.02)):
    (tmp_path / name).mkdir()
    for i, clip in enumerate(clips):
      np.save(tmp_path / name / f"{i}.npy", clip.joints + np.float32([0, shift, 0]), allow_pickle=False)
  printed = output_of("judge_a_folder", tmp_path / "real", tmp_path / "mine")
  assert f"{tmp_path / 'mine'}: 4 motions" in printed and "FID of" in printed
