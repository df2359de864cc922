"""The benchmarks' scores as pure functions: numpy arrays in, numbers out, all sums in float64.

Embeddings are rows of (N, E) arrays; row i of texts matches row i of motions. Random draws are arguments: results are
reproducible. Definitions: docs/papers/cmdm.md#protocol, #reconstruction, docs/papers/cdamd.md#metrics.
"""
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from motion_jax.shapes import Array, Bool, Float, Int, Num
from motion_jax.utils.deprecation import renamed_parameters

RECALLS = (1, 2, 3, 5, 10)


def distances(a: Num[Array, "n e"], b: Num[Array, "m e"]) -> Float[np.ndarray, "n m"]:
  """Euclidean distances (N, M) between the rows of a (N, E) and of b (M, E)."""
  a, b = _rows(a), _rows(b)
  squares = (a * a).sum(1)[:, None] + (b * b).sum(1)[None] - 2 * a @ b.T
  return np.sqrt(np.maximum(squares, 0))


def cosines(a: Num[Array, "n e"], b: Num[Array, "m e"]) -> Float[np.ndarray, "n m"]:
  """Cosines (N, M) between the rows of a (N, E) and of b (M, E)."""
  return units(a) @ units(b).T


@renamed_parameters(removed_in="0.3", own="column")
def hits(away: Num[Array, "n m"], top_k: int = 3, column: Int[Array, " n"] | None = None
         ) -> Float[np.ndarray, " {top_k}"]:
  """Expected number of rows of away (N, M) whose matching column is among the nearest 1, 2, .. top_k: (top_k,).

  away: distances, or negative similarities. column (N,): matching column of each row; None: row i matches column i, and
  N = M. Ties count by chance: an evaluator that maps everything to one point scores k / M, in any order of the batch.
  (Parity: the references sort, which orders ties by their position in the batch.)
  """
  return hit_chances(away, top_k, column).sum(0)


@renamed_parameters(removed_in="0.3", own="column")
def hit_chances(away: Num[Array, "n m"], top_k: int = 3, column: Int[Array, " n"] | None = None
                ) -> Float[np.ndarray, "n {top_k}"]:
  """`hits` row by row (N, top_k): 1 if the matching column is among the nearest, 0 if not, a fraction for ties."""
  nearer, tied = _places(away, column)
  chance = (np.arange(1, top_k + 1) - nearer[:, None]) / tied[:, None]
  return np.clip(chance, 0, 1)


def r_precision(text: Num[Array, "n e"], motion: Num[Array, "n e"], top_k: int = 3, pool: int = 32,
                away: Callable[..., np.ndarray] = distances) -> Float[np.ndarray, " {top_k}"]:
  """Share of texts whose motion is among the nearest 1, 2, .. top_k of its pool: (top_k,).

  The rows are taken in order, `pool` at a time (R-precision depends on the pool); the last, smaller pool is omitted, as
  in the benchmarks' loaders. away: `distances`, or cosine_distances for SnapMoGen.
  """
  text, motion = _pairs(text, motion)
  pools = len(text) // pool
  if not pools:
    raise ValueError(f"got {len(text)} pairs, R-precision needs a pool of {pool}; take more samples or a smaller pool")
  counts = sum((hits(away(text[i:i + pool], motion[i:i + pool]), top_k) for i in range(0, pools * pool, pool)),
              start=np.zeros(top_k))
  return counts / (pools * pool)


def cosine_distances(a: Num[Array, "n e"], b: Num[Array, "m e"]) -> Float[np.ndarray, "n m"]:
  return -cosines(a, b)


def matching_score(text: Num[Array, "n e"], motion: Num[Array, "n e"]) -> float:
  """Mean Euclidean distance of matched pairs (MM-Dist)."""
  text, motion = _pairs(text, motion)
  return float(np.linalg.norm(text - motion, axis=1).mean())


def clip_score(text: Num[Array, "n e"], motion: Num[Array, "n e"]) -> float:
  """Mean cosine of matched pairs, neither clipped nor times 100."""
  text, motion = _pairs(text, motion)
  return float((units(text) * units(motion)).sum(1).mean())


def retrieval(similarity: Num[Array, "n n"]) -> dict[str, float]:
  """Retrieval scores in both directions of similarity (N, N), whose diagonal holds the matches; larger = closer.

  -> {"r1", "r2", "r3", "r5", "r10": share in 0..1, "median_rank": 1 = best}, and the same with "back_" for columns.
  With texts as rows the former are text to motion. Ties count as in `hits`; their rank is their mean rank.
  """
  similarity = np.asarray(similarity, np.float64)
  if similarity.ndim != 2 or similarity.shape[0] != similarity.shape[1] or not len(similarity):
    raise ValueError(f"got similarities of shape {similarity.shape}, expected (N, N), row i belonging to column i")
  if not np.isfinite(similarity).all():
    raise ValueError("the similarities hold NaN or infinity; check the embeddings")
  row: dict[str, float] = {}
  for prefix, away in (("", -similarity), ("back_", -similarity.T)):
    counts = hits(away, max(RECALLS)) / len(away)
    row |= {f"{prefix}r{k}": float(counts[k - 1]) for k in RECALLS}
    nearer, tied = _places(away)
    row[f"{prefix}median_rank"] = float(np.median(nearer + (tied + 1) / 2))
  return row


