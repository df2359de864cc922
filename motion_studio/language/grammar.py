"""The whole grammar as one table, and as Markdown for docs/sentences.md (`tools/sentences_page.py` writes it)."""
from motion_studio.language import connectors, counting, ellipsis, light_verbs, ordering, parser, poses

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
  words = getattr(rule, "words", ())  # of a connector
  name = f"{rule.name}." if not words else ", ".join(f"\"{one}\"" for one in words)
  examples = "\n".join(f"{sentence}\n    {parse}" for sentence, parse in rule.examples.items())
  return f"**{name}** {rule.meaning}\n\n```\n{examples}\n```"
