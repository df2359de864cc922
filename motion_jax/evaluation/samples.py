"""Generated motions of a replication: which items it draws, what a model generates from their captions, and their
files.

Every draw is a function of (seed, replication), a motion's noise of (seed, replication, item, copy): the results are
the same alone or in a batch, on one device or several, at once or after a kill.

A folder of samples holds samples.json, which names everything that determines them and the code that generated them,
and a file rNNN_bNNN.npz per batch: features (rows, F), float32, of all its motions concatenated, in physical units,
start (B + 1,) offsets, frames (B,), seeds (B,). After its frames a motion may have up to TAIL more rows of the decoder.
Joints follow from features (`motion.representations.to_joints`).
"""
import concurrent.futures
import hashlib
import json
import pathlib
from typing import NamedTuple

import jax
import numpy as np
from tqdm import tqdm

from motion_jax.data.mirror import mirror_legs
from motion_jax.training import checkpoint
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import load_npz

BATCH = 32  # motions made together, whatever the protocol's pool: one compiled function serves all
TAIL = 4    # rows kept after a motion's end: as far as an evaluator's last token reaches


class Draw(NamedTuple):
  """A draw from the test set: item, index of its caption, first row and number of rows of the cut, (N,) each."""
  item: np.ndarray
  caption: np.ndarray
  start: np.ndarray
  frames: np.ndarray

  def __len__(self):
    return len(self.item)

  def captions_of(self, test_set):
    return [test_set.captions[i][c] for i, c in zip(self.item, self.caption)]

  def tokens_of(self, test_set):
    return [test_set.tokens[i][c] for i, c in zip(self.item, self.caption)]

  def cut(self, features):
    """The drawn rows [(frames, F)] of features, which are a list for all items."""
    return [features[i][s:s + m] for i, s, m in zip(self.item, self.start, self.frames)]


class Jobs(NamedTuple):
  """Motions to generate: lists of equal length of captions, frames, seeds, and places in the draw."""
  captions: list[str]
  frames: list[int]
  seeds: list[int]
  places: list[int]


def draw_replication(test_set, protocol, seed, replication, limit=None, stream=0, order=None) -> Draw:
  """The draw of a replication: whole batches of protocol.pool items.

  limit: at most this many items, for a trial. stream: 1 gives another draw. order: items (N,) to take in this order.
  Raises ValueError if there are fewer items than one pool.
  """
  rows, pool = test_set.rows, protocol.pool
  rng = np.random.default_rng((seed, replication, stream))
  drawn = rng.permutation(len(rows)) if protocol.shuffle else np.arange(len(rows))
  which, shorten, where, again = rng.random((4, len(rows)))
  num_captions = np.array([len(captions) for captions in test_set.captions])
  caption = (which * num_captions).astype(int) if protocol.random_caption else np.zeros(len(rows), int)
  # Parity: one time in three a unit less than the clip holds, so that each length occurs with two cuts.
  units = rows // protocol.unit_length - (shorten < 1 / 3 if protocol.coin else 0)
  count = np.maximum(units, 1) * protocol.unit_length
  start = (where * (rows - count + 1)).astype(int) if protocol.random_crop else np.zeros(len(rows), int)
  long = count > protocol.max_frames
  over = np.where(long, count - protocol.max_frames, 0)
  start = start + ((again * (over + 1)).astype(int) if protocol.random_crop else 0)
  frames = np.where(long, protocol.max_frames, count)
  if order is not None:
    return Draw(order, caption[order], start[order], frames[order])
  total = min(len(rows), limit or len(rows)) // pool * pool
  if not total and len(rows) >= pool:
    raise ValueError(f"got --limit {limit}, protocol {protocol.name!r} compares {pool} motions at a time; --limit "
                     f"{pool} is enough, the test set has {len(rows)}")
  if not total:
    raise ValueError(f"got {len(rows)} test items, protocol {protocol.name!r} compares {pool} at a time; give more "
                     "data, or judge a folder of `motion-jax data build` by --protocol own-66, which compares fewer")
  order = drawn[:total]
  if protocol.sort_by_caption:
    words = np.array([len((test_set.tokens[i][caption[i]] or test_set.captions[i][caption[i]]).split())
                      for i in order])
    order = np.concatenate([order[i:i + pool][np.argsort(-words[i:i + pool], kind="stable")]
                            for i in range(0, total, pool)])
  return Draw(order, caption[order], start[order], frames[order])


def seed_of(seed, replication, item, copy=0) -> int:
  """The seed of the noise of one motion."""
  return int(np.random.SeedSequence((seed, replication, item, copy)).generate_state(1)[0] >> 1)


def jobs_of(test_set, drawn, seed, replication, copy=None) -> Jobs:
  """The jobs of a draw; copy (N,): which of several generations of an item, by default the first."""
  copy = np.zeros(len(drawn), int) if copy is None else copy
  seeds = [seed_of(seed, replication, int(i), int(c)) for i, c in zip(drawn.item, copy)]
  return Jobs(drawn.captions_of(test_set), drawn.frames.tolist(), seeds, list(range(len(seeds))))


