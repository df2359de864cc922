"""The table of a sweep: what is shown of measurements, and where it is written."""
import json
import sys

import pytest

from motion_jax.utils.errors import InputError
from tests.conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
import results  # noqa: E402
import sweep_table  # noqa: E402

METHODS = {"one": ["one/all"], "two": ["two/part", "two/whole"]}


@pytest.fixture
def out(tmp_path):
  score = {"mean": 0.25, "interval": 0.5, "values": []}
  rows = {"one/trained/7": dict(stages={"all": dict(steps=7, cpu_seconds=10.2)}, cpu_seconds=10.2,
                                parameters=3_456_789),
          "one/speed/7": dict(frames_per_second=100.4, processor_seconds=1.2, first_frame_ms=34.4, streams=False,
                              others=1.5),
          "one/evaluation/7": dict(rows={"real": {"fid": score}, "model": {"fid": score | {"interval": None}}},
                                   result=str(tmp_path / "none")),
          "one/behaviour/5": dict(passed=1, motions=8, categories={"walk": [1, 8]}, planted=0.1),
          "one/behaviour/7": dict(passed=2, motions=8, categories={"walk": [2, 8]}, planted=0.1),
          "two/speed/3": dict(error="it did not run")}
  for piece, row in rows.items():
    results.write(results.path_of(tmp_path, piece), dict(piece=piece, date="today", commit="c", machine="m") | row)
  return tmp_path


def test_the_newest_measurement_of_each_part_is_shown_and_a_failed_one_is_not(out, tmp_path):
  lines = sweep_table.markdown(sweep_table.newest(out, METHODS, tmp_path)).splitlines()
  assert "| real motions | – | – | 0.250 ± 0.500 | – | – | – | – |" in lines
  assert "| one | – | – | 0.250 | – | – | – | 2 of 8, 25 % |" in lines
  assert "| one | 3.46 | 10 | all 7 (10 s) | 100 | 1.200 | 34 | no | shared: others used 1.5 cores |" in lines
  assert "| two | – | – | – | – | – | – | – | – |" in lines and "| walk | 2 of 8 | – |" in lines


def test_the_page_keeps_what_stands_around_the_table(out, tmp_path):
  page = tmp_path / "docs" / "page.md"
  page.parent.mkdir()
  page.write_text(f"# Title\n\n{sweep_table.BEGIN}\nold\n{sweep_table.END}\n\nAfter.\n")
  for _ in range(2):
    sweep_table.report(out, METHODS, tmp_path, page, "the command")
  text = page.read_text()
  assert text.startswith(f"# Title\n\n{sweep_table.BEGIN}\ntoday, commit c, m.\n") and "old" not in text
  assert text.endswith(f"{sweep_table.END}\n\nAfter.\n") and text.count("3.46") == 1
  assert json.loads(page.with_suffix(".json").read_text())["methods"]["one"]["speed"]["first_frame_ms"] == 34.4
  page.write_text("# Title")
  with pytest.raises(InputError, match="page.md lacks the lines"):
    sweep_table.write_page(page, "text")
