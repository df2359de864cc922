"""A rig's rotations of a stream: whatever the blocks, near those of the whole motion, in bounded delay."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.export.rig import on_rig
from motion_jax.export.rig_stream import RigStream
from motion_jax.motion import rotations as rot


def rows_of(clip, size, rig="mixamo"):
  stream, found = RigStream(rig, clip.fps), []
  for first in range(0, clip.num_frames, size):
    found.append(stream.push(clip.joints[first:first + size]))
    seen = min(first + size, clip.num_frames) / clip.fps
    assert seen - sum(map(len, found)) / 50 <= stream.delay + 1e-9
  return np.concatenate([*found, stream.finish()])


def degrees(p, q):
  return np.degrees(np.linalg.norm(rot.to_vector(rot.multiply(rot.conjugate(p), q)), axis=-1))


@pytest.fixture(scope="module")
def clip():
  return next(clip for clip in synthetic_clips(seed=0) if "walk" in clip.captions[0].text).cut(0, 40)


@pytest.mark.slow
def test_any_blocks_give_the_same_rows(clip):
  rows = rows_of(clip, 40)
  assert len(rows) == 39 * 2.5 // 1 + 1
  np.testing.assert_array_equal(rows_of(clip, 7), rows)


def test_rows_are_the_rotations_of_the_whole_motion(clip):
  rows, whole = rows_of(clip, 12)[::5], on_rig(clip, "mixamo")
  found, frames = rows[:, 3:].reshape(len(rows), -1, 4), np.arange(0, clip.num_frames, 2)
  np.testing.assert_allclose(rows[:, :3], whole.root[frames], atol=1e-3)
  turned = degrees(found, whole.rotations[frames])
  # The twist of limbs, which joints hardly show, is chosen with less of the future: on a grid of 5 degrees.
  assert np.percentile(turned, 99) < 6 and turned.max() < 12


@pytest.mark.parametrize("rig", ["ue4", "biped"])
def test_the_rest_pose_is_that_of_the_rig(clip, rig):
  stream = RigStream(rig, clip.fps)
  np.testing.assert_allclose(stream.offsets, on_rig(clip, rig).offsets, atol=1e-6)
