"""How many captured training clips of archives show which action, by their captions: a table for models' cards.

  python tools/shown_actions.py path/to/cmu path/to/bandai > actions.md

A clip shows what its captions name, or what the rules of captions by kinematics find beside them. What none shows, no
model of these archives has seen.
"""
import argparse
import collections
import re

from motion_jax.data.datasets.archive import read_archive
from motion_jax.data.kinematic_captions import with_kinematic_captions

# What people often ask for, {name: pattern of captions}.
ACTIONS = {name: re.compile(pattern) for name, pattern in {
    "walk": r"\b(walk|strid|stroll|march|pac(es|ing)\b)", "walk backward": r"walk\w* (\w+ )?backward",
    "side steps": r"sideways|side steps?|sidestep", "run, jog": r"\b(run(s|ning)?|jog\w*|sprint\w*)\b",
    "walk in a circle": r"in a (\w+ )?circle|around in a circle", "zigzag": r"zigzag", "turn": r"\bturn(s|ing)?\b",
    "sneak": r"sneak|tiptoe|creep", "limp": r"\blimp", "skip": r"\bskip(s|ping)?\b",
    "stairs, climbing": r"stair|climb|ladder", "jump": r"\b(jump|leap)",
    "long jump": r"long jump|broad jump|leaps? far", "hop on one leg": r"\bhops?\b.*\b(foot|leg)\b",
    "jumping jacks": r"jumping jack", "squat": r"squat", "bow": r"\bbow(s|ing)?\b", "wave": r"\bwav(es?|ing)\b",
    "raise a hand": r"\b(rais|lift|put)\w* .*\b(hand|arm)s?\b",
    "raise both hands": r"\b(rais|lift|put|hold|stretch)\w* both (hand|arm)s", "clap": r"\bclap",
    "point": r"\bpoint(s|ing)?\b", "fold the arms": r"\b(cross|fold)\w* .*arms",
    "hands on the hips": r"(hands?|arms?) on (the |his |her )?(left |right )?hips?\b|akimbo", "shrug": r"shrug",
    "nod": r"\bnod", "salute": r"salut", "beckon": r"beckon|come here", "cheer": r"cheer|joy|celebrat",
    "kick": r"\bkick", "punch": r"punch|\bjabs?\b|boxing|boxes\b", "block, dodge": r"\b(block|dodg|guard)",
    "sword": r"sword|slash", "aim, shoot": r"\b(aims?|shoots?|gun|rifle|pistol)\b",
    "throw": r"\b(throws?|toss\w*) (?!.*punch)", "catch": r"\bcatch", "dribble, basketball": r"dribbl|basketball",
    "pick up": r"pick\w* .*up|reach\w* .*(floor|ground)|scoop", "put down": r"put\w* .*(down|on the floor)|deposit",
    "carry, lift": r"carr(y|ies)|lift\w* .*(box|weight|object)", "push, pull": r"\b(push|pull)(es|s|ing)?\b",
    "press a button": r"button", "drink, eat": r"\b(drink|eat)", "sit down": r"\bsits?\b|sitting|takes? a seat",
    "stand up": r"(stands?|gets?|rises?) up",
    "sit on the floor": r"(sit\w*|cross-legged).*(floor|ground)|cross-legged",
    "kneel": r"\bkneel|(on|to) (both|one|the) knees?", "lie down": r"\b(lies?|lying)\b",
    "get up from the floor": r"(gets?|stands?) up from .*(floor|ground|lying|back|belly)", "crawl": r"crawl",
    "roll": r"\broll(s|ing)?\b", "cartwheel": r"cartwheel", "flip": r"flip", "push-ups": r"push-?ups?",
    "fall": r"\bfalls?\b|falling|collapse|trip", "stretch": r"\bstretch\w* (?!both|the (left|right))",
    "dance": r"danc|charleston|salsa|lambada", "swim": r"\bswim", "play an instrument": r"guitar|piano|violin|drum",
    "golf, tennis": r"golf|tennis|racket", "phone": r"phone",
    "stand still, idle": r"stands? still|standing|\bidle\b|wait",
    "look around": r"look\w* around|turns the head|looks to"}.items()}


def counts(folders):
  """{action: number of clips in each folder} of the captured clips of the train splits."""
  found = {name: collections.Counter() for name in ACTIONS}
  for folder in folders:
    for clip in read_archive(folder, "train", faults=[]):
      said = " | ".join(caption.text.lower() for caption in with_kinematic_captions(clip).captions)
      for name, pattern in ACTIONS.items():
        found[name][clip.source] += bool(pattern.search(said))
  return found


def table(found) -> str:
  """Markdown: actions that clips show, the rarest last, and in a line those of which there is none."""
  names = list(dict.fromkeys(source for own in found.values() for source in own))
  shown = sorted((name for name in found if found[name].total()), key=lambda name: -found[name].total())
  rows = [f"| {name} | {found[name].total()} | " + " | ".join(str(found[name][one] or "") for one in names) + " |"
          for name in shown]
  none = [name for name in found if not found[name].total()]
  return "\n".join([f"| action | clips | {' | '.join(names)} |", "| --- " * (len(names) + 2) + "|", *rows, "",
                    f"No clip shows: {', '.join(none) or 'nothing of this list'}."])


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("archives", nargs="+", help="folders of archives")
  print(table(counts(parser.parse_args().archives)))


if __name__ == "__main__":
  main()
