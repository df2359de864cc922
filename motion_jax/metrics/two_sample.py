"""Classifier two-sample test: how well a small classifier distinguishes generated from real motion.

Motions of the same captions are cut into windows of 2 s, each described by statistics of one kind (`KINDS`). A logistic
regression is evaluated by five-fold cross-validation over clips. The area under its ROC curve (AUC) is 0.5 for
indistinguishable and 1 for perfectly separable samples. Source: Lopez-Paz and Oquab, ICLR 2017.
"""
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.metrics.physics import in_body_frame
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.shapes import Float, Int, Num
from motion_jax.utils.deprecation import renamed_parameters

SECONDS = 2.0  # of a window
FOLDS = 5
LEAST = 10     # least number of clips of each sample
_RIDGE = 1.0   # weight decay of the regression, on standardized numbers
_TINY = 1e-6


class Windows(NamedTuple):
  """Windows of clips: statistics (N, D) of each kind with their D names, and the clip of each window (N,)."""
  numbers: dict[str, Float[np.ndarray, "n d"]]
  names: dict[str, list[str]]
  clip: Int[np.ndarray, " n"]

  def of(self, chosen: Int[np.ndarray, " n"]) -> "Windows":
    """A selection of the windows."""
    return Windows({kind: numbers[chosen] for kind, numbers in self.numbers.items()}, self.names, self.clip[chosen])


class Verdict(NamedTuple):
  """auc, and the most separating single statistics: [(name, its AUC)], the clearest first.

  An AUC of a single statistic below 0.5 means that it is smaller in generated motion.
  """
  auc: float
  reasons: list[tuple[str, float]]


def describe(motions: Sequence[np.ndarray], skeleton: Skeleton = HUMANML3D) -> Windows:
  """Windows of motions, joints (T, J, 3) each, overlapping by half; motions of less than 2 s give none.

  Raises ValueError for NaN or infinity.
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
  return Windows({kind: np.array(values, np.float64) for kind, values in rows.items()}, names, np.array(clip, int))



def _log(values):
  return np.log(np.maximum(values, _TINY))


def _jerk(window, skeleton):
  """Logarithms of the mean acceleration and jerk of each joint."""
  numbers: dict[str, float] = {}
  for order, name in ((2, "acceleration"), (3, "jerk")):
    size = np.linalg.norm(np.diff(window, order, axis=0) * skeleton.fps ** order, axis=-1).mean(0)
    numbers |= {f"{name} of {joint}": value for joint, value in zip(skeleton.joints, _log(size))}
  return numbers


def _dynamics(window, skeleton):
  """Logarithms of mean, standard deviation and maximum of speeds and accelerations of the ends of the body, in the
  world and relative to the pelvis."""
  numbers: dict[str, float] = {}
  seen = {"": window, " from the pelvis": in_body_frame(window, skeleton)}
  joints = [index for index in range(len(skeleton.joints)) if index not in skeleton.parents[1:]]  # ends of chains
  joints += [skeleton.parents[index] for index in joints]
  for about, points in seen.items():
    chosen = joints if about else [0, *joints]
    for order, name in ((1, "speed"), (2, "acceleration")):
      size = np.linalg.norm(np.diff(points[:, chosen], order, axis=0) * skeleton.fps ** order, axis=-1)
      for what, values in (("mean", size.mean(0)), ("spread of the", size.std(0)), ("largest", size.max(0))):
        numbers |= {f"{what} {name} of {skeleton.joints[joint]}{about}": value
                  for joint, value in zip(chosen, _log(values))}
  return numbers


def _limbs(window, skeleton):
  """Mean and spread of the direction of each bone in the body's frame."""
  local = in_body_frame(window, skeleton)
  numbers = {}
  for joint, parent in list(enumerate(skeleton.parents))[1:]:
    bone = local[:, joint] - local[:, parent]
    bone = bone / np.maximum(np.linalg.norm(bone, axis=-1, keepdims=True), _TINY)
    for axis, name in enumerate("xyz"):
      numbers[f"mean {name} of {skeleton.joints[joint]}"] = bone[:, axis].mean()
    numbers[f"spread of {skeleton.joints[joint]}"] = _log(bone.std(0).sum())
  return numbers


KINDS = {"jerk": _jerk, "dynamics": _dynamics, "limbs": _limbs}


@renamed_parameters(removed_in="0.3", made="generated")
def compare(real: Windows, generated: Windows, num_reasons: int = 5) -> dict[str, Verdict]:
  """Verdicts {kind: Verdict} on two samples; {} if one has windows of fewer than 10 clips.

  Clips of equal index, such as a real and a generated motion of one caption, are in the same fold.
  """
  if min(len(np.unique(windows.clip)) for windows in (real, generated)) < LEAST:
    return {}
  label = np.concatenate([np.zeros(len(real.clip)), np.ones(len(generated.clip))])
  fold = np.concatenate([real.clip, generated.clip]) % FOLDS
  verdicts = {}
  for kind in KINDS:
    numbers = np.concatenate([real.numbers[kind], generated.numbers[kind]])
    score = np.zeros(len(label))
    for windows in range(FOLDS):
      test = fold == windows
      score[test] = _classified(numbers[~test], label[~test], numbers[test])
    alone = [area(column, label) for column in numbers.T]
    order = np.argsort(-np.abs(np.array(alone) - 0.5), kind="stable")[:num_reasons]
    by_fold = [area(score[fold == windows], label[fold == windows]) for windows in range(FOLDS)]
    verdicts[kind] = Verdict(float(np.mean(by_fold)), [(real.names[kind][i], float(alone[i])) for i in order])
  return verdicts


def halves(real: Windows, draws: int = 4, seed: int = 0) -> dict[str, float]:
  """Chance level {kind: AUC}: between random disjoint halves of the clips, averaged over draws."""
  clips, rng, aucs = np.unique(real.clip), np.random.default_rng(seed), []
  if len(clips) < 2 * LEAST:
    return {}
  for _ in range(draws):
    left, right = (_numbered(real, half) for half in np.array_split(rng.permutation(clips), 2))
    aucs.append({kind: verdict.auc for kind, verdict in compare(left, right).items()})
  return {kind: float(np.mean([draw[kind] for draw in aucs])) for kind in aucs[0]}


def _numbered(windows, clips):
  """The windows of some clips, renumbered from 0 in their order."""
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
  """Area under the ROC curve: probability that a row of label 1 scores higher than one of label 0; ties count half."""
  _, place, count = np.unique(score, return_inverse=True, return_counts=True)
  rank = (np.cumsum(count) - (count - 1) / 2)[place]
  ones = label > 0.5
  num = int(ones.sum())
  if not 0 < num < len(label):
    return 0.5
  return float((rank[ones].sum() - num * (num + 1) / 2) / (num * (len(label) - num)))
