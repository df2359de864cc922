"""Contrast guidance: a prompt's embedding is moved away from that of its negative prompt, such as the other leg."""
import numpy as np
import pytest

from motion_jax.data.mirror import mirror_legs
from motion_jax.loading import load
from motion_jax.text.contrast import Contrast
from tests.models.cmdm.test_multi_prompt import FAST, shaken

KICK = "a person kicks with the left foot"


@pytest.fixture(scope="module")
def model(tiny_run):
  return shaken(load(tiny_run))


def test_embeddings_move_away_from_those_of_the_other_leg(model):
  """text_emb + scale (text_emb - mirrored), in the row of the sentence that names a leg and in no other."""
  prompts = ["a person walks", KICK, "a person left the room", "he kicks with the right foot, left of the ball"]
  plain, mask = model.encode_words(prompts)
  led, same = model.encode_words(prompts, Contrast(mirror_legs, 1.5))
  assert (mask == same).all() and (led[[0, 2]] == plain[[0, 2]]).all()
  for row, mirrored in ((1, KICK.replace("left", "right")), (3, "he kicks with the left foot, left of the ball")):
    other = model.encode_words([mirrored])[0][0]
    np.testing.assert_allclose(led[row], plain[row] + 1.5 * (plain[row] - other), rtol=1e-5, atol=1e-5)
    assert np.abs(led[row] - plain[row]).max() > 0.1 and (led[row, ~mask[row]] == 0).all()
  # The two sides stay each other's mirror image, and a sentence does not know its batch-mates.
  both = lambda scale: sum(model.encode_words([prompt], Contrast(mirror_legs, scale))[0]
                           for prompt in (KICK, KICK.replace("left", "right")))
  np.testing.assert_allclose(both(1.0), both(0.0), rtol=1e-5, atol=1e-5)
  assert (model.encode_words([KICK], Contrast(mirror_legs, 1.5))[0][0] == led[1]).all()
  # Tokens of a prompt whose negative has another number of them have no counterpart.
  longer = Contrast(lambda text: text.replace("left", "right flibbertigibbet"), 1.0)
  assert (model.encode_words([KICK], longer)[0] == model.encode_words([KICK])[0]).all()


@pytest.mark.parametrize("text, other", [
    ("a left-footed kick", "a right-footed kick"), ("Left hand up, right leg out", "Left hand up, left leg out"),
    ("a right kick, turning right", "a left kick, turning right"), ("on his LEFT  KNEE", "on his RIGHT  KNEE"),
    *((same, same) for same in (
        "turns left while waving a hand", "a right hand turn", "left the foot", "upright legs",
        "puts the foot to the left"))])
def test_which_words_name_a_leg(text, other):
  assert (mirror_legs(text), mirror_legs(other)) == (other, text)


def test_motions_that_name_no_side_stay_and_streams_say_the_same(model):
  """Bit for bit without a side; with one, offline and stream lead the same blocks, whenever the words are said."""
  prompts = [("a person walks", 1.2), (KICK, 1.3), ("a person sits", 0.7)]
  make = lambda scale: model.multi_prompt(prompts, seed=2, negative_prompts=mirror_legs, contrast_scale=scale, **FAST)
  plain, led = make(0.0), make(2.0)
  assert (plain.meta["contrast_scale"], led.meta["contrast_scale"]) == (0.0, 2.0)
  assert (led.joints[:24] == plain.joints[:24]).all() and np.abs(led.joints[24:50] - plain.joints[24:50]).max() > 1e-3
  stream = model.stream("a person walks", seed=2, num_frames=64, negative_prompts={KICK: mirror_legs(KICK)},
                        contrast_scale=2.0, **FAST)
  stream.say(KICK, after=1.2)
  stream.say("a person sits", after=2.4)
  assert np.abs(np.concatenate(list(stream)) - led.joints).max() < 1e-4


def test_without_negative_prompts_nothing_is_contrasted(model):
  """Whatever the scale, and with them only where a scale is chosen: cmdm-small's config does, others do not."""
  assert load("cmdm-small").sampling().contrast_scale == 1.0 and model.sampling().contrast_scale == 0.0
  plain = model.generate(KICK, 72, seed=1, **FAST)
  same = model.generate(KICK, 72, seed=1, contrast_scale=2.0, **FAST), model.generate(
      KICK, 72, seed=1, negative_prompts=mirror_legs, **FAST)
  assert all((one.joints == plain.joints).all() and one[0].meta["contrast_scale"] == 0.0 for one in same)
  with pytest.raises(ValueError, match="contrast_scale -1.*from 0 to 10"):
    model.sampling(contrast_scale=-1)
