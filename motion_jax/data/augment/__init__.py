"""Augment training data: new clips made from captured ones, with captions to match (docs/augmentation.md).

  stitched    two or three clips whose poses meet: "A, then B"
  bent_paths  straight walks and runs on circles, arcs, u-turns and zigzags
  idle        real standing before or after an action: "stands still, then ..."
  counted     one action done once to four times: "kicks with the right foot twice"
  excerpts    a short cut around what is done in a longer clip: "punches with the right hand"
  seats       sitting down or standing up, cut out of a clip of both
  wandering   any locomotion, on a path that turns at random: for training on constraints
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
from motion_jax.data.augment.seats import seats
from motion_jax.data.augment.wandering import wandering
from motion_jax.data.augment.warps import time_warp
from motion_jax.data.clip import Clip

# {kind: function(parts, rng), an endless generator of clips, or None for failed attempts}
KINDS: dict[str, Callable] = {"stitched": stitched, "bent_paths": bent_paths, "idle": idle, "counted": counted,
                              "excerpts": excerpts, "seats": seats, "wandering": wandering,
                              "time_warp": time_warp}
_ATTEMPTS = 8  # at most, for each requested clip


def augmented(clips, shares, progress=False) -> list[Clip]:
  """New clips made of training clips; shares: {kind: how many of it for each of these}, kinds as in `KINDS`.

  Clips of other skeletons than HumanML3D's, or of other rates than 20 frames a second, are not used. There are fewer
  new clips than requested if too few fit.
  """
  unknown = sorted(set(shares) - set(KINDS))
  if unknown:
    raise ValueError(f"got the kind {unknown[0]!r} of new clips, expected one of {', '.join(KINDS)}")
  made: list[Clip] = []
  if not any(shares.values()):
    return made
  shown = dict(unit="clip", leave=False, disable=None if progress else True)
  for folder in {(clip.source, clip.license): None for clip in clips}:
    own = [clip for clip in clips if (clip.source, clip.license) == folder and usable(clip)]
    parts = [part_of(clip) for clip in tqdm.tqdm(own, desc=f"parts of {folder[0]}", **shown)]
    for kind, share in shares.items():
      rng = np.random.default_rng((zlib.crc32(kind.encode()), zlib.crc32(repr(folder).encode())))
      count = round(share * len(own))
      with tqdm.tqdm(total=count, desc=f"{kind} of {folder[0]}", **shown) as bar:
        for clip, _ in zip(_until(KINDS[kind](parts, rng), count), range(_ATTEMPTS * count)):
          if clip is not None:
            made.append(clip)
            bar.update()
  return made


def _until(attempts, count):
  """The attempts up to the count-th that came to something."""
  for clip in attempts:
    if count <= 0:
      return
    count -= clip is not None
    yield clip
