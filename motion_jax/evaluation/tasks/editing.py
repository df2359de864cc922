"""Editing: parts of real motions are regenerated from their captions, four tasks (docs/papers/cdamd.md#editing).

By the paper's method, `CdamdModel.edits`, on the features of the test set, all frames as decoded; or, with the option
cleanup=true, finished by `shared.pasting`: kept frames are put back and new ones joined to them.
"""
import numpy as np

from motion_jax.evaluation import samples
from motion_jax.evaluation.candidates import load_able
from motion_jax.evaluation.tasks.base import ClipTask, SampleRequest, TaskScores
from motion_jax.models.keys import keys_of
from motion_jax.models.shared import pasting
from motion_jax.models.shared.mask_schedule import TASKS, task_mask


class Editing(ClipTask):
  FITS_GIVEN = True
  OPTIONS = ("cleanup",)  # finished edits
  FILES = ("for each of the four tasks the whole motion of `motion` (joints of a real one), its frames outside of "
           "`keep` ([first, past] each) made from the caption, in the place where `motion` is; a task without a folder "
           "is left out")

  @staticmethod
  def load(run, raw=False):
    """A model that edits. Raises ValueError for another one."""
    return load_able(run, "edit", raw)

  def score(self, candidate, replication):
    """A row of each of the four tasks: the same draw, edited in four ways."""
    # Unlike what is generated from words alone, edits depend on the real motions.
    kind = f"editing{', pasted and joined' * self.protocol.paste} of {self.test_set.hash}"
    store = candidate.store(self.harness, kind)
    drawn = self.harness.drawn(replication)
    real = drawn.cut(self.test_set.of(candidate.reader))
    jobs, judged = self.jobs(replication), {}
    for name, task in candidate.parts({_folder(task, replication): task for task in TASKS}).items():
      motions = candidate.sample(editor(candidate, self.protocol, real, task), store, name, jobs,
                                 f"{task} {replication + 1}")
      judged[task] = self.harness.judged(replication, motions, candidate.model.stats.layout)
    return TaskScores({task: scores.row for task, scores in judged.items()},
                      by_motion={task: scores.by_motion for task, scores in judged.items()})

  def requests(self, replication, reader):
    jobs, joints = self.jobs(replication), self.joints(replication, reader)
    for task in TASKS:
      records = [record | {"task": task, "keep": kept_spans(task, count)}
                 for record, count in zip(self.ids(replication), jobs.frames)]
      yield SampleRequest(_folder(task, replication), jobs, records, joints)


def _folder(task, replication):
  return f"{task}_r{replication:03d}"


def kept_spans(task, num_frames, frames_per_latent=4):
  """[[first, past]] of the frames that a task keeps of a motion of num_frames."""
  kept = ~np.repeat(task_mask(task, [num_frames], num_frames // frames_per_latent, frames_per_latent)[0],
                    frames_per_latent)
  edges = np.flatnonzero(np.diff(np.concatenate([[0], kept, [0]])))
  return edges.reshape(-1, 2).tolist()


def editor(candidate, protocol, real, task):
  """make(jobs) of `samples.sample`: of the real motions [(T, F)] those at the jobs' places, edited."""
  def make(jobs):
    # Parity: the released script edits with the mask that it samples with; --sampling mask=bcm is ours.
    model, options = candidate.model, dict(candidate.options)
    cleanup = options.pop("cleanup", False)
    defaults = {"mask": model.config.sampler.mask} if "mask" in model.options.described() else {}
    options = defaults | {"guidance_scale": candidate.guidance_scale} | options
    motions = [real[i][:count] for i, count in zip(jobs.places, jobs.frames)]
    if protocol.paste or cleanup:
      keys, seeds = keys_of(None, jobs.seeds, len(motions))
      edited = pasting.edited(model, motions, jobs.captions, lambda count: pasting.requested_frames(count, task), keys,
                              seeds, cleanup, options, task)
      return [motion.features for motion in edited]
    edited = model.edits(motions, jobs.captions, task, seeds=jobs.seeds, **options)
    return [row[:count + samples.TAIL] for row, count in zip(edited.decoded, jobs.frames)]

  return make
