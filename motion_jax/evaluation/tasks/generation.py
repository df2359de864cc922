"""Text to motion: a model makes each item of a pass anew, of its caption and at its length."""
import dataclasses

import numpy as np

from motion_jax import loading
from motion_jax.evaluation import samples
from motion_jax.evaluation.judge import PHYSICS

METRICS = ("top1", "top2", "top3", "fid", "matching", "diversity", "multimodality", "clip_score", *PHYSICS)

load = loading.load


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
  name, jobs, _ = _first(judge, repeat)
  return subject.sample(subject.generator(), subject.store(judge), name, jobs, f"repeat {repeat + 1}")


def wanted(judge, repeat):
  """All that a repeat wants made: [(name of the files, jobs, items (N,))]."""
  found = [_first(judge, repeat)]
  if has_multimodality(judge.protocol, repeat):
    found.append(_many(judge, repeat))
  return found


def _first(judge, repeat):
  drawn = judge.drawn(repeat)
  jobs = samples.jobs_of(judge.items, drawn, judge.seed, repeat, _copies(judge, repeat))
  return f"r{repeat:03d}", jobs, drawn.item


def _many(judge, repeat):
  """The other generations of the first captions."""
  drawn, pairs = judge.drawn(repeat), _pairs(judge, repeat)
  places, copies = (np.array(part) for part in zip(*pairs))
  some = samples.Pass(*(part[places] for part in drawn))
  return f"r{repeat:03d}_many", samples.jobs_of(judge.items, some, judge.seed, repeat, copies), some.item


def _pairs(judge, repeat):
  """(place in the pass, generation of it) of those."""
  count, have = min(judge.protocol.num_multimodality, judge.count), _copies(judge, repeat)
  return [(i, copy) for i in range(count) for copy in range(judge.protocol.multimodality_motions) if copy != have[i]]


def _copies(judge, repeat):
  """Which generation of each item the scores are of: the first, or the last where a protocol makes many of it."""
  protocol, count = judge.protocol, judge.count
  last = protocol.multimodality_motions - 1
  many = np.arange(count) < protocol.num_multimodality
  return np.where(many, last, 0) if protocol.multimodality_shared and has_multimodality(protocol, repeat) else (
      np.zeros(count, int))


def _generations(judge, subject, repeat, motions):
  """Lists of protocol.multimodality_motions generations of the first captions; `motions` holds one of each already."""
  protocol, have = judge.protocol, _copies(judge, repeat)
  name, jobs, _ = _many(judge, repeat)
  made = iter(subject.sample(subject.generator(), subject.store(judge), name, jobs, f"multimodality {repeat + 1}"))
  return [[motions[i] if copy == have[i] else next(made) for copy in range(protocol.multimodality_motions)]
          for i in range(min(protocol.num_multimodality, judge.count))]


def without_multimodality(protocol):
  return dataclasses.replace(protocol, multimodality_captions=0, multimodality_batches=0)
