"""A two-sample test: how well a small classifier tells generated motion from real motion of the same captions.

Motions are cut into windows of 2 s; a window is described by statistics of one kind (`KINDS`), and a logistic
regression is trained on all clips but a fifth and judged on that fifth, in turn. The area under its ROC curve (AUC)
is 0.5 where nothing sets the two apart and 1 where everything does. A classifier as a two-sample test: Lopez-Paz and
Oquab, ICLR 2017.
"""
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.motion.skeleton import HUMANML3D, Skeleton, facing
from motion_jax.shapes import Float, Int, Num

SECONDS = 2.0  # of a window
FOLDS = 5
LEAST = 10     # clips of either sample
_RIDGE = 1.0   # weight decay of the regression, on standardized numbers
_TINY = 1e-6


class Windows(NamedTuple):
  """Windows of clips: numbers (N, D) of each kind with their D names, and the clip of each window (N,)."""
  numbers: dict[str, Float[np.ndarray, "n d"]]
  names: dict[str, list[str]]
  clip: Int[np.ndarray, " n"]

  def of(self, chosen: Int[np.ndarray, " n"]) -> "Windows":
    """Those of some windows."""
    return Windows({kind: numbers[chosen] for kind, numbers in self.numbers.items()}, self.names, self.clip[chosen])


class Verdict(NamedTuple):
  """auc, and the numbers that set the samples apart by themselves: [(name, AUC of it alone)], the clearest first.

  An AUC of a single number under 0.5 means that generated motion has less of it.
  """
  auc: float
  reasons: list[tuple[str, float]]


