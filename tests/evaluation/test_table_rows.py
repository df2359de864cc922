"""Every named row of the papers' tables at size tiny: trained, sampled, evaluated, written beside its printed row."""
import math
import runpy

import numpy as np
import pytest

from motion_jax import fit, loading
from motion_jax.evaluation import protocols
from motion_jax.evaluation.report import tables
from motion_jax.evaluators.evaluator import fresh_evaluator
from motion_jax.utils import config_files
from motion_jax.utils.errors import InputError
from tests.conftest import ROOT, light_training, some_of
from tests.evaluation.small import judged, small

pytestmark = pytest.mark.usefixtures("kept_features")
STAGES = {"cmdm": "denoiser", "cdamd": "generator"}
# {paper: (protocol, table of its own rows, features of its evaluator)}
JUDGES = {"cmdm": ("cmdm-259", "full"), "cdamd": ("cdamd-66", "coordinates")}
FILES = {name: runpy.run_path(str(ROOT / "configs" / "ablations" / f"{name}.py")) for name in (
    "cmdm", "cmdm_paper", "cdamd", "cdamd_paper")}
ROWS = [(name, row) for name, module in FILES.items() for row in module["ROWS"]]


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
  """trained(config file, row) -> the run folder of its last stage after two steps."""
  made = {}

  def folder(name, row):
    if (name, row) not in made:
      made[name, row] = tmp_path_factory.mktemp("rows") / row
      with light_training():
        fit.run(config_files.load(f"ablations/{name}:{row}/{STAGES[name.partition('_')[0]]}/tiny"), made[name, row])
    return made[name, row]

  return folder


@pytest.fixture(scope="module")
def judges():
  return {layout: fresh_evaluator("t2m", layout) for _, layout in JUDGES.values()}


def protocol_of(paper, monkeypatch):
  """The paper's own protocol with few motions, on procedural ones, and still with its table."""
  monkeypatch.setattr(protocols.Benchmark, "on", lambda self, data_format: self)
  return small(JUDGES[paper][0], formats=("archive",), multimodality_motions=2, multimodality_pairs=1,
               multimodality_batches=0)


@pytest.mark.parametrize("name, row", some_of(ROWS, slow=[("cmdm", "vae"), ("cdamd", "bcm")]))
def test_a_row_is_trained_sampled_evaluated_and_written(name, row, trained, archive, judges, tmp_path, monkeypatch):
  paper = name.partition("_")[0]
  folder, evaluator = trained(name, row), judges[JUDGES[paper][1]]
  result = judged([folder], [archive], protocol_of(paper, monkeypatch), evaluator, tmp_path / "out")
  numbers = result.rows[folder.name]
  assert all(math.isfinite(numbers[metric]["mean"]) for metric in ("fid", "top1", "matching", "diversity"))
  printed = FILES[name]["ROWS"][row][0] if "_" not in name else {}
  text = (tmp_path / "out" / "tables.md").read_text()
  assert folder.name in text
  for table, expected in printed.items():
    listed = [(one["table"], one["row"]) for one in result.paper["row"].get(folder.name, [])]
    assert (table, expected) in listed or not judges_table(paper, table)


def judges_table(paper, table):
  """Whether a table of the paper is judged by the protocol of the test."""
  return JUDGES[paper][0] in tables.paper_table(paper, table).protocols


@pytest.mark.slow
def test_a_tokenizer_that_looks_both_ways_makes_whole_motions(trained):
  """Table 4's VAE: each motion is decoded alone and at once, so that longer ones beside it change nothing."""
  model = loading.load(trained("cmdm", "vae"))
  fast = dict(num_steps=2, lag=1, cleanup=False)
  alone, = model.generate(["a person walks"], 30, seeds=[3], **fast)
  beside = model.generate(["a person walks", "a person waves"], [30, 80], seeds=[3, 4], **fast)[0]
  np.testing.assert_allclose(alone.features, beside.features, atol=1e-4)
  for way in model.ways:
    made = model.multi_prompt([("a person walks", 1.5), ("a person sits", 1.5)], seed=3, way=way, num_steps=2, lag=1)
    assert made.num_frames in (56, 60) and np.isfinite(made.features).all()
  longer = model.extend(alone, "a person waves", 24, seed=5, num_steps=2, lag=1)
  assert longer.num_frames == 30 + 24
  assert not model.can("stream") and not model.can("graphs") and not model.takes_control
  with pytest.raises(InputError, match=r"looks ahead \(tokenizer.causal=False\), so it cannot be streamed"):
    model.stream("a person walks")
