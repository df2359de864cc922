"""How the benchmarks turn motions into a row of numbers.

Source: docs/papers/cmdm.md#protocol, #reconstruction, docs/papers/cdamd.md#items, #metrics.

Evaluators have done their work here already, so the loops can be used and tested without a network. A replication is a
list of `Batch`, made one at a time while motions are generated; `generation_scores` and `reconstruction_scores` read it
at the end. Random draws come from a numpy generator, so a replication is known by its key.
"""
import dataclasses
import typing
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.metrics import scores
from motion_jax.motion.representations import Representation, layout_for, to_joints
from motion_jax.shapes import Array, Num


@dataclasses.dataclass(frozen=True)
class Protocol:
  """The choices of a benchmark's evaluation; the defaults are those of CMDM's released scripts."""
  pool: int = 32                # candidates of R-precision: a batch
  top_k: int = 3
  lost_frames: int = 1          # Parity: the evaluator gets length m - 1 (a predecessor lost a frame); 0: m
  diversity_draws: int = 300
  few_draws: int = 100          # where there are no more samples than diversity_draws
  multimodality_batches: int = 3
  multimodality_motions: int = 30
  multimodality_pairs: int = 10
  replications: int = 10
  cosine: bool = False          # R-precision ranks by angle, not by Euclidean distance (SnapMoGen)


@typing.runtime_checkable
class Normalization(typing.Protocol):
  """Mean and std (F,) of features, as `motion.stats.Stats` has them."""

  @property
  def mean(self) -> np.ndarray: ...

  @property
  def std(self) -> np.ndarray: ...


class Batch(NamedTuple):
  """What the evaluators make of one batch of matched texts, real motions and made ones: (B, E) each, rows alike.

  clip_text and clip_made, of the CLIP-type evaluator, may be None; errors is a list of (T_i,) joint errors, or None.
  real_for_fid, made_for_fid (B, S): what FID and diversity are taken of, where that is not `real` and `made`.
  """
  text: np.ndarray
  real: np.ndarray
  made: np.ndarray
  clip_text: np.ndarray | None = None
  clip_made: np.ndarray | None = None
  errors: list[np.ndarray] | None = None
  real_for_fid: np.ndarray | None = None
  made_for_fid: np.ndarray | None = None


class DiversityPairs(NamedTuple):
  """Rows for diversity, two draws for real motions and two for made ones."""
  real: tuple[np.ndarray, np.ndarray]
  made: tuple[np.ndarray, np.ndarray]


def evaluator_frames(num_frames: Sequence[int] | np.ndarray, protocol: Protocol) -> np.ndarray:
  """The lengths (B,) that the evaluator gets for motions of num_frames."""
  return np.asarray(num_frames) - protocol.lost_frames


def draw_diversity_pairs(rng: np.random.Generator, count: int, protocol: Protocol) -> DiversityPairs:
  """The rows that diversity compares among count real and as many made motions."""
  size = protocol.diversity_draws if count > protocol.diversity_draws else protocol.few_draws
  return DiversityPairs(scores.draw_pairs(rng, count, size), scores.draw_pairs(rng, count, size))