def describe(motions: Sequence[np.ndarray], skeleton: Skeleton = HUMANML3D) -> Windows:
  """Windows of motions, joints (T, J, 3) each, half overlapping; motions of less than 2 s give none.

  Raises ValueError for one that holds NaN or infinity.
  """
  width = round(SECONDS * skeleton.fps)
  rows: dict[str, list] = {kind: [] for kind in KINDS}
  names: dict[str, list[str]] = {}
  clip = []
  for index, joints in enumerate(motions):
    joints = np.asarray(joints, np.float64) * skeleton.unit
    if not np.isfinite(joints).all():
      raise ValueError(f"motion {index} holds NaN or infinity, of which a classifier sees nothing; leave it out and "
                       "count it apart")
    for first in range(0, len(joints) - width + 1, width // 2):
      window = joints[first:first + width]
      for kind, measure in KINDS.items():
        numbers = measure(window, skeleton)
        names[kind] = list(numbers)
        rows[kind].append(list(numbers.values()))
      clip.append(index)
  return Windows({kind: np.array(found, np.float64) for kind, found in rows.items()}, names, np.array(clip, int))


def _local(window, skeleton):
  """Joints seen from the pelvis, ahead of the body on z."""
  ahead = facing(window, skeleton)
  local = window - window[:, :1]
  x, z = ahead[:, None, 0], ahead[:, None, 2]
  return np.stack([local[..., 0] * z - local[..., 2] * x, local[..., 1], local[..., 0] * x + local[..., 2] * z], -1)


def _log(values):
  return np.log(np.maximum(values, _TINY))


def _jerk(window, skeleton):
  """Logarithms of the mean acceleration and jerk of every joint."""
  found: dict[str, float] = {}
  for order, name in ((2, "acceleration"), (3, "jerk")):
    size = np.linalg.norm(np.diff(window, order, axis=0) * skeleton.fps ** order, axis=-1).mean(0)
    found |= {f"{name} of {joint}": value for joint, value in zip(skeleton.joints, _log(size))}
  return found


def _dynamics(window, skeleton):
  """Logarithms of mean, spread and peak of the speeds and accelerations of the ends of the body, over the ground and
  seen from the pelvis."""
  found: dict[str, float] = {}
  seen = {"": window, " from the pelvis": _local(window, skeleton)}
  joints = [index for index in range(len(skeleton.joints)) if index not in skeleton.parents[1:]]  # ends of chains
  joints += [skeleton.parents[index] for index in joints]
  for about, points in seen.items():
    chosen = joints if about else [0, *joints]
    for order, name in ((1, "speed"), (2, "acceleration")):
      size = np.linalg.norm(np.diff(points[:, chosen], order, axis=0) * skeleton.fps ** order, axis=-1)
      for what, values in (("mean", size.mean(0)), ("spread of the", size.std(0)), ("largest", size.max(0))):
        found |= {f"{what} {name} of {skeleton.joints[joint]}{about}": value
                  for joint, value in zip(chosen, _log(values))}
  return found


def _limbs(window, skeleton):
  """Mean and spread of the direction of every bone in the axes of the body."""
  local = _local(window, skeleton)
  found = {}
  for joint, parent in list(enumerate(skeleton.parents))[1:]:
    bone = local[:, joint] - local[:, parent]
    bone = bone / np.maximum(np.linalg.norm(bone, axis=-1, keepdims=True), _TINY)
    for axis, name in enumerate("xyz"):
      found[f"mean {name} of {skeleton.joints[joint]}"] = bone[:, axis].mean()
    found[f"spread of {skeleton.joints[joint]}"] = _log(bone.std(0).sum())
  return found


KINDS = {"jerk": _jerk, "dynamics": _dynamics, "limbs": _limbs}


def compare(real: Windows, made: Windows, num_reasons: int = 5) -> dict[str, Verdict]:
  """{kind: Verdict} of two samples; {} where one has windows of fewer than 10 clips.

  Clips of the same number, such as a real and a generated motion of one caption, are in the same fold.
  """
  if min(len(np.unique(one.clip)) for one in (real, made)) < LEAST:
    return {}
  label = np.concatenate([np.zeros(len(real.clip)), np.ones(len(made.clip))])
  fold = np.concatenate([real.clip, made.clip]) % FOLDS
  found = {}
  for kind in KINDS:
    numbers = np.concatenate([real.numbers[kind], made.numbers[kind]])
    score = np.zeros(len(label))
    for one in range(FOLDS):
      test = fold == one
      score[test] = _classified(numbers[~test], label[~test], numbers[test])
    alone = [area(column, label) for column in numbers.T]
    order = np.argsort(-np.abs(np.array(alone) - 0.5), kind="stable")[:num_reasons]
    by_fold = [area(score[fold == one], label[fold == one]) for one in range(FOLDS)]
    found[kind] = Verdict(float(np.mean(by_fold)), [(real.names[kind][i], float(alone[i])) for i in order])
  return found


def halves(real: Windows, draws: int = 4, seed: int = 0) -> dict[str, float]:
  """{kind: AUC} between disjoint halves of the clips, the mean of some draws: what chance alone gives."""
  clips, rng, found = np.unique(real.clip), np.random.default_rng(seed), []
  if len(clips) < 2 * LEAST:
    return {}
  for _ in range(draws):
    left, right = (_numbered(real, half) for half in np.array_split(rng.permutation(clips), 2))
    found.append({kind: verdict.auc for kind, verdict in compare(left, right).items()})
  return {kind: float(np.mean([one[kind] for one in found])) for kind in found[0]}


def _numbered(windows, clips):
  """The windows of some clips, which are numbered from 0 in their order."""
  chosen = windows.of(np.flatnonzero(np.isin(windows.clip, clips)))
  place = {clip: number for number, clip in enumerate(clips)}
  return chosen._replace(clip=np.array([place[clip] for clip in chosen.clip], int))


def _classified(numbers, label, test):
  """Scores (M,) of test rows by a ridge logistic regression trained on rows (N, D) with labels of 0 and 1."""
  mean, std = numbers.mean(0), numbers.std(0) + _TINY
  x = np.concatenate([np.ones((len(numbers), 1)), (numbers - mean) / std], 1)
  weights, penalty = np.zeros(x.shape[1]), np.full(x.shape[1], _RIDGE)
  penalty[0] = 0.0
  for _ in range(25):  # Newton's steps
    chance = 1 / (1 + np.exp(-np.clip(x @ weights, -30, 30)))
    slope = x.T @ (label - chance) - penalty * weights
    curvature = (x * (chance * (1 - chance))[:, None]).T @ x + np.diag(penalty + 1e-8)
    step = np.linalg.solve(curvature, slope)
    weights = weights + step
    if np.abs(step).max() < 1e-6:
      break
  return np.concatenate([np.ones((len(test), 1)), (test - mean) / std], 1) @ weights


def area(score: Num[np.ndarray, " n"], label: Num[np.ndarray, " n"]) -> float:
  """Area under the ROC curve: how often a row of label 1 has a higher score than one of label 0; ties count half."""
  _, place, count = np.unique(score, return_inverse=True, return_counts=True)
  rank = (np.cumsum(count) - (count - 1) / 2)[place]
  ones = label > 0.5
  num = int(ones.sum())
  if not 0 < num < len(label):
    return 0.5
  return float((rank[ones].sum() - num * (num + 1) / 2) / (num * (len(label) - num)))
