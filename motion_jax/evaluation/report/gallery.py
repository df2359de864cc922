"""Motions to look at: some of a pass beside the real ones of the same captions, and those that match their words worst.
"""
import pathlib

import numpy as np

from motion_jax import export
from motion_jax.data.clip import Caption, Clip
from motion_jax.evaluation.tasks import generation
from motion_jax.motion.representations import to_joints

COUNT = 6  # of either kind


def write(judge, subject, out, repeat=0) -> list[dict]:
  """gallery/*.npz in `out` -> [{"caption", "kind", "score", "row", "real", "made"}]; score: from words to motion."""
  reading, layout = judge.read(repeat), subject.model.stats.layout
  motions = generation.sampled(judge, subject, repeat)
  made = judge.embed(judge.evaluator, judge.carried(judge.evaluator, motions, layout, reading.drawn.frames),
                     reading.drawn.frames)
  away = np.linalg.norm(reading.text - made, axis=1)
  captions, real = reading.drawn.captions_of(judge.items), reading.drawn.cut(judge.items.of(judge.evaluator))
  worst = [int(i) for i in np.argsort(-away, kind="stable")]
  shown = [("grid", i) for i in _different(range(len(away)), captions)]
  shown += [("failure", i) for i in _different(worst, captions)]
  entries = []
  for number, (kind, i) in enumerate(shown):
    entry = dict(caption=captions[i], kind=kind, score=float(away[i]), row=subject.name)
    for side, features, form in (("real", real[i], judge.evaluator.layout), ("made", motions[i], layout)):
      name = f"gallery/{kind}_{number:02d}_{side}.npz"
      joints = np.asarray(to_joints(features[:reading.drawn.frames[i]], form), np.float32)
      clip = Clip(joints, form.skeleton.fps, (Caption(captions[i]),), id=f"{kind}_{number:02d}_{side}",
                  skeleton=form.skeleton, source=subject.name if side == "made" else "data")
      export.save(clip, pathlib.Path(out) / name)
      entry[side] = name
    entries.append(entry)
  return entries


def _different(order, captions):
  """The first few of an order, no caption twice."""
  found = {}
  for i in order:
    found.setdefault(captions[i], i)
  return list(found.values())[:COUNT]