class Store:
  """A folder of samples of one model with one choice of sampling.

  about: everything that determines the samples; its hash names the folder, so that other samples are never read. maker:
  code and machine, which should not change the samples; samples.json lists all that contributed.
  """

  def __init__(self, folder, about, maker=None):
    self.about, self.maker = about, maker
    self.key = hashlib.sha256(json.dumps(about, sort_keys=True).encode()).hexdigest()[:16]
    self.folder = pathlib.Path(folder) / self.key

  def path(self, name, batch):
    return self.folder / f"{name}_b{batch:03d}.npz"

  def read(self, name, batch, jobs):
    """[(rows, F)] of a batch, or None if it is missing or incomplete."""
    keys = ("features", "start", "frames", "seeds")
    try:
      file = load_npz(self.path(name, batch), keys, required=keys)
    except (OSError, InputError):  # a file that a dying machine cut short
      return None
    if file["frames"].tolist() != jobs.frames or file["seeds"].tolist() != jobs.seeds:
      return None
    return [file["features"][a:b] for a, b in zip(file["start"][:-1], file["start"][1:])]

  @property
  def makers(self) -> list[dict]:
    """Code and machines that generated the samples; [{}] where that was not recorded."""
    path = self.folder / "samples.json"
    return checkpoint.load_json(self.folder, path.name).get("made_by", [{}]) if path.is_file() else []

  def write(self, name, batch, jobs, motions):
    makers = self.makers
    if self.maker not in makers or not makers:
      content = self.about | {"made_by": [*makers, self.maker]}
      with atomic_path(self.folder / "samples.json") as path:
        path.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    start = np.cumsum([0, *map(len, motions)])
    with atomic_path(self.path(name, batch)) as path:
      np.savez(path, features=np.concatenate(motions).astype(np.float32), start=start, frames=np.array(jobs.frames),
               seeds=np.array(jobs.seeds))


def sample(make, store, name, jobs, *, batch=None, devices=None, only_read=False, bar=None) -> list[np.ndarray]:
  """Features [(rows, F)] of all jobs, read from the store or generated and stored, batch by batch.

  make(jobs) -> list of (rows, F), for `batch` motions at a time. Jobs are sorted by length, so that short motions are
  not computed at the size of the longest, and the last batch is filled up. Devices take whole batches in turn, so their
  number does not change the results. name: of the files, such as "r000". only_read: raise ValueError instead of
  generating. bar: a tqdm bar, advanced by each motion.
  """
  size = batch or BATCH
  order = np.argsort(np.array(jobs.frames), kind="stable")
  parts = [order[i:i + size] for i in range(0, len(order), size)]
  devices = devices or jax.local_devices()[:1]

  def run(number):
    some = Jobs(*([part[i] for i in parts[number]] for part in jobs))
    motions = store.read(name, number, some)
    if motions is None:
      if only_read:
        raise ValueError(f"{store.path(name, number)} does not exist: these samples were never generated, or another "
                         "model, sampling or protocol is requested; leave --recompute out to generate them")
      fill = size - len(some.captions)
      full = Jobs(*(part + part[-1:] * fill for part in some))
      with jax.default_device(devices[number % len(devices)]):
        motions = [np.asarray(x, np.float32) for x in make(full)[:len(some.captions)]]
      for x, caption, seed in zip(motions, some.captions, some.seeds):
        if not np.isfinite(x).all():
          raise FloatingPointError(f"the model generated NaN or infinity for {caption!r} (seed {seed}); check the "
                                   "run's loss, or sample with less guidance")
      store.write(name, number, some, motions)
    if bar is not None:
      bar.update(len(motions))
    return motions

  collected = [None] * len(order)
  for part, motions in zip(parts, _in_turn(run, len(parts), len(devices))):
    for i, motion in zip(part, motions):
      collected[i] = motion
  return collected


def _in_turn(run, count, workers):
  if workers == 1:
    yield from map(run, range(count))
    return
  pool = concurrent.futures.ThreadPoolExecutor(workers)
  try:
    yield from pool.map(run, range(count))
  finally:
    pool.shutdown(cancel_futures=True)  # an error in one batch leaves the rest undone


def progress(total, what, shown=True):
  return tqdm(total=total, desc=what, unit="motion", disable=None if shown else True, leave=False)


def contrast_of(model):
  """The contrast guidance that a model's config asks for: captions that name a leg, against the other leg."""
  return dict(negative_prompts=mirror_legs) if "negative_prompts" in model.more_choices else {}


def generator_of(model, guidance_scale=None, sampling=None):
  """make(jobs) of `sample` for a loaded model: one pass of the network."""
  choices = dict(guidance_scale=guidance_scale) | contrast_of(model) | (sampling or {})

  def make(jobs):
    generated = model.generate(jobs.captions, jobs.frames, seeds=jobs.seeds, **choices)
    return [x[:count + TAIL] for x, count in zip(generated.decoded, jobs.frames)]
  return make
