"""Connectors: the words between two actions, and the order in time that they give."""
from motion_jax_studio.language import lexicon

_CONNECTORS = {
    "then": "and then, but then, and after that, after that, after which, after a while, after a moment, a moment "
            "later, and afterwards, afterwards, followed by, and finally, finally, and lastly, lastly, and next, next, "
            "and later, later on, then, ;, ., !, ?",
    "before": "before",
    "after": "after, once, when",
    "until": "until, till, and then until",
    "while": "while also, while, whilst, and at the same time, at the same time as, and simultaneously, during, as",
    "and": "and also, and, but"}
_KIND_OF = {words: kind for kind, row in _CONNECTORS.items() for words in row.split(", ")} | {",": ","}
_LONGEST = max(len(words.split()) for words in _KIND_OF)
_STRENGTH = ("", ",", "and", "then", "while", "until", "after", "before")


def connector_at(words, at):
  """(number of tokens, kind) of the connector that begins at words[at]; (0, "") if there is none."""
  for length in range(min(_LONGEST, len(words) - at), 0, -1):
    name = " ".join(words[at:at + length])
    if name in _KIND_OF:
      after = words[at + length] if at + length < len(words) else ""
      before = words[at - 1] if at else ""
      return (0, "") if _is_another_word(name, before, after) else (length, _KIND_OF[name])
  return 0, ""


def _is_another_word(connector, before, after):
  """Whether the words of a connector mean something else between these neighbours, as in "rests for a while"."""
  return (connector == "as" and after in lexicon.NOT_A_CONNECTOR_AFTER_AS
          or connector == "next" and after == "to"
          or connector == "then" and after in ("more", "again")
          or connector == "once" and (after in lexicon.AFTER_ONCE or not after[:1].isalnum())
          or connector == "while" and before in lexicon.BEFORE_WHILE)  # "rests for a while"


def stronger(first, second):
  """The more specific of two adjacent connectors: "while" of "and while"."""
  return max(first, second, key=_STRENGTH.index)
