"""Text to motion: a model generates a motion for each item of a draw, from its caption and at its length."""
import numpy as np

from motion_jax import loading
from motion_jax.evaluation import samples
from motion_jax.evaluation.tasks.base import ClipTask, SampleRequest


class Generation(ClipTask):
  TEXT_TO_MOTION = True
  METRICS = (*ClipTask.METRICS, *ClipTask.SET_APART)
  FILES = "a motion of each caption at its length, wherever it begins and whichever way it faces"

  @staticmethod
  def load(run, raw=False):
    """The model of a run folder or a shipped one."""
    return loading.load(run, raw=raw)

  def score(self, candidate, replication):
    """The row of a candidate's motions, with multimodality where the protocol has it."""
    motions, layout = self.sampled(candidate, replication), candidate.model.stats.layout
    further = {}
    if self.protocol.has_multimodality(replication):
      generations = self._generations(candidate, replication, motions)
      further["multimodality"] = self.harness.multimodality(replication, generations, layout)
    return self.scores_with_auc(replication, motions, layout, **further)

  def sampled(self, candidate, replication):
    """The motions of a replication [(rows, F)] in the order of its draw."""
    request = self._first(replication)
    return candidate.sample(candidate.generator(), candidate.store(self.harness), request.name, request.jobs,
                            f"replication {replication + 1}")

  def requests(self, replication, reader):
    yield self._first(replication)
    if self.protocol.has_multimodality(replication):
      yield self._many(replication)

  def _first(self, replication):
    jobs = self.jobs(replication, self._copies(replication))
    return SampleRequest(f"r{replication:03d}", jobs, self.ids(replication))

  def _many(self, replication):
    """The other generations of the first captions."""
    drawn, pairs = self.harness.drawn(replication), self._pairs(replication)
    places, copies = (np.array(part) for part in zip(*pairs))
    some = samples.Draw(*(part[places] for part in drawn))
    jobs = samples.jobs_of(self.test_set, some, self.harness.seed, replication, copies)
    return SampleRequest(f"r{replication:03d}_many", jobs, [{"id": self.test_set.ids[item]} for item in some.item])

  def _pairs(self, replication):
    """(place in the draw, number of the generation) of each."""
    have = self._copies(replication)
    return [(i, copy) for i in range(self._num_captions) for copy in range(self.protocol.multimodality_motions)
            if copy != have[i]]

  @property
  def _num_captions(self):
    return min(self.protocol.num_multimodality, self.harness.count)

  def _copies(self, replication):
    """The generation of each item that is scored: the first, or the last where a protocol generates many."""
    protocol, count = self.protocol, self.harness.count
    last = protocol.multimodality_motions - 1
    many = np.arange(count) < protocol.num_multimodality
    shared = protocol.multimodality_shared and protocol.has_multimodality(replication)
    return np.where(many, last, 0) if shared else np.zeros(count, int)

  def _generations(self, candidate, replication, motions):
    """Lists of protocol.multimodality_motions generations of the first captions, one of which is in `motions`."""
    have, request = self._copies(replication), self._many(replication)
    sampled = iter(candidate.sample(candidate.generator(), candidate.store(self.harness), request.name, request.jobs,
                                    f"multimodality {replication + 1}"))
    return [[motions[i] if copy == have[i] else next(sampled) for copy in range(self.protocol.multimodality_motions)]
            for i in range(self._num_captions)]
