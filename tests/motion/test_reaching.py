"""Hands come to each place as near as the arm is long; bones keep their lengths, and nothing else moves."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion import rotations as rot
from motion_jax.motion.reaching import PLACES, bring_hands, distance_to_place
from motion_jax.motion.retarget import mirror, retarget
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths

ARMS = [HUMANML3D.joints.index(f"{side}_{part}") for side in ("left", "right") for part in ("elbow", "wrist")]
WALK = retarget(synthetic_joints("walk", 40, np.random.default_rng(0)))
WHOLE = np.ones(len(WALK))


@pytest.mark.parametrize("place", PLACES)
def test_hands_come_to_their_place_and_nothing_else_moves(place):
  made = bring_hands(WALK, place, ("left", "right"), WHOLE)
  rest = [joint for joint in range(22) if joint not in ARMS]
  np.testing.assert_array_equal(made[:, rest], WALK[:, rest].astype(np.float32))
  np.testing.assert_allclose(bone_lengths(made.astype(np.float64), HUMANML3D), bone_lengths(WALK, HUMANML3D), atol=1e-5)
  if place != "knees":  # farther than an arm is long while the body stands
    for side in ("left", "right"):
      assert distance_to_place(made, place, side).max() < 1e-3


def test_one_hand_leaves_the_other_and_a_weight_of_zero_leaves_both():
  np.testing.assert_allclose(bring_hands(WALK, "head", ("left", "right"), 0 * WHOLE), WALK, atol=1e-5)
  made = bring_hands(WALK, "head", ("left",), WHOLE)
  np.testing.assert_array_equal(made[:, ARMS[2:]], WALK[:, ARMS[2:]].astype(np.float32))
  assert np.abs(made[:, ARMS[:2]] - WALK[:, ARMS[:2]]).max() > 0.3


@pytest.mark.parametrize("place", PLACES)
def test_hands_come_to_their_place_without_a_jump(place):
  count = len(WALK)
  made = bring_hands(WALK, place, ("left", "right"), np.clip((np.arange(count) - 10) / 16, 0, 1))
  arms = np.linalg.norm(np.diff(made[:, ARMS] - made[:, :1], axis=0), axis=-1) * 20
  assert arms[:, [1, 3]].max() < 4 and arms.max() < 8  # metres a second, of wrists and elbows


def test_a_hand_goes_around_its_shoulder():
  hangs = bring_hands(WALK, "down", ("left",), WHOLE)
  half = bring_hands(hangs, "up", ("left",), 0.5 * WHOLE)
  wrist, shoulder = (HUMANML3D.joints.index(f"left_{part}") for part in ("wrist", "shoulder"))
  assert np.linalg.norm(half[:, wrist] - half[:, shoulder], axis=-1).min() > 0.2


@pytest.mark.parametrize("place", ["face", "shoulder", "hips", "side"])
def test_places_turn_with_the_body_and_are_the_same_on_both_sides(place):
  made = bring_hands(WALK, place, ("left",), WHOLE)
  turn = rot.about_axis(np.array(1.2), "y")
  elsewhere = rot.rotate(turn[None, None], WALK) + [3.0, 0.0, -1.0]
  np.testing.assert_allclose(bring_hands(elsewhere, place, ("left",), WHOLE),
                             rot.rotate(turn[None, None], made.astype(np.float64)) + [3.0, 0.0, -1.0], atol=1e-5)
  np.testing.assert_allclose(bring_hands(mirror(WALK), place, ("right",), WHOLE), mirror(made), atol=1e-5)


def test_places_are_where_their_names_say():
  wrists = {place: bring_hands(WALK, place, ("left", "right"), WHOLE)[:, [20, 21]].mean(0) - WALK[:, [0]].mean(0)
            for place in PLACES}
  height = {place: own[:, 1].mean() for place, own in wrists.items()}
  assert height["up"] > height["head"] > height["face"] > height["chest"] > height["stomach"] > height["hips"] > (
      height["down"])
  apart = {place: own[0, 0] - own[1, 0] for place, own in wrists.items()}
  assert apart["side"] > 1.2 and apart["crossed"] < 0 < apart["together"] < 0.15 < apart["apart"]
  ahead = {place: own[:, 2].mean() for place, own in wrists.items()}
  assert ahead["front"] > 0.4 > ahead["chest"] > 0.05 and ahead["back"] < -0.05
