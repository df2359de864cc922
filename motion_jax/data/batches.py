"""Batches: items, cuts and padding are a pure function of (seed, step): a resumed run sees the same data.

Each of several processes can make a part of a batch: `rows` selects rows of the B rows of the whole batch.
"""
import dataclasses
import functools
import warnings
from typing import NamedTuple

import numpy as np

ALL = slice(None)
_SHORT = 0.1  # share of clips that may be shorter than a window without a warning


def step_rng(seed, *path):
  """A numpy generator keyed by integers, independent of earlier draws."""
  return np.random.Generator(np.random.Philox(np.random.SeedSequence((seed,) + path)))


def epoch_indices(num_items, batch_size, seed, step):
  """Indices (batch_size,) of a batch if every item occurs once per epoch; the last partial batch is dropped.

  With fewer items than batch_size, items repeat within a batch, all equally often up to one.
  """
  if not num_items:
    raise ValueError(f"got no items for batches of {batch_size}; add data")
  per_epoch = num_items // batch_size
  if not per_epoch:
    warnings.warn(f"{num_items} items are fewer than a batch of {batch_size}: each step sees some of them twice; lower "
                  "data.batch_size or add data", stacklevel=2)
    passes = range(step * batch_size // num_items, ((step + 1) * batch_size - 1) // num_items + 1)
    rows = np.concatenate([_epoch(num_items, seed, epoch) for epoch in passes])
    return rows[step * batch_size % num_items:][:batch_size]
  epoch, place = divmod(step, per_epoch)
  return _epoch(num_items, seed, epoch)[place * batch_size:(place + 1) * batch_size]


@functools.lru_cache(maxsize=2)
def _epoch(num_items, seed, epoch):
  """The order of an epoch; cached, since there may be millions of windows."""
  return step_rng(seed, 0, epoch).permutation(num_items)


def window_starts(lengths, window, stride, released=False):
  """The windows of clips with these numbers of rows: (N, 2), index of the clip and first row of the window.

  Clips shorter than the window are omitted. released: every stride-th window of CDAMD's and MARDM's released loader,
  which has one window per row beyond the first window (docs/papers/cdamd.md#items).
  """
  if released:
    # Parity: the last possible start is never used, a clip of exactly the window's length has no window, and the first
    # start of a clip is used only because item 0 and the steps between clips fall on it.
    kept = np.flatnonzero(np.asarray(lengths) >= window)
    ends = np.cumsum(np.concatenate([[0], np.asarray(lengths)[kept] - window]))
    items = np.arange(ends[-1])[::stride]
    clip = np.maximum(np.searchsorted(ends, items) - 1, 0)
    return np.stack([kept[clip], np.where(items > 0, items - ends[clip] - 1, 0)], axis=1)
  starts = [(i, s) for i, length in enumerate(lengths) for s in range(0, length - window + 1, stride)]
  return np.array(starts, int).reshape(-1, 2)


@dataclasses.dataclass(frozen=True, eq=False)
class Windows:
  """Windows of a fixed number of frames from clips, for the autoencoders (docs/papers/cmdm.md#items).

  features: list of normalized (T_i, F); clips shorter than the window are omitted. released: see `window_starts`.
  groups: the action of each clip; with balance > 0 windows are drawn with replacement, those of rare groups more often
  (`balance_weights`), else each occurs once per epoch. short: length of the windows of every second batch, which
  includes shorter clips and more beginnings of clips; 0: no such batches. one_per_clip: one window per clip and epoch,
  at a random position; short clips then weigh as much as long ones (docs/papers/t2m_gpt.md#vq-vae). factors: sampling
  factor of each clip's windows.
  """
  features: list[np.ndarray]
  window: int = 64
  stride: int = 10
  released: bool = False
  groups: list[str] | None = None
  balance: float = 0.0
  short: int = 0
  one_per_clip: bool = False
  factors: np.ndarray | None = None

  def __post_init__(self):
    if self.short:
      object.__setattr__(self, "shorter", dataclasses.replace(self, window=self.short, short=0))
    starts = window_starts([len(x) for x in self.features], self.window, self.stride, self.released)
    if self.one_per_clip:
      starts = np.array([(i, 0) for i, x in enumerate(self.features) if len(x) >= self.window], int).reshape(-1, 2)
    if not len(starts):
      raise ValueError(f"none of {len(self.features)} clips has the {self.window} frames of a window")
    missed = sum(len(x) < self.window for x in self.features)
    if missed > _SHORT * len(self.features) and not (self.released or self.short):
      warnings.warn(f"{missed:,} of {len(self.features):,} clips are shorter than a window of {self.window} frames, "
                    "and nothing is learned from them; data.short_window = 24 adds shorter ones", stacklevel=2)
    object.__setattr__(self, "starts", starts)
    upto = None  # cumulative sampling probabilities of the windows
    if self.balance or self.factors is not None:
      weights = balance_weights([self.groups[i] for i in starts[:, 0]], self.balance)
      if self.factors is not None:
        weights = weights * self.factors[starts[:, 0]]
      upto = np.cumsum(weights) / weights.sum()
    object.__setattr__(self, "upto", upto)

  def __len__(self):
    return len(self.starts)

  def batch(self, batch_size, seed, step, rows=ALL):
    """-> features (B, window, F), index (B,), of these rows."""
    if self.short:
      step, odd = divmod(step, 2)
      if odd:
        return self.shorter.batch(batch_size, seed + 1, step, rows)
    if self.upto is None:
      drawn = epoch_indices(len(self), batch_size, seed, step)
    else:
      drawn = np.minimum(np.searchsorted(self.upto, step_rng(seed, 5, step).random(batch_size), "right"), len(self) - 1)
    chosen = self.starts[drawn]
    if self.one_per_clip:
      spare = np.array([len(self.features[i]) - self.window + 1 for i, _ in chosen])
      chosen = np.stack([chosen[:, 0], step_rng(seed, 6, step).integers(spare)], axis=1)
    chosen = chosen[rows]
    return {"features": np.stack([self.features[i][s:s + self.window] for i, s in chosen]),
            "index": np.arange(batch_size)[rows]}


Segments = tuple[tuple[str, int, int], ...]  # (caption, first frame, frame past the last) of each part of a clip


class Draw(NamedTuple):
  """The items of a batch: clips (B,), first frames and numbers of frames (B,), captions, the padded length.

  segments: of clips with per-segment captions, their parts inside the cut; () for other clips; None without any.
  """
  clip: np.ndarray
  start: np.ndarray
  num_frames: np.ndarray
  captions: list[str]
  length: int
  segments: list[Segments] | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class TextItems:
  """Clips with captions, for the generators (docs/papers/cmdm.md#items, docs/papers/cdamd.md#items).

  features: list of normalized (T_i, F), captions: a list of captions for each. lengths: possible padded frame counts,
  increasing; a batch is drawn from the items of one of them, which avoids computing padding. With one length everything
  is padded to it, as in the reference. weights (one per item): sampling weights with replacement, for data with rare
  actions; without them and with one length every item occurs once per epoch.

  max_frames: the longest padded length. crop_frames: if given, the largest number of real frames of an item, since
  whole latents may not fill whole blocks (320 frames are 80 latents, padded to 27 blocks of 3: 324 frames;
  docs/papers/cmdm.md#data-sets). keep_long: cut longer clips instead of omitting them. shorten_rate: probability that
  an item is shortened by the frames of one latent.

  spans: the parts of each clip that was joined from several, () for others; per_segment_captions: probability that such
  a clip has the captions of its parts, each in its frames, instead of one caption of the whole clip. optimality: of
  each clip, if these are scored samples.
  """
  features: list[np.ndarray]
  captions: list[list[str]]
  min_frames: int = 40
  max_frames: int = 192
  lengths: tuple[int, ...] = (192,)
  frames_per_latent: int = 4
  weights: np.ndarray | None = None
  crop_frames: int = 0  # 0: max_frames
  keep_long: bool = False
  shorten_rate: float = 1 / 3
  spans: list[Segments] | None = None
  per_segment_captions: float = 0.0
  optimality: list[float] | None = None

  def __post_init__(self):
    if not 0 <= self.crop_frames <= self.max_frames or self.crop_frames % self.frames_per_latent:
      raise ValueError(f"got crop_frames {self.crop_frames}, expected a multiple of {self.frames_per_latent} up to "
                       f"max_frames = {self.max_frames}, or 0")
    object.__setattr__(self, "longest", self.crop_frames or self.max_frames)
    if self.lengths[-1] != self.max_frames:
      raise ValueError(f"got padded lengths {self.lengths}, the last must be max_frames = {self.max_frames}")
    # Parity: "< 200" is the reference's upper limit for clips that are then cut to 192.
    most = np.inf if self.keep_long else self.longest + 7
    kept = [i for i, x in enumerate(self.features) if self.min_frames <= len(x) <= most and self.captions[i]]
    if not kept:
      raise ValueError(f"none of {len(self.features)} clips has {self.min_frames} to {most} frames and a caption")
    frames = np.array([min(len(self.features[i]), self.longest) for i in kept])
    object.__setattr__(self, "kept", np.array(kept))
    object.__setattr__(self, "bucket_of", np.searchsorted(self.lengths, frames))

  def __len__(self):
    return len(self.kept)

  @functools.cached_property
  def _shares(self):
    """Sampling probabilities of the padded lengths, and for each length (its items, their cumulative probabilities)."""
    weights = np.ones(len(self)) if self.weights is None else np.asarray(self.weights)[self.kept]
    shares = np.array([weights[self.bucket_of == b].sum() for b in range(len(self.lengths))])
    inside = [np.flatnonzero(self.bucket_of == b) for b in range(len(self.lengths))]
    return shares / shares.sum(), [(items, _upto(weights[items] / shares[b])) for b, items in enumerate(inside)]

  def draw(self, batch_size, seed, step):
    """Draws the clips of a batch, the cut and the caption of each."""
    rng = step_rng(seed, 1, step)
    if self.weights is None and len(self.lengths) == 1:
      chosen = self.kept[epoch_indices(len(self), batch_size, seed, step)]
      length = self.lengths[0]
    else:
      shares, of_lengths = self._shares
      bucket = rng.choice(len(self.lengths), p=shares)
      inside, upto = of_lengths[bucket]
      # Equals rng.choice(inside, batch_size, p=...), without its sum over all items in every step.
      chosen, length = self.kept[inside[upto.searchsorted(rng.random(batch_size), "right")]], self.lengths[bucket]
    starts, num_frames, captions = [], [], []
    for i in chosen:
      frames = len(self.features[i])
      # Parity: one time in three one latent less than the clip holds, then a random position in the clip.
      count = self._frames(frames, rng.random() < self.shorten_rate)
      starts.append(rng.integers(frames - count + 1))
      num_frames.append(count)
      captions.append(self.captions[i][rng.integers(len(self.captions[i]))])
    segments = None
    if self.per_segment_captions:
      spoken = rng.random(batch_size) < self.per_segment_captions
      segments = [_inside(self.spans[i], start, start + count) if said else ()
              for i, start, count, said in zip(chosen, starts, num_frames, spoken)]
    return Draw(chosen, np.array(starts), np.array(num_frames, np.int32), captions, length, segments)

  def _frames(self, frames, less):
    return min(max(frames // self.frames_per_latent - less, 1) * self.frames_per_latent, self.longest)

  def cuts(self):
    """All cuts that may be drawn: (clip, start, count, padded length) of each."""
    for i, bucket in zip(self.kept, self.bucket_of):
      frames = len(self.features[i])
      rates = ((0, 1 - self.shorten_rate), (1, self.shorten_rate))
      counts = {self._frames(frames, less) for less, rate in rates if rate}
      for count in sorted(counts, reverse=True):
        yield from ((int(i), start, count, self.lengths[bucket]) for start in range(frames - count + 1))

  def batch(self, batch_size, seed, step, rows=ALL):
    """-> features (B, T, F) zero-padded, num_frames (B,), index (B,), of scored samples optimality (B,), of these rows;
    caption, a list of all B, and with per_segment_captions also segments (`Draw`)."""
    drawn = self.draw(batch_size, seed, step)
    index, num_frames = np.arange(batch_size)[rows], drawn.num_frames[rows]
    out = np.zeros((len(index), drawn.length, self.features[0].shape[-1]), np.float32)
    for row, i, start, count in zip(out, drawn.clip[rows], drawn.start[rows], num_frames):
      row[:count] = self.features[i][start:start + count]
    batch = {"features": out, "num_frames": num_frames, "caption": drawn.captions, "index": index}
    if self.optimality is not None:
      batch["optimality"] = np.array([self.optimality[i] for i in drawn.clip[rows]], np.float32)
    return batch if drawn.segments is None else batch | {"segments": drawn.segments}


def _upto(shares):
  """Cumulative probabilities (N,), as `numpy.random.Generator.choice` computes them; [] for []."""
  total = shares.cumsum()
  return total / total[-1] if len(total) else total


def _inside(spans, first, past):
  """Spans in frames of the cut first:past; spans outside of it are dropped."""
  cut = [(text, max(a, first) - first, min(b, past) - first) for text, a, b in spans]
  return tuple(span for span in cut if span[1] < span[2])


def balance_weights(groups, power):
  """Weights (N,) that sample group g in proportion to count(g) ** (1 - power): 0 by frequency, 1 all groups equally."""
  names, inverse, counts = np.unique(groups, return_inverse=True, return_counts=True)
  return counts[inverse].astype(np.float64) ** -power


@dataclasses.dataclass(frozen=True, eq=False)
class CaptionedClips:
  """Whole clips with a caption, for the teacher: zero-padded, or cut at a random position.

  Source: docs/papers/cmdm.md#items.
  """
  features: list[np.ndarray]
  captions: list[list[str]]
  max_frames: int = 196
  weights: np.ndarray | None = None  # draws with replacement in proportion to them

  def __post_init__(self):
    kept = np.array([i for i, captions in enumerate(self.captions) if captions], int)
    if not len(kept):
      raise ValueError(f"none of {len(self.captions)} clips has a caption")
    object.__setattr__(self, "kept", kept)

  def __len__(self):
    return len(self.kept)

  def rows(self, chosen, rng, rows=ALL):
    """A batch of the clips with these indices -> features (B, max_frames, F), num_frames (B,), index (B,), of these
    rows; caption, a list of all B."""
    starts, captions = [], []
    for i in chosen:
      starts.append(rng.integers(max(len(self.features[i]) - self.max_frames, 0) + 1))
      captions.append(self.captions[i][rng.integers(len(self.captions[i]))])
    index = np.arange(len(chosen))[rows]
    out = np.zeros((len(index), self.max_frames, self.features[0].shape[-1]), np.float32)
    num_frames = np.zeros(len(index), np.int32)
    for row, i in enumerate(index):
      clip = self.features[chosen[i]][starts[i]:starts[i] + self.max_frames]
      out[row, :len(clip)], num_frames[row] = clip, len(clip)
    return {"features": out, "num_frames": num_frames, "caption": captions, "index": index}

  def batch(self, batch_size, seed, step, rows=ALL):
    rng = step_rng(seed, 3, step)
    if self.weights is None:
      return self.rows(self.kept[epoch_indices(len(self), batch_size, seed, step)], rng, rows)
    p = np.asarray(self.weights)[self.kept]
    return self.rows(rng.choice(self.kept, batch_size, p=p / p.sum()), rng, rows)
