"""Rules of benchmarks/behaviour.py on motions made for them: each says yes to what it is about, no to the rest."""
import hashlib
import sys

import numpy as np
import pytest

from motion_jax.analysis.signals import JOINT, PAIR
from motion_jax.motion import rotations
from tests.analysis.test_describe import _jump, _kick, _lie_down, _standing, _turn, _walk, _wave
from tests.conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
import behaviour  # noqa: E402
import behaviour_rules as rules  # noqa: E402
import behaviour_sentences as lists  # noqa: E402

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
    "stands still": "both(stands_still, stays)", "walks": "walks()", "walks quickly": "walks(pace=(1.4, 2.6))",
    "walks slowly": "walks(pace=(0.15, 0.9), least=0.4)",
    "walks backward": "walks((135, 225), pace=(0.3, 1.1), least=0.5)", "turns left": "turns(40, 140)",
    "turns right": "turns(-140, -40)", "circles": "circles()", "kicks": "kicks()", "kicks left": "kicks(LEFT)",
    "kicks right": "kicks(RIGHT)", "kicks twice": "kicks(None, 2)", "waves left": "waves(True, False)",
    "waves right": "waves(False, True)", "raises left": "raises(True, False)", "raises right": "raises(False, True)",
    "jumps": "jumps()", "jumps twice": "jumps(2)", "sits": "sits", "squats": "squats()", "bows": "bows()",
    "dances": "dances",
}


@pytest.mark.parametrize("name", DONE)
def test_a_rule_passes_what_it_is_about_and_nothing_else(name):
  joints, wanted = DONE[name]
  body = rules.body_of(joints)
  assert {name for name, rule in RULES.items() if lists.rule_of(rule)(body)} == wanted


def _there_and_back():
  there = _walk(seconds=3.0)
  return np.concatenate([there, there[::-1]])


def _jump_round(degrees):
  """A jump in whose half second the body turns."""
  joints = _jump(0.3)
  heading = np.radians(degrees) * np.clip(2 * (np.arange(len(joints)) / 20 - 1), 0, 1)
  return rotations.rotate(rotations.about_axis(heading, "y")[:, None], joints)


def _pivoting(side, degrees):
  """A turn about the ankle of a side."""
  joints = _turn(degrees)
  ankle = joints[:, [PAIR["ankle"][side]]]
  return joints - ankle * [1, 0, 1]


def _sitting():
  """A body whose pelvis is low, its legs stretched ahead on the ground."""
  joints = _standing(2.0)
  upper = np.full(joints.shape[1], True)
  upper[[index for part in ("knee", "ankle", "foot") for index in PAIR[part]]] = False
  joints[:, upper, 1] -= joints[:, :1, 1] - 0.15
  for part, ahead in (("knee", 0.4), ("ankle", 0.8), ("foot", 0.85)):
    joints[:, PAIR[part]] = joints[:, PAIR["hip"]] * [1, 0, 1] + [0, 0.05, ahead]
  return joints


def _moved(parts, offset, joints=None):
  """A body whose joints `parts` are elsewhere by `offset`."""
  joints = _standing(2.0) if joints is None else joints.copy()
  joints[:, parts] += offset
  return joints


def _one_step(side):
  """A foot that is put half a metre ahead, alone."""
  joints = _standing(3.0)
  far = 0.5 * np.clip(2 * np.arange(len(joints)) / 20 - 1, 0, 1)
  joints[:, [PAIR[part][side] for part in ("ankle", "foot")], 2] += far[:, None]
  return joints


