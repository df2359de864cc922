"""The lists of sentences of benchmarks/behaviour.py, read from benchmarks/data/sentences, a row a sentence.

  own.tsv                   this project's own: category, sentence, rule, seconds
  captions.tsv              captions of HumanML3D's test split, in two halves: kind, line, rule, data
  blind.tsv to blind4.tsv   further ones of the same file; each list says how it was drawn
  kit.tsv                   sentences of KIT Motion-Language: kind, sentence, rule, data

Captions are not in this repository. A row names one by its line, from 0, in a file of one caption a line, or by the id
of its row in kit_captions.jsonl and its place there, such as 00510.1 (`SHA256` of both files). A rule is a call of the
functions in behaviour_rules.py and rules_*.py, such as `both(walks(least=0.5), turns(40, 140))`. data is "outside"
where no capture of the shipped models' data shows the kind, and "few" where captures do but `OUTSIDE` counts the kind
as outside, as the older lists do.
"""
import ast
import functools
import hashlib
import json
import pathlib
from collections.abc import Callable, Mapping
from typing import NamedTuple

import behaviour_rules
import rules_body
import rules_hands
import rules_legs
from behaviour_rules import (
  bows,
  dances,
  jumps,
  kicks,
  on_one_leg,
  punches,
  raises,
  runs,
  sits,
  squats,
  turns,
  walks,
  waves,
)

from motion_jax.analysis.signals import Body

FOLDER = pathlib.Path(__file__).parent / "data" / "sentences"
CAPTIONS, BLIND, KIT = "captions", ("blind", "blind2", "blind3", "blind4"), "kit"
SHA256 = {CAPTIONS: "5d3e6db2df11a9c22e65863b339f27e944b32eda8a3d29220051977d4ab35ac0",
          KIT: "2bf24f340f70337a5ff3f4deb8546868dbf5715417583a47e1868e11a06e40c0"}
OUTSIDE = ("outside", "few")  # values of the column data
DEVELOPMENT, FINAL = "development", "final"  # halves of CAPTIONS

Rule = Callable[[Body], bool]


class Sentence(NamedTuple):
  """A sentence and its rule. seconds: of its motion; None, as long as such captions usually are."""
  category: str
  text: str
  rule: Rule
  seconds: float | None = None


class Row(NamedTuple):
  """A row of a list of captions. outside: no capture of the shipped models' data shows the kind, or only few do."""
  kind: str
  line: int | str
  rule: Rule
  outside: bool


@functools.cache
def _functions():
  """{name: what a rule may name}: the public functions of the modules of rules, LEFT and RIGHT."""
  return {name: value for module in (behaviour_rules, rules_body, rules_hands, rules_legs)
          for name, value in vars(module).items()
          if name in ("LEFT", "RIGHT") or getattr(value, "__module__", "") == module.__name__ and name[0] != "_"}


@functools.cache
def rule_of(text: str) -> Rule:
  """The rule that a text such as "in_order(walks(), sits)" names. Raises ValueError for anything but such calls."""
  def value(node):
    match node:
      case ast.Constant():
        return node.value
      case ast.Name() if node.id in _functions():
        return _functions()[node.id]
      case ast.Tuple():
        return tuple(map(value, node.elts))
      case ast.UnaryOp(ast.USub(), ast.Constant()):
        return -node.operand.value
      case ast.Call(ast.Name()):
        return value(node.func)(*map(value, node.args), **{keyword.arg: value(keyword.value)
                                                           for keyword in node.keywords})
    raise ValueError(f"got {ast.unparse(node)!r} in the rule {text!r}, expected calls of the functions in "
                     "behaviour_rules.py and rules_*.py, with numbers, words and tuples")

  return value(ast.parse(text, mode="eval").body)


def _rows(name):
  """The cells of each row of a list; lines that begin with # say how it was drawn."""
  lines = [line for line in (FOLDER / f"{name}.tsv").read_text(encoding="utf-8").splitlines() if line[:1] != "#"]
  columns = lines[0].split("\t")
  return [dict(zip(columns, line.split("\t"), strict=True)) for line in lines[1:]]


def sentences() -> list[Sentence]:
  """This project's own list."""
  return [Sentence(row["category"], row["sentence"], rule_of(row["rule"]), float(row["seconds"] or 0) or None)
          for row in _rows("own")]


def rows(name: str) -> list[Row]:
  """The rows of a list of captions: CAPTIONS, KIT or one of BLIND."""
  return [Row(row["kind"], row["sentence"] if name == KIT else int(row["line"]), rule_of(row["rule"]),
              row["data"] in OUTSIDE) for row in _rows(name)]


def read_captions(path: str | pathlib.Path, name: str = CAPTIONS) -> dict[int | str, str]:
  """{line or id: caption} of the file that the rows of KIT, or of the other lists, name.

  Raises ValueError for a file with other contents.
  """
  content = pathlib.Path(path).read_bytes()
  expected = SHA256[KIT if name == KIT else CAPTIONS]
  if hashlib.sha256(content).hexdigest() != expected:
    raise ValueError(f"{path} is not the list of captions that the rules were written for (sha256 "
                     f"{expected[:12]}..)")
  lines = content.decode().splitlines()
  if name != KIT:
    return dict(enumerate(lines))
  return {f"{row['id']}.{place}": text for row in map(json.loads, lines) for place, text in enumerate(row["text"])}


