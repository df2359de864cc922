"""A motion to a rig's file and back: joints within 1 mm, rotations that follow from them in 0.5 degrees.

Joints of all rigs come back in tests/export/test_rigs.py; these differ in kind.
"""
import dataclasses

import numpy as np
import pytest

from motion_jax import export
from motion_jax.export.rig import rigged
from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import pose_to_joints
from motion_jax.motion.skeleton import HUMANML3D
from tests.export.test_bvh import walk

# Rigs whose files cannot hold the 22 joints: arms that hang on the neck, a trunk of fewer joints; millimetres, degrees.
LOOSE = {"biped": (10, 4), "bandai": (20, 16)}


@pytest.fixture(scope="module")
def clip():
  """A walk on a body with a rigid pelvis and chest, as a rig has them."""
  moved = walk(12, 0.2)
  joints = pose_to_joints(rigged(moved)) / HUMANML3D.unit
  return dataclasses.replace(moved, joints=joints.astype(np.float32))


@pytest.mark.parametrize("name", ["mixamo", "ue5", *LOOSE])
def test_a_motion_to_a_rig_and_back(name, clip, tmp_path):
  export.save(clip, tmp_path / "rig.bvh", rig=name)
  back = export.load(tmp_path / "rig.bvh", unit="cm")
  assert back.num_frames == clip.num_frames and back.fps == clip.fps
  millimetres, most = LOOSE.get(name, (1, 0.5))
  assert 1000 * np.linalg.norm(back.joints - clip.joints, axis=-1).max() < millimetres
  turn = rot.multiply(rot.conjugate(rigged(clip).turned), rigged(back).turned)
  turned = np.degrees(np.linalg.norm(rot.to_vector(turn), axis=-1))
  assert turned.max() < most
