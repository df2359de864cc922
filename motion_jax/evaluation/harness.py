"""Evaluators applied to a test set: embeddings of texts, real and generated motions, and the scores of a replication.
"""
import dataclasses
from typing import NamedTuple

import numpy as np

from motion_jax.evaluation import samples
from motion_jax.evaluation.differences import ByMotion
from motion_jax.metrics import physics, scores, two_sample
from motion_jax.metrics import protocol as protocol_lib
from motion_jax.motion.representations import to_joints
from motion_jax.text.tagger import tag

# Streams of random numbers inside a (seed, replication).
AGAIN, DIVERSITY, MULTIMODALITY, NOISE = 1, 2, 3, 4
SHUFFLE, HALVES = 6, 7
CHUNK = 256  # motions that are padded together
WIDER = 16   # rows by which they grow where they have to, so that few sizes are compiled


@dataclasses.dataclass(frozen=True, eq=False)
class Embedded:
  """The draw of a replication and its embeddings (N, E); `again`: real motions of the same items, cut differently.

  real_for_fid, again_for_fid: the vectors of FID, where the evaluator has separate ones.
  """
  drawn: samples.Draw
  text: np.ndarray
  real: np.ndarray
  again: np.ndarray
  clip_text: np.ndarray | None
  clip_real: np.ndarray | None
  real_for_fid: np.ndarray | None
  again_for_fid: np.ndarray | None
  physics: dict[str, float]
  diversity_pairs: protocol_lib.DiversityPairs


class Judged(NamedTuple):
  """A row {metric: number}, and the values of each motion that it is the mean of."""
  row: dict[str, float]
  by_motion: ByMotion


