"""A store: the outputs of frozen networks for training data, computed once and kept on disk.

`motion-jax data encode` writes one: the latents (and codes) of every cut that training may draw of a clip, and the
features of every caption. A training run that names it in data.store reads rows instead of running the encoders in
every step. A store is a folder of plain files:

  store.json       what it was made from, and each table's shape and sha256 sum
  NAME.rows        raw numbers, row by row
  NAME.ends.npy    (N,) end of the rows of each entry
  cuts.npy         (N, 3) of each entry of the tables of cuts: index of the clip, first frame, number of frames
  captions.json    the captions whose features are in the table "words"

It is valid for one data set, tokenizer and text encoder only: `Store.require` rejects any other by their digests.
"""
import contextlib
import hashlib
import itertools
import json
import pathlib
from collections.abc import Callable

import jax
import numpy as np
import tqdm

from motion_jax.data.batches import ALL, TextItems
from motion_jax.text.captions import with_subjects
from motion_jax.text.encoder import TextEncoder
from motion_jax.utils.atomic import atomic_folder
from motion_jax.utils.errors import InputError, reading
from motion_jax.utils.format_versions import check_version
from motion_jax.utils.input_files import load_npy, read_json

ABOUT, CUTS, CAPTIONS, WORDS = "store.json", "cuts.npy", "captions.json", "words"
_ADVICE = "make the store again by motion-jax data encode"


class Writer:
  """Writes a store's tables row by row; `with writing(folder) as writer` creates the folder only if all succeeds."""

  def __init__(self, folder):
    self.folder, self._files, self._ends, self._about, self._sums = folder, {}, {}, {}, {}

  def add(self, table, rows):
    """Adds one entry to a table: rows (L, C), of the same C and dtype for all entries."""
    rows = np.ascontiguousarray(rows)
    about = dict(columns=rows.shape[1], dtype=str(rows.dtype))
    if self._about.setdefault(table, about) != about:
      raise ValueError(f"got rows of {about} for the table {table!r} of {self._about[table]}")
    if table not in self._files:
      self._files[table], self._ends[table] = open(self.folder / f"{table}.rows", "wb"), [0]
      self._sums[table] = hashlib.sha256()
    content = rows.tobytes()
    self._files[table].write(content)
    self._sums[table].update(content)
    self._ends[table].append(self._ends[table][-1] + len(rows))

  def close(self, identity, cuts, captions):
    """Finishes the store. identity: {part: digest}; cuts (N, 3): entries of the tables of cuts; captions of "words"."""
    for table, file in self._files.items():
      file.close()
      np.save(self.folder / f"{table}.ends.npy", np.array(self._ends[table][1:], np.int64))
      self._about[table] |= dict(rows=self._ends[table][-1], sha256=self._sums[table].hexdigest())
    np.save(self.folder / CUTS, np.asarray(cuts, np.int64).reshape(-1, 3))
    (self.folder / CAPTIONS).write_text(json.dumps(list(captions), ensure_ascii=False))
    (self.folder / ABOUT).write_text(json.dumps(dict(format=1, identity=identity, tables=self._about), indent=1) + "\n")


@contextlib.contextmanager
def writing(folder):
  """Yields a Writer whose folder is created when the block succeeds. Raises InputError if the folder is not empty."""
  folder = pathlib.Path(folder)
  if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
    raise InputError(f"{folder} is there already; remove it, or choose another folder")
  with atomic_folder(folder) as temporary:
    yield Writer(temporary)


class Store:
  """A store on disk, opened for reading; its tables are memory-mapped."""

  def __init__(self, folder):
    self.folder = folder = pathlib.Path(folder)
    if not (folder / ABOUT).is_file():
      raise FileNotFoundError(f"{folder} has no {ABOUT}: it is no store; motion-jax data encode makes one")
    about = read_json(folder / ABOUT, dict, advice=_ADVICE)
    with reading(folder / ABOUT, _ADVICE):
      check_version(about["format"], f"the store {folder}")
      self.identity, self._tables = dict(about["identity"]), dict(about["tables"])
      self._rows = {name: self._mapped(name, table) for name, table in self._tables.items()}
    self._ends = {name: load_npy(folder / f"{name}.ends.npy") for name in self._tables}
    self.captions = {caption: i for i, caption in enumerate(read_json(folder / CAPTIONS, list, advice=_ADVICE))}
    cuts = load_npy(folder / CUTS)
    self._cuts = {key: i for i, key in enumerate(map(tuple, cuts.tolist()))}
    self._longest = {}  # {(clip, start): the entry with the most frames}
    for i, (clip, start, count) in enumerate(cuts.tolist()):
      known = self._longest.get((clip, start))
      if known is None or cuts[known, 2] < count:
        self._longest[clip, start] = i

  def __reduce__(self):
    return Store, (self.folder.absolute(),)  # other processes open the large tables themselves

  def _mapped(self, name, table):
    path, shape = self.folder / f"{name}.rows", (int(table["rows"]), int(table["columns"]))
    dtype = np.dtype(table["dtype"])
    if not path.is_file() or path.stat().st_size != shape[0] * shape[1] * dtype.itemsize:
      raise InputError(f"{path} is missing or cut short: expected {shape[0]} rows of {shape[1]} {dtype}; {_ADVICE}")
    return np.memmap(path, dtype, "r", shape=shape) if shape[0] else np.zeros(shape, dtype)

  def require(self, identity):
    """Raises InputError, naming the differing parts, unless the store was made from identity, {part: digest}."""
    other = [part for part in {**identity, **self.identity} if identity.get(part) != self.identity.get(part)]
    if other:
      raise InputError(f"{self.folder} was made from other {', '.join(sorted(other))} than this run has; {_ADVICE}")

  def damage(self) -> list[str]:
    """Names of the tables whose content has changed since it was written."""
    digest = lambda name: hashlib.sha256((self.folder / f"{name}.rows").read_bytes()).hexdigest()
    return [name for name, table in self._tables.items() if digest(name) != table["sha256"]]

  def cut(self, table, clip, start, count=None):
    """Rows (L, C) of a cut; without count those of the longest cut from this frame."""
    entry = self._longest.get((clip, start)) if count is None else self._cuts.get((clip, start, count))
    if entry is None:
      raise InputError(f"{self.folder} has no {table} of clip {clip} from frame {start}"
                       f"{'' if count is None else f' of {count} frames'}; {_ADVICE}")
    return self._entry(table, entry)

  def words(self, caption):
    """Features (S, D) of a caption, or None."""
    entry = self.captions.get(caption)
    return None if entry is None else self._entry(WORDS, entry)

  def _entry(self, table, entry):
    ends = self._ends[table]
    return self._rows[table][ends[entry - 1] if entry else 0:ends[entry]]


