"""The whole grammar as one table, and as Markdown for docs/sentences.md (`tools/sentences_page.py` writes it)."""
import textwrap

from motion_studio.language import connectors, counting, ellipsis, light_verbs, ordering, parser, poses

_WIDTH = 120
# Title of a section -> its rules, in the order in which a reader meets them.
GRAMMAR = {
    "Connectors": connectors.CONNECTORS,
    "Order": ordering.RULES,
    "Repetitions and durations": counting.RULES,
    "Pauses and poses": poses.RULES,
    "Light verbs": light_verbs.RULES,
    "Words left out": (*ellipsis.CONTINUATIONS, *ellipsis.VERBLESS),
    "Turns and raised hands": parser.RULES,
}


def examples():
  """[(name of the rule, sentence, parse)] of all rules."""
  return [(rule.name, *example) for rules in GRAMMAR.values() for rule in rules for example in rule.examples.items()]


def page() -> str:
  """The grammar as Markdown: a section per group of rules, each rule with its examples."""
  return "\n\n".join(f"### {title}\n\n" + "\n\n".join(map(_entry, rules)) for title, rules in GRAMMAR.items())


def _entry(rule):
  """A rule as Markdown: name, meaning, the words of a connector, and the examples as code."""
  words = ", ".join(f"\"{one}\"" for one in getattr(rule, "words", ()) if one != rule.name)
  also = f" In the same way: {words}." if words else ""
  name = "Comma" if rule.name == "," else rule.name.capitalize()
  text = textwrap.fill(f"**{name}.** {rule.meaning}{also}", _WIDTH, break_on_hyphens=False)
  return "\n".join([text, "", "```", *(line for one in rule.examples.items() for line in _example(*one)), "```"])


def _example(sentence, parse):
  line = f"{sentence}  →  {parse}"
  return [line] if len(line) <= _WIDTH else [sentence, f"    →  {parse}"]
