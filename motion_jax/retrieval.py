"""Finds motions by words, and words by motions, with a trained teacher: `motion-jax retrieve`."""
import dataclasses
import functools
import hashlib
import os
import pathlib

import jax
import jax.numpy as jnp
import numpy as np
from tqdm import tqdm

from motion_jax import checkpoint
from motion_jax import teacher as teacher_lib
from motion_jax.data import archive, humanml3d
from motion_jax.data.clip import Clip, atomic_path
from motion_jax.metrics.scores import retrieval
from motion_jax.model import PRETRAINED
from motion_jax.motion.features import to_features
from motion_jax.motion.stats import load_stats
from motion_jax.nets.masks import padding_mask
from motion_jax.recipes.cmdm import word_pieces
from motion_jax.recipes.recipe import plain
from motion_jax.text.bert import Bert
from motion_jax.text.encoder import load_text_encoder

BATCH = 64  # motions embedded together; the last batch is filled up, so one compiled function serves all


class Retriever:
  """A trained teacher: sentences and motions in, unit vectors in one space out. Made by `load`."""

  def __init__(self, folder, config):
    self.folder, self.config = pathlib.Path(folder), config
    self.stats = load_stats(folder, config.data.layout)
    self.teacher = teacher_lib.make_teacher(plain(config.model.to_dict()), config.data.layout)
    self.bert = Bert(**plain(config.text.to_dict()))
    shapes = teacher_lib.teacher_shapes(self.teacher, plain(config.text.to_dict()), config.data.layout)
    self.params = jax.tree.map(jnp.asarray, checkpoint.load_params(folder, shapes))
    self.encoder = load_text_encoder(config.frozen.text)  # for its tokenizer; the weights are the run's own
    self._text = jax.jit(lambda params, ids, mask: teacher_lib.embed_text(
        self.teacher, self.bert, params, ids, mask, config.loss.text_pool))
    self._motion = jax.jit(functools.partial(teacher_lib.embed_motion, self.teacher))

  @property
  def fingerprint(self):
    return hashlib.sha256((self.folder / checkpoint.PARAMS).read_bytes()).hexdigest()

  def embed_text(self, sentences):
    """Unit vectors (B, E); a sentence longer than the teacher was trained on is cut."""
    ids, text_mask = word_pieces(self.encoder, list(sentences), self.config.data.max_words)
    made = [self._text(self.params, *_filled((ids[i:i + BATCH], text_mask[i:i + BATCH])))
            for i in range(0, len(ids), BATCH)]
    return np.concatenate(made)[:len(ids)]

  def embed_motion(self, features, progress=False):
    """Unit vectors (B, E) of motions, a list of (T, F) features that are not normalized.

    A motion longer than the teacher's window is cut into pieces; its vector is the direction of their mean.
    """
    length, pieces, owner = self.config.data.max_frames, [], []
    for i, x in enumerate(features):
      self.stats.layout.check(x)
      count = -(-len(x) // length)
      pieces += np.array_split(self.stats.normalize(x), count)
      owner += [i] * count
    padded = np.zeros((len(pieces), length, self.stats.layout.dim), np.float32)
    frames = np.array([len(piece) for piece in pieces])
    for row, piece in zip(padded, pieces):
      row[:len(piece)] = piece
    made = []
    for i in tqdm(range(0, len(pieces), BATCH), desc="embedding", unit="batch", disable=not progress, leave=False):
      x, mask = _filled((padded[i:i + BATCH], np.asarray(padding_mask(frames[i:i + BATCH], length))))
      made.append(np.asarray(self._motion(self.params, x, mask)))
    total = np.zeros((len(features), made[0].shape[-1]))
    np.add.at(total, owner, np.concatenate(made)[:len(pieces)])
    return (total / np.linalg.norm(total, axis=-1, keepdims=True)).astype(np.float32)

  def features_of(self, clip: Clip):
    """The features (T, F) of a clip that this teacher reads."""
    if clip.features is not None and clip.features.shape[-1] == self.stats.layout.dim:
      return clip.features
    return to_features(clip.joints, self.stats.layout, self.config.data.mode)


def load(name="part-tmr-small") -> Retriever:
  """A teacher from its run folder or from those that ship."""
  folder = pathlib.Path(name)
  if not folder.is_dir():
    folder = PRETRAINED / str(name)
  if not folder.is_dir():
    raise FileNotFoundError(f"found neither a run folder {str(name)!r} nor a teacher of that name that ships; train "
                            "one with configs/part_tmr.py")
  config = checkpoint.load_config(folder)
  if config.get("stage") != "cmdm.teacher":
    raise ValueError(f"{folder} holds a {config.get('stage')!r} run; retrieving needs the run of a cmdm.teacher")
  return Retriever(folder, config)


@dataclasses.dataclass(frozen=True, eq=False)
class Collection:
  """Clips that can be searched: a name, captions, a length in seconds and a unit vector for each."""
  ids: list[str]
  captions: list[list[str]]
  seconds: np.ndarray
  vectors: np.ndarray

  def __len__(self):
    return len(self.ids)

  def nearest_clips(self, vector, num=5):
    """[(similarity, number of the clip)], best first."""
    similarity = self.vectors @ vector
    return [(float(similarity[i]), int(i)) for i in np.argsort(-similarity, kind="stable")[:num]]

  def nearest_captions(self, vector, retriever, num=5):
    """[(similarity, caption)] of all different captions, best first."""
    captions = sorted({caption for row in self.captions for caption in row})
    similarity = retriever.embed_text(captions) @ vector
    return [(float(similarity[i]), captions[i]) for i in np.argsort(-similarity, kind="stable")[:num]]

  def scores(self, retriever):
    """(number of clips, `metrics.scores.retrieval` of them) among one clip of each first caption."""
    first = {row[0]: i for i, row in reversed(list(enumerate(self.captions))) if row}
    chosen = sorted(first.values())
    text = retriever.embed_text([self.captions[i][0] for i in chosen])
    return len(chosen), retrieval(text @ self.vectors[chosen].T)


def read_clips(folder, split=None) -> list[Clip]:
  """The captioned clips of an archive or a HumanML3D-layout folder."""
  folder = pathlib.Path(folder)
  if archive.is_archive(folder):
    clips = archive.read_archive(folder, split)
  elif (folder / "new_joint_vecs").is_dir():
    clips = humanml3d.read_folder(folder, split or "all")
  else:
    raise FileNotFoundError(f"{folder} is neither an archive (motions.npz, captions.jsonl) nor a HumanML3D-layout "
                            "folder (new_joint_vecs, texts); `motion-jax data build` makes one")
  clips = [clip for clip in clips if clip.num_frames >= 8 and clip.captions]
  if not clips:
    raise ValueError(f"{folder} has no clip with a caption" + (f" in split {split!r}" if split else ""))
  return clips


def read_collection(retriever, folder, split=None) -> Collection:
  """The clips of a folder with their vectors, which are kept in the user's cache for the next question."""
  clips = read_clips(folder, split)
  digest = hashlib.sha256(retriever.fingerprint.encode())
  for clip in clips:
    digest.update(clip.id.encode() + np.ascontiguousarray(clip.joints[::10]).tobytes())
  cache = pathlib.Path(os.environ.get("XDG_CACHE_HOME") or pathlib.Path.home() / ".cache") / "motion_jax" / "vectors"
  path = cache / f"{digest.hexdigest()[:32]}.npy"
  if path.is_file():
    vectors = np.load(path, allow_pickle=False)
  else:
    bar = tqdm(clips, desc="features", unit="clip", leave=False, disable=None)
    features = [retriever.features_of(clip) for clip in bar]
    vectors = retriever.embed_motion(features, progress=True)
    try:
      cache.mkdir(parents=True, exist_ok=True)
      with atomic_path(path) as temporary, open(temporary, "wb") as file:
        np.save(file, vectors, allow_pickle=False)
    except OSError:
      pass  # a read-only home costs time, not the answer
  return Collection([clip.id for clip in clips], [[caption.text for caption in clip.captions] for clip in clips],
                    np.array([clip.seconds for clip in clips]), vectors)


def _filled(arrays):
  """Arrays with rows added up to BATCH."""
  return [np.concatenate([a, np.repeat(a[-1:], BATCH - len(a), axis=0)]) for a in arrays]
