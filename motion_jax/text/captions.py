"""Subjects of captions, and captions with the same meaning."""
import re

SUBJECTS = ("a person", "someone", "the person", "a man", "the man", "a woman", "the woman", "a human", "somebody",
             "he", "she", "a figure")
_KNOWN = re.compile(r"^(a person|someone|the person|a man|the man|a woman|the woman|somebody)\s+", re.IGNORECASE)

_ANYBODY = re.compile(rf"^(?:{'|'.join(SUBJECTS)})\s+", re.IGNORECASE)


def vary_subject(caption, rng, rate):
  """The caption with another subject with probability rate, if it starts with one ("a person walks." -> "she walks.").

  rng: a numpy generator, from which two numbers are drawn whatever the caption.
  """
  chance, place = rng.random(), int(rng.integers(len(SUBJECTS)))
  found = _KNOWN.match(caption)
  if chance >= rate or not found:
    return caption
  return f"{SUBJECTS[place]} {caption[found.end():]}"


def with_subjects(caption):
  """All captions that `vary_subject` can return for one, the caption itself first."""
  found = _KNOWN.match(caption)
  return [caption] + ([f"{subject} {caption[found.end():]}" for subject in SUBJECTS] if found else [])


def without_subject(caption):
  """A caption in small letters without its subject: "someone walks forward ." -> "walks forward"."""
  return re.sub(r"\s+([,.;:!?])", r"\1", _KNOWN.sub("", caption.strip().lower())).rstrip(" .!")


def of_a_person(caption) -> str:
  """The caption with "a person" as its subject, where it has one of SUBJECTS: "she bows" -> "a person bows"."""
  return _ANYBODY.sub("a person ", caption.strip(), count=1)


def known_subject(caption) -> bool:
  """Whether a caption begins with a subject that can be replaced or left out."""
  return bool(_KNOWN.match(caption))


def meanings(captions):
  """{sentence: number} of lists of sentences, one list per clip: sentences linked by clips have the same number.

  Of captions from templates "someone bows" and "a person takes a bow" occur in the same clips; a contrastive loss
  should not separate the two.
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
