"""The whole grammar as one table (`tools/sentences_page.py` writes it into docs/sentences.md)."""
from motion_jax_studio.language import connectors, counting, ellipsis, light_verbs, ordering, parser, poses

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
