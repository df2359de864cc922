"""The final projection: exact, smooth, feet planted, bones of one length; a warning names what no body can do."""
import numpy as np
import pytest

from motion_jax.control.compiling import compile
from motion_jax.control.constraints import EffectorTarget, EndPose, Keyframe, RootPath, StartPose
from motion_jax.control.project import project
from motion_jax.control.signal import none
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.pinned_feet import stands
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths


@pytest.fixture(scope="module")
def walk():
  return synthetic_joints("walk", 80, np.random.default_rng(0)).astype(np.float64)


def _off(made, constraints):
  """Metres (T, 22) that joints are off their targets."""
  signal = compile(constraints, len(made), 20.0, np.asarray(made, np.float64))
  return np.linalg.norm(np.where(signal.given[0], made - signal.positions[0], 0), axis=-1)


def _asked(joints):
  """One set of constraints of each kind, for a walk of 60 frames or more."""
  far = joints[:, 0] + [0.3, 0, 0.2]
  turn = np.linspace(0, np.pi, 9)
  return {
      "path": [RootPath(np.stack([1 - np.cos(turn), np.sin(turn)], -1) * 0.8)],
      "way points": [RootPath(far[[0, 20, 40], :][:, [0, 2]], [0, 1, 2], between=False)],
      "poses": [StartPose(joints[20]), Keyframe(joints[7], 1.5), EndPose(joints[11])],
      "hand ahead": [EffectorTarget("right_hand", [1.0, 2.0], [[-0.2, 1.2, 0.4]] * 2, "root")],
      "foot": [EffectorTarget("left_foot", [1.5], [joints[30, 10] + [0.05, 0.08, 0.1]])],
      "hand all the time": [EffectorTarget("left_hand", [0, 1, 2], [[0.2, 1.2, 0.3], [0.4, 1.4, 0.2], [0.2, 1.2, 0.3]],
                                           "root", between=True)]}


@pytest.mark.parametrize("kind", ["path", "way points", "poses", "hand ahead", "foot", "hand all the time"])
def test_each_kind_is_met_to_a_millimetre_without_a_jump(walk, kind):
  joints = walk[:44].astype(np.float64)
  joints = joints - joints[0, 0] * [1, 0, 1]
  constraints = _asked(joints)[kind]
  made = project(joints, constraints).astype(np.float64)
  assert _off(made, constraints).max() < 1e-3
  assert np.abs(bone_lengths(made, HUMANML3D) - bone_lengths(joints, HUMANML3D)).max() < 1e-5
  haste = lambda x: np.linalg.norm(np.diff(x, n=2, axis=0), axis=-1).max() * 400
  assert haste(made) < 1.5 * haste(joints) + 20  # m/s^2: a reach within half a second, and no more


def test_feet_stay_planted_while_a_hand_reaches(walk):
  joints = walk[:44].astype(np.float64)
  made = project(joints, [EffectorTarget("left_hand", [1.5], [joints[30, 0] + [0.4, 0.2, 0.35]])])
  feet, flags = list(HUMANML3D.left_feet + HUMANML3D.right_feet), np.repeat(stands(joints), 2, axis=1)
  assert flags.any()
  assert np.linalg.norm(made[:, feet] - joints[:, feet], axis=-1)[flags].max() < 5e-3


def test_without_a_target_nothing_moves(walk):
  assert np.array_equal(project(walk[:40], none(1, 40)), walk[:40].astype(np.float32))
  assert np.array_equal(project(walk[:40], []), walk[:40].astype(np.float32))
  far = project(walk[:80], [EffectorTarget("left_hand", [0.5], [walk[10, 20] + [0.1, 0.1, 0.1]])])
  assert np.abs(far[60:] - walk[60:80]).max() < 2e-3


def test_what_no_body_can_do_has_a_warning_and_the_nearest_is_made(walk):
  joints = walk[:44].astype(np.float64)
  with pytest.warns(UserWarning) as said:
    high = project(joints, [EffectorTarget("left_hand", [1.5], [joints[30, 0] * [1, 0, 1] + [0, 4, 0]])])
  assert "left_wrist" in str(said[0].message) and "4.00 m at 1.50 s (frame 30)" in str(said[0].message)
  assert high[30, 20, 1] > 1.8 and np.isfinite(high).all()
  with pytest.warns(UserWarning, match=r"pelvis has to move at 12\.0 m/s .*\(frame"):
    fast = project(joints, [RootPath([[0, 0], [0, 12 * 43 / 20]])])
  assert np.linalg.norm(np.diff(fast[:, 0], axis=0), axis=-1).max() * 20 < 7.5


def test_a_limb_that_is_stretched_out_still_finds_its_target(walk):
  still = np.repeat(walk[:1], 40, axis=0)
  low = [EffectorTarget("right_hand", [1.0], [still[20, 0] * [1, 0, 1] + [-0.2, 0.3, 0.5]])]
  made = project(still, low).astype(np.float64)
  assert _off(made, low).max() < 1e-3
  assert made[:, [7, 8, 10, 11], 1].min() > still[:, [7, 8, 10, 11], 1].min() - 0.01  # not under the floor
