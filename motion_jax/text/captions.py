"""Vary and strip subjects of captions, and group captions of the same meaning."""
import re

SUBJECTS = ("a person", "someone", "the person", "a man", "the man", "a woman", "the woman", "a human", "somebody",
             "he", "she", "a figure")
_KNOWN = re.compile(r"^(a person|someone|the person|a man|the man|a woman|the woman|somebody)\s+", re.IGNORECASE)

_ANYBODY = re.compile(rf"^(?:{'|'.join(SUBJECTS)})\s+", re.IGNORECASE)


def vary_subject(caption, rng, rate):
  """Replaces the subject of a caption with probability rate: "a person walks." -> "she walks.".

  rng: a numpy generator, from which two numbers are drawn for every caption.
  """
  chance, place = rng.random(), int(rng.integers(len(SUBJECTS)))
  match = _KNOWN.match(caption)
  if chance >= rate or not match:
    return caption
  return f"{SUBJECTS[place]} {caption[match.end():]}"


def with_subjects(caption):
  """All possible results of `vary_subject`, the caption itself first."""
  match = _KNOWN.match(caption)
  return [caption] + ([f"{subject} {caption[match.end():]}" for subject in SUBJECTS] if match else [])


def without_subject(caption):
  """A caption in lower case without its subject: "someone walks forward ." -> "walks forward"."""
  return re.sub(r"\s+([,.;:!?])", r"\1", _KNOWN.sub("", caption.strip().lower())).rstrip(" .!")


def of_a_person(caption) -> str:
  """Replaces a subject of SUBJECTS by "a person": "she bows" -> "a person bows"."""
  return _ANYBODY.sub("a person ", caption.strip(), count=1)


def known_subject(caption) -> bool:
  """Whether a caption begins with a subject that can be replaced or removed."""
  return bool(_KNOWN.match(caption))


def meanings(captions):
  """Groups {sentence: number} of lists of sentences, one list per clip: sentences of one clip have the same number.

  Template captions such as "someone bows" and "a person takes a bow" occur in the same clips; a contrastive loss should
  not separate them.
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
