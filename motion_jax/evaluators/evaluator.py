"""Evaluators: frozen networks that embed motions and captions in one space, loaded by name or folder.

  "t2m"        classic networks on tokens with their parts of speech: R-precision, matching, FID, diversity
  "clip"       transformers on word pieces: the CLIP score
  "tmr"        a motion-language teacher (`retrieval`): the timeline benchmark
  "snapmogen"  SnapMoGen's Gaussians on its 148 numbers: R-precision by cosine, FID of separate vectors

Folders: runs of the configs evaluator_matching, evaluator_clip, evaluator_snapmogen and part_tmr, and released weights
converted by `motion-jax convert evaluator`. Source: docs/papers/cmdm.md#evaluators, #snapmogen,
docs/papers/cdamd.md#matching-evaluator, #clip-evaluator.
"""
import dataclasses
import functools
import hashlib
import pathlib
from collections.abc import Callable

import jax
import jax.numpy as jnp
import ml_collections
import numpy as np

from motion_jax import runs
from motion_jax.data.clip import Clip
from motion_jax.evaluators import stages as matching
from motion_jax.evaluators.networks import ClipEvaluator, T2MEvaluator
from motion_jax.evaluators.snapmogen_network import SnapEvaluator
from motion_jax.evaluators.words import CONVERTED, GLOVE_FILES, WordFeatures, load_words
from motion_jax.models.tmr.space import make_space
from motion_jax.motion.representations import Representation, get_layout, to_features
from motion_jax.motion.stats import Stats
from motion_jax.nets.masks import padding_mask
from motion_jax.text.bert import bert_fields_of
from motion_jax.text.encoder import load_text_encoder
from motion_jax.text.tagger import tag
from motion_jax.training import checkpoint
from motion_jax.utils.config_files import module_fields

KINDS = {"evaluator.matching": "t2m", "evaluator.t2m": "t2m", "evaluator.clip": "clip", "tmr.teacher": "tmr",
         "evaluator.snapmogen": "snapmogen"}
BATCH = 32  # rows embedded together; the last batch is filled up, so one compiled function serves all
MAX_FRAMES = 196  # what released evaluators were trained on


