"""Sentences that say which leg are told apart from those with the other leg: side guidance."""
import numpy as np
import pytest

from motion_jax.data.mirror import mirror_legs
from motion_jax.loading import load
from motion_jax.models.cmdm import networks
from motion_jax.models.cmdm.networks import away_from_the_other_side
from motion_jax.text.encoder import load_text_encoder
from tests.models.cmdm.test_multi_prompt import FAST, shaken

KICK = "a person kicks with the left foot"


@pytest.fixture(scope="module")
def model(tiny_run):
  return shaken(load(tiny_run))


def test_words_go_away_from_the_other_side(model):
  """words + scale (words - mirrored words), in the row of the sentence that names a side and in no other."""
  prompts = ["a person walks", KICK, "a person left the room", "he kicks with the right foot, left of the ball"]
  plain, mask = model.encode_words(prompts)
  led, same = model.encode_words(prompts, 1.5)
  assert (mask == same).all() and (led[[0, 2]] == plain[[0, 2]]).all()
  for row, mirrored in ((1, KICK.replace("left", "right")), (3, "he kicks with the left foot, left of the ball")):
    other = model.encode_words([mirrored])[0][0]
    np.testing.assert_allclose(led[row], plain[row] + 1.5 * (plain[row] - other), rtol=1e-5, atol=1e-5)
    assert np.abs(led[row] - plain[row]).max() > 0.1 and (led[row, ~mask[row]] == 0).all()
  # The two sides stay each other's mirror image, and a sentence does not know its batch-mates.
  both = lambda scale: sum(model.encode_words([prompt], scale)[0] for prompt in (KICK, KICK.replace("left", "right")))
  np.testing.assert_allclose(both(1.0), both(0.0), rtol=1e-5, atol=1e-5)
  assert (model.encode_words([KICK], 1.5)[0][0] == led[1]).all()


def test_words_of_another_number_of_pieces_stay(model, monkeypatch):
  """There is nothing to lead each of them away from."""
  monkeypatch.setattr(networks, "mirror_legs", lambda text: text.replace("left", "right flibbertigibbet"))
  assert (model.encode_words([KICK], 1.0)[0] == model.encode_words([KICK])[0]).all()


@pytest.mark.parametrize("text, other", [
    ("a left-footed kick", "a right-footed kick"), ("Left hand up, right leg out", "Left hand up, left leg out"),
    ("a right kick, turning right", "a left kick, turning right"), ("on his LEFT  KNEE", "on his RIGHT  KNEE"),
    *((same, same) for same in (
        "turns left", "walks to the right", "turns left while waving a hand", "goes clockwise", "a right hand turn",
        "left the foot", "upright legs", "waves the left hand", "right away", "puts the foot to the left"))])
def test_which_words_name_a_leg(text, other):
  assert (mirror_legs(text), mirror_legs(other)) == (other, text)


def test_one_vector_a_sentence_is_led_too():
  encoder = load_text_encoder("words", level="sentence")
  emb, mask = encoder([KICK, "a person walks"])
  led = away_from_the_other_side(encoder, [KICK, "a person walks"], emb, mask, 1.0)
  other = encoder([KICK.replace("left", "right")])[0]
  np.testing.assert_allclose(led[0], 2 * emb[0] - other[0], rtol=1e-5, atol=1e-6)
  assert (led[1] == emb[1]).all()


def test_motions_that_name_no_side_stay_and_streams_say_the_same(model):
  """Bit for bit without a side; with one, offline and stream lead the same blocks, whenever the words are said."""
  prompts = [("a person walks", 1.2), (KICK, 1.3), ("a person sits", 0.7)]
  make = lambda scale: model.multi_prompt(prompts, seed=2, cleanup=False, side_guidance=scale, **FAST)
  plain, led = make(0.0), make(2.0)
  assert (plain.meta["side_guidance"], led.meta["side_guidance"]) == (0.0, 2.0)
  assert (led.joints[:24] == plain.joints[:24]).all() and np.abs(led.joints[24:50] - plain.joints[24:50]).max() > 1e-3
  stream = model.stream("a person walks", seed=2, num_frames=64, cleanup=False, side_guidance=2.0, **FAST)
  stream.say(KICK, after=1.2)
  stream.say("a person sits", after=2.4)
  assert np.abs(np.concatenate(list(stream)) - led.joints).max() < 1e-4


@pytest.mark.slow
def test_the_released_way_is_led_too(model):
  prompts = [("a person walks", 1.2), (KICK, 1.3)]
  plain, led = (model.multi_prompt(prompts, seed=2, cleanup=False, way="chain", side_guidance=scale, **FAST).joints
                for scale in (0.0, 2.0))
  assert np.abs(led[:20] - plain[:20]).max() < 1e-4 and np.abs(led - plain).max() > 1e-3


def test_the_model_that_ships_is_led_and_others_are_not(model):
  assert load("cmdm-small").sampling().side_guidance == 1.0
  assert model.sampling().side_guidance == 0.0
  with pytest.raises(ValueError, match="side_guidance -1.*from 0 to 10"):
    model.sampling(side_guidance=-1)
