"""Steps for 64 and 256 devices are lowered, and their memory computed, without any of these devices."""
import pathlib
import sys

import jax
import pytest

from motion_jax.nets.partitioning import LAYOUTS
from motion_jax.training.mesh import Mesh

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "benchmarks"))
import meshes  # noqa: E402


@pytest.mark.parametrize("data, model", [
    pytest.param(16, 4, marks=pytest.mark.slow), pytest.param(256, 1, marks=pytest.mark.slow), (64, 4)])
def test_a_step_is_lowered_for_devices_that_are_not_there(data, model):
  where = Mesh(data, model, LAYOUTS["fully_sharded"], data * model)
  text = meshes.lowered(meshes.training("denoiser", "XL", tiny=True), where).as_text()
  assert f'sdy.mesh @mesh = <["data"={data}, "model"={model}]>' in text
  assert '{"data"}' in text and ('{"model"}' in text) == (model > 1)


@pytest.mark.slow
def test_the_memory_of_a_large_denoiser_is_split():
  trained = meshes.training("denoiser", "3B")
  shapes, placed = Mesh(64, 4, LAYOUTS["fully_sharded"], 256).shapes(trained.init, *trained.args())
  whole = sum(leaf.size * 4 for leaf in jax.tree.leaves(shapes.params))
  assert 2.9e9 < whole / 4 < 3.2e9
  assert whole / 256 <= meshes.on_one_device(shapes.params, placed.params) < 1.2 * whole / 256
  assert meshes.on_one_device(shapes, placed) < 1.2 * 4 * whole / 256  # two moments and an average