def captions(path: str | pathlib.Path, part: str = DEVELOPMENT) -> list[Sentence]:
  """The captions of a half, DEVELOPMENT or FINAL, of one of BLIND, or of KIT. path: the file of captions."""
  return part_of(part, read_captions(path, part))


def part_of(part: str, lines: Mapping[int | str, str]) -> list[Sentence]:
  """Those of `captions`, of the file's lines. Each kind's captions are in turn in the one half and the other."""
  halves = {DEVELOPMENT: 0, FINAL: 1}
  listed = [Sentence(row.kind, lines[row.line], row.rule) for row in rows(CAPTIONS if part in halves else part)]
  return listed[halves[part]::2] if part in halves else listed


def outside() -> set[str]:
  """Kinds of captions that no capture of the shipped models' data shows, or only few do."""
  return {row.kind for name in (CAPTIONS, *BLIND, KIT) for row in rows(name) if row.outside}


# --- rules on real clips ---------------------------------------------------------------------------------------------

# Real clips of a kind: name, rule, labels that mean it, labels that may or may not show it.
REAL = (
    ("walk", walks(), ("walk", "slow walk", "walk-turn-left", "walk-turn-right", "walk/stride"), (
        "walk", "navigate", "run/jog", "respond", "guide", "ZombieWalk", "step")),
    ("walk backward", walks((135, 225), pace=(0.3, 1.1), least=0.5), ("walk-back",), ("navigate",)),
    ("turn left", turns(40, 140), ("walk-turn-left",), ("run", "jog", "walk on", "navigate")),
    ("turn right", turns(-140, -40), ("walk-turn-right",), ("run", "jog", "walk on", "navigate")),
    ("run", runs(), ("run", "dash", "run/jog"), ("jog", "jump", "kick")),
    ("raise left", raises(True, False), ("raise-up-left-hand",), (
        "wave", "bye", "throw", "grab", "traffic", "wash", "reach", "call")),
    ("raise right", raises(False, True), ("raise-up-right-hand",), (
        "wave", "bye", "throw", "grab", "traffic", "wash", "reach", "call", "scoop", "slash", "drink")),
    ("raise both", raises(True, True), ("raise-up-both-hands",), (
        "wave", "bye", "throw", "grab", "traffic", "wash", "reach", "rotate", "dance", "jump", "slash")),
    ("wave left", waves(True, False), ("wave-left-hand",), ("bye", "rotate", "traffic", "wash")),
    ("wave right", waves(False, True), ("wave-right-hand",), ("bye", "rotate", "traffic", "wash", "drink", "throw")),
    ("wave both", waves(True, True), ("wave-both-hands",), ("rotate", "traffic", "wash")),
    ("kick", kicks(), ("kick front, left leg", "kick", "Front Kick", "Mawashigeri", "soccer - kick ball"), (
        "Yokogeri", "Heiansyodan", "swing legs", "dance")),
    ("kick left", kicks(0), ("kick front, left leg",), (
        "Kick", "kick", "geri", "Heiansyodan", "swing legs", "dance", "balance")),
    ("punch", punches(), ("punch", "boxing", "Oiduki"), (
        "Empi", "Gedanbarai", "Heiansyodan", "Syutouuke", "elbow", "slash", "throw", "Kick", "geri", "traffic",
        "signals", "raise", "wave", "rotate", "grab", "run", "jump")),
    ("jump", jumps(), ("jump", "forward jump", "hop on both legs"), ("jump", "hop", "run", "dash", "jog", "backflip",
                                                                      "Kick", "geri")),
    ("squat", squats(), ("squat",), ("squat", "sit", "jump", "floor", "scoop", "lie", "hop", "backflip", "bend")),
    ("sit", sits, ("sit on stepstool, stand up", "sit on high stool, stand up"), (
        "sit", "squat", "floor", "scoop", "lie", "bend", "jump", "hop")),
    ("bow", bows(), ("bow",), ("bend", "scoop", "floor", "squat", "sit", "guide", "lie")),
    ("balance", on_one_leg, ("balance on one leg, outstretched arms",), ("balance", "kick", "Kick", "geri", "elbow")),
    ("dance", dances, ("salsa dance", "dance-short", "lambada dance"), ("walk", "run", "jump", "hop")),
)
# Rules of a number, by clips whose rows say how often: name, rule of a number, labels.
COUNTED = (("kick, how often", lambda number: kicks(0, number), ("kick front, left leg",)),
           ("jump, how often", jumps, ("hop on both legs",)),
           ("squat, how often", squats, ("squat",)))
# Rules of a pace, by walks of a style that means it: name, rule, styles, styles between the paces.
PACED = (("walk slowly", walks(pace=(0.15, 0.9), least=0.4), ("elderly", "old", "sad", "proud", "not-confident"), (
             "childish", "exhausted", "tired", "giant")),
         ("walk quickly", walks(pace=(1.4, 2.6)), ("active", "happy"), ("angry", "musical", "youthful", "masculine")))
