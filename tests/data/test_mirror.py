"""Mirrored captions exchange sides and turns and nothing else; mirrored clips move the other way."""
import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax.data.clip import Caption
from motion_jax.data.datasets.base import clip_items
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.data.mirror import mirror_caption, mirror_clip
from motion_jax.motion.representations import get_layout

SPANS = (("a person walks.", 0, 10), ("she waves the left hand.", 10, 30))


@pytest.mark.parametrize("text, expected", [
    ("A person turns Left, then RIGHT.", "A person turns Right, then LEFT."),
    ("turns clockwise, then counter-clockwise", "turns counterclockwise, then clockwise"),
    ("turns left a bit, then right after", "turns right a bit, then left after"),
    # A verb that goes to a side, "to", or another side beside it: "right" before then, before, as is a side.
    ("a person steps right then left", "a person steps left then right"),
    ("he turns right before he sits", "he turns left before he sits"),
    ("from left to right back to the left", "from right to left back to the right"),
    ("swings the hand left and right as if angry", "swings the hand right and left as if angry"),
    ("the lefthand side, a RIGHTHAND turn, the leftfoot", "the righthand side, a LEFTHAND turn, the rightfoot"),
    ("raises the left hand right before sitting", "raises the right hand right before sitting"),
    ("right then he sits, right now, right there", None), ("he turns around right after", None),
    ("the rights, leftover, rightly", None), ("turns in a right angle then stops", None),
    ("walks right away, upright, all right", None),
    ("the man left the room", None),
])
def test_captions(text, expected):
  assert mirror_caption(text) == (expected or text)


def test_a_mirrored_clip_has_its_captions_its_parts_and_its_joints_on_the_other_side():
  clip = synthetic_clips(0, 8, num_frames=30)[7]
  clip = clip.replace(meta=clip.meta | {"spans": SPANS, "tokens": (("a/DET",),)}, captions=(
      Caption("turns left", 0.5, 1.0), *clip.captions))
  once = mirror_clip(clip)
  assert once.id == "M" + clip.id and once.captions[0] == Caption("turns right", 0.5, 1.0)
  assert once.meta["spans"] == (SPANS[0], ("she waves the right hand.", 10, 30)) and "tokens" not in once.meta
  np.testing.assert_array_equal(once.joints[:, 20], clip.joints[:, 21] * [-1, 1, 1])  # wrists
  twice = mirror_clip(once)
  assert twice.captions == clip.captions and twice.meta["spans"] == SPANS
  np.testing.assert_array_equal(twice.joints, clip.joints)


def test_what_training_takes_of_a_mirrored_clip_has_its_parts_on_the_other_side_and_inside_of_its_rows():
  clip = synthetic_clips(0, 8, num_frames=30)[7].replace(captions=(Caption("waves the left hand"),), split="train",
                                                         meta={"spans": SPANS, "content": "wave"})
  plain, mirrored = clip_items([clip], ConfigDict(dict(mode="corrected", mirror=True)), "train", get_layout("full"))
  assert len(plain.features) == len(mirrored.features) == 29 and mirrored.group == "wave"
  assert plain.spans == (("a person walks.", 0, 10), ("she waves the left hand.", 10, 29))
  assert mirrored.spans == (("a person walks.", 0, 10), ("she waves the right hand.", 10, 29))
  assert mirrored.captions == ("waves the right hand",)
  assert np.abs(mirrored.features - plain.features).max() > 0.1
