"""Sentences about the events of a motion: verb phrases with side, count, pace and degrees, in several wordings.

The sentence of a mirrored motion is the mirrored sentence (`data.mirror.mirror_caption`).
"""
from motion_jax.text.captions import SUBJECTS

# Usual pace of an action, medians over the labelled archives (docs/captions.md): walk and run in metres a second, by
# direction, waves in cycles a second. Below 0.75 of it is slow, above 1.3 quick.
USUAL = {"walk forward": 1.15, "walk backward": 0.70, "walk forward-left": 0.97, "walk forward-right": 0.97,
         "run forward": 2.75, "wave": 1.5}
SLOWLY, QUICKLY = 0.75, 1.3
TIMES = {1: "", 2: "twice", 3: "three times", 4: "four times", 5: "five times", 6: "six times", 7: "seven times",
          8: "eight times"}
_NUMBER = {2: "two", 3: "three", 4: "four", 5: "five", 6: "six", 7: "seven", 8: "eight"}
_DEGREES = ((45, 12), (90, 20), (180, 20), (270, 20), (360, 20))


def sentence(events, seconds, variant, subject=""):
  """One sentence in the variant-th wording, "" for no event; subject: replaces "a person" and the like."""
  moving = [event for event in events if event.kind != "still"]
  phrases = []
  for index, event in enumerate(moving):
    if index and _same(event, moving[index - 1]):
      continue
    phrase = _phrase(event, moving, variant)
    if phrase and phrase not in phrases:
      phrases.append(phrase)
  if not phrases and any(event.kind == "still" and event.end - event.start > 0.8 * seconds for event in events):
    phrases = [_pick(variant, "stands still", "is standing still", "stands in place and does not move")]
  elif not 1 <= len(phrases) <= 3:  # more are too many for a sentence
    return ""
  elif moving:
    begin, end = min(event.start for event in moving), max(event.end for event in moving)
    rests = [event for event in events if event.kind == "still"]
    if any(event.end <= begin + 0.4 and event.end - event.start >= 0.8 for event in rests):
      phrases.insert(0, _pick(variant, "stands still", "stands still for a moment"))
    if any(event.start >= end - 0.4 and event.end - event.start >= 0.8 for event in rests):
      walks = moving[-1].kind in ("walk", "run")
      phrases.append(_pick(variant, *(("stops", "comes to a stop") if walks else ("stands still", "stays still"))))
  return f"{subject or SUBJECTS[variant % 3]} {_joined(phrases, variant)}." if phrases else ""


def _joined(phrases, variant):
  if len(phrases) == 1:
    return phrases[0]
  last = _pick(variant, ", then ", " and then ")
  return ", ".join(phrases[:-1]) + last + phrases[-1]


def _pick(variant, *choices):
  return choices[variant % len(choices)]


def _same(event, other):
  return event.kind == other.kind and event[3:5] == other[3:5] and event[6:] == other[6:]


def _phrase(event, others, variant):
  """The verb phrase of an event, or "" if that of another event includes it."""
  return _PHRASES[event.kind](event, others, variant)


def usual_pace(event):
  """The usual pace of an event's kind, None if unknown."""
  return USUAL.get(event.kind) or USUAL.get(f"{event.kind} {event.way}")


def pace(event):
  """The pace of an event relative to its kind: "slowly", "quickly", or "" for usual or unknown."""
  usual = usual_pace(event)
  if not usual or not event.amount:
    return ""
  ratio = event.amount / usual
  return "slowly" if ratio < SLOWLY else "quickly" if ratio > QUICKLY else ""


def _spaced(*words):
  return " ".join(word for word in words if word)


def _going(event, others, variant):
  verb = _pick(variant, *{"walk": ("walks", "is walking", "walks"), "run": ("runs", "is running", "runs")}[event.kind])
  turns = [turn for turn in others if turn.kind == "turn" and turn.start < event.end and turn.end > event.start]
  side = turns[0].side if turns and len({turn.side for turn in turns}) == 1 else ""
  way = {"forward": _pick(variant, "forward", "ahead", "forward"), "backward": "backward",
         "left": "sideways to the left", "right": "sideways to the right"}.get(event.way, "")
  if event.kind == "walk" and event.way in ("left", "right"):
    verb, way = _pick(variant, (verb, way), ("steps", way), ("shuffles", way),
                      ("takes side steps", f"to the {event.way}"), ("sidesteps", f"to the {event.way}"),
                      ("steps", f"to the {event.way} side"), (f"takes steps to the {event.way}", "sideways"))
  if event.way.startswith(("forward-", "backward-")):
    way = _spaced("diagonally", *event.way.split("-", 1)[:1], "to the", event.way.rpartition("-")[2])
  shape = ""
  if event.way in ("forward", "") and side:
    shape = {"circle": _pick(variant, f"in a circle to the {side}", f"around in a circle, turning {side}"),
             "u-turn": _pick(variant, f"in a half circle to the {side}", f"and makes a u-turn to the {side}")}.get(
                 event.path, "")
    if event.path == "curve" and len(turns) == 1:
      shape = _pick(variant, f"and {_turn(turns[0], variant)}", f"in a curve to the {side}")
  elif event.path == "zigzag" and event.way == "forward":
    shape = "in a zigzag"
  elif event.path == "straight" and event.way == "forward":
    way = _pick(variant, "forward", "straight ahead", "forward in a straight line")
  return _spaced(verb, way, pace(event), shape)


