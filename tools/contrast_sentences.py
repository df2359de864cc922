"""Sentences about movement that differ in one word only, and in what that word asks for: slowly or quickly, left or
right, twice or three times, with or without.

`CONTRASTS` says which words part otherwise equal sentences, and which mean the same there; `pairs` draws such sentences
two by two. The distillation of the small text encoder (tools/distill_words.py) moves the features of the former apart
and holds those of the latter together. `event_sentences` and `composed` are what else people ask of motion in one
sentence: captions by kinematics (`motion_jax.analysis.event_words`), and several actions after each other or at once.
"""
import random
import re
from typing import NamedTuple

import movement_sentences
import numpy as np

from motion_jax.analysis.event_words import USUAL, sentence
from motion_jax.analysis.events import Event
from motion_jax.text.captions import SUBJECTS, vary_subject, without_subject

GAITS = "walks runs jogs jumps hops steps moves goes crawls skips sneaks marches"
ACTIONS = ("walks; runs; walks forward; turns around; waves the right hand; waves both hands; bows; claps; dances; "
           "sits down; stands up; kicks with the left foot; raises the left hand; punches; jumps; squats; nods; walks "
           "in a circle; raises both arms; crawls; sneaks forward; picks up a box; throws a ball; lies down; bends "
           "down")
REPEATED = ("jumps; hops; waves; waves the right hand; kicks with the left foot; kicks; squats; claps; nods; punches; "
            "turns around; bows; raises both hands; stomps; walks in a circle; swings the arms; hops on one leg")


class Contrast(NamedTuple):
  """Predicates with a gap {x}, in which other words mean something else.

  frames: predicates, ";" between them; {g}, {a} and {r} stand for one of GAITS, ACTIONS and REPEATED. meanings: lists
  of what may stand in the gap, a list for each meaning; where not all its words carry the meaning, *those* do.
  """
  frames: str
  meanings: tuple[str, ...]


