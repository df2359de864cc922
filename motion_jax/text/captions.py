"""Captions said in other words: who moves is told in many ways, and sentences about one clip mean the same motion."""
import re

SUBJECTS = ("a person", "someone", "the person", "a man", "the man", "a woman", "the woman", "a human", "somebody",
             "he", "she", "a figure")
_KNOWN = re.compile(r"^(a person|someone|the person|a man|the man|a woman|the woman|somebody)\s+", re.IGNORECASE)

_ANYBODY = re.compile(rf"^(?:{'|'.join(SUBJECTS)})\s+", re.IGNORECASE)


def vary_subject(caption, rng, rate):
  """The caption with another subject with probability rate, if it starts with one ("a person walks." -> "she walks.").

  rng is a numpy generator; two numbers are drawn whatever the caption, so that draws stay in step.
  """
  chance, place = rng.random(), int(rng.integers(len(SUBJECTS)))
  found = _KNOWN.match(caption)
  if chance >= rate or not found:
    return caption
  return f"{SUBJECTS[place]} {caption[found.end():]}"


def with_subjects(caption):
  """All captions that `vary_subject` may make of one, itself first."""
  found = _KNOWN.match(caption)
  return [caption] + ([f"{subject} {caption[found.end():]}" for subject in SUBJECTS] if found else [])


def without_subject(caption):
  """What a caption says that is done, in small letters: "someone walks forward ." -> "walks forward"."""
  return re.sub(r"\s+([,.;:!?])", r"\1", _KNOWN.sub("", caption.strip().lower())).rstrip(" .!")


def of_a_person(caption) -> str:
  """The caption, of "a person" where it is of anybody in other words: "she bows" -> "a person bows"."""
  return _ANYBODY.sub("a person ", caption.strip(), count=1)


def known_subject(caption) -> bool:
  """Whether a caption begins with a subject that may be exchanged or left out."""
  return bool(_KNOWN.match(caption))


def meanings(captions):
  """{sentence: number} for lists of sentences, one list per clip: sentences that clips link carry the same number.

  Where captions are made from templates, "someone bows" and "a person takes a bow" stand in the same clips; a contrast
  between the two teaches nothing.
  """
  leader = {}

  def find(sentence):
    while leader.setdefault(sentence, sentence) != sentence:
      sentence = leader[sentence]
    return sentence

  for row in captions:
    for sentence in row:
      leader[find(sentence)] = find(row[0])
  numbers = {}
  return {sentence: numbers.setdefault(find(sentence), len(numbers)) for sentence in leader}
