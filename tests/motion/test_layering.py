"""Arms, head and torso of one motion on another: exact where they are the same, and nothing else moves."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion import rotations as rot
from motion_jax.motion.layering import acting, put_on
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths
from motion_jax_studio.planning.pauses import held_frame, insert_pause

ARMS = {"right": [14, 17, 19, 21], "left": [13, 16, 18, 20]}


@pytest.fixture(scope="module")
def clips():
  return [clip.joints.astype(np.float64) for clip in synthetic_clips(0, 6, num_frames=60)]


@pytest.mark.parametrize("part, joints", [("arms", ARMS["right"]), ("head", [12, 15]),
                                          ("torso", [3, 6, 9, 12, 15, *ARMS["right"], *ARMS["left"]])])
def test_only_the_part_is_the_others_and_bones_keep_their_lengths(clips, part, joints):
  base, other = clips[0], clips[1]
  made = put_on(base, other, part, ("right",), np.ones(60), HUMANML3D)
  still = [j for j in range(22) if j not in joints]
  np.testing.assert_array_equal(made[:, still], base[:, still].astype(np.float32))
  np.testing.assert_allclose(bone_lengths(made.astype(np.float64), HUMANML3D), bone_lengths(base, HUMANML3D), atol=1e-5)
  np.testing.assert_allclose(put_on(base, other, part, ("right",), np.zeros(60), HUMANML3D), base, atol=1e-5)


def test_a_part_put_on_its_own_body_wherever_that_stands_changes_nothing(clips):
  turn = rot.about_axis(np.array(1.2), "y")
  elsewhere = rot.rotate(turn[None, None], clips[0]) + [3.0, 0.0, -1.0]
  for part in ("arms", "head", "torso"):
    np.testing.assert_allclose(put_on(clips[0], elsewhere, part, ("left", "right"), np.ones(60), HUMANML3D), clips[0],
                               atol=2e-5)


def test_arms_are_held_upright_on_a_body_that_leans(clips):
  """Against where it faces: a hand that is up goes up, from where the shoulder is."""
  other = np.repeat(clips[0][:1], 60, axis=0)
  lean = rot.about_axis(np.array(0.8), "x")
  upper = [3, 6, 9, 12, 15, *ARMS["right"], *ARMS["left"]]
  base = rot.rotate(rot.about_axis(np.array(1.2), "y")[None, None], other)
  base[:, upper] = base[:, :1] + rot.rotate(lean[None, None], base[:, upper] - base[:, :1])
  made = put_on(base, other, "arms", ("right",), np.ones(60), HUMANML3D, upright=True)
  still = [j for j in range(22) if j not in (19, 21)]
  np.testing.assert_array_equal(made[:, still], base[:, still].astype(np.float32))
  for joint, parent in ((19, 17), (21, 19)):
    bone = other[:, joint] - other[:, parent]
    np.testing.assert_allclose((made[:, joint] - made[:, parent])[:, 1], bone[:, 1], atol=1e-5)
    turned = rot.rotate(rot.about_axis(np.array(1.2), "y"), bone)  # out of where the other faces, into where it does
    np.testing.assert_allclose(made[:, joint] - made[:, parent], turned, atol=0.01)


def test_the_hand_that_moves_is_the_one_that_acts(clips):
  body = np.repeat(clips[0][:1], 60, axis=0)
  body[:, 21, 1] += 0.2 * np.sin(np.arange(60) / 3)
  assert acting(body, HUMANML3D) == ("right",)
  body[:, 20, 1] += 0.2 * np.sin(np.arange(60) / 3)
  assert acting(body, HUMANML3D) == ("left", "right")
  assert acting(np.repeat(clips[0][:1], 60, axis=0), HUMANML3D) == ("left", "right")


@pytest.mark.parametrize("at, count, ends", [(30, 40, False), (30, 5, False), (0, 30, False), (60, 40, True),
                                             (60, 3, True), (2, 1, False)])
def test_a_body_that_rests_stands_still_and_goes_on_from_there(clips, at, count, ends):
  walk = clips[0] + np.linspace(0, 2, 60)[:, None, None] * [0, 0, 1.0]
  made, first, past = insert_pause(walk, at, count, HUMANML3D, ends)
  assert made.shape == (60 + count, 22, 3) and 0 <= first < past <= 60 + count
  np.testing.assert_array_equal(made[first:past], np.repeat(made[first:first + 1], past - first, axis=0))
  legs = [j for chain in HUMANML3D.chains[:2] for j in chain[1:]]
  fastest = lambda joints: np.abs(np.diff(joints, axis=0)).max()
  assert fastest(np.delete(made, legs, axis=1)) <= fastest(np.delete(walk, legs, axis=1)) * 1.01  # nothing leaps
  assert fastest(made[:, legs]) < 0.1  # metres, of a foot that is put down
  ankles = made[(first + past) // 2, [7, 8], 1]
  assert (ankles < walk[:, [7, 8], 1].min(0) + 0.06).all()
  if ends:
    assert past == len(made)
  else:
    np.testing.assert_allclose(np.delete(made[-1], legs, axis=0), np.delete(walk[-1], legs, axis=0), atol=1e-6)


def test_a_leg_is_held_where_its_foot_is_highest(clips):
  body = np.repeat(clips[0][:1], 60, axis=0)
  body[:, 7, 1] += 0.4 * np.exp(-((np.arange(60) - 33) / 5) ** 2)
  assert held_frame(body, 0, 60, "leg", (), HUMANML3D) == 33
