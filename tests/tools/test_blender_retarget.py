"""The add-on that puts a motion on a character: bones by name, and the turn of a bone; Blender is not needed for these.

What Blender itself does with it is in docs/formats.md.
"""
import importlib.util
import pathlib

import numpy as np
import pytest

from motion_jax.motion import rotations as rot
from motion_jax.rigs.rig import get_rig

PATH = pathlib.Path(__file__).parents[2] / "blender" / "motion_jax_retarget.py"


@pytest.fixture(scope="module")
def addon():
  spec = importlib.util.spec_from_file_location("motion_jax_retarget", PATH)
  module = importlib.util.module_from_spec(spec)
  spec.loader.exec_module(module)
  return module


def test_bones_are_those_of_our_table_of_rigs(addon):
  for name in ("mixamo", "humanik", "lafan", "rigify", "ue5", "ue4", "vrm", "unity", "vroid", "humanml3d"):
    rig = get_rig(name)
    bones, _ = addon.find_bones([*rig.names, "ik_hand_l", "prop"])
    assert bones == {joint: rig.names[number] for joint, number in rig.joints.items()}, name


def test_a_character_without_legs_is_one_sentence(addon):
  rig = get_rig("mixamo")
  with pytest.raises(ValueError, match="nearest to those of Mixamo.*without left_ankle, left_hip, left_knee"):
    addon.find_bones([name for name in rig.names if "Leg" not in name and "Foot" not in name])
  with pytest.raises(ValueError, match="no known rig"):
    addon.find_bones(["Cube"])


def test_a_bone_of_an_a_pose_ends_in_the_direction_of_the_motion(addon):
  """A target that rests with its arm down by 45 degrees and rolled bones: its arm points where the source's does."""
  rng = np.random.default_rng(0)
  source = {"left_shoulder": (0, 0, 1.4), "left_elbow": (0.3, 0, 1.4), "left_wrist": (0.6, 0, 1.4)}
  target = {"left_shoulder": (0, 0, 1.5), "left_elbow": (0.2, 0, 1.3), "left_wrist": (0.4, 0, 1.1)}
  fix = addon.corrections(source, target)
  assert set(fix) == {"left_shoulder", "left_elbow", "left_wrist"}
  moved, rested, rest = (rot.unit(rng.normal(size=4)) for _ in range(3))
  turned = np.array(addon.turn(tuple(moved), tuple(rested), fix["left_elbow"], tuple(rest)))
  bone = rot.rotate(rot.conjugate(rest), np.array([1, 0, -1]) / np.sqrt(2))  # the target's bone in its own frame
  along = rot.rotate(rot.multiply(moved, rot.conjugate(rested)), np.array([1.0, 0, 0]))
  np.testing.assert_allclose(rot.rotate(turned, bone), along, atol=1e-9)