class Harness:
  """Evaluators and the test set of a protocol. `drawn` is the draw of a replication, `embedded` its real side, `scores`
  a row of generated motions. It is never changed from outside.
  """

  def __init__(self, protocol, evaluator, clip_evaluator, test_set, seed, limit=None):
    # The evaluator is of CLIP's type itself (docs/papers/cmdm.md#snapmogen).
    if protocol.cosine and clip_evaluator is None:
      clip_evaluator = evaluator
    self.evaluator, self.clip_evaluator, self.test_set = evaluator, clip_evaluator, test_set
    self.seed, self.limit = int(seed), limit
    count = len(samples.draw_replication(test_set, protocol, seed, 0, limit))
    if count < protocol.few_draws:  # a trial: no other protocol has so few samples
      protocol = dataclasses.replace(protocol, few_draws=count)
    self.protocol, self.count = protocol, count
    self._texts, self._embedded, self._windows = {}, {}, {}

  def rng(self, replication, stream):
    return np.random.default_rng((self.seed, replication, stream))

  def drawn(self, replication) -> samples.Draw:
    """The items that a replication draws, in order."""
    return samples.draw_replication(self.test_set, self.protocol, self.seed, replication, self.limit)

  def embedded(self, replication) -> Embedded:
    """The real side of a replication."""
    if replication not in self._embedded:
      self._embedded[replication] = self._embed_replication(replication)
    return self._embedded[replication]

  def _embed_replication(self, replication):
    drawn = self.drawn(replication)
    again = samples.draw_replication(self.test_set, self.protocol, self.seed, replication, stream=AGAIN,
                                     order=drawn.item)
    real, repeated = (some.cut(self.test_set.of(self.evaluator)) for some in (drawn, again))
    clip_text = clip_real = None
    if self.clip_evaluator is not None:
      clip_text = self.embed_text(self.clip_evaluator, drawn)
      clip_real = self.embed(self.clip_evaluator, drawn.cut(self.test_set.of(self.clip_evaluator)), drawn.frames)
    return Embedded(
        drawn, self.embed_text(self.evaluator, drawn), self.embed(self.evaluator, real, drawn.frames),
        self.embed(self.evaluator, repeated, again.frames), clip_text, clip_real,
        self.embed_apart_for_fid(real, drawn.frames), self.embed_apart_for_fid(repeated, again.frames),
        physics_of(real, drawn.frames, self.evaluator.layout),
        protocol_lib.draw_diversity_pairs(self.rng(replication, DIVERSITY), len(drawn), self.protocol))

  def embed_text(self, evaluator, drawn):
    """Embeddings (N, E) of the captions of a draw."""
    return self.embed_captions(evaluator, drawn.captions_of(self.test_set), drawn.tokens_of(self.test_set))

  def embed_captions(self, evaluator, captions, tokens):
    """Embeddings (N, E) of captions; equal captions are embedded once. tokens: as the data has them, None: by rule."""
    known, pairs = self._texts.setdefault(id(evaluator), {}), list(zip(captions, tokens))
    new = [pair for pair in dict.fromkeys(pairs) if pair not in known]
    if new:
      captions = [caption for caption, _ in new]
      tokens = [tokens or " ".join(tag(caption)) for caption, tokens in new] if evaluator.kind == "t2m" else None
      known |= dict(zip(new, evaluator.embed_text(captions, tokens)))
    return np.stack([known[pair] for pair in pairs])

  def embed(self, evaluator, motions, frames, embed=None):
    """Embeddings (N, E) of motions [(rows, F)] in the evaluator's features; the evaluator receives the lengths `frames`
    (N,).

    Rows after `frames` are kept where the protocol keeps them, up to its longest motion; the rest is zeros. embed: one
    of the evaluator's functions, embed_motion by default.
    """
    embed = embed or evaluator.embed_motion
    lengths = protocol_lib.evaluator_frames(frames, self.protocol)
    # Pieces of long motions end on the model's own grid, some frames after the longest clip.
    width = self.protocol.max_frames
    width += -(-max(int(np.max(frames)) - width, 0) // WIDER) * WIDER
    parts = []
    for first in range(0, len(motions), CHUNK):
      some = slice(first, first + CHUNK)
      x = np.zeros((len(motions[some]), width, evaluator.layout.dim), np.float32)
      for row, motion, count in zip(x, motions[some], frames[some]):
        evaluator.layout.check(motion)
        kept = motion[:width if self.protocol.made_padding == "decoded" else count]
        row[:len(kept)] = evaluator.stats.normalize(kept)
      parts.append(embed(x, lengths[some]))
    embeddings = np.concatenate(parts)
    if not np.isfinite(embeddings).all():
      raise FloatingPointError(f"evaluator {evaluator.name!r} made NaN or infinity; check its weights and statistics")
    return embeddings

  def embed_apart_for_fid(self, motions, frames):
    """The vectors of FID, diversity and multimodality, where the evaluator has separate ones for them; else None."""
    evaluator = self.evaluator
    return None if evaluator.motion_for_fid is None else self.embed(evaluator, motions, frames, evaluator.embed_for_fid)

  def embed_for_fid(self, motions, frames):
    """The vectors of FID, diversity and multimodality: separate ones, or those of `embed`."""
    return self.embed(self.evaluator, motions, frames, self.evaluator.embed_for_fid)

  def converted(self, evaluator, motions, layout, frames):
    """Converts motions [(rows, F)] of a layout to the evaluator's features [(rows, F')].

    Features depend on neighbouring frames (headings are smoothed over seconds), so they are computed from the first
    `frames` (N,) rows alone: rows that a decoder adds after them are noise.
    """
    convert = lambda motion: layout.convert(motion, evaluator.layout, evaluator.mode)
    if layout.narrows_to(evaluator.layout):  # each frame stands for itself
      return [convert(motion) for motion in motions]
    converted = [convert(motion[:count]) for motion, count in zip(motions, frames)]
    if self.protocol.made_padding != "decoded":
      return converted
    return [np.concatenate([kept, convert(motion)[count:]]) if len(motion) > count else kept
            for kept, motion, count in zip(converted, motions, frames)]

  def batches(self, embedded, generated, clip_generated=None, generated_for_fid=None, text=None, clip_text=None):
    """The rows in pools, as `metrics.protocol` takes them."""
    text = embedded.text if text is None else text
    clip_text = embedded.clip_text if clip_text is None else clip_text
    parts = protocol_lib.Batch(text, embedded.real, generated, None if clip_generated is None else clip_text,
                               clip_generated, None, embedded.real_for_fid, generated_for_fid)
    pool = self.protocol.pool
    return [protocol_lib.Batch(*(None if part is None else part[i:i + pool] for part in parts))
            for i in range(0, len(generated), pool)]

  def scores(self, replication, motions, layout) -> dict[str, float]:
    """The row of motions [(rows, F)] in a model's layout, one motion for each item of the draw, in order."""
    return self.judged(replication, motions, layout).row

  def judged(self, replication, motions, layout) -> Judged:
    """The same row, with the values of each motion."""
    embedded = self.embedded(replication)
    converted = self.converted(self.evaluator, motions, layout, embedded.drawn.frames)
    generated = self.embed(self.evaluator, converted, embedded.drawn.frames)
    generated_for_fid = self.embed_apart_for_fid(converted, embedded.drawn.frames)
    clip_generated = None
    if self.clip_evaluator is not None:
      clip_generated = self.embed(self.clip_evaluator, self.converted(
          self.clip_evaluator, motions, layout, embedded.drawn.frames), embedded.drawn.frames)
    batches = self.batches(embedded, generated, clip_generated, generated_for_fid)
    row = protocol_lib.generation_scores(batches, self.protocol, embedded.diversity_pairs)
    row = {name: value for name, value in row.items() if not name.startswith("real_")}
    bodies = physics_by_motion(motions, embedded.drawn.frames, layout)
    values = protocol_lib.scores_by_motion(batches, self.protocol) | bodies
    real = embedded.real if embedded.real_for_fid is None else embedded.real_for_fid
    for_fid = generated if generated_for_fid is None else generated_for_fid
    by_motion = ByMotion(embedded.drawn.item, values, real, for_fid)
    return Judged(row | {name: float(np.mean(per_motion)) for name, per_motion in bodies.items()}, by_motion)

  def real_scores(self, replication) -> dict[str, float]:
    """The row of the real motions; their FID is that of other cuts of the same items."""
    embedded = self.embedded(replication)
    row = protocol_lib.generation_scores(self.batches(
        embedded, embedded.again, embedded.clip_real, embedded.again_for_fid), self.protocol, embedded.diversity_pairs)
    of_real = {name.removeprefix("real_"): value for name, value in row.items() if name.startswith("real_")}
    between = {name: row[name] for name in row if name not in of_real and not name.startswith("real_")}
    return of_real | between | embedded.physics

  def shuffled_scores(self, replication) -> dict[str, float]:
    """The real motions with captions shuffled within their pool: the scores of an evaluator that knows nothing."""
    embedded, pool = self.embedded(replication), self.protocol.pool
    rng = self.rng(replication, SHUFFLE)
    order = np.concatenate([first + rng.permutation(pool) for first in range(0, self.count, pool)])
    turned = lambda x: None if x is None else x[order]
    row = protocol_lib.generation_scores(
        self.batches(embedded, embedded.real, embedded.clip_real, embedded.real_for_fid, turned(embedded.text),
                     turned(embedded.clip_text)),
        self.protocol, embedded.diversity_pairs)
    return {name: row[name] for name in row if name.startswith("top") or name in ("matching", "clip_score")}

  def share_of_nearer_shuffles(self, replication, draws=400) -> float:
    """Share of random orders of the captions that fit the real motions as well as the right order; 0.5 for an evaluator
    that knows nothing. Captions are shuffled across pools.
    """
    embedded, rng = self.embedded(replication), self.rng(replication, SHUFFLE)
    away = scores.distances(embedded.text, embedded.real)
    rows, right = np.arange(self.count), np.trace(away)
    return float(np.mean([away[rows, rng.permutation(self.count)].sum() <= right for _ in range(draws)]))

  def real_windows(self, replication) -> two_sample.Windows:
    """Windows of the real motions of a draw."""
    if replication not in self._windows:
      drawn, layout = self.drawn(replication), self.evaluator.layout
      self._windows[replication] = windows_of(drawn.cut(self.test_set.of(self.evaluator)), drawn.frames, layout)
    return self._windows[replication]

  def set_apart(self, replication, motions, layout) -> dict[str, two_sample.Verdict]:
    """How well small classifiers tell motions [(rows, F)] of the draw from the real ones (`metrics.two_sample`); {} for
    few or short motions, and for another skeleton."""
    if layout.skeleton != self.evaluator.layout.skeleton:
      return {}
    return two_sample.compare(self.real_windows(replication), windows_of(
        motions, self.drawn(replication).frames, layout))

  def halves(self, replication, draws=10) -> dict[str, float]:
    """FID and KID between two disjoint halves of the real motions, means of some draws: the distances of two samples of
    half the size that differ only by chance. A model that is given the real captions and lengths may score lower. Empty
    for fewer than 4 motions.
    """
    embedded, rng = self.embedded(replication), self.rng(replication, HALVES)
    real, half = embedded.real if embedded.real_for_fid is None else embedded.real_for_fid, self.count // 2
    if half < 2:
      return {}
    orders = [rng.permutation(self.count) for _ in range(draws)]
    parts = [(real[order[:half]], real[order[half:2 * half]]) for order in orders]
    return {name: float(np.mean([distance(*part) for part in parts]))
            for name, distance in (("fid", scores.fid), ("kid", scores.kernel_distance))}

  def multimodality(self, replication, generations, layout):
    """generations: for each caption a list of motions [(rows, F)], with the lengths of the first items of the draw."""
    frames = self.embedded(replication).drawn.frames
    flat = [motion for motions in generations for motion in motions]
    lengths = np.repeat(frames[:len(generations)], len(generations[0]))
    embeddings = self.embed_for_fid(self.converted(self.evaluator, flat, layout, lengths), lengths)
    pairs = protocol_lib.draw_multimodality_pairs(self.rng(replication, MULTIMODALITY), self.protocol)
    return scores.multimodality(embeddings.reshape(len(generations), -1, embeddings.shape[-1]), *pairs)


def windows_of(motions, frames, layout) -> two_sample.Windows:
  """Windows of motions [(rows, F)] by their first frames (N,)."""
  return two_sample.describe([to_joints(motion[:count], layout) for motion, count in zip(motions, frames)],
                             layout.skeleton)


def physics_by_motion(motions, frames, layout):
  """The metrics of `metrics.physics` for motions [(rows, F)]: {metric: (N,)}, lengths in metres."""
  summaries = [physics.summary(to_joints(motion[:count], layout), layout.skeleton.fps, layout.skeleton)
               for motion, count in zip(motions, frames)]
  each = lambda key: np.array([summary[key] for summary in summaries]) / (1000 if key.endswith("_mm") else 1)
  return {name: each(key) for name, key in physics.IN_ROWS.items()}


def physics_of(motions, frames, layout):
  """Means over motions of `physics_by_motion`."""
  return {name: float(np.mean(values)) for name, values in physics_by_motion(motions, frames, layout).items()}