def mean_ranks(similarity: Num[Array, "n n"], same: Bool[Array, "n n"] | None = None) -> Float[np.ndarray, " n"]:
  """The rank (N,), from 0, of the matching column of each row of similarity (N, N); ties have their mean rank.

  same (N, N): columns that also count as matches of a row; the nearest of them counts, as in TMR's protocol with a
  threshold on the similarity of captions (docs/papers/cmdm.md#tmr).
  """
  away = -np.asarray(similarity, np.float64)
  own_distance = np.diagonal(away) if same is None else np.where(same, away, np.inf).min(1)
  return (away < own_distance[:, None]).sum(1) + ((away == own_distance[:, None]).sum(1) - 1) / 2


def retrieval_by_rank(similarity: Num[Array, "n n"], same: Bool[Array, "n n"] | None = None) -> dict[str, float]:
  """TMR's retrieval scores, named as in `retrieval`: a row counts at k if its mean rank is below k.

  Parity: with many ties this differs from `retrieval`, which counts expected hits.
  """
  row: dict[str, float] = {}
  for prefix, way in (("", similarity), ("back_", np.transpose(similarity))):
    ranks = mean_ranks(way, same)
    row |= {f"{prefix}r{k}": float((ranks < k).mean()) for k in RECALLS}
    row[f"{prefix}median_rank"] = float(np.median(ranks) + 1)
  return row


class Moments(NamedTuple):
  """Count, mean (E,) and scatter (E, E) = sum of outer products about the mean: sufficient for a Gaussian fit."""
  count: int  # type: ignore[assignment]  # a tuple has a method of this name
  mean: np.ndarray
  scatter: np.ndarray

  @property
  def covariance(self) -> Float[np.ndarray, "e e"]:
    """Unbiased covariance (E, E), normalized by n - 1 as in numpy."""
    if self.count < 2:
      raise ValueError(f"got {self.count} samples, a covariance needs 2 or more")
    return self.scatter / (self.count - 1)


def moments(features: Num[Array, "n e"]) -> Moments:
  """Moments of the rows of features (N, E)."""
  rows = _rows(features)
  mean = rows.mean(0)
  away = rows - mean
  return Moments(len(rows), mean, away.T @ away)


def merge(a: Moments, b: Moments) -> Moments:
  """Moments of the union of two sets, for data that is processed in chunks."""
  count = a.count + b.count
  apart = b.mean - a.mean
  return Moments(count, a.mean + apart * (b.count / count),
                 a.scatter + b.scatter + np.outer(apart, apart) * (a.count * b.count / count))


@renamed_parameters(removed_in="0.3", made="generated")
def fid(real: Num[Array, "n e"] | Moments, generated: Num[Array, "m e"] | Moments) -> float:
  """Frechet distance of two sets of embeddings (N, E) and (M, E), or of their `moments`."""
  real, generated = (m if isinstance(m, Moments) else moments(m) for m in (real, generated))
  return frechet_distance(real.mean, real.covariance, generated.mean, generated.covariance)


def frechet_distance(mean1: Num[Array, " e"], cov1: Num[Array, "e e"], mean2: Num[Array, " e"], cov2: Num[Array, "e e"]
                     ) -> float:
  """Frechet distance |mean1 - mean2|^2 + tr(cov1 + cov2 - 2 (cov1 cov2)^(1/2)), for covariances of any rank.

  The trace of the root of the product is the sum of singular values of cov1^(1/2) cov2^(1/2), both roots symmetric: no
  complex numbers, nothing to invert, and 0 to rounding for a set against itself.
  Parity: the references take means in float32 and scipy's sqrtm of the product, adding 1e-6 to the diagonals where that
  fails; where it works the two agree to 7e-7 relative.
  """
  mean1, mean2 = np.asarray(mean1, np.float64), np.asarray(mean2, np.float64)
  if mean1.shape != mean2.shape or np.shape(cov1) != mean1.shape * 2 or np.shape(cov2) != np.shape(cov1):
    raise ValueError(f"got means of shape {mean1.shape} and {mean2.shape}, covariances of {np.shape(cov1)} and "
                     f"{np.shape(cov2)}; expected two of the same evaluator")
  roots = np.linalg.svd(_root(cov1) @ _root(cov2), compute_uv=False)
  apart = mean1 - mean2
  return float(apart @ apart + np.trace(cov1) + np.trace(cov2) - 2 * roots.sum())


