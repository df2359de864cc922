"""Best of n: rows of samples, each scored and sampled again until it is good enough."""
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
  """The best of up to n samples of each of `count` rows: that of the lowest score, of equals the first.

  sample(rows, number, bests so far) -> (sample, record) of each of these rows, its attempt `number`, from 0.
  score(row, sample). A row whose best score is `until` or less is not sampled again; -1 samples all n times.
  """
  bests = [Best([]) for _ in range(count)]
  for number in range(n):
    rows = [i for i, row in enumerate(bests) if not row.attempts or row.best.score > until]
    for i, (drawn, record) in zip(rows, sample(rows, number, bests) if rows else ()):
      attempts, kept = bests[i]
      attempt = Attempt(drawn, score(i, drawn), record)
      bests[i] = Best([*attempts, attempt], number if attempts and attempt.score < attempts[kept].score else kept)
  return bests
