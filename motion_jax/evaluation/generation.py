"""Text to motion: a model makes each item of a pass anew, of its caption and at its length."""
import dataclasses

import numpy as np

from motion_jax import model
from motion_jax.evaluation import samples
from motion_jax.evaluation.judge import PHYSICS

METRICS = ("top1", "top2", "top3", "fid", "matching", "diversity", "multimodality", "clip_score", *PHYSICS)

load = model.load


def real_rows(judge, repeat):
  """Rows of a repeat that need no model."""
  return {"real": judge.real_scores(repeat), "shuffled": judge.shuffled_scores(repeat)}


def rows(judge, subject, repeat):
  """{"": scores} of a subject's motions for a repeat; with multimodality where the protocol has it."""
  motions, layout = sampled(judge, subject, repeat), subject.model.stats.layout
  row = judge.scores(repeat, motions, layout)
  protocol = judge.protocol
  if has_multimodality(protocol, repeat):
    row["multimodality"] = judge.multimodality(repeat, _generations(judge, subject, repeat, motions), layout)
  return {"": row}


def has_multimodality(protocol, repeat):
  return protocol.num_multimodality > 0 and (
      protocol.multimodality_repeats is None or repeat < protocol.multimodality_repeats)


def sampled(judge, subject, repeat):
  """The motions of a repeat [(rows, F)] in the order of its pass."""
  drawn = judge.read(repeat).drawn
  jobs = samples.jobs_of(judge.items, drawn, judge.seed, repeat, _copies(judge, repeat))
  return subject.sample(subject.generator(), subject.store(judge), f"r{repeat:03d}", jobs, f"repeat {repeat + 1}")


def _copies(judge, repeat):
  """Which generation of each item the scores are of: the first, or the last where a protocol makes many of it."""
  protocol, count = judge.protocol, judge.count
  last = protocol.multimodality_motions - 1
  many = np.arange(count) < protocol.num_multimodality
  return np.where(many, last, 0) if protocol.multimodality_shared and has_multimodality(protocol, repeat) else (
      np.zeros(count, int))


def _generations(judge, subject, repeat, motions):
  """Lists of protocol.multimodality_motions generations of the first captions; `motions` holds one of each already."""
  drawn, protocol = judge.read(repeat).drawn, judge.protocol
  count = min(protocol.num_multimodality, len(drawn))
  have = _copies(judge, repeat)
  pairs = [(i, copy) for i in range(count) for copy in range(protocol.multimodality_motions) if copy != have[i]]
  places, copies = (np.array(part) for part in zip(*pairs))
  some = samples.Pass(*(part[places] for part in drawn))
  jobs = samples.jobs_of(judge.items, some, judge.seed, repeat, copies)
  store = subject.store(judge)
  made = iter(subject.sample(subject.generator(), store, f"r{repeat:03d}_many", jobs,
                             f"multimodality {repeat + 1}"))
  return [[motions[i] if copy == have[i] else next(made) for copy in range(protocol.multimodality_motions)]
          for i in range(count)]


def without_multimodality(protocol):
  return dataclasses.replace(protocol, multimodality_captions=0, multimodality_batches=0)
