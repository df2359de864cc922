"""Differences between rows on the same captions, and how far other test clips would move a row."""
import numpy as np
import pytest

from motion_jax.evaluation import aggregates, protocols
from motion_jax.evaluation.differences import ByMotion, over_clips
from motion_jax.evaluation.report import differences, tables
from motion_jax.evaluation.result import Result
from motion_jax.metrics import scores


def rows(shift=0.0, noise=0.0, count=60, replications=2):
  """Replications of a row: clips differ by much, its values from another row's by shift and noise."""
  found = []
  for i in range(replications):
    rng, own = np.random.default_rng(i), np.random.default_rng(100 + i)
    value, real = rng.normal(5, 3, count), rng.normal(size=(count, 4))
    found.append(ByMotion(rng.permutation(count), {"matching": value + shift + own.normal(0, noise, count)}, real,
                          real + shift + own.normal(0, noise, real.shape)))
  return found


def test_rows_of_the_same_clips_are_told_apart_where_their_own_intervals_overlap():
  alone = over_clips(rows())["matching"]
  assert alone["interval"] == pytest.approx(1.96 * 3 / np.sqrt(60 * 2), rel=0.35)
  paired = over_clips(rows(0.3, 0.1), rows())["matching"]
  assert paired["mean"] == pytest.approx(0.3, abs=0.05) and paired["interval"] < 0.1 < alone["interval"]


def test_a_row_does_not_differ_from_itself():
  found = over_clips(rows(), rows())
  assert found == {"fid": {"mean": 0, "interval": 0}, "matching": {"mean": 0, "interval": 0}}


@pytest.mark.parametrize("count, dim", [(60, 4), (8, 20)])
def test_fid_is_that_of_the_table(count, dim):
  rng = np.random.default_rng(0)
  own = [ByMotion(np.arange(count), {}, rng.normal(size=(count, dim)), rng.normal(1, 2, size=(count, dim)))]
  assert over_clips(own)["fid"]["mean"] == pytest.approx(scores.fid(own[0].real, own[0].generated), rel=1e-6)


def test_fid_is_that_of_the_rows_and_its_interval_that_of_their_difference():
  found = over_clips(rows(0.5, 0.1), rows(0.2, 0.1))["fid"]
  assert found["mean"] == pytest.approx(4 * (0.5**2 - 0.2**2), rel=0.3) and 0 < found["interval"] < found["mean"]


def test_rows_are_compared_with_the_first_of_their_part():
  made = {"prefix: a": (None, "prefix"), "suffix: a": (None, "suffix"), "prefix: b": (None, "prefix"),
          "without": (None, "")}
  found = aggregates.compared(made, {"prefix: a": rows(), "suffix: a": rows(), "prefix: b": rows(1.0)}, 0)
  assert [(one["row"], one["against"]) for one in found] == [("prefix: b", "prefix: a")]
  result = Result("archives-66", "Title", {}, [], ["fid", "matching"], differences=found)
  table, = differences.comparisons(result)
  matching = table.lines[0].cells[1]
  assert table.lines[0].name == "prefix: b" and matching.mean == "+1.000" and matching.marked
  text = differences.whole(tables.markdown)(result)
  assert "### Title" in text and "### Differences from prefix: a, on the same captions" in text


def test_own_data_of_few_test_clips_have_a_protocol():
  own = protocols.get_protocol("own-66")
  few = own.of_few(8)
  assert few.pool == 8 and few.note.endswith("by chance R@1 is 0.12")
  with pytest.raises(ValueError, match="got 3 test clips, protocol 'own-66' needs 4 or more; give more recordings"):
    own.of_few(3)
  assert own.of_few(32) is own and protocols.get_protocol("archives-66").of_few(8).pool == 32
