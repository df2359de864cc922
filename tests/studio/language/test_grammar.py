"""The grammar: each rule does what its examples say, and each is needed for one of them."""
import pytest

from motion_jax_studio.language import ellipsis, grammar, light_verbs, parse

LISTS = [(light_verbs, "RULES"), (ellipsis, "CONTINUATIONS"), (ellipsis, "VERBLESS")]


def test_rules_do_what_their_examples_say():
  examples = {sentence: parsed for _, sentence, parsed in grammar.examples()}
  assert {sentence: parse(sentence).summary for sentence in examples} == examples


@pytest.mark.parametrize("module, name", LISTS)
def test_no_other_rule_does_what_a_rule_does(monkeypatch, module, name):
  rules = getattr(module, name)
  for place, rule in enumerate(rules):
    monkeypatch.setattr(module, name, rules[:place] + rules[place + 1:])
    assert any(parse(sentence).summary != parsed for sentence, parsed in rule.examples.items()), rule.name


def test_each_rule_has_a_name_of_its_own_and_examples():
  for title, rules in grammar.GRAMMAR.items():
    assert len({rule.name for rule in rules}) == len(rules), title
    assert all(rule.examples and rule.meaning.endswith(".") for rule in rules), title
