"""Editing: parts of real motions are made anew from their captions, four tasks (docs/papers/cdamd.md#editing)."""
import functools

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax import loading
from motion_jax.evaluation import samples
from motion_jax.evaluation.tasks.generation import METRICS as _GENERATION
from motion_jax.evaluation.tasks.generation import real_rows
from motion_jax.evaluation.tasks.reconstruction import padded
from motion_jax.models import cdamd
from motion_jax.models.cdamd import draws
from motion_jax.models.cdamd import mask_schedule as masking
from motion_jax.models.cdamd.model import CdamdModel
from motion_jax.models.cdamd.unmasking import most_revealed
from motion_jax.nets.masks import padding_mask

METRICS = tuple(name for name in _GENERATION if name != "multimodality")
__all__ = ["METRICS", "load", "real_rows", "rows"]


def load(run, raw=False):
  """A model that edits. Raises ValueError for another one."""
  loaded = loading.load(run, raw=raw)
  if not isinstance(loaded, CdamdModel):
    raise ValueError(f"{run} holds a model that makes motion from its beginning on; editing needs the run of a "
                     "cdamd.generator")
  return loaded


def rows(judge, subject, repeat):
  """{task: scores} of all tasks: the same pass, edited in four ways, and judged whole."""
  # Unlike what is generated from words alone, edits depend on the real motions.
  store = subject.store(judge, f"editing{', pasted' * judge.protocol.paste} of {judge.items.hash}")
  drawn = judge.read(repeat).drawn
  real = drawn.cut(judge.items.of(subject.reader))
  jobs = samples.jobs_of(judge.items, drawn, judge.seed, repeat)
  found = {}
  for task in masking.TASKS:
    made = subject.sample(_editor(subject, judge.protocol, real, task), store, f"{task}_r{repeat:03d}", jobs,
                          f"{task} {repeat + 1}")
    found[task] = judge.scores(repeat, made, subject.model.stats.layout)
  return found


def _editor(subject, protocol, real, task):
  """make(jobs) of `samples.sample`: the motions at the jobs' places, edited."""
  edited_by = subject.model
  # Parity: the released script edits with the mask that it samples with; --sampling mask=bcm is ours.
  options = {"mask": edited_by.config.sampler.mask} | dict(subject.options)
  plan, num_rounds, order, revealed_only = edited_by.plan_of(**options)
  scale = edited_by.scale_of(subject.guidance_scale)
  length, unit = edited_by.max_latents, edited_by.unit
  plan = plan._replace(guided=scale != 1.0)
  if revealed_only:  # the most that any motion needs, so that one compiled function serves all
    every = masking.hidden_counts(num_rounds, np.arange(1, length + 1))
    plan = plan._replace(num_rows=most_revealed(every))
  run = _compiled(edited_by, plan, protocol.paste)

  def make(jobs):
    keys = jnp.stack([jax.random.key(seed) for seed in jobs.seeds])
    edited = masking.task_mask(task, jobs.frames, length, unit)
    drawn = draws.draw_order(keys, np.full(len(keys), length), length, order)
    hidden = masking.hidden_table(np.where(edited, drawn, np.inf), masking.hidden_counts(num_rounds, edited.sum(-1)))
    x = padded([real[i][:m] for i, m in zip(jobs.places, jobs.frames)], edited_by.stats, length * unit)
    mask = padding_mask(jnp.asarray(jobs.frames) // unit, length)
    words = edited_by.encode_words(jobs.captions)
    made = run(edited_by.params, edited_by.codec, x, words, edited, hidden, mask, scale, keys)
    made = edited_by.stats.denormalize(np.asarray(made))
    return [row[:m + samples.TAIL] for row, m in zip(made, jobs.frames)]
  return make


@functools.lru_cache(maxsize=4)
def _compiled(loaded, plan, paste):
  """One function for all tasks and repeats: which latents are hidden is data."""
  def run(params, codec, x, words, edited, hidden, real_mask, scale, keys):
    draw = draws.make_draw(keys, length, loaded.net.transformer.latent_dim)
    return cdamd.edit(loaded.net, plan, params, codec, x, words[0], edited, hidden, real_mask, scale, draw, paste,
                      words[1])
  length = loaded.max_latents
  return jax.jit(run)
