"""Published results.json files load, and are written again byte for byte."""
import dataclasses
import json

import pytest

from motion_jax.evaluation.protocols import PROTOCOLS
from motion_jax.evaluation.report import tables
from motion_jax.evaluation.result import FILE, Result
from tests.conftest import ROOT

PUBLISHED = sorted(path.parent for path in (ROOT / "docs" / "benchmark").glob(f"*/{FILE}"))


@pytest.mark.parametrize("folder", PUBLISHED, ids=lambda folder: folder.name)
def test_published_results_open_and_make_their_tables(folder):
  text, result = (folder / FILE).read_text(encoding="utf-8"), Result.read(folder)
  assert json.dumps(result.as_json(), indent=1) + "\n" == text and result.folder == folder
  assert tables.markdown(result) == (folder / "tables.md").read_text(encoding="utf-8")
  fields = result.provenance["protocol"]
  assert fields.keys() <= {field.name for field in dataclasses.fields(PROTOCOLS[result.protocol])}


def test_a_file_that_is_no_result_is_refused(tmp_path):
  with pytest.raises(FileNotFoundError, match="expected the --out folder of motion-jax evaluate"):
    Result.read(tmp_path)
  (tmp_path / FILE).write_text('{"protocol": "kit", "rows": {}}')
  with pytest.raises(ValueError, match="holds no result of motion-jax evaluate: it has no row_order, metrics"):
    Result.read(tmp_path)
