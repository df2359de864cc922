"""Joints -> rotations -> joints: nothing is lost, and nothing jumps while a body turns round and round."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import TIPS, pose_to_joints, t_pose, to_pose, turn_ends
from motion_jax.motion.skeleton import HUMANML3D, KIT

INDEX = {name: j for j, name in enumerate(HUMANML3D.joints)}


def joints_of(action, num_frames=60):
  return synthetic_joints(action, num_frames, np.random.default_rng(1))


def turn_per_frame(q):
  """Degrees between neighbouring frames, the same for q and -q."""
  return 2 * np.degrees(np.arccos(np.clip(np.abs((q[1:] * q[:-1]).sum(-1)), 0, 1)))


def spin(joints, turns):
  angle = np.linspace(0, 2 * np.pi * turns, len(joints))
  return rot.rotate(rot.about_axis(angle, "y")[:, None], joints)


@pytest.mark.parametrize("action", ["walk", "turn_left", "wave_left", "squat"])
def test_forward_kinematics_gives_the_joints_back(action):
  joints = joints_of(action)
  assert np.abs(pose_to_joints(to_pose(joints)) - joints).max() < 1e-4  # metres
  assert np.abs(pose_to_joints(to_pose(joints[:1])) - joints[:1]).max() < 1e-4


def test_bones_of_any_skeleton():
  rng = np.random.default_rng(0)
  offsets = t_pose(KIT) * rng.uniform(0.8, 1.2, (21, 1))
  turned = rot.unit(np.array([1.0, 0, 0, 0]) + 0.2 * np.cumsum(rng.normal(size=(30, 21, 4)), 0) / 10)
  joints = np.zeros((30, 21, 3))
  for chain in KIT.chains:
    for parent, joint in zip(chain[:-1], chain[1:]):
      joints[:, joint] = joints[:, parent] + rot.rotate(turned[:, parent], offsets[joint])
  pose = to_pose(joints, KIT, KIT.fps)
  np.testing.assert_allclose(pose_to_joints(pose, KIT), joints, atol=0.05)  # millimetres
  assert np.abs(pose.shifts).max() < 1e-6, "a rigid root and neck leave nothing to shift"


def test_rest_is_a_t_pose():
  offsets = t_pose()
  np.testing.assert_allclose(np.linalg.norm(offsets, axis=1), HUMANML3D.bone_lengths, atol=1e-12)
  for side, sign in (("left", 1), ("right", -1)):
    for joint in ("elbow", "wrist"):
      bone = offsets[INDEX[f"{side}_{joint}"]]
      assert sign * bone[0] > 0.2 and abs(bone[1]) < 1e-9, "left arm to +x, right arm to -x, level"
    assert offsets[INDEX[f"{side}_ankle"], 1] < -0.3 and offsets[INDEX[f"{side}_foot"], 2] > 0, "toes point ahead"


def test_several_whole_turns_stay_smooth():
  joints = joints_of("walk", 120)
  joints[:, INDEX["left_wrist"]] = joints[:, INDEX["left_elbow"]]  # limbs of no length are turned with their body
  joints[:, INDEX["left_foot"]] = joints[:, INDEX["left_ankle"]]
  straight, spun = to_pose(joints), to_pose(spin(joints, 3))
  assert (spun.rotations[1:] * spun.rotations[:-1]).sum(-1).min() > 0, "signs never flip"
  # Turning the world turns the root only: the limbs do not notice.
  np.testing.assert_allclose(np.abs((straight.rotations * spun.rotations).sum(-1))[:, 1:], 1, atol=1e-9)
  heading = np.unwrap(2 * np.arctan2(spun.rotations[:, 0, 2], spun.rotations[:, 0, 0]))
  assert heading[-1] - heading[0] == pytest.approx(6 * np.pi, abs=0.6)


@pytest.mark.parametrize("lost, put", [
    ([13, 14], {9: 1}), ([13, 14], {9: 0.4, 12: 0.6}), ([13, 14, 16, 17], {9: 1}), ([1, 2], {0: 1}),
    ([0, 3], {1: 0.5, 2: 0.5})], ids=["collars in the chest", "collars on the spine's line", "no shoulders",
                                      "hips in the pelvis", "a pelvis on the hips' line"])
def test_bones_that_show_no_turn_leave_it_to_the_rest_of_the_body(lost, put):
  """Chest and pelvis face where the body faces and turn no faster than it, whichever way it faces, also lying."""
  sound = joints_of("walk", 60)
  whole, odd = to_pose(sound).turned, sound.copy()
  odd[:, lost] = sum(share * sound[:, [joint]] for joint, share in put.items())
  for turn in (rot.about_axis(0.0, "y"), rot.about_axis(2.5, "y"), rot.about_axis(np.pi / 2, "x")):
    pose = to_pose(rot.rotate(turn, odd))
    for joint in ("pelvis", "spine3"):
      ahead = rot.rotate(pose.turned[:, INDEX[joint]], np.array([0.0, 0, 1]))
      expected = rot.rotate(rot.multiply(turn[None], whole[:, INDEX[joint]]), np.array([0.0, 0, 1]))
      assert np.degrees(np.arccos((ahead * expected).sum(-1).clip(-1, 1))).max() < 35, joint
      assert turn_per_frame(pose.turned[:, INDEX[joint]]).max() < 6, joint


def test_a_frame_without_a_body_takes_its_neighbour_s_turn():
  joints = joints_of("walk", 20)
  joints[7], joints[0] = joints[7, :1], joints[0, :1]
  turned = to_pose(joints).turned[:, [0, INDEX["spine3"]]]
  assert (np.abs((turned[7] * turned[6]).sum(-1)) > 0.9999).all()
  assert (np.abs((turned[0] * turned[1]).sum(-1)) > 0.9999).all(), "the first frame takes the next"


def test_a_nearly_straight_arm_does_not_flip_about_itself():
  """An elbow that bends a little the wrong way for some frames: the upper arm must not turn about in a frame."""
  joints = np.repeat(joints_of("stand")[:1], 60, axis=0)
  shoulder, elbow, wrist = (INDEX[f"left_{name}"] for name in ("shoulder", "elbow", "wrist"))
  bend = np.radians(np.interp(np.arange(60), [0, 20, 24, 36, 40, 59], [25, 25, -30, -30, 25, 25]))
  joints[:, elbow] = joints[:, shoulder] + [0, -0.26, 0]
  joints[:, wrist] = joints[:, elbow] + 0.27 * np.stack([0.09 + 0 * bend, -np.cos(bend), np.sin(bend)], -1)
  pose = to_pose(joints)
  assert turn_per_frame(pose.rotations)[:, shoulder].max() < 30


def test_toes_stay_on_the_ground_while_the_foot_rolls_over_them():
  joints = np.repeat(joints_of("stand")[:1], 40, axis=0)
  ankle, foot = INDEX["left_ankle"], INDEX["left_foot"]
  tall, length = joints[0, ankle, 1] - joints[0, foot, 1], np.linalg.norm(joints[0, ankle] - joints[0, foot])
  lift = np.linspace(np.arcsin(tall / length), np.radians(75), 40)  # the heel rises, the toe joint stays
  ahead = (joints[0, foot] - joints[0, ankle]) * [1, 0, 1]
  ahead = ahead / np.linalg.norm(ahead)
  joints[:, ankle] = joints[:, foot] + length * (np.sin(lift)[:, None] * [0, 1, 0] - np.cos(lift)[:, None] * ahead)
  straight = to_pose(joints)
  pose = turn_ends(straight, joints)
  tip = lambda pose: joints[:, foot, 1] + rot.rotate(pose.turned[:, foot], np.array(TIPS["foot"]))[:, 1]
  assert tip(straight).min() < joints[0, foot, 1] - 0.03, "through the ground"
  assert np.abs(tip(pose) - joints[0, foot, 1]).max() < 3e-3
  assert turn_per_frame(pose.rotations)[:, foot].max() < 5
  others = [j for j in range(22) if j != foot]
  np.testing.assert_allclose(np.abs((pose.rotations * straight.rotations).sum(-1))[:, others], 1, atol=0.01)
