"""Turn straight walks and runs into steps in place, sideways or backward, with matching captions.

Captured locomotion goes forward. Here the course of the body becomes a point or a line to its side; each step moves as
a whole, without foot sliding (`motion.root_paths.along`). A walk in reverse is close to a walk backward: the
angles of the joints are nearly those of a walk forward with time reversed (Winter, Pluck and Yang 1989, Journal of
Motor Behavior 21, 291-305). A clip to the side or backward is kept only if the kinematic rules (`analysis`) find that
direction in it, one on the spot only if both feet are lifted again and again.
"""
from collections.abc import Iterator

import numpy as np

from motion_jax.analysis.describe import FPS, sentences
from motion_jax.analysis.events import find_events
from motion_jax.analysis.signals import PAIR
from motion_jax.data.augment.parts import MOST, PLAIN, SHORTEST, new_clip
from motion_jax.data.clip import Clip
from motion_jax.motion.retiming import retimed
from motion_jax.motion.root_paths import along, course
from motion_jax.text.captions import SUBJECTS

_SIDEWAYS = (0.2, 0.4)  # metres a second, at which feet do not cross
_SLOWER = (0.5, 0.8)  # speed of walking backward relative to forward
_ON_THE_SPOT = {"walk": ("walks in place", "walks on the spot", "steps in place", "marches in place"),
                "run": ("jogs in place", "runs in place", "jogs on the spot", "runs on the spot")}
_SHOWS = {"": "on the spot", "left": "to the side", "right": "to the side", "backward": "backward"}
_STEPS, _LIFTED = 2, 0.06  # least number of lifts of each foot; metres above the other foot


def stepping(parts, rng) -> Iterator[Clip | None]:
  """Walks in place, sideways and backward, and runs in place, from straight forward walks and runs."""
  ways = [(part, part.events[0]) for part in parts
          if part.going and part.known and part.events[0].way == "forward" and len(part.joints) >= SHORTEST]
  number = 0
  while ways:
    part, event = ways[rng.integers(len(ways))]
    number += 1
    joints = part.joints[:MOST]
    way = ("left", "right", "backward", "")[rng.integers(4)] if event.kind == "walk" else ""
    moved = retimed(joints[::-1], rng.uniform(*_SLOWER))[:MOST] if way == "backward" else _moved(joints, way, rng)
    said = _directed(moved, part, way, number) if way else _in_place(moved, event.kind, rng)
    shows = f"{event.kind} {_SHOWS[way]}"
    yield new_clip("stepping", number, moved, said, part, shows) if said else None


def _moved(joints, way, rng):
  """A straight forward walk or run, moved onto a line to its left or right, or onto a point."""
  path = course(joints)[0]
  speed = rng.uniform(*_SIDEWAYS) * {"left": 1, "right": -1, "": 0}[way]
  ahead = path[-1] - path[0]
  left = np.array([ahead[1], -ahead[0]]) / np.linalg.norm(ahead)
  goal = path[0] + speed / FPS * np.arange(len(joints))[:, None] * left
  return along(joints, np.zeros(len(joints)), path, goal)


def _directed(joints, part, way, number):
  """Captions by kinematics; () unless the rules detect exactly one walk in that direction."""
  events = find_events(joints, FPS)
  if [(event.kind, event.way) for event in events] != [("walk", way)]:
    return ()
  return sentences(events, (len(joints) - 1) / FPS, key=f"{part.clip.id}{number}", subject=part.subject, plain=PLAIN)


def _in_place(joints, kind, rng):
  """Captions of steps in place; () unless both feet are lifted repeatedly."""
  feet = joints[:, PAIR["foot"], 1]
  for over in (feet[:, 0] - feet[:, 1], feet[:, 1] - feet[:, 0]):
    if (np.diff((over > _LIFTED).astype(int)) == 1).sum() < _STEPS:
      return ()
  said = _ON_THE_SPOT[kind]
  return tuple(f"{SUBJECTS[place]} {said[k]}." for place, k in enumerate(rng.permutation(len(said))[:3]))
