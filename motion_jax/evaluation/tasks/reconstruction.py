"""Reconstruction: the items of a draw through a tokenizer, evaluated like generated motions, and by joint errors."""
import numpy as np

from motion_jax.evaluation import samples
from motion_jax.evaluation.tasks.base import ClipTask, Damaged, SampleRequest
from motion_jax.evaluation.tokenizers import load_tokenizer
from motion_jax.metrics import protocol as protocol_lib
from motion_jax.metrics import scores


class Reconstruction(ClipTask):
  """mpjpe in millimetres, of poses without heading; mpjpe_heading of the whole motion; released_mpjpe as the released
  code prints.
  """
  FITS_GIVEN = True
  FILES = "the motion of `motion` (joints of a real one) after your encoder and decoder, in the place where it is"
  METRICS = (*ClipTask.METRICS, "mpjpe", "mpjpe_heading", "released_mpjpe", *ClipTask.SET_APART)

  @staticmethod
  def load(run, raw=False):
    """The tokenizer of a run, or inside a generator's. Raises ValueError for a run without one."""
    return load_tokenizer(run, raw)

  def score(self, candidate, replication):
    """The row of a tokenizer."""
    protocol, layout, drawn = self.protocol, candidate.model.stats.layout, self.harness.drawn(replication)
    real = drawn.cut(self.test_set.of(candidate.reader))
    if candidate.model.can("round_trip"):
      motions = self.reconstructed(candidate, replication, real)
    else:
      request, = self.requests(replication, candidate.reader)
      motions = candidate.sample(None, None, request.name, request.jobs, "")
    errors = {}
    for alone in (True, False):
      pairs = zip(real, motions, drawn.frames)
      errors[alone] = [protocol_lib.reconstruction_errors(a[None], b[None], [m], alone, layout)[0] for a, b, m in pairs]
    mm = 1000 * layout.skeleton.unit
    return self.scores_with_auc(
        replication, motions, layout, mpjpe=mm * scores.mpjpe(errors[True]),
        mpjpe_heading=mm * scores.mpjpe(errors[False]),
        released_mpjpe=scores.released_mpjpe(errors[protocol.poses_alone], protocol.pool))

  def requests(self, replication, reader):
    return [SampleRequest(f"r{replication:03d}", self.jobs(replication), self.ids(replication),
                          self.joints(replication, reader))]

  def damaged(self, replication, joints):
    """Joint errors of real motions against the same with noise on every joint."""
    mm = 1000 * self.harness.evaluator.layout.skeleton.unit
    errors = {name: [scores.joint_errors(a, b) for a, b in zip(joints["real"], noisy)]
              for name, noisy in joints.items()}
    return Damaged({name: {"mpjpe": mm * scores.mpjpe(some),
                           "released_mpjpe": scores.released_mpjpe(some, self.protocol.pool)}
                    for name, some in errors.items()}, {"noise": {"mpjpe": 1, "released_mpjpe": 1}})

  def reconstructed(self, candidate, replication, real):
    """Motions [(rows, F)] of a draw after the tokenizer, BATCH at a time."""
    stats, protocol, drawn = candidate.model.stats, self.protocol, self.harness.drawn(replication)
    motions = []
    with samples.progress(len(real), f"{candidate.name}, replication {replication + 1}", candidate.show) as bar:
      for first in range(0, len(real), samples.BATCH):
        places = np.minimum(np.arange(first, first + samples.BATCH), len(real) - 1)
        x = padded([real[i] for i in places], stats, protocol.max_frames)
        seeds = [samples.seed_of(self.harness.seed, replication, int(drawn.item[i])) for i in places]
        back = candidate.model.round_trip(x, drawn.frames[places], seeds if protocol.sampled_latents else None)
        motions += [stats.denormalize(row[:m + samples.TAIL]) for row, m in zip(back, drawn.frames[places])]
        bar.update(samples.BATCH)
    return motions[:len(real)]


def padded(motions, stats, length):
  """Motions [(T_i, F)] normalized and padded with zeros: (B, length, F)."""
  x = np.zeros((len(motions), length, stats.layout.dim), np.float32)
  for row, motion in zip(x, motions):
    row[:len(motion)] = stats.normalize(motion)
  return x
