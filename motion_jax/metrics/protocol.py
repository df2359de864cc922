"""The benchmarks' evaluation protocol: from embedded motions and texts to a row of scores.

Source: docs/papers/cmdm.md#protocol, #reconstruction, docs/papers/cdamd.md#items, #metrics.

Inputs are embeddings: no network is needed here. A replication is a list of `Batch`, collected while motions are
generated; `generation_scores` and `reconstruction_scores` compute its row. Random draws come from a numpy generator: a
replication is reproducible by its key.
"""
import dataclasses
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.metrics import scores
from motion_jax.motion.representations import Representation, layout_for, to_joints
from motion_jax.shapes import Array, Num
from motion_jax.utils.deprecation import renamed_parameters


@dataclasses.dataclass(frozen=True)
class Protocol:
  """Settings of a benchmark's evaluation; the defaults are those of CMDM's released scripts."""
  pool: int = 32                # candidates of R-precision: a batch
  top_k: int = 3
  lost_frames: int = 1          # Parity: the evaluator gets length m - 1 (a predecessor lost a frame); 0: m
  diversity_draws: int = 300
  few_draws: int = 100          # if there are no more samples than diversity_draws
  multimodality_batches: int = 3
  multimodality_motions: int = 30
  multimodality_pairs: int = 10
  replications: int = 10
  cosine: bool = False          # R-precision ranks by angle, not by Euclidean distance (SnapMoGen)



class Batch(NamedTuple):
  """Embeddings of one batch of matched texts, real motions and generated ones (`generated`): (B, E) each.

  clip_text and clip_generated, of the CLIP-type evaluator, may be None; errors: a list of (T_i,) joint errors, or None.
  real_for_fid, generated_for_fid (B, S): other embeddings for FID and diversity, if not `real` and `generated`.
  """
  text: np.ndarray
  real: np.ndarray
  generated: np.ndarray
  clip_text: np.ndarray | None = None
  clip_generated: np.ndarray | None = None
  errors: list[np.ndarray] | None = None
  real_for_fid: np.ndarray | None = None
  generated_for_fid: np.ndarray | None = None


class DiversityPairs(NamedTuple):
  """Row indices for diversity: two draws for real motions and two for generated ones."""
  real: tuple[np.ndarray, np.ndarray]
  generated: tuple[np.ndarray, np.ndarray]


def evaluator_frames(num_frames: Sequence[int] | np.ndarray, protocol: Protocol) -> np.ndarray:
  """Lengths (B,) that are passed to the evaluator for motions of num_frames."""
  return np.asarray(num_frames) - protocol.lost_frames


def draw_diversity_pairs(rng: np.random.Generator, count: int, protocol: Protocol) -> DiversityPairs:
  """Draws the rows that diversity compares among count real and as many generated motions."""
  size = protocol.diversity_draws if count > protocol.diversity_draws else protocol.few_draws
  return DiversityPairs(scores.draw_pairs(rng, count, size), scores.draw_pairs(rng, count, size))


def generation_scores(batches: Iterable[Batch], protocol: Protocol, pairs: DiversityPairs) -> dict[str, float]:
  """The text-to-motion scores of one replication, with those of the real motions under "real_".

  R-precision is counted within each batch (each must have protocol.pool rows), the rest over all rows together.
  """
  batches = list(batches)
  wrong = [len(batch.text) for batch in batches if len(batch.text) != protocol.pool]
  if not batches or wrong:
    raise ValueError(f"got {len(batches)} batches{f', one of {wrong[0]} rows' if wrong else ''}, the protocol needs "
                     f"batches of {protocol.pool}; drop the last partial one, or take more samples")
  join = lambda name: np.concatenate([getattr(batch, name) for batch in batches])
  text, real, generated = join("text"), join("real"), join("generated")
  apart = batches[0].generated_for_fid is not None
  real_for_fid, generated_for_fid = map(join, ("real_for_fid", "generated_for_fid") if apart else ("real", "generated"))
  row = {"fid": scores.fid(real_for_fid, generated_for_fid),
         "fid_unit": scores.fid(scores.units(real_for_fid), scores.units(generated_for_fid)),
         "kid": scores.kernel_distance(real_for_fid, generated_for_fid),
         "diversity": scores.diversity(generated_for_fid, *pairs.generated),
         "real_diversity": scores.diversity(real_for_fid, *pairs.real)}
  for prefix, motion in (("", generated), ("real_", real)):
    precision = scores.r_precision(text, motion, protocol.top_k, protocol.pool, _ranking_distances(protocol))
    row |= {f"{prefix}top{k + 1}": float(share) for k, share in enumerate(precision)}
    row[f"{prefix}matching"] = scores.matching_score(text, motion)
  if batches[0].clip_text is not None:
    row["clip_score"] = scores.clip_score(join("clip_text"), join("clip_generated"))
  return row