@renamed_parameters(removed_in="0.3", made="generated")
def kernel_distance(real: Num[Array, "n e"], generated: Num[Array, "m e"]) -> float:
  """KID: squared maximum mean discrepancy of real (N, E) and generated (M, E), kernel (x . y / E + 1)^3.

  Unbiased for any N and M of 2 or more, and possibly negative for similar sets; a Frechet distance is biased upward,
  and with fewer than E + 1 rows its covariance has no full rank. Source: Binkowski et al. 2018.
  """
  real, generated = _rows(real), _rows(generated)
  if min(len(real), len(generated)) < 2:
    raise ValueError(f"got {len(real)} real and {len(generated)} generated embeddings, a kernel distance needs 2 or "
                     "more of each")
  kernel = lambda a, b: (a @ b.T / real.shape[1] + 1) ** 3
  within = lambda a: (kernel(a, a).sum() - np.trace(kernel(a, a))) / (len(a) * (len(a) - 1))
  return float(within(real) + within(generated) - 2 * kernel(real, generated).mean())


def draw_pairs(rng: np.random.Generator, count: int, size: int) -> tuple[np.ndarray, np.ndarray]:
  """Two independent draws of size indices out of count, each without replacement, from a numpy generator."""
  if count < size:
    raise ValueError(f"got {count} samples to draw {size} from; take more samples or a smaller draw")
  return rng.choice(count, size, replace=False), rng.choice(count, size, replace=False)


def diversity(features: Num[Array, "n e"], first: Int[Array, " s"], second: Int[Array, " s"]) -> float:
  """Mean distance between rows first (S,) and second (S,) of features (N, E)."""
  features = _rows(features)
  return float(np.linalg.norm(features[first] - features[second], axis=1).mean())


def multimodality(features: Num[Array, "n m e"], first: Int[Array, " s"], second: Int[Array, " s"]) -> float:
  """Mean distance between generations first (S,) and second (S,) of the same text: features (texts, generations, E)."""
  features = np.asarray(features, np.float64)
  if features.ndim != 3:
    raise ValueError(f"got features of shape {features.shape}, expected (texts, generations, E)")
  return float(np.linalg.norm(features[:, first] - features[:, second], axis=2).mean())


@renamed_parameters(removed_in="0.3", made="generated")
def joint_errors(real: Num[Array, "*lead t j 3"], generated: Num[Array, "*lead t j 3"]) -> Float[np.ndarray, "*lead t"]:
  """Mean root-aligned joint error of each frame: joints (..., T, J, 3) -> (..., T), in their unit."""
  real, generated = np.asarray(real, np.float64), np.asarray(generated, np.float64)
  if real.shape != generated.shape:
    raise ValueError(f"got joints of shape {real.shape} and {generated.shape}, expected the same frames of both")
  aligned = lambda joints: joints - joints[..., :1, :]
  return np.linalg.norm(aligned(real) - aligned(generated), axis=-1).mean(-1)


def mpjpe(errors: Sequence[np.ndarray]) -> float:
  """Mean per-joint position error over all frames of all clips; errors: a list of (T_i,) from `joint_errors`."""
  return float(np.concatenate(_some(errors)).mean())


def released_mpjpe(errors: Sequence[np.ndarray], batch_size: int = 32) -> float:
  """MPJPE as the released code computes it: sums over frames, divided by the number of clips and by the batch size.

  Parity: the divisor should be the lengths of the clips; this is `mpjpe` times mean length / batch size. Use it only to
  compare with printed numbers (docs/papers/cmdm.md#reconstruction).
  """
  return float(sum(error.sum() for error in _some(errors)) / (len(errors) * batch_size))


def _some(errors):
  if not len(errors):
    raise ValueError("got no joint errors, expected an array of each clip's frames")
  return errors


def _rows(x):
  x = np.asarray(x, np.float64)
  if x.ndim != 2 or not len(x):
    raise ValueError(f"got embeddings of shape {x.shape}, expected (N, E) with N of 1 or more")
  if not np.isfinite(x).all():
    raise ValueError(f"row {int(np.flatnonzero(~np.isfinite(x).all(1))[0])} of the embeddings holds NaN or infinity; "
                     "leave that motion out")
  return x


def _pairs(text, motion):
  text, motion = _rows(text), _rows(motion)
  if text.shape != motion.shape:
    raise ValueError(f"got {text.shape} text and {motion.shape} motion embeddings, expected matched pairs")
  return text, motion


def units(x: Num[Array, "n e"]) -> Float[np.ndarray, "n e"]:
  """Normalizes rows (N, E) to length 1."""
  x = _rows(x)
  return x / np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-12)


def _places(away, column=None):
  """For each row of away (N, M): numbers of columns nearer than the matching one, and at the same distance (>= 1)."""
  away = np.asarray(away, np.float64)
  column = np.arange(len(away)) if column is None else np.asarray(column)
  distance = np.take_along_axis(away, column[:, None], 1)
  return (away < distance).sum(1), (away == distance).sum(1)


def _root(covariance):
  """The symmetric square root; eigenvalues at rounding level count as 0, as their roots would not be small."""
  values, vectors = np.linalg.eigh(np.asarray(covariance, np.float64))
  floor = len(values) * np.finfo(np.float64).eps * values[-1]
  return (vectors * np.sqrt(np.where(values > floor, values, 0))) @ vectors.T