_SIDES = ("the *left* {}", "the *right* {}", "*both* {}s", "*one* {}")
CONTRASTS = {
    "speed": Contrast("{a} {x}; {g} forward {x}; {g} {x}; {r} {x}; {x} {a}", (
        "slowly; very *slowly*; unhurriedly; leisurely; at a *slow* pace",
        "quickly; fast; rapidly; swiftly; very *fast*; very *quickly*; briskly; in a *hurry*; at a *fast* pace; "
        "at high *speed*")),
    "force": Contrast("{a} {x}; {r} {x}", ("strongly; forcefully", "gently; softly")),
    "direction": Contrast("{g} {x}; {g} slowly {x}; {g} {x} quickly; {g} three steps {x}; leans {x}", (
        "forward; forwards; ahead; straight *ahead*", "backward; backwards; in *reverse*",
        "to the *left*; sideways to the *left*", "to the *right*; sideways to the *right*", "in *place*")),
    "turn": Contrast("turns {x}; spins {x}; rotates {x}; walks forward and turns {x}; turns 90 degrees {x}; looks {x}; "
                     "leans {x}; walks in a circle {x}; makes a u-turn {x}; walks diagonally forward {x}", (
                         "to the *left*; *left*", "to the *right*; *right*")),
    "sense": Contrast("turns {x}; spins {x}; walks in a circle {x}; swings the arms {x}; runs around {x}", (
        "clockwise", "counterclockwise; anticlockwise")),
    "hand": Contrast("raises {x}; lifts {x}; waves {x}; waves with {x}; lowers {x}; swings {x}; puts up {x}; circles "
                     "{x} forward; punches with {x}; reaches to the floor with {x}; throws a ball with {x}; points "
                     "with {x}; waves {x} three times; lifts {x} up", tuple(
                         "; ".join(side.format(limb) for limb in ("hand", "arm")) for side in _SIDES)),
    "foot": Contrast("kicks with {x}; kicks twice with {x}; hops on {x}; lifts {x}; stands on {x}; stomps with {x}", (
        "the *left* foot; the *left* leg", "the *right* foot; the *right* leg", "*both* feet; *both* legs",
        "*one* foot; *one* leg")),
    "limb": Contrast("raises the left {x}; moves the right {x}; bends the left {x}; shakes the right {x}", (
        "hand", "foot", "knee", "elbow", "shoulder")),
    "count": Contrast("{r} {x}; {r} quickly {x}", (
        "once; *one* time", "twice; *two* times", *(f"*{number}* times" for number in
                                                   "three four five six seven eight ten".split()),
        "*several* times; *many* times")),
    "number": Contrast("takes {x} steps forward; does {x} squats; takes {x} steps back; does {x} kicks; makes {x} "
                       "jumps; walks for {x} seconds; waits {x} seconds", tuple(
                           "two three four five six seven eight ten".split())),
    "degrees": Contrast("turns {x} degrees to the left; turns {x} degrees to the right; spins {x} degrees", (
        "45; forty-five", "90; ninety", "180", "270", "360")),
    "path": Contrast("walks {x}; runs {x}; walks slowly {x}; jogs {x}; goes {x}; walks quickly {x}", (
        "in a *circle*; in *circles*", "in a *zigzag*", "in a *straight line*; *straight* ahead", "in a *curve*; in an "
        "*arc*", "in a *square*")),
    "height": Contrast("jumps {x}; raises the left knee {x}; kicks {x}; lifts both arms {x}; squats {x}; bows {x}", (
        "high; very *high*", "low; very *low*", "deeply", "slightly; a *little*")),
    "up and down": Contrast("looks {x}; reaches {x}; swings the arms {x}; points {x}; moves both hands {x}; climbs "
                            "{x}; bends the head {x}; walks {x} the stairs", ("up; upward; upwards", "down; downward; "
                                                                         "downwards")),
    "size": Contrast("{g} forward with {x} steps; takes {x} steps; waves with {x} movements; makes {x} circles; swings "
                     "the arms in {x} circles", ("big; large; long", "small; short; tiny")),
    "negation": Contrast("{g} forward {x} confidence; {a} {x} confidence; {g} {x} energy; walks {x} swinging the arms; "
                         "jumps {x} bending the knees; walks {x} a limp", ("*with*", "*without*")),
    "confidence": Contrast("{g} {x}; {g} forward {x}; {a} {x}", (
        "confidently; with *confidence*; proudly", "*without confidence*; timidly; hesitantly; shyly")),
    "rest": Contrast("{x}; {x} for a moment; {x} for three seconds", (
        "*stands still*; *stays still*; is *standing still*; does *nothing*; does *not move*; *stands motionless*; "
        "stands in place and does *not move*; *waits*", "*walks*; *walks* forward; is *walking*", "*runs*; is "
        "*running*", "*jumps*", "*dances*")),
    "stop": Contrast("walks forward and {x}; walks, then {x}; runs and then {x}; walks in a circle and {x}; jogs and "
                     "{x}", ("*stops*; *halts*; comes to a *stop*; *stands still*; *pauses*",
                             "*goes on*; *continues*; *keeps going*", "*turns* around", "*jumps*")),
    "begin": Contrast("{x} walking; {x} running; {x} waving; {x} to walk", ("starts; begins", "stops; finishes")),
    "order": Contrast("walks forward {x} waving; {a} {x} sitting down; {a} {x} turning around; {a} {x} jumping", (
        "before", "after", "while")),
    "arms": Contrast("{x} the left hand; {x} the right arm; {x} both arms; {x} the right knee", (
        "raises; lifts", "lowers; drops", "waves; shakes")),
    "posture": Contrast("{x}; {x} slowly; {x} on the floor", ("*sits*; *sits down*", "*stands up*; *gets up*",
                                                              "*lies down*; *lies*", "*kneels*; *kneels down*")),
    "objects": Contrast("{x} a box; {x} the box with both hands; {x} a ball", (
        "*picks up*; *lifts*", "*puts down*; *sets down*", "pushes; shoves", "pulls; drags", "throws; tosses",
        "catches")),
    "gait": Contrast("{x} forward; {x} in a circle; {x} to the left; {x} quickly; {x} slowly; {x}", (
        "walks; strolls", "runs; jogs", "jumps; hops", "crawls; creeps")),
    "mood": Contrast("{g} {x}; {a} {x}", ("happily; joyfully; cheerfully", "sadly; unhappily", "angrily; furiously",
                                          "tiredly; exhaustedly")),
}


