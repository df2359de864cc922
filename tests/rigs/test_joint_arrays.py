"""Arrays of joints are recognised by how many joints they have and by their bones."""
import warnings

import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion.skeleton import HUMANML3D, KIT, SNAPMOGEN
from motion_jax.rigs.joint_arrays import pick_joints
from tests.rigs.rig_names import RIGS, build

INDEX = {name: j for j, name in enumerate(HUMANML3D.joints)}


@pytest.fixture(scope="module")
def clip():
  return synthetic_clips(num=2, num_frames=24)[1]


def with_hands(joints, extra):
  """Joints (T, 22 + extra, 3): hands 8 cm behind the wrists, fingers about them."""
  hands = [joints[:, wrist] + 0.3 * (joints[:, wrist] - joints[:, elbow]) for wrist, elbow in ((20, 18), (21, 19))]
  more = [hands[i % 2] + 0.01 * i for i in range(extra)]
  return np.concatenate([joints, np.stack(more, axis=1)], axis=1)


@pytest.mark.parametrize("count, scale", [(24, 1), (24, 100), (45, 1), (127, 1)])
def test_the_first_22_of_a_body_with_hands_and_face(clip, count, scale):
  with pytest.warns(UserWarning, match=f"{count} joints, of which the first 22 are SMPL's"):
    joints, skeleton = pick_joints(with_hands(clip.joints, count - 22) * scale)
  assert skeleton is HUMANML3D
  np.testing.assert_array_equal(joints, clip.joints * scale)


@pytest.mark.parametrize("count, starts", [(77, (0, 11, 39, 67, 72)), (30, (0, 10, 16, 22, 26))])
def test_soma_s_joints_by_their_order(count, starts):
  """Kimodo's arrays hold SOMA's joints in the order of its definitions.py."""
  names, _, places, where = build(RIGS["SOMA, nv-tlabs/kimodo:kimodo/skeleton/definitions.py"])
  joints = np.full((3, count, 3), 5.0)
  parts = (["Hips", "Spine1", "Spine2", "Chest", "Neck1", "Neck2", "Head"], *(
      [side + word for word in words.split()] for words in ("Shoulder Arm ForeArm Hand", "Leg Shin Foot ToeBase")
      for side in ("Left", "Right")))
  for start, part in zip(starts, parts):
    for offset, name in enumerate(part):
      joints[:, start + offset] = places[names.index(name)]
  with pytest.warns(UserWarning, match=f"{count} joints, read as SOMA's"):
    found, skeleton = pick_joints(joints)
  assert skeleton is HUMANML3D and found.shape == (3, 22, 3)
  for joint, index in where.items():
    if joint != "pelvis":
      np.testing.assert_allclose(found[0, INDEX[joint]], places[index], err_msg=joint)


def test_plain_arrays_stay_as_they_are(clip):
  with warnings.catch_warnings():
    warnings.simplefilter("error")
    for joints, skeleton in ((clip.joints, HUMANML3D), (clip.on_skeleton(KIT).joints, KIT),
                             (clip.on_skeleton(SNAPMOGEN).joints * np.float32(100), SNAPMOGEN)):
      found, own = pick_joints(joints)
      assert own is skeleton and found is joints


def test_arrays_of_no_skeleton(clip):
  shuffled = np.random.default_rng(0).permutation(52)
  with pytest.raises(ValueError, match=r"shape \(24, 52, 3\), the first 22 of which do not have SMPL's bones"):
    pick_joints(with_hands(clip.joints, 30)[:, shuffled])
  for shape in ((5, 4, 3), (5, 22, 2), (5, 22), (0, 24, 3)):
    with pytest.raises(ValueError, match="expected joints .frames, 22, 3."):
      pick_joints(np.zeros(shape))
