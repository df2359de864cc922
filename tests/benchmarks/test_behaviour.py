"""Rules of benchmarks/behaviour.py on motions made for them: each says yes to what it is about, no to the rest."""
import sys

import pytest

from tests.analysis.test_describe import _jump, _kick, _standing, _walk, _wave
from tests.conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
import behaviour  # noqa: E402
import behaviour_rules as rules  # noqa: E402
import behaviour_sentences  # noqa: E402
import caption_rules  # noqa: E402

# What is done, and every rule that says yes to it.
DONE = {
    "stand": (_standing(4.0), {"stands still"}),
    "walk": (_walk(), {"walks"}),
    "walk fast": (_walk(speed=1.6), {"walks", "walks quickly"}),
    "walk slowly": (_walk(speed=0.6), {"walks", "walks slowly"}),
    "walk backward": (_walk(speed=0.7, ways=180), {"walks backward"}),
    "walk and turn left": (_walk(90), {"walks", "turns left"}),
    "walk and turn right": (_walk(-90), {"walks", "turns right"}),
    "circle": (_walk(360, seconds=9.0), {"walks", "circles", "dances"}),  # who goes round may be dancing
    "kick": (_kick("right"), {"kicks", "kicks right"}),
    "kick twice": (_kick("left", (1.0, 2.5)), {"kicks", "kicks left", "kicks twice"}),
    "wave left": (_wave("left", 4), {"waves left", "raises left"}),
    "wave right": (_wave("right", 4), {"waves right", "raises right"}),
    "jump": (_jump(0.3), {"jumps"}),
    "jump twice": (_jump(0.3, 2), {"jumps", "jumps twice"}),
}
RULES = {
    "stands still": behaviour_sentences.still, "walks": rules.walks(), "walks quickly": rules.walks(pace=(1.4, 2.6)),
    "walks slowly": rules.walks(pace=(0.15, 0.9), least=0.4), "walks backward": behaviour_sentences.backward,
    "turns left": behaviour_sentences.left_turn, "turns right": behaviour_sentences.right_turn,
    "circles": rules.circles(), "kicks": rules.kicks(), "kicks left": rules.kicks(0), "kicks right": rules.kicks(1),
    "kicks twice": rules.kicks(None, 2), "waves left": behaviour_sentences.left_wave,
    "waves right": behaviour_sentences.right_wave, "raises left": behaviour_sentences.left_up,
    "raises right": behaviour_sentences.right_up, "jumps": rules.jumps(), "jumps twice": rules.jumps(2),
    "sits": rules.sits, "squats": rules.squats(), "bows": rules.bows(), "dances": rules.dances,
}


@pytest.mark.parametrize("name", DONE)
def test_a_rule_passes_what_it_is_about_and_nothing_else(name):
  joints, wanted = DONE[name]
  body = rules.body_of(joints)
  assert {rule for rule in RULES if RULES[rule](body)} == wanted


def test_every_sentence_is_judged_once(monkeypatch):
  """Each of more than 200 sentences has its seeds; what a model makes is counted as the rules say."""

  class Motion:
    joints, meta = _walk(), {}

  class Model:
    def notes(self, prompts):
      return ["not known"] * (prompts[0] == "walk forward")

    def __call__(self, prompts, seconds=None, seeds=None):
      assert len(prompts) == len(seeds) <= behaviour.MOST
      return [Motion] * len(prompts)

  listed = behaviour_sentences.sentences()
  assert len(listed) >= 200
  rows = behaviour.judge(Model(), [entry for entry in listed if entry[0] in ("walk", "kick", "path")], seeds=2)
  assert {row["sentence"]: sum(row["passed"]) for row in rows if row["category"] != "path"} == {
      sentence: 2 * (category == "walk") for category, sentence, *_ in listed if category in ("walk", "kick")}
  assert {row["sentence"] for row in rows if row["noted"]} == {"walk forward"}
  failed = [row | {"passed": [False] * len(row["passed"])} for row in rows]
  lines = behaviour.table({behaviour.ONE_PASS: failed, behaviour.BEST: rows}, "a model")
  assert any("| walk | 8 | 0 of 16, 0 % | 16 of 16, 100 % |" in line for line in lines)


def test_halves_of_the_captions_are_apart(tmp_path):
  """Every line is one of 4,042, in one half; another file is refused."""
  lines = [line for kind in caption_rules.KINDS for line in kind.lines]
  assert len(lines) == len(set(lines)) >= 300 and 0 <= min(lines) and max(lines) < 4042
  (tmp_path / "some.txt").write_text("a person walks\n")
  with pytest.raises(ValueError, match="not the list of captions that the rules were written for"):
    caption_rules.sentences(tmp_path / "some.txt")
  every = [f"caption {i}" for i in range(4042)]
  found = {half: {caption for _, caption, *_ in caption_rules.halves(every)[half]}
           for half in (caption_rules.DEVELOPMENT, caption_rules.FINAL)}
  assert not found[caption_rules.DEVELOPMENT] & found[caption_rules.FINAL]
  assert sum(map(len, found.values())) == len(lines)


def test_the_blind_lists_have_no_line_of_the_others():
  modules = (caption_rules, *behaviour.BLIND.values())
  lines = [[line for kind in module.KINDS for line in kind.lines] for module in modules]
  assert [len(own) for own in lines[1:]] == [150, 120, 99] and max(map(max, lines)) < 4042
  assert all(len(own) == len(set(own)) for own in lines[1:])
  assert not any(set(one) & set(other) for i, one in enumerate(lines) for other in lines[:i])
  kinds = [kind for module in modules for kind in module.KINDS]
  names = {outside: {kind.name for kind in kinds if kind.outside == outside} for outside in (True, False)}
  assert not names[True] & names[False]  # a name says whether the data show it
  assert behaviour.outside() == names[True]
