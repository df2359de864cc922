"""One clause: its subject, its verb and the other words, how often and for how long."""
from typing import NamedTuple

from motion_jax.text.morphology import is_participle, is_past, present_participle, verb_of
from motion_jax.text.tagger import tag_words
from motion_jax_studio.language import lexicon, parts
from motion_jax_studio.language.counting import with_steps
from motion_jax_studio.language.light_verbs import reworded


class Clause(NamedTuple):
  """The words of one action: subject, adverbs before the verb, verb, words after it."""
  subject: list[str]
  before: list[str]   # "slowly"
  verb: str           # base form
  form: str           # as it was written
  words: list[str]    # after the verb
  times: int = 1
  seconds: float | None = None
  simultaneous: bool = False  # the sentence says so: "at the same time"
  reworded: bool = False  # the verb is not the written one: "takes a bow"
  steps: bool = False  # a given number of steps

  @property
  def part(self) -> str:
    """The body part that acts (`parts.part_of`)."""
    return parts.part_of(self.verb, self.words)


def clause_of(words):
  """The clause that words form; None if they have no verb of an action."""
  lemmas, tags = zip(*tag_words(words)) if words else ((), ())
  start = _first_verb(words, tags)
  if start is None:
    return None
  head, verb = _main_verb(words, tags, start, verb_of(words[start]) or lemmas[start])
  if verb == "have" and next((word for word in words[head + 1:] if word not in lexicon.WITH_A_LIMB), "") in (
      lexicon.LIMBS):
    verb = "hold"  # "has the left hand raised"
  elif tags[head] == "AUX" and verb != "do":  # "is happy", "can"
    return None
  subject, before = list(words[:start]), []
  while subject and subject[0] in ("first", "firstly", "having", ","):
    del subject[0]
  while subject and subject[-1] in lexicon.RELATIVE:
    subject.pop()
  while subject and tags[start - len(before) - 1] == "ADV" and (
      subject[-1] not in {*lexicon.SIDES, *lexicon.BACKWARD}):  # "a person with a broken back"
    before.insert(0, subject.pop())
  if subject and not any(tag in ("NOUN", "PRON") for tag in tags[:start]):
    before, subject = subject + before, []
  before = [word for word in before if word != "first"]
  before += [word for word in words[start + 1:head] if word.endswith("ly")]
  form, after = words[head], words[head + 1:]
  if "with" in subject[1:] and not lexicon.LIMBS.isdisjoint(subject) and parts.part_of(verb, ()) == "legs":
    added = subject.index("with")  # "a person with both arms up walks"; arms that act themselves do not stay so
    subject, after = subject[:added], [*after, *subject[added:]]
  if is_past(form) and (lexicon.BEING | {"be"}) & set(words[start:head]):  # "is pushed"
    before.insert(0, "are" if words[start] == "are" else "is")
  action = reworded(verb, after)
  if action is None:
    return with_steps(Clause(subject, before, verb, form, after))
  verb, after, times = action
  return Clause(subject, before, verb, present_participle(verb) if is_participle(form) else verb, after, times,
                reworded=True)


def _main_verb(words, tags, head, verb):
  """(index, base form) of the verb that names the action: "walk" of "starts to walk", "is walking"."""
  while True:
    after = head + 1
    while after < len(words) and (words[after] in ("to", "not", "be") or _is_manner(words[after], tags[after])):
      after += 1
    is_aspect = verb in lexicon.ASPECTS or verb == "go" and after < len(words) and is_participle(words[after]) or (
        verb in lexicon.BEFORE_TO and words[head + 1:head + 2] == ["to"])  # "stops to bend over"
    if not is_aspect or after >= len(words) or not verb_of(words[after]):
      return head, verb
    head, verb = after, verb_of(words[after])


def _is_manner(word, tag):
  return tag == "ADV" and word.endswith("ly")


def _first_verb(words, tags):
  """The index of the first verb; None if there is none."""
  for at, (word, tag) in enumerate(zip(words, tags)):
    before = tags[at - 1] if at else ""
    if word in lexicon.SUBORDINATE:
      return None
    if at and words[at - 1] in lexicon.POSSESSIVES or "jumping jack" in " ".join(words[max(at - 1, 0):at + 2]):
      continue  # "regains his balance"
    if at > 1 and words[at - 1] in lexicon.SIDES and words[at - 2] in lexicon.ONE_MORE and verb_of(word) == word:
      continue  # "a right turn"
    if keeps_limbs(words, at) or _describes(words, at):
      continue  # "with the knees bent", "a walking man"
    if tag in ("VERB", "AUX") and word not in ("being", "been", "having"):
      return at
    if tag in ("NOUN", "ADJ") and verb_of(word) and before not in ("DET", "ADJ", "NUM", "ADP"):
      return at
  return None


def keeps_limbs(words, at):
  """Whether the participle words[at] describes a limb during the action: "bent" of "walks with the knees bent"."""
  if not (is_participle(words[at]) or is_past(words[at])) or at < 2 or words[at - 1] not in lexicon.LIMBS:
    return False
  return "with" == next((word for word in reversed(words[:at]) if word not in lexicon.LIMBS | lexicon.WITH_A_LIMB), "")


def _describes(words, at):
  """Whether a participle belongs to the noun after it: "a walking man", "with bent knees"."""
  before, after = words[at - 1] if at else "", words[at + 1] if at + 1 < len(words) else ""
  return is_participle(words[at]) and before in lexicon.DETERMINERS and after in lexicon.PEOPLE or (
      is_past(words[at]) and before in lexicon.WITH_A_LIMB | {"with"} and after in lexicon.LIMBS)


def unknown_verb(words):
  """The clause of words that begin with a verb unknown to the word lists, as in "then warms them"; else None."""
  word = words[0]
  is_verb = len(word) > 3 and word.isalpha() and word.endswith("s") and (
      word not in lexicon.DIRECTIONS | lexicon.LIMBS)
  return Clause([], [], word[:-1], word, words[1:]) if is_verb else None


def is_person(subject):
  """Whether a subject is a person, not a thing as in "the music starts"."""
  return any(word in lexicon.PEOPLE for word in subject)


def can_be_simultaneous(group, clause):
  """Whether a body can do a clause and all of a group at once: with different parts, or with an arm each."""
  for member in group:
    if not member.part or not clause.part or {member.part, clause.part} == {"legs", "body"}:
      return False
    if member.part == clause.part:
      sides, others = (parts.sides_of(x.words) for x in (member, clause))
      if member.part != "arms" or not sides or not others or set(sides) & set(others):
        return False
  return True
