"""Rules of benchmarks/behaviour.py on motions made for them: each says yes to what it is about, no to the rest."""
import sys

import numpy as np
import pytest

from tests.analysis.test_describe import _jump, _kick, _standing, _walk, _wave
from tests.conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
import behaviour  # noqa: E402
import behaviour_rules as rules  # noqa: E402
import behaviour_sentences  # noqa: E402
import caption_rules  # noqa: E402
import caption_rules_blind  # noqa: E402
import caption_rules_blind2  # noqa: E402
import caption_rules_blind3  # noqa: E402

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


def test_one_after_another_and_not_the_other_way_round():
  walk, wave = _walk(seconds=3.0), _wave("right", 4)
  wave = wave + (walk[-1, :1] - wave[0, :1]) * [1, 0, 1]
  joints = np.concatenate([walk, wave])
  then = lambda *parts: rules.in_order(*parts)(rules.body_of(joints))
  assert then(rules.walks(), rules.waves_one) and not then(rules.waves_one, rules.walks())
  assert not rules.at_once(rules.walks(), rules.waves_one)(rules.body_of(joints))


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


def test_rules_of_captions_pass_what_they_are_about():
  body = lambda joints: rules.body_of(joints)
  walk, backward, jump, wave = _walk(), _walk(speed=0.7, ways=180), _jump(0.3), _wave("left", 4)
  assert caption_rules.leads(-45, 45)(body(walk)) and not caption_rules.leads(-45, 45)(body(backward))
  assert caption_rules.leads(45, 135)(body(_walk(ways=90))) and not caption_rules.leads(-135, -45)(body(_walk(ways=90)))
  back = [way for way in (150, 180, 210) if caption_rules.leads(120, 240, 0.15)(body(_walk(speed=0.7, ways=way)))]
  assert back == [150, 180, 210] and not caption_rules.leads(120, 240, 0.15)(body(walk))
  assert caption_rules.goes(2.0, 9.0)(body(walk)) and not caption_rules.goes(2.0, 9.0)(body(jump))
  there_and_back = np.concatenate([walk, walk[::-1]])
  assert caption_rules.comes_back(body(there_and_back)) and not caption_rules.comes_back(body(walk))
  assert caption_rules.lifts_foot(1)(body(_kick("right"))) and not caption_rules.lifts_foot(0)(body(_kick("right")))
  assert caption_rules.lifts_hand(0)(body(wave)) and not caption_rules.lifts_hand(1)(body(wave))
  assert caption_rules.spins()(body(_walk(360, seconds=9.0))) and not caption_rules.spins()(body(walk))
  low = walk - np.array([0, 0.5, 0]) * np.linspace(0, 1, len(walk))[:, None, None]
  low[..., 1] = np.maximum(low[..., 1], 0.02)
  assert caption_rules.crouches(body(low)) and not caption_rules.crouches(body(walk))
  for rule in (caption_rules.crawls, caption_rules.kneels, caption_rules.lies, caption_rules.trunk_bends,
               caption_rules.reaches_low, caption_rules.hands_meet, caption_rules.reaches_head(None)):
    assert not rule(body(walk))


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


def _rule(kinds, name):
  return next(kind.rule for kind in kinds if kind.name == name)


def test_sitting_down_and_standing_up_again_passes_in_this_order_only():
  standing = _standing(6.0)
  sunk = np.interp(np.arange(len(standing)) / 20, [0, 1, 2, 4, 5, 6], [0, 0, 1, 1, 0, 0])[:, None]
  down = standing.copy()
  down[..., 1] -= 0.45 * sunk
  down[:, [4, 5], 2] += 0.4 * sunk  # knees ahead of hips and ankles
  down[:, [7, 8, 10, 11]] = standing[:, [7, 8, 10, 11]]
  rule = _rule(caption_rules.KINDS, "sit and stand")
  assert rules.sits(rules.body_of(down)) and rule(rules.body_of(down))
  assert not rule(rules.body_of(down[:80])) and not rule(rules.body_of(_standing(6.0)))


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


@pytest.mark.parametrize("name", ["walk", "kick left", "wave", "turn right", "jump to the left", "clap", "throw"])
def test_rules_of_the_blind_list_reject_what_is_something_else(name):
  """Each says yes to its own motion, where one is made here, and no to standing."""
  rule = _rule(caption_rules_blind.KINDS, name)
  own = {"walk": _walk(), "kick left": _kick("left"), "wave": _wave("left", 4), "turn right": _walk(-90)}
  assert not rule(rules.body_of(_standing(4.0)))
  assert name not in own or rule(rules.body_of(own[name]))


def test_every_rule_of_the_blind_lists_judges_a_motion():
  for kind in (kind for module in behaviour.BLIND.values() for kind in module.KINDS):
    assert kind.rule(rules.body_of(_walk(speed=0.7))) in (True, False), kind.name


def test_rules_of_the_later_blind_lists_reject_standing():
  stands = rules.body_of(_standing(6.0))
  kinds = [*caption_rules_blind2.KINDS, *caption_rules_blind3.KINDS]
  passed = [kind.name for kind in kinds if kind.rule(stands)]
  assert passed == [kind.name for kind in kinds if 1708 in kind.lines]  # which is about standing
