"""Editing: parts of real motions are made anew from their captions, four tasks (docs/papers/cdamd.md#editing).

By the function that anyone edits with, `CdamdModel.edits`, on the features of the test set as they are.
"""
from motion_jax.evaluation import samples
from motion_jax.evaluation.candidates import load_able
from motion_jax.evaluation.tasks.generation import METRICS as _GENERATION
from motion_jax.evaluation.tasks.generation import real_rows
from motion_jax.models.cdamd.mask_schedule import TASKS

METRICS = tuple(name for name in _GENERATION if name != "multimodality")
__all__ = ["METRICS", "load", "real_rows", "rows"]


def load(run, raw=False):
  """A model that edits. Raises ValueError for another one."""
  return load_able(run, "edit", raw)


def rows(judge, subject, repeat):
  """{task: scores} of all tasks: the same pass, edited in four ways, and judged whole."""
  # Unlike what is generated from words alone, edits depend on the real motions.
  store = subject.store(judge, f"editing{', pasted and joined' * judge.protocol.paste} of {judge.items.hash}")
  drawn = judge.read(repeat).drawn
  real = drawn.cut(judge.items.of(subject.reader))
  jobs = samples.jobs_of(judge.items, drawn, judge.seed, repeat)
  found = {}
  for task in TASKS:
    made = subject.sample(editor(subject, judge.protocol, real, task), store, f"{task}_r{repeat:03d}", jobs,
                          f"{task} {repeat + 1}")
    found[task] = judge.scores(repeat, made, subject.model.stats.layout)
  return found


def editor(subject, protocol, real, task):
  """make(jobs) of `samples.sample`: of the real motions [(T, F)] those at the jobs' places, edited."""
  # Parity: the released script edits with the mask that it samples with; --sampling mask=bcm is ours.
  options = {"mask": subject.model.config.sampler.mask} | dict(subject.options)

  def make(jobs):
    motions = [real[i][:count] for i, count in zip(jobs.places, jobs.frames)]
    made = subject.model.edits(motions, jobs.captions, task, seeds=jobs.seeds, paste=protocol.paste, cleanup=False,
                               guidance_scale=subject.guidance_scale, **options)
    return [row[:count + samples.TAIL] for row, count in zip(made.decoded, jobs.frames)]

  return make