def _ranking_distances(protocol):
  """The distances (N, M) by which R-precision ranks."""
  return scores.cosine_distances if protocol.cosine else scores.distances


def scores_by_motion(batches: Iterable[Batch], protocol: Protocol) -> dict[str, np.ndarray]:
  """Terms of R-precision, matching and CLIP score per motion, {metric: (N,)}, in the order of the batches' rows."""
  terms: dict[str, list] = {}
  away = _ranking_distances(protocol)
  for batch in batches:
    hit = scores.hit_chances(away(batch.text, batch.generated), protocol.top_k)
    row = {f"top{k + 1}": hit[:, k] for k in range(protocol.top_k)}
    row["matching"] = np.linalg.norm(np.asarray(batch.text, np.float64) - batch.generated, axis=1)
    if batch.clip_text is not None and batch.clip_generated is not None:
      row["clip_score"] = (scores.units(batch.clip_text) * scores.units(batch.clip_generated)).sum(1)
    for metric, values in row.items():
      terms.setdefault(metric, []).append(values)
  return {metric: np.concatenate(parts) for metric, parts in terms.items()}


def reconstruction_scores(batches: Iterable[Batch], protocol: Protocol, pairs: DiversityPairs) -> dict[str, float]:
  """`generation_scores` of an autoencoder, with MPJPE and the released code's number for it ("released_mpjpe").

  Raises ValueError for a batch without joint errors.
  """
  batches = list(batches)
  row = generation_scores(batches, protocol, pairs)
  if any(batch.errors is None for batch in batches):
    raise ValueError("a batch has no joint errors; make them with reconstruction_errors")
  errors = [error for batch in batches for error in batch.errors or ()]
  return row | {"mpjpe": scores.mpjpe(errors), "released_mpjpe": scores.released_mpjpe(errors, protocol.pool)}


@renamed_parameters(removed_in="0.3", made="generated")
def reconstruction_errors(real: Num[Array, "b t f"], generated: Num[Array, "b _ f"],
                          num_frames: Sequence[int | np.integer] | np.ndarray,
                          alone: bool = True, layout: Representation | None = None) -> list[np.ndarray]:
  """Root-aligned joint errors (T_i,) of each clip; real and generated (B, T, F) are de-normalized, one of them may be
  padded further.

  alone: decode every frame by itself, facing ahead: heading errors do not count. Parity: the released evaluation does
  this, as it passes features as (frames, 1, F). False decodes the whole motion.
  """
  layout = layout or layout_for(np.shape(real)[-1])
  rebuild = lambda x: to_joints(x[:, None], layout)[:, 0] if alone else to_joints(x, layout)
  clips = zip(np.asarray(real, np.float64), np.asarray(generated, np.float64), num_frames)
  return [scores.joint_errors(rebuild(a[:m]), rebuild(b[:m])) for a, b, m in clips]


def draw_multimodality_pairs(rng: np.random.Generator, protocol: Protocol) -> tuple[np.ndarray, np.ndarray]:
  """Draws the pairs of generations that multimodality compares, the same for all texts."""
  return scores.draw_pairs(rng, protocol.multimodality_motions, protocol.multimodality_pairs)
