"""Connectors: the words between two actions, and the order in time that they give."""
import re
from collections.abc import Mapping
from typing import NamedTuple

from motion_jax_studio.language import lexicon


class Connector(NamedTuple):
  """Words that join actions in the same way, with examples as in `rule.Rule`."""
  name: str
  words: tuple[str, ...]
  meaning: str
  examples: Mapping[str, str]


CONNECTORS = (
    Connector("then", (
        "and then", "but then", "and after that", "after that", "after which", "after a while", "after a moment",
        "a moment later", "and afterwards", "afterwards", "followed by", "and finally", "finally", "and lastly",
        "lastly", "and next", "next", "and later", "later on", "then", ";", ".", "!", "?"),
              "A, then B: one after the other.", {
                  "a person walks forward, then waves the right hand": "walks forward | waves the right hand",
                  "a person walks. Then he waves. Finally, he sits down.": "walks | waves | sits down",
                  "a person walks. he then waves, he then sits": "walks | waves | sits",
                  "a person walks; he waves": "walks | waves"}),
    Connector("before", ("before",), "A before B: first A, then B.", {
        "a person waves before sitting down": "waves | sits down",
        "before sitting down, he waves": "waves | sits down"}),
    Connector("after", ("after", "once", "when"), "A after B: first B, then A.", {
        "a person bows after waving": "waves | bows",
        "after sitting down and standing up, a person walks forward": "sits down | stands up | walks forward",
        "when he stops, a person waves": "stands still | waves"}),
    Connector("until", ("until", "till", "and then until"), "A until B: first A, then B.", {
        "a person walks until he stops": "walks | stands still"}),
    Connector("while", (
        "while also", "while", "whilst", "and at the same time", "at the same time as", "and simultaneously", "during",
        "as"), "A while B: at the same time, where different body parts act.", {
            "a person waves while walking": "walks + waves",
            "as he walks, a person waves": "walks + waves",
            "a person walks forward while looking around": "walks forward + looks around"}),
    Connector("and", ("and also", "and", "but"),
              "A and B: at the same time where the legs go on, or with an arm each; otherwise one after the other.", {
                  "a person walks and waves": "walks + waves",
                  "a person raises the left hand and raises the right hand":
                      "raises the left hand + raises the right hand",
                  "a person sits down and stands up": "sits down | stands up"}),
    Connector(",", (",",), "A, B: one after the other; at the same time where B is a participle.", {
        "a person walks, turns around and waves": "walks | turns around | waves",
        "a person walks forward, waving the right hand": "walks forward + waves the right hand"}),
)
_KIND_OF = {words: one.name for one in CONNECTORS for words in one.words}
_LONGEST = max(len(words.split()) for words in _KIND_OF)
_STRENGTH = ("", ",", "and", "then", "while", "until", "after", "before")


def connector_at(words, at):
  """(number of tokens, name) of the connector that begins at a place, (0, "") where there is none."""
  for length in range(min(_LONGEST, len(words) - at), 0, -1):
    name = " ".join(words[at:at + length])
    if name in _KIND_OF:
      after = words[at + length] if at + length < len(words) else ""
      before = words[at - 1] if at else ""
      return (0, "") if _is_another_word(name, before, after) else (length, _KIND_OF[name])
  return 0, ""


def _is_another_word(connector, before, after):
  """Whether the words of a connector are none here, for what stands before and after them."""
  return (connector == "as" and after in lexicon.NOT_A_CONNECTOR_AFTER_AS
          or connector == "next" and after == "to"
          or connector == "then" and after in ("more", "again")
          or connector == "once" and (after in lexicon.AFTER_ONCE or not re.match(r"\w", after))
          or connector == "while" and before in lexicon.BEFORE_WHILE)  # "rests for a while"


def stronger(one, other):
  """The one of two adjacent connectors that says more: "while" of "and while"."""
  return max(one, other, key=_STRENGTH.index)
