"""The grammar: each rule does what its examples say, each is needed for one of them, and the page shows all of them."""
import pytest

from motion_studio.language import ellipsis, grammar, light_verbs, parse

LISTS = [(light_verbs, "RULES"), (ellipsis, "CONTINUATIONS"), (ellipsis, "VERBLESS")]
READERS = [(module, name, place) for module, name in LISTS for place in range(len(getattr(module, name)))]


@pytest.mark.parametrize("name, sentence, parsed", grammar.examples(), ids=[one[1] for one in grammar.examples()])
def test_an_example_of_a_rule(name, sentence, parsed):
  assert parse(sentence).summary == parsed


@pytest.mark.parametrize("module, name, place", READERS, ids=[
    f"{module.__name__.rsplit('.')[-1]}-{getattr(module, name)[place].name}" for module, name, place in READERS])
def test_no_other_rule_does_what_a_rule_does(monkeypatch, module, name, place):
  rules = getattr(module, name)
  monkeypatch.setattr(module, name, rules[:place] + rules[place + 1:])
  assert [sentence for sentence, parsed in rules[place].examples.items() if parse(sentence).summary != parsed]


def test_each_rule_has_a_name_of_its_own_and_examples():
  for title, rules in grammar.GRAMMAR.items():
    assert len({rule.name for rule in rules}) == len(rules), title
    assert all(rule.examples and rule.meaning.endswith(".") for rule in rules), title