@dataclasses.dataclass(frozen=True, eq=False)
class Evaluator:
  """Embeds motions and captions as vectors of one space. Created by `load_evaluator`.

  kind: see above; embeddings of two evaluators are not comparable. hash: sha256 of parameters and statistics. dim: size
  of an embedding; frames_per_token: of its motion encoder; max_frames: the length that motions are padded to.
  """
  name: str
  folder: pathlib.Path | None
  kind: str
  stats: Stats
  dim: int
  hash: str
  max_frames: int
  mode: str  # how joints become features, "benchmark" or "corrected"
  motion: Callable  # (x (B, T, F), num_frames (B,)) -> (B, E)
  text: Callable    # (captions, tokens) -> (N, E)
  frames_per_token: int = 4
  motion_for_fid: Callable | None = None  # as motion, where FID uses vectors of its own
  words: Callable = lambda: None  # () -> fingerprint of the text encoder or vocabulary

  @property
  def layout(self) -> Representation:
    return self.stats.layout

  def features_of(self, motion):
    """The evaluator's features (T, F), not normalized, of a Clip or of joints (T, J, 3).

    Joints are converted as in its training: on the skeleton's bones, from the origin, facing +z. In most layouts
    features have one row less than joints.
    """
    if isinstance(motion, Clip):
      if motion.features is not None and motion.features.shape[-1] == self.layout.dim:
        return np.asarray(motion.features)
      motion = motion.joints
    return to_features(motion, self.layout, self.mode)

  def embed_motion(self, x, num_frames):
    """Motions x (B, T, F), normalized by `stats` and padded with zeros, num_frames (B,) -> (B, E) float32.

    Rows are padded further to max_frames, so that a row does not depend on the batch. Parity: the references pad
    generated motions to the longest of their batch only; the last token of the longest sees the edge where others see
    zeros. Raises ValueError for features of another representation, or a motion under `frames_per_token` frames.
    """
    return self._embed(self.motion, x, num_frames)

  def embed_for_fid(self, x, num_frames):
    """The vectors of FID and diversity: those of `embed_motion`, or SnapMoGen's activations before the last layer."""
    return self._embed(self.motion_for_fid or self.motion, x, num_frames)

  def _embed(self, apply, x, num_frames):
    x, num_frames = np.asarray(x, np.float32), np.asarray(num_frames)
    if x.ndim != 3 or num_frames.shape != x.shape[:1] or not len(x):
      raise ValueError(f"got motions of shape {x.shape} and frame counts of shape {num_frames.shape}, expected "
                       "(B, T, F) and (B,)")
    if x.shape[-1] != self.layout.dim:
      raise ValueError(f"got {x.shape[-1]} features per frame, evaluator {self.name!r} reads {self.layout.dim} "
                       f"({self.layout.name}); its features_of makes them from joints, or choose the evaluator of the "
                       "motion's representation")
    if num_frames.min() < self.frames_per_token or num_frames.max() > x.shape[1]:
      raise ValueError(f"got motions of {num_frames.min()} to {num_frames.max()} frames in {x.shape[1]} rows, expected "
                       f"{self.frames_per_token} to {x.shape[1]}; leave shorter ones out")
    x = np.pad(x, ((0, 0), (0, max(self.max_frames - x.shape[1], 0)), (0, 0)))
    return in_batches(apply, x, num_frames.astype(np.int32))

  def embed_text(self, captions, tokens=None):
    """Captions to (N, E) float32. tokens: their "lemma/POS" lines, as in HumanML3D's text files (kind "t2m"; by default
    they are computed by `text.tagger`).
    """
    captions = list(captions)
    if not captions or not all(isinstance(caption, str) for caption in captions):
      raise ValueError(f"got captions {captions[:2]!r}, expected a list of sentences")
    if tokens is not None and len(tokens) != len(captions):
      raise ValueError(f"got {len(captions)} captions and {len(tokens)} token lines, expected one for each")
    return self.text(captions, tokens)


def in_batches(apply, *arrays):
  """apply over rows, BATCH at a time -> (N, E) float32."""
  count = len(arrays[0])
  filled = [np.concatenate([a, np.repeat(a[-1:], -count % BATCH, axis=0)]) for a in arrays]
  parts = [np.asarray(apply(*(a[i:i + BATCH] for a in filled)), np.float32) for i in range(0, count, BATCH)]
  return np.concatenate(parts)[:count]


def load_evaluator(name="evaluator-small", text=None) -> Evaluator:
  """The shipped evaluator of that name, or that of a folder: a run, or converted weights.

  text: text input of a converted one: the benchmark's glove folder or a vocabulary made from it (kind "t2m"), a CLIP
  folder (kind "clip"); for a run, another folder of its text encoder. Raises FileNotFoundError or ValueError for a
  folder that is no evaluator, lacks statistics or has those of another representation.
  """
  run = runs.load_run(name, tuple(KINDS))
  reader = functools.cache(lambda: _reader(run, text))
  with checkpoint.building(run.folder):
    params = jax.device_put(run.params())
    return _assemble(run.folder.name, run.folder, run.config, run.stats, params, reader)


def shipped_names():
  """Names of the shipped evaluators."""
  return runs.shipped_names(tuple(KINDS))


