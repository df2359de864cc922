"""Published results load, are written again byte for byte, and make the tables of their pages."""
import dataclasses
import json

import pytest

from motion_jax.evaluation.protocols import PROTOCOLS
from motion_jax.evaluation.report import tables
from motion_jax.evaluation.result import FILE, Result
from tests.conftest import ROOT

FOLDER = ROOT / "docs" / "benchmark"
# One result of each protocol, a line each: {"page": the page in docs/benchmark that shows it, "result": results.json}.
PUBLISHED = [json.loads(line) for line in
             (ROOT / "tests" / "fixtures" / "evaluation" / "published" / "results.jsonl").read_text().splitlines()]


@pytest.mark.parametrize("published", PUBLISHED, ids=lambda published: published["page"])
def test_published_results_open_and_make_their_tables(published, tmp_path):
  text = json.dumps(published["result"], indent=1) + "\n"
  (tmp_path / FILE).write_text(text)
  result = Result.read(tmp_path)
  assert json.dumps(result.as_json(), indent=1) + "\n" == text and result.folder == tmp_path
  assert tables.markdown(result) == (FOLDER / published["page"]).read_text(encoding="utf-8")
  fields = result.provenance["protocol"]
  assert fields.keys() <= {field.name for field in dataclasses.fields(PROTOCOLS[result.protocol])}


def test_a_file_that_is_no_result_is_refused(tmp_path):
  with pytest.raises(FileNotFoundError, match="expected the --out folder of motion-jax evaluate"):
    Result.read(tmp_path)
  (tmp_path / FILE).write_text('{"protocol": "kit", "rows": {}}')
  with pytest.raises(ValueError, match="holds no result of motion-jax evaluate: it has no row_order, metrics"):
    Result.read(tmp_path)
