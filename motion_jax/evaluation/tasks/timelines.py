"""Timelines: one motion for each, told as prompts that follow each other, judged interval by interval (STMC's MTT).

Data: a file of timelines (`data.timelines`) and folders with a real clip for each of its texts, whose caption it is.
"""
import numpy as np

from motion_jax.data.timelines import read_timelines, single_track
from motion_jax.evaluation import samples
from motion_jax.evaluation.tasks.long_horizon import BATCH, load, tell
from motion_jax.metrics import timeline_scores
from motion_jax.motion.representations import to_joints

METRICS = ("crop_top1", "crop_top3", "tmr_m2t", "tmr_m2m", "fid", "transition_distance")
__all__ = ["METRICS", "load", "real_rows", "rows"]


def real_rows(judge, repeat):
  """The real motions of the texts, looked at in their quarters."""
  texts, items, text_latents, real_latents = _real(judge)
  joints = [_metres(judge.items.of(judge.evaluator)[i], judge.evaluator.layout) for i in items]
  return {"real": timeline_scores.real_row(texts, text_latents, real_latents, joints, _rules(judge),
                                           judge.evaluator.layout.skeleton)}


def rows(judge, subject, repeat):
  """{"": scores} of a subject's motions for all timelines."""
  layout, timelines = subject.model.stats.layout, _timelines(judge)
  tales = [single_track(timeline) for timeline in timelines]
  frames = [sum(round(seconds * subject.model.fps) for _, seconds in tale) for tale in tales]
  jobs = samples.Jobs([" | ".join(caption for caption, _ in tale) for tale in tales], frames,
                      [samples.seed_of(judge.seed, repeat, i) for i in range(len(tales))], list(range(len(tales))))
  store = subject.store(judge, f"timelines {tales}")
  made = subject.sample(tell(subject, tales, subject.options), store, f"r{repeat:03d}", jobs, f"repeat {repeat + 1}",
                        BATCH)
  texts, _, text_latents, real_latents = _real(judge)
  seen, mode = judge.evaluator.layout, judge.evaluator.mode
  embed = lambda motions: judge.embed(judge.evaluator, motions, np.array([len(x) for x in motions]))
  return {"": timeline_scores.score(
      timelines, [layout.convert(x, seen, mode) for x in made], [_metres(x, layout) for x in made], embed, texts,
      text_latents, real_latents, _rules(judge), layout.skeleton)}


def _metres(features, layout):
  return np.asarray(to_joints(features, layout), np.float64) * layout.skeleton.unit


def _rules(judge):
  return timeline_scores.Mtt() if judge.protocol.released_slips else timeline_scores.CORRECTED


def _timelines(judge):
  if judge.protocol.timelines is None:
    raise ValueError("protocol 'mtt' needs a file of timelines: give it as one of --data, such as --data "
                     "timelines.txt HumanML3D")
  return read_timelines(judge.protocol.timelines)[:judge.protocol.sequences]


def _real(judge):
  """(texts, an item with each as caption, embeddings of both)."""
  if "mtt" not in judge.kept:
    texts = sorted({interval.text for timeline in _timelines(judge) for interval in timeline})
    known = {caption.rstrip(" ."): (i, c) for i, said in reversed(list(enumerate(judge.items.captions)))
             for c, caption in enumerate(said)}
    missing = [text for text in texts if text.rstrip(" .") not in known]
    if missing:
      raise ValueError(f"{len(missing)} of {len(texts)} texts of the timelines are no caption of the data, such as "
                       f"{missing[0]!r}; real motions of them are what made ones are compared with")
    item, caption = (np.array(part) for part in zip(*(known[text.rstrip(" .")] for text in texts)))
    drawn = samples.Pass(item, caption, np.zeros(len(item), int), judge.items.rows[item])
    real = judge.embed(judge.evaluator, drawn.cut(judge.items.of(judge.evaluator)), drawn.frames)
    judge.kept["mtt"] = texts, item, judge.embed_text(judge.evaluator, drawn), real
  return judge.kept["mtt"]
