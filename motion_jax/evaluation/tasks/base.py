"""The interface of a task: rows of real motions, rows of a candidate's, and controls of its own metrics."""
import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from motion_jax.evaluation import samples
from motion_jax.evaluation.candidates import Candidate
from motion_jax.evaluation.differences import ByMotion
from motion_jax.evaluation.harness import Harness
from motion_jax.evaluation.result import HALVES
from motion_jax.metrics import two_sample
from motion_jax.metrics.physics import IN_ROWS
from motion_jax.motion.representations import to_joints

Row = dict[str, float]  # {metric: number}


@dataclasses.dataclass(frozen=True)
class TaskScores:
  """The results of a task in one replication.

  rows: {part: {metric: number}}; a candidate with a single row has part "". curves: {part: mean jerk (width,) of each
  frame around a transition}, where a task measures it. by_motion: the values of each motion, {part: ..}, where a task's
  motions are those of the draw. notes: {part: sentence}, for the notes under the table.
  """
  rows: Mapping[str, Row]
  curves: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
  by_motion: Mapping[str, ByMotion] = dataclasses.field(default_factory=dict)
  notes: Mapping[str, str] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Damaged:
  """Rows of motions that were damaged on purpose, {control: {metric: number}}, "real" among them, and the direction in
  which each metric has to move, {control: {metric: 1 up, -1 down}}.
  """
  rows: Mapping[str, Row] = dataclasses.field(default_factory=dict)
  expected: Mapping[str, Mapping[str, int]] = dataclasses.field(default_factory=dict)


class SampleRequest(NamedTuple):
  """Motions that another program has to generate for a replication (`evaluation.external`).

  name: of the folder of their files. records: further fields of each line of prompts.jsonl, besides file, caption,
  frames, rate and seed. source_joints: (T, J, 3) of the real motion that each is based on, if any.
  """
  name: str
  jobs: samples.Jobs
  records: list[dict]
  source_joints: list[np.ndarray] | None = None


class Task:
  """What a protocol measures, over the test set of a harness. A task caches what it computes only once."""
  METRICS: ClassVar[tuple[str, ...]]        # that its rows may have, in the order of the tables
  OPTIONS: ClassVar[tuple[str, ...]] = ()   # choices of --sampling that it has besides those of the method
  TEXT_TO_MOTION: ClassVar[bool] = False    # captions and lengths are all that a motion is made of
  FITS_GIVEN: ClassVar[bool] = False        # motions of other programs must fit what they are given, so are not moved
  FILES: ClassVar[str]                      # what another program has to make, for those who write it

  def __init__(self, harness: Harness):
    self.harness, self.protocol, self.test_set = harness, harness.protocol, harness.test_set

  @staticmethod
  def load(run, raw=False) -> Any:
    """The model of a run, which must be able to do the task. raw: the last weights, not their average. Raises
    ValueError for another model.
    """
    raise NotImplementedError("a task of evaluation has a `load` of its own (docs/adding.md)")

  def real(self, replication: int) -> TaskScores:
    """Rows that need no model: "real", and further ones."""
    raise NotImplementedError(f"{type(self).__name__} has no `real` (docs/adding.md)")

  def requests(self, replication: int, reader) -> Iterable[SampleRequest]:
    """The motions that another program has to generate; reader: of the real motions that it is given."""
    raise NotImplementedError(f"{type(self).__name__} has no `requests` (docs/adding.md)")

  def score(self, candidate: Candidate, replication: int) -> TaskScores:
    """Rows of a candidate's motions."""
    raise NotImplementedError(f"{type(self).__name__} has no `score` (docs/adding.md)")

  def damaged(self, replication: int, joints: Mapping[str, list]) -> Damaged:
    """Controls of the task's own metrics. joints: {"real" or a level of noise: joints (T, J, 3) of each item drawn}."""
    return Damaged()

  def jobs(self, replication, copies=None) -> samples.Jobs:
    """The jobs of a draw, see `samples.jobs_of`."""
    return samples.jobs_of(self.test_set, self.harness.drawn(replication), self.harness.seed, replication, copies)

  def sequence_jobs(self, replication, sequences, frames) -> samples.Jobs:
    """A job for each sequence of captions, of frames (N,) in all."""
    places = range(len(sequences))
    return samples.Jobs([" | ".join(captions) for captions in sequences], list(frames),
                        [samples.seed_of(self.harness.seed, replication, i) for i in places], list(places))

  @property
  def notes(self) -> tuple[str, ...]:
    """Notes under the table, in addition to the protocol's own."""
    return ()


class ClipTask(Task):
  """A task whose motions are as long as the items of the test set, and evaluated as a whole."""
  METRICS = ("top1", "top2", "top3", "fid", "fid_unit", "kid", "matching", "diversity", "multimodality", "clip_score",
             *IN_ROWS)
  SET_APART = tuple(f"auc_{kind}" for kind in two_sample.KINDS)  # of tasks that have them among METRICS

  def ids(self, replication):
    """[{"id"}] of the items of a draw, for lines of prompts.jsonl."""
    return [{"id": self.test_set.ids[item]} for item in self.harness.drawn(replication).item]

  def joints(self, replication, reader):
    """Joints [(T, J, 3)] of the real motions of a draw, at their place in the clip."""
    real = self.harness.drawn(replication).cut(self.test_set.of(reader))
    return [np.asarray(to_joints(features, reader.layout), np.float32) for features in real]

  def real(self, replication):
    """Rows of the real motions, of two halves of them against each other (with the AUC of one against the other where
    the task has it), and of them with shuffled captions."""
    halves, real = self.harness.halves(replication), self.harness.real_scores(replication)
    if self.METRICS[-1] in self.SET_APART:
      real = real | {f"auc_{kind}": value
                     for kind, value in two_sample.halves(self.harness.real_windows(replication)).items()}
    return TaskScores({"real": real} | ({HALVES: halves} if halves else {})
                      | {"shuffled": self.harness.shuffled_scores(replication)})

  def scores_with_auc(self, replication, motions, layout, **further):
    """Scores of motions [(rows, F)] of the draw, with further numbers and the AUC of classifiers that tell them from
    real ones; the notes say by which features."""
    row, by_motion = self.harness.judged(replication, motions, layout)
    apart = self.harness.set_apart(replication, motions, layout)
    row = row | further | {f"auc_{kind}": verdict.auc for kind, verdict in apart.items()}
    return TaskScores({"": row}, by_motion={"": by_motion}, notes={"": _reasons(apart)} if apart else {})


def _reasons(apart):
  """A sentence on the numbers that set motions apart from real ones, of {kind: Verdict}."""
  listed = "; ".join(f"{kind}: " + ", ".join(f"{name} {'larger' if auc > 0.5 else 'smaller'} ({auc:.2f})"
                                             for name, auc in verdict.reasons[:3]) for kind, verdict in apart.items())
  return f"what sets its windows of 2 s apart from real ones by itself (AUC), {listed}"
