"""What every task of an evaluation offers: rows of real motions, rows of a candidate's, and controls of its own."""
import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from motion_jax.evaluation import samples
from motion_jax.evaluation.candidates import Candidate
from motion_jax.evaluation.differences import ByMotion
from motion_jax.evaluation.harness import Harness
from motion_jax.metrics.physics import IN_ROWS
from motion_jax.motion.representations import to_joints

Row = dict[str, float]  # {metric: number}


@dataclasses.dataclass(frozen=True)
class Found:
  """What a task found in one replication.

  rows: {part: {metric: number}}; a candidate's only row is of part "". curves: {part: mean jerk (width,) of each frame
  around a transition}, where a task measures it. by_motion: what rows are of, motion by motion, {part: ..}, where a
  task's motions are those of the draw.
  """
  rows: Mapping[str, Row]
  curves: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
  by_motion: Mapping[str, ByMotion] = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True)
class Damaged:
  """Rows of motions that were damaged on purpose, {control: {metric: number}}, "real" among them, and which way each
  metric has to go, {control: {metric: 1 up, -1 down}}."""
  rows: Mapping[str, Row] = dataclasses.field(default_factory=dict)
  expected: Mapping[str, Mapping[str, int]] = dataclasses.field(default_factory=dict)


class Wanted(NamedTuple):
  """Motions that a replication wants another program to make (`evaluation.external`).

  name: of the folder of their files. about: what a line of prompts.jsonl says of each motion beside its file, caption,
  frames, rate and seed. given: joints (T, J, 3) of the real motion that each is made of, if it is.
  """
  name: str
  jobs: samples.Jobs
  about: list[dict]
  given: list[np.ndarray] | None = None


class Task:
  """What a protocol asks of a model, over the test set of a harness. What it makes only once, it keeps itself."""
  METRICS: ClassVar[tuple[str, ...]]        # that its rows may have, in the order of the tables
  OPTIONS: ClassVar[tuple[str, ...]] = ()   # choices of --sampling that it has beside those of the method
  TEXT_TO_MOTION: ClassVar[bool] = False    # captions and lengths are all that a motion is made of
  FILES: ClassVar[str]                      # what another program has to make, for those who write it

  def __init__(self, harness: Harness):
    self.harness, self.protocol, self.test_set = harness, harness.protocol, harness.test_set

  @staticmethod
  def load(run, raw=False) -> Any:
    """The model of a run that can do what is asked. raw: of the last weights, not their average. Raises ValueError for
    another model."""
    raise NotImplementedError("a task of evaluation has a `load` of its own (docs/adding.md)")

  def real(self, replication: int) -> Found:
    """Rows that need no model: "real", and others beside it."""
    raise NotImplementedError(f"{type(self).__name__} has no `real` (docs/adding.md)")

  def wanted(self, replication: int, reader) -> Iterable[Wanted]:
    """What a replication wants another program to make; reader: of the real motions that are given."""
    raise NotImplementedError(f"{type(self).__name__} has no `wanted` (docs/adding.md)")

  def found(self, candidate: Candidate, replication: int) -> Found:
    """Rows of a candidate's motions."""
    raise NotImplementedError(f"{type(self).__name__} has no `found` (docs/adding.md)")

  def damaged(self, replication: int, joints: Mapping[str, list]) -> Damaged:
    """Controls of the task's own metrics. joints: {"real" or a level of noise: joints (T, J, 3) of each item drawn}."""
    return Damaged()

  @property
  def notes(self) -> tuple[str, ...]:
    """What has to be said under the table beside the protocol's own note."""
    return ()


class ClipTask(Task):
  """Motions as long as the items of the test set, judged whole."""
  METRICS = ("top1", "top2", "top3", "fid", "matching", "diversity", "multimodality", "clip_score", *IN_ROWS)

  def ids(self, replication):
    """[{"id"}] of the items of a draw, for lines of prompts.jsonl."""
    return [{"id": self.test_set.ids[item]} for item in self.harness.drawn(replication).item]

  def joints(self, replication, reader):
    """Joints [(T, J, 3)] of the real motions of a draw, where they are in their clips."""
    real = self.harness.drawn(replication).cut(self.test_set.of(reader))
    return [np.asarray(to_joints(features, reader.layout), np.float32) for features in real]

  def real(self, replication):
    """Rows of the real motions, and of them with shuffled captions."""
    return Found({"real": self.harness.real_scores(replication), "shuffled": self.harness.shuffled_scores(replication)})