def _turn(event, variant):
  degrees = next((known for known, off in _DEGREES if abs(abs(event.amount) - known) <= off), 0)
  if degrees == 180:
    return _pick(variant, f"turns around to the {event.side}", f"turns 180 degrees to the {event.side}")
  if degrees == 360:
    return _pick(variant, f"turns once around to the {event.side}", f"makes a full turn to the {event.side}")
  if degrees:
    return _pick(variant, f"turns {degrees} degrees to the {event.side}", f"turns to the {event.side}",
                 f"makes a {degrees}-degree turn to the {event.side}")
  return _pick(variant, f"turns to the {event.side}", f"turns {event.side}")


def _turning(event, others, variant):
  if any(other.kind in ("walk", "run") and other.start < event.end and other.end > event.start for other in others):
    return ""
  return _turn(event, variant)


def _kick(event, others, variant):
  return _blow(event, variant, _pick(variant, "foot", "leg"), "kicks", "does", "a kick", "")


def _punch(event, others, variant):
  return _blow(event, variant, _pick(variant, "hand", "fist"), "punches", "throws", "a punch",
               "throws punches with both hands")


def _blow(event, variant, limb, several, does, single, both):
  """Kicks or punches. several: plural and verb; single: "a kick"; both: phrase for over two blows of both limbs."""
  if event.side == "both":
    return f"{several} with one {limb} and then the other" if event.count == 2 else both
  if variant % 3 == 2 and event.count:
    number = _NUMBER.get(event.count)
    return f"{does} {f'{number} {several}' if number else single} with the {event.side} {limb}"
  if event.count == 1 and single == "a punch" and (other := variant // 3 % 4):
    return (f"{does} a {event.side} punch", f"strikes with the {event.side} {limb}",
            f"jabs with the {event.side} {limb}")[other - 1]
  return _spaced(several, TIMES.get(event.count, ""), f"with the {event.side} {limb}")


def _limb(event, variant):
  part = _pick(variant, "hand", "arm")
  return f"both {part}s" if event.side == "both" else f"the {event.side} {part}"


def _raise(event, others, variant):
  limb = _limb(event, variant)
  verb = _pick(variant, f"raises {limb}", f"lifts {limb} up", f"puts {limb} up in the air",
               f"raises {limb} over the head", f"puts {limb} up", f"holds {limb} up high", f"stretches {limb} up")
  return _spaced(verb, TIMES.get(event.count, ""))


def _wave(event, others, variant):
  verb = _pick(variant, "waves", "waves with", "raises {} and waves")
  verb = verb.format(_limb(event, variant)) if "{}" in verb else f"{verb} {_limb(event, variant)}"
  return _spaced(verb, pace(event), TIMES.get(event.count, "") if event.count > 1 else "")


def _jump(event, others, variant):
  way = event.way if event.way in ("forward", "backward") else ""
  times = TIMES.get(event.count, "")
  height = f"about {10 * round(event.amount * 10)} centimeters high" if event.amount > 0.15 and not way else ""
  if event.path == "long" and event.count == 1:
    return _pick(variant, "makes a long jump", f"leaps far {event.way}", "does a broad jump", f"jumps far {event.way}",
                 f"does a long jump {event.way}", f"takes a big leap {event.way}", "does a standing long jump")
  if event.count == 1 and height:
    return _pick(variant, f"jumps {height}", "jumps up", "jumps into the air" if event.amount > 0.25 else "jumps up")
  return _spaced(_pick(variant, "jumps", "hops", "jumps"), way, _pick(variant, "", "with both feet", ""), times)


def _hop(event, others, variant):
  leg = _pick(variant, f"on the {event.side} foot", f"on one leg, the {event.side} one", f"on the {event.side} leg")
  return _spaced("hops", TIMES.get(event.count, ""), leg)


def _squat(event, others, variant):
  deep = "deeply" if event.amount < 75 else ""
  if event.count == 1:
    return _pick(variant, _spaced("squats", deep, "and stands up again"), "squats down and gets up", "does a squat")
  number = _NUMBER.get(event.count, "several")
  return _pick(variant, _spaced("squats", deep, TIMES.get(event.count, "")), f"does {number} squats",
               f"does {number} deep squats" if deep else f"does {number} squats")


def _bow(event, others, variant):
  return _spaced(_pick(variant, "bows", "takes a bow", "bends forward in a bow"), "deeply" if event.amount > 60 and
                 variant % 3 == 0 else "", TIMES.get(event.count, ""))


def _reach_floor(event, others, variant):
  hand = {"both": "with both hands", "": ""}.get(event.side, f"with the {event.side} hand")
  return _spaced(_pick(variant, "bends down and reaches to the floor", "reaches down to the ground"), hand,
                 TIMES.get(event.count, ""))


def _lie_down(event, others, variant):
  return _pick(variant, "lies down on the floor", "gets down and lies on the ground")


def _arm_circle(event, others, variant):
  return _pick(variant, f"circles {_limb(event, 1)} {event.way}", f"swings {_limb(event, 1)} around {event.way}")


_PHRASES = {"walk": _going, "run": _going, "turn": _turning, "kick": _kick, "punch": _punch, "raise": _raise,
            "wave": _wave, "jump": _jump, "hop": _hop, "squat": _squat, "bow": _bow, "reach-floor": _reach_floor,
            "lie-down": _lie_down, "arm-circle": _arm_circle}