def fresh_evaluator(kind="t2m", layout="coordinates", seed=0) -> Evaluator:
  """A tiny evaluator with random weights, for trials and tests: a seed gives the same on every machine."""
  layout, encoder = get_layout(layout), load_text_encoder("random-init")
  config = dict(data=dict(layout=layout.name, max_frames=MAX_FRAMES, max_words=64, mode="corrected"))
  columns = dict(features=layout.dim, columns=layout.dim)
  if kind == "t2m":
    config |= dict(stage="evaluator.matching", model=columns | dict(
        movement_width=12, movement_dim=12, motion_width=16, text_width=12, dim=16))
  elif kind == "clip":
    config |= dict(stage="evaluator.clip", model=columns | dict(
        width=encoder.dim, depth=1, num_heads=2, mlp_width=16, dim=16, max_words=64,
        vocab_size=len(matching.piece_tables(encoder)[0])))
  elif kind == "tmr":
    config |= dict(stage="tmr.teacher", text=bert_fields_of(encoder.model), loss=dict(text_pool="mean"), model=dict(
        kind="whole_body", width=16, depth=1, num_heads=2, mlp_width=16, dim=16, pool="real"))
  elif kind == "snapmogen":
    config |= dict(stage="evaluator.snapmogen", model=columns | dict(width=16, depth=1, num_heads=2, mlp_width=16))
  else:
    raise ValueError(f"got evaluator kind {kind!r}, expected t2m, clip, tmr or snapmogen")
  config = ml_collections.FrozenConfigDict(config)
  init = _NETWORKS[kind](config, encoder.dim)[0]
  stats = Stats(np.zeros(layout.dim, np.float32), np.ones(layout.dim, np.float32), layout)
  reader = lambda: WordFeatures(encoder) if kind == "t2m" else encoder
  return _assemble(f"fresh-{kind}", None, config, stats, _random_params(init, seed), reader)


def _random_params(init, seed):
  """Random parameters that preserve the scale of signals; drawn by numpy, which needs no compilation."""
  rng = np.random.default_rng(seed)

  def draw(path, leaf):
    if path[-1].key == "scale":
      return jnp.ones(leaf.shape)
    size = np.prod(leaf.shape[:-1]) ** -0.5 if path[-1].key in ("kernel", "w_in", "w_hidden") else 0.2
    return jnp.asarray(rng.normal(0, size, leaf.shape), jnp.float32)

  return jax.tree_util.tree_map_with_path(draw, jax.eval_shape(init, jax.random.key(0)))


def _assemble(name, folder, config, stats, params, reader):
  """reader() returns the text encoder or vocabulary of the network; it is called at the first caption."""
  kind = KINDS[config.stage]
  if "features" in config.model and config.model.features > config.model.get("columns", stats.layout.dim):
    matching.check_columns(config.model, stats.layout, name)
  columns = config.model.get("columns", stats.layout.dim)
  if columns != stats.layout.dim:
    raise ValueError(f"{name}: the network reads {columns} numbers per frame, its statistics are of layout "
                     f"{stats.layout.name!r} with {stats.layout.dim}; restore the evaluator's own Mean.npy and Std.npy")
  init, motion, text, *for_fid = _NETWORKS[kind](config, _word_dim(kind, params))
  checkpoint.check_fits(params, jax.eval_shape(init, jax.random.key(0)), f"{name}: the weights do not fit the config")
  motion = functools.partial(jax.jit(motion), params)
  dim = jax.eval_shape(motion, jnp.zeros((1, 8, columns)), jnp.full(1, 8)).shape[-1]
  return Evaluator(name, folder, kind, stats, dim, _hash(params, stats), int(config.data.max_frames),
                   config.data.mode, motion,
                   lambda captions, tokens: text(params, reader(), captions, tokens),
                   motion_for_fid=functools.partial(jax.jit(for_fid[0]), params) if for_fid else None,
                   words=lambda: reader().fingerprint)


def _word_dim(kind, params):
  """Dimension of the word vectors that the weights were trained on, where a text encoder or vocabulary gives them."""
  encoder = params["params"].get("text_encoder", {}) if "params" in params else {}
  name = {"t2m": "classes", "snapmogen": "embed"}.get(kind)
  if name is None:
    return 0
  if "kernel" not in encoder.get(name, {}):
    raise ValueError(f"the weights do not fit an evaluator of kind {kind!r}: text_encoder/{name} is missing")
  return encoder[name]["kernel"].shape[-1 if kind == "t2m" else 0]


