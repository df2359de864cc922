"""Numbers of a clause: how often an action is done, for how long, and in how many steps."""
import re

from motion_jax.text.morphology import is_participle, present_participle
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.meaning import pace_of

_NUMBER = r"(\d+(?:\.\d+)?|" + "|".join(lexicon.NUMBERS) + r")"
_TIMES = re.compile(r"(?<!than )(?<!at )\b(once|twice|thrice)\b(?! as| more| again)|"
                    rf"\b(?:a )?{_NUMBER}(?: of)?(?: more)? times\b(?: in a row)?")
_EXACT = "|".join(word for word in lexicon.NUMBERS if word not in lexicon.INEXACT_NUMBERS)
_STEPS = re.compile(
    rf"(?<!up )(?<!down )(?<!half )\b(?:a )?(\d+|{_EXACT})(?: of)?"
    r"((?: more| short| small| big| large| long| side| tiny| giant| quick| fast| rapid| slow| careful)*) steps?\b"
    r"(?! by| in place| at a time)")
# "steps forward", "steps back with the left foot": a single step.
_A_STEP = re.compile(r"(?:slightly )?(?:forwards?|ahead|back|backwards?)(?: (?:slightly|once|a (?:bit|little)))?"
                     r"(?: with (?:his|her|their|the) (?:left|right) (?:foot|leg))?")
_ABOUT = r"\b(?:for )?(?:about |around |roughly |exactly )?(?:a )?"
_SECONDS = (re.compile(_ABOUT + r"(\d+(?:\.\d+)?) ?(s|secs?|seconds?|mins?|minutes?)\b(?: long)?"),
            re.compile(rf"{_ABOUT}{_NUMBER}(?: of)?(?: a)? (secs?|seconds?|mins?|minutes?)\b(?: long)?"))
_SIMULTANEOUS = re.compile(rf"\b(?:{'|'.join(sorted(lexicon.SIMULTANEOUS))})\b")
# Seconds of a step, of a step backward, and of a single step: 24 walks of `cmdm-small`, forward, back and sideways, of
# 1.6, 2.2, 2.8 and 4 s have 3, 4, 5 and 7 steps in the median, those cut off at the ends among them.
_STEP, _STEP_BACK, _SINGLE_STEP = 0.55, 0.65, 0.8
_PACE_FACTORS = {"quickly": 0.75, "slowly": 1.4}  # times these seconds


def with_numbers(clause):
  """The clause with its repetitions and duration as numbers, and without the words that say them."""
  clause = with_steps(clause)
  text, times, seconds = " ".join(clause.words), clause.times, clause.seconds
  if match := _SECONDS[0].search(text) or _SECONDS[1].search(text):
    seconds, text = _number(match[1]) * (60 if match[2].startswith("min") else 1), _without(text, match)
  if (match := _TIMES.search(text)) and _times(match):
    times, text = _times(match), _without(text, match)
  if match := _SIMULTANEOUS.search(text):
    text = _without(text, match)
  before = [word for word in clause.before if word not in lexicon.SIMULTANEOUS]
  return clause._replace(
      words=text.split(), before=before, times=times, seconds=seconds, steps=clause.steps and seconds == clause.seconds,
      simultaneous=match is not None or before != clause.before)


def with_steps(clause):
  """The clause with the duration of its counted steps; "takes two steps back" becomes "walks backward"."""
  text = " ".join(clause.words)
  goes_on = clause.subject and is_participle(clause.form)  # "a person stepping backward"
  if clause.verb == "step" and not goes_on and _A_STEP.fullmatch(text):
    text = f"one step {text}"
  match = _STEPS.search(text) if clause.verb in lexicon.STEP_VERBS else None
  if match is None or _number(match[1]) < 1:
    return clause
  is_back = not lexicon.BACKWARD.isdisjoint(text.split())
  pace = [pace for word in match[2].split() if (pace := pace_of(word)) in _PACE_FACTORS][:1]
  factor = _PACE_FACTORS[pace[0]] if pace else 1.0
  seconds = max(round(_number(match[1]) * (_STEP_BACK if is_back else _STEP) * factor, 2), _SINGLE_STEP)
  if clause.verb not in lexicon.LIGHT_VERBS | {"step"} and not is_back:
    return clause._replace(seconds=seconds, steps=True)
  # In the words of captions.
  verb = clause.verb if clause.verb in ("run", "jog", "march") else "walk"
  way = " ".join("backward" if word in lexicon.BACKWARD else word for word in _without(text, match).split())
  way = f"sideways to the {way.removeprefix('to the ')}" if way in lexicon.SIDES or way.startswith("to the ") else way
  form = present_participle(verb) if is_participle(clause.form) else verb
  return clause._replace(verb=verb, form=form, words=[*(way or "forward").split(), *pace], reworded=True,
                         seconds=seconds, steps=True)


def without_times(tokens):
  """(the tokens without "twice" or "three times", the number); (tokens, None) where there is none."""
  text = " ".join(tokens)
  match = _TIMES.search(text)
  return (tokens, None) if match is None else (_without(text, match).split(), max(_times(match), 1))


def _times(match):
  word = next(filter(None, match.groups()))
  return {"once": 1, "twice": 2, "thrice": 3}.get(word) or int(_number(word))


def _number(word):
  return float(lexicon.NUMBERS.get(word, 0) if not word[0].isdigit() else word)


def _without(text, match):
  return (text[:match.start()].rstrip() + " " + text[match.end():].lstrip()).strip()