def generation_scores(batches: Iterable[Batch], protocol: Protocol, pairs: DiversityPairs) -> dict[str, float]:
  """The text-to-motion row of one replication, with the real motions' numbers under "real_".

  R-precision is counted inside each batch (each must have protocol.pool rows), the rest over all rows together.
  """
  batches = list(batches)
  wrong = [len(batch.text) for batch in batches if len(batch.text) != protocol.pool]
  if not batches or wrong:
    raise ValueError(f"got {len(batches)} batches{f', one of {wrong[0]} rows' if wrong else ''}, the protocol needs "
                     f"batches of {protocol.pool}; drop the last partial one, or take more samples")
  join = lambda name: np.concatenate([getattr(batch, name) for batch in batches])
  text, real, made = join("text"), join("real"), join("made")
  apart = batches[0].made_for_fid is not None
  real_for_fid, made_for_fid = map(join, ("real_for_fid", "made_for_fid") if apart else ("real", "made"))
  row = {"fid": scores.fid(real_for_fid, made_for_fid),
         "fid_unit": scores.fid(scores.units(real_for_fid), scores.units(made_for_fid)),
         "kid": scores.kernel_distance(real_for_fid, made_for_fid),
         "diversity": scores.diversity(made_for_fid, *pairs.made),
         "real_diversity": scores.diversity(real_for_fid, *pairs.real)}
  for prefix, motion in (("", made), ("real_", real)):
    found = scores.r_precision(text, motion, protocol.top_k, protocol.pool, _ranking_distances(protocol))
    row |= {f"{prefix}top{k + 1}": float(share) for k, share in enumerate(found)}
    row[f"{prefix}matching"] = scores.matching_score(text, motion)
  if batches[0].clip_text is not None:
    row["clip_score"] = scores.clip_score(join("clip_text"), join("clip_made"))
  return row


def _ranking_distances(protocol):
  """The distances (N, M) by which R-precision ranks."""
  return scores.cosine_distances if protocol.cosine else scores.distances


def scores_by_motion(batches: Iterable[Batch], protocol: Protocol) -> dict[str, np.ndarray]:
  """What R-precision, matching and CLIP score are means of, {metric: (N,)}, in the order of the batches' rows."""
  found: dict[str, list] = {}
  away = _ranking_distances(protocol)
  for batch in batches:
    hit = scores.hit_chances(away(batch.text, batch.made), protocol.top_k)
    one = {f"top{k + 1}": hit[:, k] for k in range(protocol.top_k)}
    one["matching"] = np.linalg.norm(np.asarray(batch.text, np.float64) - batch.made, axis=1)
    if batch.clip_text is not None and batch.clip_made is not None:
      one["clip_score"] = (scores.units(batch.clip_text) * scores.units(batch.clip_made)).sum(1)
    for metric, values in one.items():
      found.setdefault(metric, []).append(values)
  return {metric: np.concatenate(parts) for metric, parts in found.items()}


def reconstruction_scores(batches: Iterable[Batch], protocol: Protocol, pairs: DiversityPairs) -> dict[str, float]:
  """The same for an autoencoder, with joint errors: true ones, and the released code's number ("released_mpjpe").

  Raises ValueError for a batch without joint errors.
  """
  batches = list(batches)
  row = generation_scores(batches, protocol, pairs)
  if any(batch.errors is None for batch in batches):
    raise ValueError("a batch has no joint errors; make them with reconstruction_errors")
  errors = [error for batch in batches for error in batch.errors or ()]
  return row | {"mpjpe": scores.mpjpe(errors), "released_mpjpe": scores.released_mpjpe(errors, protocol.pool)}


def reconstruction_errors(real: Num[Array, "b t f"], made: Num[Array, "b _ f"],
                          num_frames: Sequence[int | np.integer] | np.ndarray,
                          alone: bool = True, layout: Representation | None = None) -> list[np.ndarray]:
  """Joint errors (T_i,) of each clip, roots at one place; real and made (B, T, F) are de-normalized, one of them may
  be padded further.

  alone: every frame is rebuilt by itself, facing ahead, so that heading errors do not count. Parity: that is what the
  released evaluation does, for it hands features over as (frames, 1, F). False rebuilds the whole motion.
  """
  layout = layout or layout_for(np.shape(real)[-1])
  rebuild = lambda x: to_joints(x[:, None], layout)[:, 0] if alone else to_joints(x, layout)
  clips = zip(np.asarray(real, np.float64), np.asarray(made, np.float64), num_frames)
  return [scores.joint_errors(rebuild(a[:m]), rebuild(b[:m])) for a, b, m in clips]


def draw_multimodality_pairs(rng: np.random.Generator, protocol: Protocol) -> tuple[np.ndarray, np.ndarray]:
  """The pairs of generations that multimodality compares, the same for all texts."""
  return scores.draw_pairs(rng, protocol.multimodality_motions, protocol.multimodality_pairs)