def _hash(params, stats):
  flat = sorted((jax.tree_util.keystr(path), leaf) for path, leaf in jax.tree_util.tree_leaves_with_path(params))
  digest = hashlib.sha256(stats.layout.name.encode() + stats.mean.tobytes() + stats.std.tobytes())
  for name, leaf in flat:
    digest.update(name.encode() + np.asarray(leaf, np.float32).tobytes())
  return digest.hexdigest()


# --- networks: (init(rng) -> params, motion(params, x, num_frames), text(params, reader, captions, tokens)), and
# motion_for_fid(params, x, num_frames) where FID is taken of another vector ---------------------------------------


def _t2m(config, word_dim):
  net = T2MEvaluator(**module_fields(config.model))
  embed = jax.jit(lambda params, *words: net.apply(params, *words, method="text"))

  def text(params, reader, captions, tokens):
    if reader.dim != word_dim:
      raise ValueError(f"the words given have vectors of {reader.dim} numbers, the evaluator was trained on {word_dim}")
    given = reader([tag(caption) for caption in captions] if tokens is None else tokens)
    return in_batches(functools.partial(embed, params), *given)

  return (functools.partial(matching.init_t2m, net, word_dim),
          lambda params, x, frames: net.apply(params, x, frames, method="motion"), text)


def _clip(config, _):
  net = ClipEvaluator(**module_fields(config.model))
  embed = jax.jit(lambda params, ids: net.apply(params, ids, method="text"))

  def text(params, reader, captions, tokens):
    return in_batches(functools.partial(embed, params), matching.piece_ids(reader, captions, net.max_words))

  return (functools.partial(matching.init_clip, net),
          lambda params, x, frames: net.apply(params, x, frames, method="motion"), text)


def _tmr(config, _):
  space = make_space(config)
  embed = jax.jit(space.text)

  def motion(params, x, frames):
    return space.motion(params, x, padding_mask(frames, x.shape[1]))

  def text(params, reader, captions, tokens):
    parts = [captions[i:i + BATCH] for i in range(0, len(captions), BATCH)]  # word features of all would not fit
    return np.concatenate([in_batches(functools.partial(embed, params), *space.read(reader, part).values())
                           for part in parts])

  return space.init, motion, text


def _snapmogen(config, word_dim):
  fields = module_fields(config.model)
  net = SnapEvaluator(**fields)
  apply = lambda method: lambda params, *given: net.apply({"params": params["params"]}, *given, method=method)
  embed = jax.jit(apply("text"))

  def text(params, reader, captions, tokens):
    if reader.dim != word_dim:
      raise ValueError(f"the text encoder gives {reader.dim} numbers a word, the evaluator was trained on {word_dim}")
    given = matching.hidden_states(reader, captions, config.data.max_words)
    return in_batches(functools.partial(embed, params), *given)

  return functools.partial(matching.init_gaussian, fields, word_dim), apply("motion"), text, apply("motion_for_fid")


_NETWORKS = {"t2m": _t2m, "clip": _clip, "tmr": _tmr, "snapmogen": _snapmogen}


# --- words --------------------------------------------------------------------------------------------------------


def _reader(run, text):
  """The text input of the network: a vocabulary, or a text encoder."""
  kind, folder, named = KINDS[run.stage], run.folder, run.text
  given = pathlib.Path(text) if text else None
  if kind == "t2m":
    for place in (given, folder):  # a vocabulary that lies in the folder is the evaluator's own
      if place and (place.is_file() or any((place / file).is_file() for file in (*GLOVE_FILES, CONVERTED))):
        return load_words(place)
    if not (text or named):
      raise FileNotFoundError(f"{folder} does not say what its words are; convert it again with --glove FOLDER, the "
                              "benchmark's word vectors, or give that folder as load_evaluator(..., text=)")
  encoder = load_text_encoder(text or named or "clip-vit-base-patch16")
  run.check_encoder(encoder)
  return WordFeatures(encoder) if kind == "t2m" else encoder
