"""Timelines: one motion for each, of consecutive prompts, evaluated interval by interval (STMC's MTT).

Data: a file of timelines (`data.timelines`) and folders with a real clip for each of its texts, which is its caption.
"""
import functools
from typing import NamedTuple

import numpy as np

from motion_jax.data.timelines import read_timelines, single_track
from motion_jax.evaluation import samples
from motion_jax.evaluation.tasks.base import SampleRequest, Task, TaskScores
from motion_jax.evaluation.tasks.long_horizon import BATCH, LongHorizon, multi_prompt_generator, ways_of
from motion_jax.metrics import timeline_scores
from motion_jax.motion.representations import to_joints


class RealTexts(NamedTuple):
  """The different texts of all timelines (M,), an item of the test set with each as caption, embeddings (M, E) of
  both."""
  texts: list[str]
  items: np.ndarray
  text: np.ndarray
  motion: np.ndarray


class Timelines(Task):
  METRICS = ("crop_top1", "crop_top3", "tmr_m2t", "tmr_m2m", "fid", "transition_distance")
  FILES = ("one motion of each `timeline`, intervals of seconds with a text and body parts that may overlap, or of "
           "`segments`, the same in a row: captions with their frames")
  OPTIONS = LongHorizon.OPTIONS
  load = LongHorizon.load

  def real(self, replication):
    """The real motions of the texts, evaluated in quarters."""
    real, evaluator = self._real, self.harness.evaluator
    features = self.test_set.of(evaluator)
    joints = [_metres(features[i], evaluator.layout) for i in real.items]
    return TaskScores({"real": timeline_scores.real_row(real.texts, real.text, real.motion, joints, self._rules,
                                                        evaluator.layout.skeleton)})

  def score(self, candidate, replication):
    """The row of a candidate's motions for all timelines."""
    harness, layout = self.harness, candidate.model.stats.layout
    prompts, jobs = self._prompts_and_jobs(replication, layout.fps)
    store = candidate.store(harness, f"timelines {prompts}")
    generated = candidate.sample(multi_prompt_generator(candidate, prompts, ways_of(candidate)), store,
                                 f"r{replication:03d}", jobs, f"replication {replication + 1}", BATCH)
    read, mode, real = harness.evaluator.layout, harness.evaluator.mode, self._real
    embed = lambda motions: harness.embed(harness.evaluator, motions, np.array([len(x) for x in motions]))
    return TaskScores({"": timeline_scores.score(
        self._timelines, [layout.convert(x, read, mode) for x in generated],
        [_metres(x, layout) for x in generated], embed, real.texts, real.text, real.motion, self._rules,
        layout.skeleton)})

  def requests(self, replication, reader):
    fps = reader.layout.fps
    prompts, jobs = self._prompts_and_jobs(replication, fps)
    yield SampleRequest(f"r{replication:03d}", jobs, [
        {"timeline": [interval._asdict() for interval in timeline],
         "segments": [{"caption": caption, "frames": round(seconds * fps)} for caption, seconds in segments]}
        for timeline, segments in zip(self._timelines, prompts)])

  def _prompts_and_jobs(self, replication, fps):
    """([(caption, seconds)] of each timeline, jobs)."""
    prompts = [single_track(timeline) for timeline in self._timelines]
    frames = [sum(round(seconds * fps) for _, seconds in segments) for segments in prompts]
    return prompts, self.sequence_jobs(replication, [[caption for caption, _ in segments] for segments in prompts],
                                       frames)

  @property
  def _rules(self):
    return timeline_scores.Mtt() if self.protocol.released_slips else timeline_scores.CORRECTED

  @functools.cached_property
  def _timelines(self):
    if self.protocol.timelines is None:
      raise ValueError("protocol 'mtt' needs a file of timelines: give it as one of --data, such as --data "
                       "timelines.txt HumanML3D")
    return read_timelines(self.protocol.timelines)[:self.protocol.sequences]

  @functools.cached_property
  def _real(self) -> RealTexts:
    texts = sorted({interval.text for timeline in self._timelines for interval in timeline})
    known = {caption.rstrip(" ."): (i, c) for i, captions in reversed(list(enumerate(self.test_set.captions)))
             for c, caption in enumerate(captions)}
    missing = [text for text in texts if text.rstrip(" .") not in known]
    if missing:
      raise ValueError(f"{len(missing)} of {len(texts)} texts of the timelines are no caption of the data, such as "
                       f"{missing[0]!r}; real motions of them are what made ones are compared with")
    item, caption = (np.array(part) for part in zip(*(known[text.rstrip(" .")] for text in texts)))
    evaluator = self.harness.evaluator
    drawn = samples.Draw(item, caption, np.zeros(len(item), int), self.test_set.rows[item])
    motion = self.harness.embed(evaluator, drawn.cut(self.test_set.of(evaluator)), drawn.frames)
    return RealTexts(texts, item, self.harness.embed_text(evaluator, drawn), motion)


def _metres(features, layout):
  return np.asarray(to_joints(features, layout), np.float64) * layout.skeleton.unit