class Marked(NamedTuple):
  """A sentence and the places (start, end) of the words that carry its meaning in a contrast."""
  text: str
  spans: tuple[tuple[int, int], ...]


def _list(text):
  return [part.strip() for part in text.split(";")]


def _marked(template, said):
  """A template whose {x} is filled with words, some of them between asterisks; all of them count where none is."""
  said = said if "*" in said else f"*{said}*"
  pieces = template.replace("{x}", said).split("*")
  text, spans = "", []
  for number, piece in enumerate(pieces):
    if number % 2:
      spans += [(len(text) + m.start(), len(text) + m.end()) for m in re.finditer(r"[\w-]+", piece)]
    text += piece
  return Marked(text, tuple(spans))


def _template(rng, contrast):
  """A sentence with the gap {x}."""
  frame = rng.choice(_list(contrast.frames)).format(
      g=rng.choice(GAITS.split()), a=rng.choice(_list(ACTIONS)), r=rng.choice(_list(REPEATED)), x="{x}")
  subject = rng.choice(SUBJECTS[:3] if rng.random() < 0.7 else SUBJECTS)
  other = rng.choice(_list(ACTIONS))
  shape = rng.choices(("{s} {f}", "{s} {f}.", "{f}", "{s} {o}, then {f}", "{s} {f}, then {o}.", "{s} {o} and {f}.",
                       "{s} {f} and then {o}"), (6, 6, 2, 2, 2, 1, 1))[0]
  return shape.format(s=subject, f=frame, o=other)


def pairs(count, seed=0):
  """(contrast's name, Marked, Marked, whether both mean the same), the two of which differ in the gap only.

  The contrasts take turns; two of three pairs mean different things.
  """
  rng, found, names = random.Random(seed), [], sorted(CONTRASTS)
  while len(found) < count:
    name = names[len(found) % len(names)]
    contrast = CONTRASTS[name]
    meanings = [_list(meaning) for meaning in contrast.meanings]
    same = [meaning for meaning in meanings if len(meaning) > 1]
    alike = bool(same) and rng.random() < 1 / 3
    one, other = rng.sample(rng.choice(same), 2) if alike else map(rng.choice, rng.sample(meanings, 2))
    template = _template(rng, contrast)
    found.append((name, _marked(template, one), _marked(template, other), alike))
  return found


def _event(rng, kind, start):
  """Events of one thing that is done from second `start` on: one, or a walk and a turn at once."""
  pick, end, side = rng.choice, start + 2.0, rng.choice(("left", "right"))
  count = pick((0, 1, 1, 2, 2, 3, 4))
  if kind in ("walk", "run"):
    way = pick(("forward",) * 5 + ("backward", "left", "right", "forward-left", "forward-right", "backward-left"))
    path = pick(("straight", "straight", "curve", "circle", "u-turn", "zigzag", "")) if way == "forward" else "straight"
    usual = USUAL.get(f"{kind} {way}", 0.0)
    event = Event(kind, start, end, amount=usual * pick((0.5, 1.0, 1.0, 1.7)), way=way, path=path)
    return [event] + ([Event("turn", start, end, side, amount=pick((90.0, 180.0, 60.0)))]
                      if path in ("curve", "circle", "u-turn") else [])
  both = pick(("left", "right", "both"))
  amount = {"turn": pick((45.0, 60.0, 90.0, 90.0, 180.0, 270.0, 360.0)), "squat": pick((60.0, 90.0)), "bow": pick(
      (40.0, 70.0)), "jump": pick((0.1, 0.2, 0.3, 0.4)), "wave": 1.5 * pick((0.5, 1.0, 1.6))}.get(kind, 0.0)
  way = pick(("forward", "backward")) if kind == "arm-circle" else pick(("", "", "forward", "backward"))
  return [Event(kind, start, end, both if kind in ("kick", "raise", "wave", "reach-floor", "arm-circle") else side,
                count, amount, way if kind in ("jump", "arm-circle") else "")]


