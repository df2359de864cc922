"""Rows of measurements: one a piece, kept in a file that a run continues."""
import json
import sys

from tests.conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
import results  # noqa: E402


def test_a_run_continues_where_it_was_and_keeps_errors_as_rows(tmp_path):
  """A piece that fails leaves its error and the others run; one with a row is not measured again."""
  out, calls = tmp_path / "rows.jsonl", []

  def piece(name, value):
    calls.append(name)
    if value is None:
      raise MemoryError("too large")
    assert json.loads(out.read_text().splitlines()[-1])["error"] == "the program ended in this piece"
    return dict(ms=value)

  wanted = {name: lambda name=name, value=value: piece(name, value)
            for name, value in {"batch/M/2": 1.0, "batch/M/10": 2.0, "plain": None}.items()}
  assert not results.measure(out, wanted, -1.0, {}) and not out.exists()
  assert results.measure(out, dict(list(wanted.items())[:2]), 1e9, dict(device="x"))
  assert results.measure(out, wanted, 1e9, dict(device="x")) and calls == list(wanted)
  assert results.read(out) == [row | dict(device="x") for row in (
      dict(piece="batch/M/2", ms=1.0), dict(piece="batch/M/10", ms=2.0),
      dict(piece="plain", error="MemoryError: too large"))]
  results.write(out, dict(piece="batch/M/2", ms=3.0))
  assert [row.get("ms") for row in results.read(out)] == [3.0, 2.0, None] and results.read(tmp_path / "none") == []
