"""Bring hands to a place and lean the trunk of standing and walking bodies, with captions to match.

Captions often mention arms held in a place, which captures seldom show. A hand is brought to a place of
`motion.reaching`, kept there and sometimes brought to another one; a trunk leans or sways (`motion.leaning`). Legs and
all other movement stay as captured.
"""
import re
from collections.abc import Iterator

import numpy as np

from motion_jax.analysis.describe import FPS
from motion_jax.data.augment.chains import in_a_row, standing
from motion_jax.data.augment.parts import MOST, SHORTEST, new_clip
from motion_jax.data.clip import Clip
from motion_jax.motion.leaning import lean
from motion_jax.motion.reaching import bring_hands
from motion_jax.motion.skeleton import SIDES
from motion_jax.motion.smoothing import smoothstep
from motion_jax.text.captions import SUBJECTS

# Phrases for bringing hands to a place, and, after "with", for hands that are there. {arms}: "both arms", "the left
# arm"; {hands} likewise; {s}: plural "s" for both hands.
_SAID = {
    "side": (("holds {arms} out to the side{s}", "stretches {arms} out to the side{s}", "extends {arms} sideways",
              "raises {arms} to the side{s}"), "{arms} held out to the side{s}"),
    "front": (("holds {arms} out in front", "stretches {arms} forward", "extends {arms} out in front of the body",
               "raises {arms} in front"), "{arms} stretched out in front"),
    "up": (("raises {arms} above the head", "puts {hands} up in the air", "reaches up with {hands}",
            "holds {arms} up over the head"), "{arms} raised above the head"),
    "face": (("brings {hands} to the face", "puts {hands} to the mouth", "holds {hands} in front of the face"),
             "{hands} at the face"),
    "ear": (("puts {hands} to the ear{s}", "holds {hands} against the ear{s}", "covers the ear{s} with {hands}"),
            "{hands} at the ear{s}"),
    "head": (("puts {hands} on the head", "touches the head with {hands}", "holds the head with {hands}"),
             "{hands} on the head"),
    "shoulder": (("puts {hands} on the opposite shoulder{s}", "touches the opposite shoulder{s} with {hands}"), ""),
    "chest": (("puts {hands} on the chest", "holds {hands} in front of the chest"), "{hands} on the chest"),
    "stomach": (("puts {hands} on the stomach", "holds the belly with {hands}"), "{hands} on the stomach"),
    "back": (("puts {hands} behind the back", "holds {hands} behind the back"), "{hands} behind the back"),
    "hips": (("puts {hands} on the hip{s}", "places {hands} on the hip{s}", "rests {hands} on the waist"),
             "{hands} on the hip{s}"),
    "together": (("puts the hands together", "brings both hands together", "clasps the hands"), "hands together"),
    "crossed": (("crosses the arms", "folds the arms in front of the chest", "crosses the arms over the chest"),
                "arms crossed")}
_BY_BOTH = ("together", "crossed")
_LOWERED = ("lowers {arms}", "brings {arms} back down", "drops {hands} to the side{s}")
# (left, ahead) of a lean, its degrees, whether it sways to the opposite side, too, and phrases.
_LEANS = (
    ((1, 0), 20.0, False, ("leans to the left", "bends to the left side", "tilts to the left")),
    ((-1, 0), 20.0, False, ("leans to the right", "bends to the right side", "tilts to the right")),
    ((0, 1), 30.0, False, ("leans forward", "bends forward a little", "leans ahead")),
    ((0, -1), 15.0, False, ("leans back", "leans backward")),
    ((1, 0), 15.0, True, ("sways from side to side", "leans from left to right", "sways left and right")),
    ((0, 1), 15.0, True, ("sways back and forth", "rocks back and forth")))
_LEANING, _GOING, _TWO, _LOWERING = 0.2, 0.35, 0.35, 0.4  # probabilities of leans, walks, second places and lowering
_TAKEN, _KEPT, _CYCLE = (0.5, 1.2), (0.7, 2.2), 2.5  # seconds of taking and keeping a posture, and of one sway
_LEAD = (0.2, 0.8)  # seconds of standing before it
_NO_OTHER = re.compile(r"\b(?:arms?|hands?|with)\b")


