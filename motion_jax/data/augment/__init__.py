"""Augment training data: new clips made from captured ones, with matching captions (docs/augmentation.md).

  stitched    two or three clips joined at similar poses: "A, then B"
  bent_paths  straight walks and runs on circles, arcs, u-turns and zigzags
  idle        real standing before or after an action: "stands still, then ..."
  counted     one action, once to four times: "kicks with the right foot twice"
  excerpts    a short cut around one action of a longer clip: "punches with the right hand"
  seats       sitting down or standing up, cut out of a clip of both
  wandering   any locomotion on a random path: for training on constraints
  stepping    walks and runs in place, walks sideways and backward
  postures    hands brought to a place, arms held while walking, leaning and swaying
  time_warp   0.7 to 1.4 times as fast: "walks slowly", "bows quickly"

The number of each is a share of the captured clips. The new clips are a pure function of clips and shares. Clips of
different sources are never joined, as their licences may not allow it.
"""
import zlib
from collections.abc import Callable

import numpy as np
import tqdm

from motion_jax.data.augment.chains import idle, stitched
from motion_jax.data.augment.counted import counted
from motion_jax.data.augment.excerpts import excerpts
from motion_jax.data.augment.parts import part_of, usable
from motion_jax.data.augment.paths import bent_paths
from motion_jax.data.augment.postures import postures
from motion_jax.data.augment.seats import seats
from motion_jax.data.augment.stepping import stepping
from motion_jax.data.augment.wandering import wandering
from motion_jax.data.augment.warps import time_warp
from motion_jax.data.clip import Clip
from motion_jax.data.worker_processes import Workers

# {kind: function(parts, rng), an endless generator of clips, or None for failed attempts}
KINDS: dict[str, Callable] = {"stitched": stitched, "bent_paths": bent_paths, "idle": idle, "counted": counted,
                              "excerpts": excerpts, "seats": seats, "stepping": stepping,
                              "wandering": wandering, "postures": postures, "time_warp": time_warp}
_ATTEMPTS = 8  # at most, for each requested clip


def augmented(clips, shares, progress=False, workers=None) -> list[Clip]:
  """New clips made from training clips; shares: {kind: number per training clip}, kinds as in `KINDS`.

  Clips of other skeletons than HumanML3D's, or of other rates than 20 frames a second, are not used. There are fewer
  new clips than requested if too few fit. workers: a pool of processes (`data.worker_processes`).
  """
  unknown = sorted(set(shares) - set(KINDS))
  if unknown:
    raise ValueError(f"got the kind {unknown[0]!r} of new clips, expected one of {', '.join(KINDS)}")
  shares = {kind: share for kind, share in shares.items() if share}
  if not shares:
    return []
  workers = workers or Workers()
  folders: dict[tuple[str, str], list[Clip]] = {}
  for clip in filter(usable, clips):
    folders.setdefault((clip.source, clip.license), []).append(clip)
  shown = dict(leave=False, disable=None if progress else True)
  used = [clip for some in folders.values() for clip in some]
  parts = iter(list(tqdm.tqdm(workers.map(part_of, used, 16), "parts of clips", len(used), unit="clip", **shown)))
  jobs = [(folder, kind, round(share * len(some)), parts_of_folder) for folder, some in folders.items()
          for parts_of_folder in [[next(parts) for _ in some]] for kind, share in shares.items()]
  order = sorted(range(len(jobs)), key=lambda k: -jobs[k][2])  # the longest first, to balance the processes
  clips_of = dict(zip(order, tqdm.tqdm(workers.map(_made, [jobs[k] for k in order]), "new clips", len(jobs), **shown)))
  return [clip for k in range(len(jobs)) for clip in clips_of[k]]


def _made(job) -> list[Clip]:
  """The new clips of one kind from the parts of one folder."""
  folder, kind, count, parts = job
  rng = np.random.default_rng((zlib.crc32(kind.encode()), zlib.crc32(repr(folder).encode())))
  attempts = zip(_until(KINDS[kind](parts, rng), count), range(_ATTEMPTS * count))
  return [clip for clip, _ in attempts if clip is not None]


def _until(attempts, count):
  """The attempts up to the count-th success."""
  for clip in attempts:
    if count <= 0:
      return
    count -= clip is not None
    yield clip
