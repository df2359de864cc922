"""Example motions: some of a replication next to the real ones, and those that match their captions worst."""
import pathlib

import numpy as np

from motion_jax import export
from motion_jax.data.clip import Caption, Clip
from motion_jax.evaluation.result import Shown
from motion_jax.evaluation.tasks.generation import Generation
from motion_jax.motion.representations import to_joints

COUNT = 6  # of either kind


def write(task: Generation, candidate, out, replication=0) -> list[Shown]:
  """Writes gallery/*.npz in `out` -> [{"caption", "kind", "score", "row", "real", "made"}]; score: distance of caption
  and motion.
  """
  harness, layout = task.harness, candidate.model.stats.layout
  embedded, motions = harness.embedded(replication), task.sampled(candidate, replication)
  drawn = embedded.drawn
  embeddings = harness.embed(harness.evaluator, harness.converted(harness.evaluator, motions, layout, drawn.frames),
                             drawn.frames)
  away = np.linalg.norm(embedded.text - embeddings, axis=1)
  captions, real = drawn.captions_of(harness.test_set), drawn.cut(harness.test_set.of(harness.evaluator))
  worst = [int(i) for i in np.argsort(-away, kind="stable")]
  shown = [("grid", i) for i in _different(range(len(away)), captions)]
  shown += [("failure", i) for i in _different(worst, captions)]
  entries: list[Shown] = []
  for number, (kind, i) in enumerate(shown):
    names = {}
    for side, features, form in (("real", real[i], harness.evaluator.layout), ("made", motions[i], layout)):
      name = f"gallery/{kind}_{number:02d}_{side}.npz"
      joints = np.asarray(to_joints(features[:drawn.frames[i]], form), np.float32)
      clip = Clip(joints, form.skeleton.fps, (Caption(captions[i]),), id=f"{kind}_{number:02d}_{side}",
                  skeleton=form.skeleton, source=candidate.name if side == "made" else "data")
      export.save(clip, pathlib.Path(out) / name)
      names[side] = name
    entries.append(Shown(caption=captions[i], kind=kind, score=float(away[i]), row=candidate.name, **names))
  return entries


def _different(order, captions):
  """The first few of an order, without repeated captions."""
  first_of = {}
  for i in order:
    first_of.setdefault(captions[i], i)
  return list(first_of.values())[:COUNT]
