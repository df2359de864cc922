"""The table of WordNet: verbs and what they stand for, nouns of actions, words of pace."""
from motion_jax.text import wordnet
from motion_jax.text.morphology import verb_of


def test_a_verb_has_targets_the_surest_first():
  found = wordnet.targets("saunter")
  assert found[0].verb == "stroll" and wordnet.Target("walk", 0.81, ("slowly",)) in found
  assert all(one.confidence >= other.confidence for verb in wordnet.verbs()
             for one, other in zip(wordnet.targets(verb), wordnet.targets(verb)[1:]))
  assert wordnet.LOST in next(one.manner for one in wordnet.targets("tiptoe") if one.verb == "walk")
  assert wordnet.targets("hunker down")[0].verb == "squat" and wordnet.targets("xyzzy") == ()


def test_nouns_and_paces():
  assert [wordnet.verb_of_noun(noun) for noun in ("stroll", "applause", "haymaker", "table")] == [
      "stroll", "applaud", "punch", ""]
  assert [wordnet.pace_of(word) for word in ("hastily", "unhurried", "red")] == ["quickly", "slowly", ""]


def test_inflected_verbs_of_the_table_are_verbs_and_nouns_are_none():
  words = "scampers scampering swivelled scamper shoulders hands legs".split()
  assert list(map(verb_of, words)) == ["scamper", "scamper", "swivel", "", "", "", ""]
