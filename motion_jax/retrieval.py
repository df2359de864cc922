"""Finds motions by words, and words by motions, with a trained teacher: `motion-jax retrieve`."""
import dataclasses
import hashlib
import io
import json

import jax
import numpy as np
from tqdm import tqdm

from motion_jax import runs
from motion_jax.data.clip import Clip
from motion_jax.data.datasets.base import SHORTEST
from motion_jax.data.datasets.registry import dataset_of
from motion_jax.metrics.scores import retrieval, retrieval_by_rank
from motion_jax.models.tmr.space import make_space
from motion_jax.motion import plausibility
from motion_jax.motion.representations import to_features
from motion_jax.nets.masks import padding_mask
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.config_files import module_fields

BATCH = 64  # motions embedded together; the last batch is filled up, so one compiled function serves all


class Retriever:
  """A trained teacher: sentences and motions in, unit vectors in one space out. Made by `load`."""

  def __init__(self, run: runs.Run):
    self.folder, self.config, self.stats = run.folder, run.config, run.stats
    config = run.config
    self.space = space = make_space(config)
    # What decides the functions of a space, and so may share what was traced of them.
    about = (space.net, module_fields(config.text), config.data.layout, module_fields(config.loss))
    shapes = cache.kept_shapes("teacher", about, lambda: jax.eval_shape(space.init, jax.random.key(0)))
    self.params = jax.device_put(run.params(shapes))
    # For its tokenizer: the weights are the run's own, but for a TMR, whose text transformer is frozen.
    self.encoder = load_text_encoder(run.text)
    if "text" not in self.params:
      run.check_encoder(self.encoder)
    self._text = cache.Program("teacher.text", space.text, about=about)
    self._motion = cache.Program("teacher.motion", space.motion, about=(space.net,))

  @property
  def fingerprint(self):
    """A digest of the weights and of what says how they are used."""
    digest = hashlib.sha256()
    for name in (checkpoint.PARAMS, checkpoint.CONFIG, "Mean.npy", "Std.npy"):
      digest.update(hashlib.sha256((self.folder / name).read_bytes()).digest())
    return digest.hexdigest()

  def embed_text(self, sentences):
    """Unit vectors (B, E). Raises ValueError for an empty sentence or one longer than the teacher has positions for."""
    sentences = list(sentences)
    parts = [self._text(self.params, *_filled(self.space.read(self.encoder, sentences[i:i + BATCH]).values()))
             for i in range(0, len(sentences), BATCH)]
    return np.concatenate(parts)[:len(sentences)]

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
    parts = []
    for i in tqdm(range(0, len(pieces), BATCH), desc="embedding", unit="batch", disable=not progress, leave=False):
      x, mask = _filled((padded[i:i + BATCH], np.asarray(padding_mask(frames[i:i + BATCH], length))))
      parts.append(np.asarray(self._motion(self.params, x, mask)))
    total = np.zeros((len(features), parts[0].shape[-1]))
    np.add.at(total, owner, np.concatenate(parts)[:len(pieces)])
    return (total / np.linalg.norm(total, axis=-1, keepdims=True)).astype(np.float32)

  def features_of(self, clip: Clip):
    """The features (T, F) of a clip that this teacher reads."""
    if clip.features is not None and clip.features.shape[-1] == self.stats.layout.dim:
      return clip.features
    plausibility.check(clip.joints, clip.skeleton, clip.fps, f"clip {clip.id!r}")
    return to_features(clip.joints, self.stats.layout, self.config.data.mode)


def load(name="part-tmr-small") -> Retriever:
  """A teacher from its run folder or from those that ship."""
  run = runs.load_run(name, "tmr.teacher")
  with checkpoint.building(run.folder):
    return Retriever(run)


