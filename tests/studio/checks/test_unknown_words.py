"""Which words of a sentence are worth a warning: those that a person would call unknown, and no others."""
import json

import pytest

from motion_jax import runs
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.captions import TrainingCaptions
from motion_jax.text.captions import SUBJECTS
from motion_jax.text.encoder import load_text_encoder
from motion_studio.checks.prompt_notes import with_suggestion

# Sentence -> the words of it that the models that ship do not know; "word=other" where it is misspelled.
SENTENCES = {
    # politeness, fillers, ways to ask
    "please walk forward": "",
    "Could you kindly walk to the left, please?": "",
    "hey, now just walk really slowly, okay?": "",
    "um, maybe he walks very, very slowly": "",
    "I would like to see somebody walk, thanks": "",
    "show me an animation of a person who waves": "",
    "generate a motion in which someone actually sits": "",
    "okay so basically the person sort of jumps a little bit": "",
    "yes, perhaps she probably runs": "",
    "a person doesn't walk, he can't, he won't": "",
    "Let's walk!": "",
    # who moves
    "she walks": "", "he is walking": "", "they walk": "", "it jumps": "", "I walk": "", "we wave": "",
    "John walks forward": "",
    "Mary is waving, then Peter sits down": "",
    "a man named Svetozar walks": "",
    "then Ferdinand waves": "",
    "Mr Smithers walks, then Smithers waves": "",
    "the human walks towards her": "",
    "a woman walks while the figure waves": "",
    # numbers, units, time
    "a person walks 5 metres": "", "a person walks five meters in 3 seconds": "",
    "a person turns 90 degrees, then 180 deg": "", "a person jumps 30 cm high": "",
    "a person jumps twenty-five times": "", "a person walks 10km at 4 km per hour": "",
    "a person waves twice for half a minute": "", "first he walks, secondly he sits, and lastly he waves": "",
    "a person suddenly starts to walk, continues walking and finally finishes": "",
    # forms of known words
    "a person walked, walks, is walking and will walk": "",
    "he ran, sat, swung the arms and threw punches": "",
    "two people are kneeing each other's feet": "",
    "the happier dancer bowed and was bowing": "",
    "a person jumps higher, faster and more slowly": "",
    "boxers kicked; a kicker punched": "",
    "the quickest, happiest walker": "",
    # other words for what is known
    "a person saunters forward": "", "a person tosses a ball": "", "a person rotates rapidly": "",
    "a joyous person hastily strolls ahead": "", "a person crouches": "", "an ancient man wanders backwards": "",
    "a person makes tiny steps leftwards": "", "a guy pivots": "", "a lady cheerfully waves": "",
    "a person pirouettes": "",  # five dances of the training data are said to hold a pirouette
    # what it never learned
    "a person moonwalks": "moonwalks",
    "a robot walks": "robot",
    "A Robot Walks": "Robot",
    "a robot walks like robots, Robot!": "robot",
    "a person does a headspin": "headspin",
    "a person does a Headspin": "Headspin",
    "Headspin and land": "Headspin",
    "a person climbs a table": "table",
    "please juggle three torches": "juggle torches=touches",
    "a person surfs on a wave and skis": "surfs skis",
    "someone plays the guitar": "plays guitar",
    "a knight rides a horse": "knight rides horse",
    "a person twerks, flosses and dabs": "twerks flosses",
    "a person sleeps, then cooks": "cooks",
    "a person swims 5 meters": "swims",
    "John does parkour": "parkour",
    "a person meditates peacefully, maybe": "peacefully",
    "a person catches a ball": "catches",
    # misspelled
    "a person wlaks": "wlaks=walks",
    "a persn walks forwrd": "persn=person forwrd=forward",
    "a person jupms and kciks": "jupms=jumps kciks=kicks",
    "someone raises the rihgt hand and wawes": "rihgt=right wawes=waves",
    "a person is wlaking quikly": "wlaking=walking quikly=quickly",
    "he frobnicates": "frobnicates",
}


class Model(TextToMotionModel):
  """The words of a model that ships, without its network."""

  def __init__(self, folder, encoder):
    with open(folder / "captions.json", encoding="utf-8") as file:
      captions = [caption for caption, _ in json.load(file)]
    self.folder, self.encoder = folder, encoder
    self.captions = TrainingCaptions(captions, [60] * len(captions), encoder, subjects=SUBJECTS)


@pytest.fixture(scope="module")
def model():
  run = runs.load_run("cmdm-small")
  return Model(run.folder, load_text_encoder(run.text))


@pytest.mark.parametrize("sentence, expected", SENTENCES.items())
def test_what_a_person_is_warned_of(model, sentence, expected):
  expected = dict((said.split("=") + [""])[:2] for said in expected.split())
  found = model.captions.unknown_words(sentence)
  assert found == list(expected)
  assert [with_suggestion(model, word) for word in found] == [
      f"{word!r} (did you mean {other!r}?)" if other else repr(word) for word, other in expected.items()]
