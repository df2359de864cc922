"""Prompts by a grammar: one to four actions with sides, manners, counts and paths, in sequence and at the same time.

A prompt is a pure function of (seed, number). Every phrase stands for what captures of the shipped models show; which
of the prompts a model can do is found out by sampling and checking them (`compose`).
"""
import numpy as np

from motion_jax.data.batches import step_rng
from motion_jax.text.morphology import present_participle, third_person

_SUBJECTS = ("a person", "a man", "a woman", "someone", "the person", "a human", "somebody", "the man", "he", "she",
             "a figure", "the figure", "a guy", "a boy", "person", "the human", "a young woman", "this person")
_GENDERS = {"he": ("he", "man", "guy", "boy"), "she": ("she", "woman")}
_SIDES = ("left", "right")
# Verb and rest; {side} is drawn. Ways of moving on, which other actions accompany.
_WAYS = ("walk forward", "walk straight ahead", "walk", "walk a few steps forward", "take a few steps", "run forward",
         "run", "jog forward", "jog", "walk backward", "walk backwards", "take a few steps back", "walk in a circle",
         "walk in a circle to the {side}", "walk around in circles", "walk in a clockwise circle",
         "walk in a counterclockwise circle", "run in a circle", "jog in circles", "walk a curve to the {side}",
         "walk forward and to the {side}", "walk diagonally to the {side}", "make a u-turn", "walk in a zigzag",
         "walk on the spot", "march in place", "sidestep to the {side}", "step to the {side}",
         "take two steps to the {side}", "move to the {side}", "walk away", "walk around", "sneak forward", "stroll",
         "march forward", "stride ahead", "hop forward", "skip ahead", "tiptoe forward", "crawl forward")
_TURNS = ("turn {side}", "turn to the {side}", "turn around", "turn around to the {side}", "spin around",
          "make a half turn", "turn 90 degrees to the {side}", "turn 180 degrees", "make a quarter turn to the {side}")
_ARMS = ("wave", "wave the {side} hand", "wave with the {side} hand", "wave both hands", "raise the {side} hand",
         "raise the {side} arm", "raise both arms", "raise both hands", "lift the {side} arm", "put both hands up",
         "hold the {side} arm up", "clap", "clap the hands", "punch with the {side} hand", "throw a {side} punch",
         "throw a punch", "stretch both arms out to the sides", "put the hands on the hips", "cross the arms",
         "hold both arms out", "scratch the head with the {side} hand", "beckon", "salute", "swing the arms")
_WHOLE = ("bow", "take a bow", "bow deeply", "kick", "kick with the {side} leg", "kick with the {side} foot",
          "throw a {side} kick", "jump", "jump up", "jump forward", "leap up", "hop", "squat", "crouch down",
          "sit down", "take a seat", "kneel down", "lie down", "bend over", "bend down", "bend forward", "stand still",
          "stop", "pause", "wait", "dance", "do a dance", "lean to the {side}", "look around", "stretch",
          "stand on one leg", "stand on the {side} leg", "lift the {side} leg", "lift the {side} knee",
          "pick something up", "throw a ball")
_COUNTED = ("jump", "hop", "kick", "kick with the {side} leg", "punch", "punch with the {side} hand", "squat", "bow",
            "wave", "clap", "wave the {side} hand", "raise the {side} hand", "jump up", "raise both arms")
_COUNTS = ("once", "twice", "two times", "three times", "3 times", "four times", "thrice")
_MANNERS = ("slowly", "quickly", "fast", "happily", "sadly", "carefully", "proudly", "tiredly", "energetically",
            "like a zombie", "like an old person", "like a robot", "in a relaxed way", "at a slow pace", "briskly",
            "like a giant", "with big steps", "nervously")
_THEN = (", then ", " and then ", ", and then ", " then ", ", and ", " and ", ". then {who} ", ", after that {who} ",
         ", afterwards {who} ", ". {who} ", " and finally ", ", followed by {ing}", " before {ing}")
_WHILE = (" while {ing}", ", {ing} at the same time", " and at the same time {s}", " and simultaneously {s}",
          ", {ing}", " as {who} {s}", " whilst {ing}", " while {who} {s}")
_WITH = ("with the {side} hand raised", "with the {side} arm up", "with both arms raised", "with both arms up",
         "with the arms crossed", "with the hands on the hips", "with both arms stretched out", "with the hands up")
_STOPS = (" and stops", ", then stops", " and then stops", ", stops", " and stands still", " and comes to a stop")
_KINDS = {"then": 0.34, "three": 0.18, "while": 0.16, "with": 0.06, "count": 0.12, "single": 0.06, "stop": 0.08}
_TYPING_ERRORS = 0.04  # share of prompts with one


