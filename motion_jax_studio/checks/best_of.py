"""Best-of-n sampling: each row is sampled and scored until a sample is good enough."""
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple


class Attempt(NamedTuple):
  """A sample, its score (0: nothing is wrong with it), and its record for meta["attempts"]."""
  sample: Any
  score: float
  record: dict[str, Any]


class Best(NamedTuple):
  """The attempts at one row, and the number of the best one."""
  attempts: list[Attempt]
  kept: int = 0

  @property
  def best(self) -> Attempt:
    return self.attempts[self.kept]


def best_of(sample: Callable[[Sequence[int], int, Sequence[Best]], Sequence[tuple[Any, dict[str, Any]]]],
            score: Callable[[int, Any], float], count: int, n: int, until: float = 0.0) -> list[Best]:
  """The best of up to n samples of each of `count` rows: the first one with the lowest score.

  sample(rows, number, bests so far) -> (sample, record) of attempt `number`, from 0, at each of these rows. score(row,
  sample) -> float, 0 for a perfect one. until: a row with this score or less is not sampled again; -1: all n times.
  """
  bests = [Best([]) for _ in range(count)]
  for number in range(n):
    rows = [i for i, row in enumerate(bests) if not row.attempts or row.best.score > until]
    for i, (drawn, record) in zip(rows, sample(rows, number, bests) if rows else ()):
      attempts, kept = bests[i]
      attempt = Attempt(drawn, score(i, drawn), record)
      bests[i] = Best([*attempts, attempt], number if attempts and attempt.score < attempts[kept].score else kept)
  return bests
