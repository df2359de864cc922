"""Verdicts on registered claims, as pure functions: effects with intervals, Holm's correction, three verdicts.

Effects are relative, (a - b) / b, as the margin is. An effect is tested twice: is it there (two-sided, against 0, with
Holm's correction over all claims of a registration), and is one of the paper's size excluded (the interval against the
margin, as in a test of equivalence, which Schuirmann's two one-sided tests are).
"""
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import t as student

SHOWN, EXCLUDED, UNDECIDED = "shown", "excluded within the margin", "undecided"
OPPOSITE = "the opposite is shown"


class Effect(NamedTuple):
  """A relative effect, its interval [low, high] at 1 - alpha, and the two-sided p-value of no effect."""
  value: float
  low: float
  high: float
  p: float


class Verdict(NamedTuple):
  """One of SHOWN, EXCLUDED, UNDECIDED, and what is to be said beside it, or ""."""
  verdict: str
  remark: str = ""


def holm(p_values: Sequence[float]) -> np.ndarray:
  """p-values (N,) corrected for N tests: N times the least, N - 1 times the next one, .. (Holm 1979)."""
  p = np.asarray(p_values, np.float64)
  order = np.argsort(p, kind="stable")
  raised = np.maximum.accumulate((len(p) - np.arange(len(p))) * p[order])
  adjusted = np.empty(len(p))
  adjusted[order] = np.minimum(raised, 1)
  return adjusted


def over_seeds(a: Sequence[float], b: Sequence[float], alpha: float = 0.05) -> Effect | None:
  """The effect over paired seeds (N,) by Student's t, relative to the mean of b; None for one seed.

  The mean of b counts as known: its own error is small against that of the difference of two rows that lie close.
  """
  difference, base = np.asarray(a, np.float64) - np.asarray(b, np.float64), float(np.mean(b))
  if len(difference) < 2:
    return None
  freedom = len(difference) - 1
  mean, error = float(difference.mean()), float(difference.std(ddof=1)) / len(difference) ** 0.5
  p = 2 * student.sf(abs(mean) / error, freedom) if error else float(mean == 0)
  half = student.ppf(1 - alpha / 2, freedom) * error
  low, high = sorted(((mean - half) / base, (mean + half) / base))
  return Effect(mean / base, low, high, float(p))


def over_clusters(a: np.ndarray, b: np.ndarray, statistic: Callable[[np.ndarray], float] = np.mean,
                  draws: int = 10_000, alpha: float = 0.05, seed: int = 0) -> Effect | None:
  """The effect by a bootstrap over clusters (clips or stories), the same ones of both rows; None for one cluster.

  a, b (N, ..): a cluster per row; statistic: of such rows a number. The interval is of percentiles; the p-value is
  twice the share of draws on the other side of 0, at least 2 / (draws + 1).
  """
  a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
  if a.shape != b.shape:
    raise ValueError(f"got clusters of shape {a.shape} and {b.shape}, expected the same ones of both rows")
  if len(a) < 2:
    return None
  rng, found = np.random.default_rng(seed), np.empty(draws)
  for i in range(draws):
    chosen = rng.integers(len(a), size=len(a))
    base = statistic(b[chosen])
    found[i] = (statistic(a[chosen]) - base) / base
  base = statistic(b)
  low, high = np.quantile(found, [alpha / 2, 1 - alpha / 2])
  other = min((found <= 0).sum(), (found >= 0).sum())
  p = min(1, 2 * (other + 1) / (draws + 1))
  return Effect(float((statistic(a) - base) / base), float(low), float(high), float(p))


def judge(effect: Effect | None, way: str, margin: float, p: float, alpha: float = 0.05) -> Verdict:
  """The verdict on a claim that the effect is "lower" or "higher"; margin: the paper's effect, without sign; p: the
  corrected p-value.

  Shown: p is below alpha and the effect is on the claimed side. Excluded: the interval ends before the paper's effect.
  Else undecided. An effect can be shown and smaller than the paper's: the remark says so.
  """
  if effect is None:
    return Verdict(UNDECIDED, "one sample")
  sign = 1 if way == "higher" else -1
  toward, low, high = sign * effect.value, *sorted((sign * effect.low, sign * effect.high))
  if p < alpha and toward > 0:
    size = "smaller than the paper's" if high < margin else "larger than the paper's" if low > margin else ""
    return Verdict(SHOWN, size)
  if high >= margin:
    return Verdict(UNDECIDED)
  if p < alpha:
    return Verdict(EXCLUDED, OPPOSITE)
  return Verdict(EXCLUDED, "no effect of that size either way" if low > -margin else "")
