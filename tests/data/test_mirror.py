"""Mirrored captions exchange sides and turns and nothing else; mirrored clips move the other way."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.data.mirror import mirror_caption, mirror_clip
from motion_jax.text.tagger import tag


@pytest.mark.parametrize("text, expected", [
    ("A person turns Left, then RIGHT.", "A person turns Right, then LEFT."),
    ("turns clockwise, then counter-clockwise", "turns counterclockwise, then clockwise"),
    ("Counterclockwise and anticlockwise", "Clockwise and clockwise"),
    ("a left-handed throw, leftwards", "a right-handed throw, rightwards"),
    ("steps leftward; lefthanded", "steps rightward; righthanded"),
    ("the person's left/right foot.", "the person's right/left foot."),
    ("turns left a bit, then right after", "turns right a bit, then left after"),
    # A verb that goes to a side, "to", or another side beside it: "right" before then, before, as is a side.
    ("a person steps right then left", "a person steps left then right"),
    ("punches left then right then left then right", "punches right then left then right then left"),
    ("he turns right before he sits", "he turns left before he sits"),
    ("moves quickly right then sits", "moves quickly left then sits"),
    ("from left to right then forward", "from right to left then forward"),
    ("from left to right back to the left", "from right to left back to the right"),
    ("swings the hand left and right as if angry", "swings the hand right and left as if angry"),
    ("the lefthand side, a RIGHTHAND turn, the leftfoot", "the righthand side, a LEFTHAND turn, the rightfoot"),
    ("raises the left hand right before sitting", "raises the right hand right before sitting"),
    ("right then he sits, right now, right there", None), ("he turns around right after", None),
    ("the rights, leftover, rightly", None), ("turns in a right angle then stops", None),
    ("to the right in front of him", "to the left in front of him"),
    ("walks right away, upright, all right", None),
    ("the man left the room", None),
    ("makes a right angle with bright cleft", None),
])
def test_captions(text, expected):
  assert mirror_caption(text) == (expected or text)


def test_two_mirrors_are_none():
  for clip in synthetic_clips(0, 11, num_frames=30):
    once = mirror_clip(clip)
    twice = mirror_clip(once)
    assert once.id == "M" + clip.id and twice.captions == clip.captions
    np.testing.assert_array_equal(twice.joints, clip.joints)


def test_tags():
  assert tag("A person waves with the left hand, bending the knees.") == [
      "a/DET", "person/NOUN", "wave/VERB", "with/ADP", "the/DET", "left/ADJ", "hand/NOUN", "bend/VERB", "the/DET",
      "knee/NOUN"]
  assert tag("he is walking slowly and turns left.") == [
      "he/PRON", "be/AUX", "walk/VERB", "slowly/ADV", "and/CCONJ", "turn/VERB", "left/ADV"]