def postures(parts, rng) -> Iterator[Clip | None]:
  """Standing, walking or running bodies with hands in a place, and standing bodies that lean."""
  still = [still_part for part in parts for still_part in standing(part, MOST)]
  going = [(part, said) for part in parts if part.going and part.known and len(part.joints) >= SHORTEST
           for said in [[text for text in part.sayings if not _NO_OTHER.search(text)]] if said]
  number = 0
  while still:
    number += 1
    chance = rng.random()
    if chance < _LEANING:
      yield _leaning(still[rng.integers(len(still))], number, rng)
    elif chance < _LEANING + _GOING and going:
      yield _carried(*going[rng.integers(len(going))], number, rng)
    else:
      yield _held(still[rng.integers(len(still))], number, rng)


def _held(part, number, rng):
  """A standing body that brings its hands to a place, perhaps to a second one, and perhaps down again."""
  places = [str(place) for place in rng.choice(list(_SAID), 1 + (rng.random() < _TWO), replace=False)]
  sides = _sides(places, rng)
  if rng.random() < _LOWERING:
    places.append("down")
  joints, start = part.joints, rng.uniform(*_LEAD) * FPS
  subjects, spans = [SUBJECTS[k] for k in rng.permutation(3)], []
  for place in places:
    taken, kept = (rng.uniform(*seconds) * FPS for seconds in (_TAKEN, _KEPT))
    joints = bring_hands(joints, place, sides, smoothstep((np.arange(len(joints)) - start) / taken))
    begin, start = round(start) if spans else 0, start + taken + kept
    spans.append((_words(place, sides, rng), begin, min(round(start), len(joints))))
  said = [in_a_row([f"{subject} {_words(place, sides, rng)}." for place in places], k) if len(places) > 1
          else f"{subject} {_words(places[0], sides, rng)}." for k, subject in enumerate(subjects)]
  spans = [(f"{subjects[0]} {words}.", begin, past) for words, begin, past in spans]
  return new_clip("postures", number, joints[:spans[-1][2]], said, part, places[0], spans if len(spans) > 1 else ())


def _carried(part, texts, number, rng):
  """A walk or run with hands in a place throughout."""
  place = str(rng.choice([place for place, (_, beside) in _SAID.items() if beside]))
  sides = _sides([place], rng)
  joints = part.joints[:MOST]
  joints_held = bring_hands(joints, place, sides, np.ones(len(joints)))
  said = [f"{texts[rng.integers(len(texts))].rstrip(' .')} with {_filled(_SAID[place][1], sides)}." for _ in range(3)]
  return new_clip("postures", number, joints_held, said, part, f"{part.events[0].kind} {place}")


def _leaning(part, number, rng):
  """A standing body that leans, or sways."""
  (left, ahead), degrees, sways, words = _LEANS[rng.integers(len(_LEANS))]
  start, taken, kept = (rng.uniform(*seconds) * FPS for seconds in (_LEAD, _TAKEN, (1.0, 4.0)))
  frames = np.arange(min(round(start + taken + kept), len(part.joints)))
  weight = smoothstep((frames - start) / taken)
  if sways:
    weight = weight * np.sin(2 * np.pi * (frames - start) / (_CYCLE * FPS))
  leaned = lean(part.joints[:len(frames)], left, ahead, rng.uniform(0.8, 1.3) * degrees * weight)
  said = [f"{SUBJECTS[k]} {words[rng.integers(len(words))]}." for k in rng.permutation(3)]
  return new_clip("postures", number, leaned, said, part, words[0])


def _sides(places, rng):
  """Random sides for hands in these places: both, left or right."""
  if set(places) & set(_BY_BOTH):
    return SIDES
  return (SIDES, SIDES[:1], SIDES[1:])[rng.integers(3)]


def _words(place, sides, rng):
  said = _LOWERED if place == "down" else _SAID[place][0]
  return _filled(said[rng.integers(len(said))], sides)


def _filled(words, sides):
  both = len(sides) == 2
  whose = "both" if both else f"the {sides[0]}"
  return words.format(arms=f"{whose} arm{'s' if both else ''}", hands=f"{whose} hand{'s' if both else ''}",
                      s="s" if both else "")
