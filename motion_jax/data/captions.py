"""Captions said in other words: who moves is told in many ways that mean the same motion."""
import re

_SUBJECTS = ("a person", "someone", "the person", "a man", "the man", "a woman", "the woman", "a human", "somebody",
             "he", "she", "a figure")
_KNOWN = re.compile(r"^(a person|someone|the person|a man|the man|a woman|the woman|somebody)\s+", re.IGNORECASE)


def vary_subject(caption, rng, rate):
  """The caption with another subject with probability rate, if it starts with one ("a person walks." -> "she walks.").

  rng is a numpy generator; two numbers are drawn whatever the caption, so that draws stay in step.
  """
  chance, place = rng.random(), int(rng.integers(len(_SUBJECTS)))
  found = _KNOWN.match(caption)
  if chance >= rate or not found:
    return caption
  return f"{_SUBJECTS[place]} {caption[found.end():]}"
