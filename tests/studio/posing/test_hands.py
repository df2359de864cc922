"""Hands are brought to where the words have them, smoothly, and stay there as long as they should."""
import numpy as np
import pytest

from motion_jax.analysis.signals import turning_points
from motion_jax.data.clip import Caption
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.models.results import Motion
from motion_jax.motion.reaching import bring_hands, distance_to_place
from motion_jax.motion.retarget import retarget
from motion_jax_studio.language import parse
from motion_jax_studio.planning.standing import standing
from motion_jax_studio.posing.hands import with_hands

WALK = retarget(synthetic_joints("walk", 120, np.random.default_rng(1)))


def _made(text, *seconds, joints=WALK):
  """The joints of a walk of six seconds with the hands of a text; seconds: where its segments end."""
  ends = (0.0, *seconds, len(joints) / 20)
  captions = tuple(Caption("", first, past) for first, past in zip(ends, ends[1:]))
  motion = Motion(joints.astype(np.float32), 20.0, captions)
  plan = parse(text, lambda text: False)
  assert len(plan.segments) == len(captions)
  return with_hands(motion, plan)


def _is_there(joints, place, side):
  return distance_to_place(joints, place, side) < 0.02


def test_hands_beside_a_walk_are_there_from_its_beginning_to_its_end():
  made = _made("a person walks forward with the arms out to the sides")
  assert all(_is_there(made, "side", side).all() for side in ("left", "right"))
  np.testing.assert_array_equal(made[:, :16], WALK[:, :16].astype(np.float32))  # legs, trunk and head


def test_a_hand_is_brought_in_its_action_and_moves_in_the_next_one_as_sampled():
  made = _made("a person puts the left hand on the hip, then walks", 3.0)
  there = _is_there(made, "hips", "left")
  assert not there[0] and there[20:58].all() and not there[75:].any()
  np.testing.assert_allclose(made[80:], WALK[80:], atol=1e-5)
  np.testing.assert_allclose(made[:, [19, 21]], WALK[:, [19, 21]], atol=1e-5)  # the right arm
  assert np.linalg.norm(np.diff(made[:, 20] - made[:, 0], axis=0), axis=-1).max() * 20 < 3.0  # metres a second


def test_hands_stay_until_they_are_brought_elsewhere():
  made = _made("a person puts the left hand to the face, walks, then lowers it", 2.0, 4.0)
  there = _is_there(made, "face", "left")
  assert there[20:78].all() and not there[95:].any() and distance_to_place(made, "down", "left")[100:].max() < 0.4
  assert not _is_there(_made("a person puts the left hand to the face, walks, then bows", 2.0, 4.0), "face", "left")[
      60:].any()
  waves = _made("a person puts the left hand to the face, waves it, then lowers the left hand", 2.0, 4.0)
  assert not _is_there(waves, "face", "left")[60:].any()


def test_hands_that_are_lowered_first_of_all_begin_ahead():
  made = _made("a person lowers the left arm, then walks", 3.0)
  assert distance_to_place(made, "front", "left")[0] < 0.02 and made[0, 20, 1] - made[40, 20, 1] > 0.3
  np.testing.assert_allclose(made[:, [19, 21]], WALK[:, [19, 21]], atol=1e-5)


def test_hands_that_are_in_their_place_are_not_moved():
  there = bring_hands(WALK, "hips", ("left", "right"), np.ones(len(WALK)))
  made = _made("a person walks with the hands on the hips", joints=there)
  np.testing.assert_array_equal(made, there)


def _gesture(text, joints=WALK):
  """The joints of a walk with the gesture of a text that its model does not know."""
  motion = Motion(joints.astype(np.float32), 20.0, (Caption("", 0, len(joints) / 20),))
  return with_hands(motion, standing(parse(text), lambda prompt: False, lambda prompt: False))


def test_hands_that_clap_come_together_again_and_again():
  apart = np.linalg.norm(np.diff(_gesture("a person claps")[:, [20, 21]], axis=1)[:, 0], axis=-1)
  assert 16 <= len(turning_points(apart[20:], 0.2)) - 2 <= 18  # five seconds of 0.6 s, there and back
  assert apart[20:].min() < 0.12
  thrice = np.linalg.norm(np.diff(_gesture("a person claps three times")[:, [20, 21]], axis=1)[:, 0], axis=-1)
  assert len([one for one in turning_points(thrice, 0.2) if thrice[one] < 0.15]) == 3


@pytest.mark.parametrize("text, height", [
    ("circles the left arm", 0.7), ("moves the left hand in circles in front", 0.15)])
def test_a_limb_that_circles_goes_round_without_a_stop(text, height):
  turned = []
  for words in (text, f"{text} backward"):
    made = _gesture(f"a person {words}")[30:]
    hand = made[:, 20] - made[:, 16]
    speed = np.linalg.norm(np.diff(hand, axis=0), axis=-1) * 20
    assert np.ptp(hand[:, 1]) > height and np.ptp(hand[:, 2]) > 0.15 and 0.35 < speed.min() < speed.max() < 2
    assert len(turning_points(hand[:, 1], height / 2)) > 4
    (_, up, ahead), (_, rises, goes) = (hand[:-1] - hand.mean(0)).T, np.diff(hand, axis=0).T
    turned.append((up * goes - ahead * rises).sum())
  assert turned[0] * turned[1] < 0  # the other way round


def test_a_hand_that_throws_goes_back_and_ahead_quickly():
  made = _gesture("a person throws a ball with the left hand")
  assert distance_to_place(made, "ear", "left")[14] < 0.05 and distance_to_place(made, "front", "left")[19] < 0.05
  speed = np.linalg.norm(np.diff(made[:, 20] - made[:, 16], axis=0), axis=-1) * 20
  assert 2.5 < speed.max() < 8 and 13 < speed.argmax() < 20
  np.testing.assert_allclose(made[:, [19, 21]], WALK[:, [19, 21]], atol=1e-5)


def test_a_hand_that_scratches_the_head_stays_near_it():
  made = _made("a person scratches the head with the right hand")
  away = np.linalg.norm(made[20:, 21] - made[20:, 15], axis=-1)
  assert away.max() < 0.25 and len(turning_points(made[20:, 21, 1] - made[20:, 15, 1], 0.05)) > 10


def test_other_motions_stay_as_they_are():
  for text in ("a person walks", "a person waves the left hand", "a person throws a ball"):  # which the network knows
    np.testing.assert_array_equal(_made(text), WALK.astype(np.float32))