def event_sentences(count, seed=0):
  """Captions as `motion_jax.analysis.describe` makes them, of events that are drawn."""
  rng, found, subjects = random.Random(seed), {}, np.random.default_rng(seed)
  kinds = ("walk walk walk run run turn turn kick kick raise wave wave jump jump hop squat bow reach-floor lie-down "
           "arm-circle").split()
  while len(found) < count:
    events, end = [], 0.0
    if rng.random() < 0.15:
      events, end = [Event("still", 0.0, 1.5)], 1.5
    for _ in range(rng.choice((0, 1, 1, 1, 2, 2, 3) if events else (1, 1, 1, 2, 2, 3))):
      events += _event(rng, rng.choice(kinds), end)
      end += 2.0
    if rng.random() < 0.2:
      events, end = [*events, Event("still", end, end + 1.5)], end + 1.5
    text = sentence(events, end, rng.randrange(60))
    if text:
      found[vary_subject(text, subjects, 0.3)] = None
  return list(found)


def composed(count, seed=0):
  """Sentences of two or three actions, after each other or at once, counted and with lengths."""
  rng, found, grammar = random.Random(seed), {}, movement_sentences.Grammar()
  short = [without_subject(text) for text in event_sentences(count // 2 + 100, seed + 1)
           if not re.search(r",| then ", text)]
  tail = (", then {b}", " and then {b}", ", {b} and {c}", ", then {b} and finally {c}", " for {n} seconds, then {b}",
          ", stops, and {b}", " until {he} stops", " and stops", ", then stands still", " before {ing}", " after {ing}",
          " while {ing}", ", stands still for {n} seconds, then {b}", ". Then {he} {b}.", "; then {b}", " {m} times",
          " {m} times, then {b}", ", then {b} {m} times", " and {b}", ", pauses and {b}", " without stopping",
          " and goes on", " as {he} {b}", ", {ing}", " and does nothing else", ", then keeps {ing}")

  def predicate():
    drawn = rng.random()
    if drawn < 0.4:
      return rng.choice(short)
    if drawn < 0.7:
      contrast = CONTRASTS[rng.choice(sorted(CONTRASTS))]
      frame = rng.choice(_list(contrast.frames)).format(g=rng.choice(GAITS.split()), a=rng.choice(_list(ACTIONS)),
                                                       r=rng.choice(_list(REPEATED)), x="{x}")
      return _marked(frame, rng.choice(_list(rng.choice(contrast.meanings)))).text
    return grammar._form(rng, 1)

  while len(found) < count:
    subject = rng.choice(SUBJECTS[:3] if rng.random() < 0.6 else SUBJECTS)
    text = f"{subject} {predicate()}" + rng.choice(tail).format(
        b=predicate(), c=predicate(), ing=grammar._form(rng, 2), he=rng.choice(("he", "she", "they")),
        n=rng.choice("two three five 2 3 5 ten".split()), m=rng.choice("two three four five several".split()))
    if len(text.split()) < 26:
      found[text + ("." if rng.random() < 0.6 and not text.endswith(".") else "")] = None
  return list(found)


if __name__ == "__main__":
  for name, one, other, alike in pairs(2 * len(CONTRASTS)):
    print(f"{name}: {one.text} {'=' if alike else '|'} {other.text}   "
          f"{[[marked.text[a:b] for a, b in marked.spans] for marked in (one, other)]}")
  print("\n".join(event_sentences(30) + composed(40)))