def prompt(seed: int, number: int) -> str:
  """Prompt `number` of a seed."""
  rng = step_rng(seed, 21, number)
  kind = rng.choice(list(_KINDS), p=list(_KINDS.values()))
  text = _Sentence(rng).of_kind(kind)
  return _mistyped(text, rng) if rng.random() < _TYPING_ERRORS else text


class _Sentence:
  """Draws the parts of one sentence."""

  def __init__(self, rng: np.random.Generator) -> None:
    self.rng, self.who = rng, str(rng.choice(_SUBJECTS))
    genders = [pronoun for pronoun, words in _GENDERS.items() if self.who.split()[-1] in words]
    self.pronoun = genders[0] if genders else str(rng.choice(("he", "she", "they")))

  def of_kind(self, kind: str) -> str:
    match kind:
      case "then":
        return self._sequence(2)
      case "three":
        return self._sequence(3 if self.rng.random() < 0.75 else 4)
      case "while":
        return self.who + " " + self._at_once()
      case "with":
        return f"{self.who} {self._finite(self._one_of(_WAYS))} {self._one_of(_WITH)}"
      case "count":
        return f"{self.who} {self._counted()}" if self.rng.random() < 0.5 else self._sequence(2, counted=True)
      case "stop":
        further = ", then " + self._finite(self._action()) if self.rng.random() < 0.5 else ""
        return f"{self.who} {self._finite(self._one_of(_WAYS))}{self._one_of(_STOPS)}{further}"
    return f"{self.who} {self._finite(self._action())} {self._one_of(_MANNERS)}"

  def _one_of(self, phrases):
    text = str(self.rng.choice(phrases))
    while "{side}" in text:
      text = text.replace("{side}", str(self.rng.choice(_SIDES)), 1)
    return text

  def _action(self):
    kinds = (_WAYS, _TURNS, _ARMS, _WHOLE)
    return self._one_of(kinds[self.rng.choice(4, p=(0.4, 0.12, 0.23, 0.25))])

  def _counted(self):
    return f"{self._finite(self._one_of(_COUNTED))} {self._one_of(_COUNTS)}"

  def _at_once(self):
    way = self._one_of(_WAYS)
    arms = self._one_of(_ARMS)
    first, second = (way, arms) if self.rng.random() < 0.7 else (arms, way)
    return self._finite(first) + self._joined(self._one_of(_WHILE), second)

  def _sequence(self, count, counted=False):
    before = self._action()
    if not counted and self.rng.random() < 0.12:
      parts = [self._at_once()]
    else:
      manner = f" {self._one_of(_MANNERS)}" if self.rng.random() < 0.15 else ""
      parts = [self._finite(before) + manner]
    at = int(self.rng.integers(count)) if counted else -1
    for place in range(1, count):
      action = self._action()
      while action == before:
        action = self._action()
      joint, before = self._one_of(_THEN), action
      if count > 2 and place < count - 1 and self.rng.random() < 0.6:
        joint = ", "
      if place == at and "{" not in joint:
        parts.append(joint + self._counted())
      else:
        parts.append(self._joined(joint if "{ing}" in joint else joint + "{s}", action))
    if at == 0:
      parts[0] = self._counted()
    if count == 2 and self.rng.random() < 0.06:
      return f"after {_participle(self._one_of(_WAYS))}, {self.who} {self._finite(before)}"
    return f"{self.who} {''.join(parts)}"

  def _joined(self, pattern, action):
    """A pattern such as ". {who} {s}" with the action in its place."""
    plural = "{who}" in pattern and self.pronoun == "they"
    return pattern.format(ing=_participle(action), s=action if plural else self._finite(action), who=self.pronoun)

  def _finite(self, action):
    verb, _, rest = action.partition(" ")
    return f"{third_person(verb)} {rest}".strip()


def _participle(action):
  verb, _, rest = action.partition(" ")
  return f"{present_participle(verb)} {rest}".strip()


def _mistyped(text, rng):
  """The text with one letter of a long word dropped, doubled or exchanged with the next."""
  words = text.split(" ")
  long = [at for at, word in enumerate(words) if len(word) > 4 and word.isalpha()]
  if not long:
    return text
  at = long[rng.integers(len(long))]
  word, place = words[at], int(rng.integers(1, len(words[at]) - 1))
  words[at] = (word[:place] + word[place + 1:], word[:place] + word[place] + word[place:],
               word[:place] + word[place + 1] + word[place] + word[place + 2:])[rng.integers(3)]
  return " ".join(words)