# Rules that only the latest lists need: a motion of which each is true, and one of which it is not.
FURTHER = {
    "paces()": (_there_and_back, _walk),
    "both(jumps(), whirls(1))": (lambda: _jump_round(360), lambda: _jump_round(180)),
    "first_step(LEFT)": (lambda: _one_step(0), lambda: _one_step(1)),
    "pivots(RIGHT)": (lambda: _pivoting(1, 150), lambda: _turn(45)),
    "crosses_feet()": (lambda: _moved(PAIR["ankle"][0], [-0.4, 0, 0.1]), lambda: _standing(2.0)),
    "on_the_ground": (_sitting, _lie_down),
    "head_bowed": (lambda: _moved(JOINT["head"], [0, -0.06, 0.1]), lambda: _standing(2.0)),
    "sweeps(LEFT)": (lambda: _wave("left", 4), lambda: _wave("right", 4)),
    "reaches_aside(RIGHT)": (lambda: _moved(PAIR["wrist"][1], [-0.4, 0.5, 0]),
                             lambda: _moved(PAIR["wrist"][1], [0, 0.5, 0.5])),
}


@pytest.mark.parametrize("text", FURTHER)
def test_a_further_rule_tells_a_motion_from_another(text):
  done, other = (lists.rule_of(text)(rules.body_of(make())) for make in FURTHER[text])
  assert (done, other) == (True, False)


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

  listed = lists.sentences()
  assert len({entry.text for entry in listed}) == len(listed) == 225
  rows = behaviour.judge(Model(), [entry for entry in listed if entry[0] in ("walk", "kick", "path")], seeds=2)
  assert {row["sentence"]: sum(row["passed"]) for row in rows if row["category"] != "path"} == {
      sentence: 2 * (category == "walk") for category, sentence, *_ in listed if category in ("walk", "kick")}
  assert {row["sentence"] for row in rows if row["noted"]} == {"walk forward"}
  failed = [row | {"passed": [False] * len(row["passed"])} for row in rows]
  lines = behaviour.table({behaviour.ONE_PASS: failed, behaviour.BEST: rows}, "a model")
  assert any("| walk | 8 | 0 of 16, 0 % | 16 of 16, 100 % |" in line for line in lines)


@pytest.mark.parametrize("text", ["walk()", "_course", "().__class__", "[walks()]", "walks(least=max(1, 2))",
                                  "walks(*(1, 2))", "lambda body: True"])
def test_a_rule_is_a_call_of_a_function_of_the_rules(text):
  with pytest.raises(ValueError, match="in the rule .* expected calls of the functions in behaviour_rules.py"):
    lists.rule_of(text)


def test_kit_sentences_are_named_by_row_and_place(tmp_path, monkeypatch):
  path = tmp_path / "kit.jsonl"
  path.write_text('{"id": "00015", "text": ["A person walks backwards.", "walks back"]}\n')
  with pytest.raises(ValueError, match="not the list of captions that the rules were written for"):
    lists.captions(path, lists.KIT)
  monkeypatch.setitem(lists.SHA256, lists.KIT, hashlib.sha256(path.read_bytes()).hexdigest())
  assert lists.read_captions(path, lists.KIT) == {"00015.0": "A person walks backwards.", "00015.1": "walks back"}


def test_halves_of_the_captions_are_apart(tmp_path):
  """Every line is one of 4,042, in one half; another file is refused."""
  (tmp_path / "some.txt").write_text("a person walks\n")
  with pytest.raises(ValueError, match="not the list of captions that the rules were written for"):
    lists.captions(tmp_path / "some.txt")
  every = {i: f"caption {i}" for i in range(4042)}
  halves = [{sentence.text for sentence in lists.part_of(half, every)} for half in (lists.DEVELOPMENT, lists.FINAL)]
  assert not halves[0] & halves[1] and sum(map(len, halves)) == len(lists.rows(lists.CAPTIONS)) == 317


def test_the_lists_of_captions_have_no_line_twice():
  rows = [row for name in (lists.CAPTIONS, *lists.BLIND, lists.KIT) for row in lists.rows(name)]
  lines = [row.line for row in rows if isinstance(row.line, int)]
  assert [len(lists.rows(name)) for name in (*lists.BLIND, lists.KIT)] == [150, 120, 99, 161, 200]
  assert len({row.line for row in rows}) == len(rows) and 0 <= min(lines) and max(lines) < 4042
  assert not lists.outside() & {row.kind for row in rows if not row.outside}  # a kind says whether the data show it
