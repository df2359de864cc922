"""Negative controls: real motions, damaged on purpose; every metric must move in the direction of the damage.

reversed runs backwards from the origin; frozen keeps the first pose; noise is added to every joint and frame, at three
levels; sliding moves the frozen pose over the ground, lifted and sunk move the motion off the floor.
"""
import numpy as np

from motion_jax.evaluation.harness import NOISE, physics_of
from motion_jax.evaluation.result import Controls, Curve, Expectation
from motion_jax.evaluation.tasks.base import Task
from motion_jax.motion.representations import canonicalize, to_joints

LEVELS = (0.01, 0.03, 0.1)  # metres, standard deviation of each coordinate
SPEED, SHIFT = 1.0, 0.1     # metres a second; metres
_WORSE = {"top1": -1, "top2": -1, "top3": -1, "matching": 1, "fid": 1, "clip_score": -1}
# Expected direction of each metric, 1 up and -1 down; metrics that a damage may move either way are left out.
EXPECTED = {
    "reversed": _WORSE,
    "frozen": _WORSE | {"diversity": -1, "jerk": -1, "acceleration": -1},
    "noise": _WORSE | {"multimodality": 1, "jerk": 1, "acceleration": 1, "bone_drift": 1, "penetration": 1},
    "sliding": {"skating": 1, "planted_speed": 1}, "lifted": {"foot_height": 1}, "sunk": {"penetration": 1},
}
SLACK = 0.02  # tolerance: share of a noise curve's range by which it may go back between two levels
CAPTIONS = 4  # whose motions make the controls' multimodality


def check(task: Task, replication=0, spread=None) -> Controls:
  """Scores of each control in one replication, and whether every metric moved as it should.

  -> {"rows": {control: scores}, "levels", "expected": [{"control", "metric", "direction", "real", "values", "ok",
  "noticed"}], "failures": [sentences]}. "real" are the same cuts with nothing done to them. values: of each level for
  "noise"; noticed: the least level from which on a metric says so, else None. The task's `damaged` has controls of its
  own metrics. spread: {metric: std of real motions over replications}; a step of that size is nothing either.
  """
  harness = task.harness
  evaluator, drawn = harness.evaluator, harness.drawn(replication)
  layout = evaluator.layout
  joints = [np.asarray(to_joints(x, layout), np.float64)
            for x in drawn.cut(harness.test_set.of(evaluator))]
  rng = harness.rng(replication, NOISE)
  noise = [rng.normal(size=x.shape) for x in joints]
  names = [f"noise {100 * level:g} cm" for level in LEVELS]
  levels = {"real": joints} | {name: [x + level / layout.skeleton.unit * n for x, n in zip(joints, noise)]
                               for name, level in zip(names, LEVELS)}
  rows = {name: harness.scores(replication, [layout.from_joints_in_place(x, evaluator.mode) for x in some], layout)
          for name, some in levels.items()}
  for name, level in zip(levels, (0.0, *LEVELS)):  # of nothing, copies of one motion
    rows[name]["multimodality"] = (
        _multimodality(harness, replication, joints, level / layout.skeleton.unit) if level else 0.0)
  for name, damage in _damages(layout.skeleton, evaluator.mode).items():
    motions = [layout.from_joints_in_place(damage(x), evaluator.mode) for x in joints]
    whole = name in ("reversed", "frozen")
    rows[name] = harness.scores(replication, motions, layout) if whole else physics_of(motions, drawn.frames, layout)
  damaged = task.damaged(replication, levels)
  both = lambda a, b: {name: a.get(name, {}) | b.get(name, {}) for name in dict.fromkeys([*a, *b])}
  rows, wanted = both(rows, damaged.rows), both(EXPECTED, damaged.expected)
  real, expected = rows["real"], list[Expectation]()
  for control, directions in wanted.items():
    degraded = [rows[name] for name in names] if control == "noise" else [rows[control]]
    for metric, direction in directions.items():
      if metric in real and all(metric in row for row in degraded):
        values, nothing = [row[metric] for row in degraded], (spread or {}).get(metric, 0.0)
        expected.append(Expectation(
            control=control, metric=metric, direction="up" if direction > 0 else "down", real=real[metric],
            values=values, ok=_moves(real[metric], values, direction, nothing),
            noticed=_noticed(real[metric], values, direction, nothing) if control == "noise" else None))
  failures = [f"{failed['metric']} of {failed['control']} does not go {failed['direction']}: "
              f"real {failed['real']:.4g}, then " + ", ".join(f"{value:.4g}" for value in failed["values"])
              for failed in expected if not failed["ok"]]
  return Controls(rows=rows, levels=list(LEVELS), expected=expected, failures=failures)


def curves(checked: Controls) -> dict[str, Curve]:
  """Scores against the level of noise."""
  rows = [checked["rows"]["real"]] + [checked["rows"][f"noise {100 * level:g} cm"] for level in checked["levels"]]
  return {f"{label} against noise": dict(
      x=[0.0] + [100 * level for level in checked["levels"]], y=[row[metric] for row in rows],
      interval=[0.0] * len(rows), x_label="noise on real joints, cm", y_label=label)
      for metric, label in (("top3", "R@3"), ("fid", "FID")) if metric in rows[0]}


def _damages(skeleton, mode):
  ground = np.array([1.0, 0.0, 0.0]) * SPEED / skeleton.fps / skeleton.unit
  up = np.array([0.0, 1.0, 0.0]) * SHIFT / skeleton.unit
  still = lambda x: np.repeat(x[:1], len(x), axis=0)
  return {"reversed": lambda x: canonicalize(x[::-1], skeleton, mode), "frozen": still,
          "sliding": lambda x: still(x) + np.arange(len(x))[:, None, None] * ground,
          "lifted": lambda x: x + up, "sunk": lambda x: x - up}


def _multimodality(harness, replication, joints, size):
  """Multimodality of a few real motions, each with many draws of noise."""
  rng, count = harness.rng(replication, NOISE + 1), harness.protocol.multimodality_motions
  layout, mode = harness.evaluator.layout, harness.evaluator.mode
  noisy = [[layout.from_joints_in_place(x + size * rng.normal(size=x.shape), mode) for _ in range(count)]
           for x in joints[:CAPTIONS]]
  return harness.multimodality(replication, noisy, layout)


def _moves(real, values, direction, spread=0.0):
  """Whether the last value lies beyond the real one, and no step on the way goes back by more than the tolerance."""
  steps = direction * np.diff([real, *values])
  total = steps.sum()
  return bool(total > 0 and steps.min() >= -max(SLACK * total, spread))


def _noticed(real, values, direction, spread=0.0):
  """The smallest level from which on all values lie beyond the real one by more than the tolerance."""
  away = direction * (np.array(values) - real)
  far = away > max(SLACK * away[-1], spread)
  return next((level for i, level in enumerate(LEVELS) if far[i:].all()), None)