@dataclasses.dataclass(frozen=True, eq=False)
class Collection:
  """Clips that can be searched: a name, captions, a length in seconds and a unit vector for each.

  words: all different captions, in order; word_vectors: a unit vector for each of them.
  """
  ids: list[str]
  captions: list[list[str]]
  seconds: np.ndarray
  vectors: np.ndarray
  words: list[str]
  word_vectors: np.ndarray

  def __len__(self):
    return len(self.ids)

  def nearest_clips(self, vector, num=5):
    """[(similarity, number of the clip)], best first."""
    similarity = self.vectors @ vector
    return [(float(similarity[i]), int(i)) for i in np.argsort(-similarity, kind="stable")[:num]]

  def nearest_captions(self, vector, num=5):
    """[(similarity, caption)] of all different captions, best first."""
    similarity = self.word_vectors @ vector
    return [(float(similarity[i]), self.words[i]) for i in np.argsort(-similarity, kind="stable")[:num]]

  def scores(self):
    """(number of clips, `metrics.scores.retrieval` of them) among one clip of each first caption."""
    chosen, similarity = self._first_captions()
    return len(chosen), retrieval(similarity)

  def near_scores(self, retriever, threshold=0.95):
    """The same by TMR's protocol in which a clip counts whose caption says nearly the same: its sentence vector has a
    cosine over 2 * threshold - 1. None if the teacher's config names no encoder of sentences (frozen.sentence)."""
    if not retriever.config.frozen.sentence:
      return None
    chosen, similarity = self._first_captions()
    encoder = load_text_encoder(retriever.config.frozen.sentence, level="sentence")
    vectors = encoder.sentence([self.captions[i][0] for i in chosen])
    return retrieval_by_rank(similarity, (vectors @ vectors.T > 2 * threshold - 1) | np.eye(len(chosen), dtype=bool))

  def _first_captions(self):
    """One clip of each first caption, and cosines of those captions (rows) to those clips."""
    first = {row[0]: i for i, row in reversed(list(enumerate(self.captions))) if row}
    chosen, place = sorted(first.values()), {words: i for i, words in enumerate(self.words)}
    text = self.word_vectors[[place[self.captions[i][0]] for i in chosen]]
    return chosen, text @ self.vectors[chosen].T


def read_clips(folder, split=None) -> list[Clip]:
  """The captioned clips of a data folder."""
  clips = dataset_of(folder).clips(folder, split)
  clips = [clip for clip in clips if clip.num_frames >= SHORTEST and clip.captions]
  if not clips:
    raise ValueError(f"{folder} has no clip with a caption" + (f" in split {split!r}" if split else ""))
  return clips


def read_collection(retriever, folder, split=None) -> Collection:
  """The clips of a folder with their vectors, by an index in the user's cache once it has been made.

  The index belongs to what lies in the folder, to the teacher's weights and to this code: another one, or one that is
  damaged, is replaced.
  """
  key = cache.key_of("index", dataset_of(folder).fingerprint(folder), split, retriever.fingerprint)
  kept = cache.read("indices", key, cache.user_folder())
  if kept is not None:
    return _from_bytes(kept)
  clips = read_clips(folder, split)
  features = [retriever.features_of(clip) for clip in tqdm(clips, desc="features", unit="clip", leave=False,
                                                           disable=None)]
  captions = [[caption.text for caption in clip.captions] for clip in clips]
  words = sorted({caption for row in captions for caption in row})
  collection = Collection([clip.id for clip in clips], captions, np.array([clip.seconds for clip in clips]),
                          retriever.embed_motion(features, progress=True), words, retriever.embed_text(words))
  cache.write("indices", key, _to_bytes(collection), cache.user_folder())
  return collection


def _to_bytes(collection):
  arrays = {name: getattr(collection, name) for name in ("seconds", "vectors", "word_vectors")}
  words = json.dumps({name: getattr(collection, name) for name in ("ids", "captions", "words")})
  stream = io.BytesIO()
  np.savez(stream, **arrays, text=np.frombuffer(words.encode(), np.uint8))
  return stream.getvalue()


def _from_bytes(payload):
  with np.load(io.BytesIO(payload), allow_pickle=False) as arrays:
    arrays = dict(arrays)
  return Collection(**json.loads(arrays.pop("text").tobytes()), **arrays)


def _filled(arrays):
  """Arrays with rows added up to BATCH."""
  return [np.concatenate([a, np.repeat(a[-1:], BATCH - len(a), axis=0)]) for a in arrays]
