"""Postures and places: 0 for a body that does it, more for one that does not."""
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.motion.retarget import bend
from motion_jax_studio.checks.violations import violation_score
from motion_jax_studio.language.requirements import Requirement


def _joints(action, frames=80):
  return synthetic_joints(action, frames, np.random.default_rng(0))


def _stands(frames=80):
  return np.repeat(_joints("stand")[:1], frames, axis=0)


def _lifted(joints, side, frames, metres=0.3):
  """The joints with a foot and ankle lifted in some frames. side: 0 left, 1 right."""
  made = joints.copy()
  for joint in ((7, 10), (8, 11))[side]:
    made[frames, joint, 1] += metres
  return made


def _going(way, metres=1.5, back=False):
  steps = np.concatenate([np.linspace(0, metres, 40), np.linspace(metres, 0, 40) if back else np.full(40, metres)])
  return _stands() + steps[:, None, None] * np.array([way[0], 0, way[1]], float)  # it faces z


def _bent():
  made = _stands()
  made[30:50, 3:] += np.array([0, -0.35, 0.5]) * (made[30:50, 3:, 1:2] > made[30:50, :1, 1:2])
  return made


def _crouched():
  made = _stands()
  made[30:60, [0, 1, 2, 3, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21], 1] -= 0.35
  return made


def _low():
  """Crouched from the first frame to the last, on legs of their own length."""
  made, stands = _crouched()[35:55], _stands(1)[0]
  for hip, knee, ankle in ((1, 4, 7), (2, 5, 8)):
    thigh, shin = (np.linalg.norm(stands[upper] - stands[lower]) for upper, lower in ((hip, knee), (knee, ankle)))
    made[:, knee] = bend(made[:, hip], made[:, ankle], np.tile([0.0, 0.0, 1.0], (len(made), 1)), thigh, shin)
  return made


def _treading():
  made = _stands()
  for first in (5, 35, 60):
    made = _lifted(_lifted(made, 0, slice(first, first + 8), 0.15), 1, slice(first + 10, first + 18), 0.15)
  return made


BODIES = {"stands": _stands, "bent": _bent, "crouched": _crouched,
          "low from the first frame": _low, "treads": _treading,
          "floats": lambda: _lifted(_lifted(_stands(), 0, slice(20, 60)), 1, slice(20, 60)),
          "left foot up": lambda: _lifted(_stands(), 0, slice(20, 60)), "left": lambda: _going((1, 0)),
          "right": lambda: _going((-1, 0)), "ahead": lambda: _going((0, 1)),
          "there and back": lambda: _going((0, 1), back=True)}


@pytest.mark.parametrize("kind, side, does, does_not", [
    ("bend", "", "bent", "stands"), ("crouch", "", "crouched", "stands"),
    ("crouch", "", "low from the first frame", "stands"),
    ("treads", "", "treads", "left foot up"),
    ("foot", "left", "left foot up", "stands"), ("balance", "right", "left foot up", "treads"),
    ("balance", "right", "left foot up", "floats"),
    ("stays", "", "treads", "ahead"), ("return", "", "there and back", "ahead"),
    ("aside", "left", "left", "right"), ("aside", "right", "right", "ahead"), ("aside", "left", "left", "stands")])
def test_a_body_that_does_it_and_one_that_does_not(kind, side, does, does_not):
  score = lambda body: violation_score(BODIES[body](), [Requirement(kind, side, 1, False)])
  assert score(does) == 0 < score(does_not) <= 1


def test_the_other_leg_is_not_the_one_that_is_named():
  score = lambda kind, side: violation_score(BODIES["left foot up"](), [Requirement(kind, side, 1, False)])
  assert score("foot", "right") > 0.5 and score("balance", "left") > 0.5
  assert score("foot", "") == 0 == score("balance", "")
  assert violation_score(BODIES["stands"](), [Requirement("return", "", 1, False)]) > 0.5  # it was never away