def digest_of(*parts) -> str:
  """sha256 of strings, arrays, lists and trees of arrays."""
  digest = hashlib.sha256()
  for part in parts:
    if isinstance(part, str):
      digest.update(part.encode() + b"\0")
      continue
    for path, leaf in jax.tree_util.tree_leaves_with_path(part):
      leaf = np.ascontiguousarray(leaf)
      digest.update(f"{jax.tree_util.keystr(path)} {leaf.shape} {leaf.dtype}".encode() + leaf.tobytes())
  return digest.hexdigest()


def stored_batch(store, items, tables, batch_size, seed, step, rows=ALL, *, latents_look_back):
  """`items.batch` with rows of a store instead of features: {table: (B, L, C)}, zero-padded.

  latents_look_back: latents depend on no later frame: those of a shorter cut are the first of the longest cut's.
  """
  drawn = items.draw(batch_size, seed, step)
  cuts = [numbers[rows] for numbers in (drawn.clip, drawn.start, drawn.num_frames)]
  batch = {"num_frames": cuts[2], "caption": drawn.captions, "index": np.arange(batch_size)[rows]}
  for table in tables:
    latents = [store.cut(table, clip, start, None if latents_look_back else count)[:count // items.frames_per_latent]
               for clip, start, count in zip(*map(np.ndarray.tolist, cuts))]
    shape = len(latents), drawn.length // items.frames_per_latent, latents[0].shape[-1]
    batch[table] = np.zeros(shape, latents[0].dtype)
    for row, cut in zip(batch[table], latents):
      row[:len(cut)] = cut
  return batch


# --- writing a store: frozen networks applied to all cuts and captions that training may draw -------------------------


def identity_of(codecs, items: TextItems, encoder: TextEncoder) -> dict[str, str]:
  """{part: digest} of the inputs of a store; codecs: the tree of the tokenizers' parameters."""
  return {"tokenizer": digest_of(codecs), "data": digest_of(items.features),
          "rules of cutting": digest_of(np.array(list(items.cuts()), np.int64)),
          "text encoder": encoder.fingerprint}


def encode(folder, codecs, items: TextItems, encoder: TextEncoder, encode_cuts: Callable, vary_subject, *,
           latents_look_back, batch_size=16):
  """Writes a store of the cuts of items and of their captions; returns a line about it.

  encode_cuts(codecs, features (B, T, F), num_frames (B,)) -> {table: rows (B, L, C)}, pure. vary_subject: training
  varies the subject of captions. latents_look_back: see `stored_batch`; only the longest cut from each frame is stored.
  """
  captions = sorted({said for i in items.kept for caption in items.captions[i]
                     for said in (with_subjects(caption) if vary_subject else [caption])})
  encoder.check(captions)
  cuts = list(items.cuts())
  if latents_look_back:  # cuts come with the longest of a clip first
    cuts = list({(clip, start): (clip, start, count, length) for clip, start, count, length in reversed(cuts)}.values())
  run, done = jax.jit(encode_cuts), []
  with writing(folder) as writer:
    with tqdm.tqdm(total=len(cuts), unit="cut", dynamic_ncols=True, disable=None) as bar:
      for length, group in itertools.groupby(sorted(cuts, key=lambda cut: cut[3]), lambda cut: cut[3]):
        group = list(group)
        for some in (group[at:at + batch_size] for at in range(0, len(group), batch_size)):
          features, counts = np.zeros((batch_size, length, items.features[0].shape[-1]), np.float32), [0] * batch_size
          for row, (clip, start, count, _) in enumerate(some):
            features[row, :count], counts[row] = items.features[clip][start:start + count], count
          encoded = jax.tree.map(np.asarray, run(codecs, features, np.array(counts, np.int32)))
          for row, count in enumerate(counts[:len(some)]):
            for table, rows in encoded.items():
              writer.add(table, rows[row, :count // items.frames_per_latent])
          done += [cut[:3] for cut in some]
          bar.update(len(some))
    said = []
    for caption, rows in encoder.in_batches(captions):
      writer.add(WORDS, rows)
      said.append(caption)
    writer.close(identity_of(codecs, items, encoder), done, said)
  return f"wrote {folder}: {len(done)} cuts of {len(items)} clips, {len(said)} captions"
