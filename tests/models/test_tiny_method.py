"""A further method is one folder, one config and one line in the registry: trained, loaded, asked and judged."""
import dataclasses

import numpy as np
import pytest

import motion_jax as mj
from motion_jax import fit as training
from motion_jax.evaluation import protocols, run
from motion_jax.evaluation.request import Request
from motion_jax.evaluators.evaluator import fresh_evaluator
from motion_jax.models import options, registry
from motion_jax.models.abilities import ABILITIES
from motion_jax_studio import cli
from tests.conftest import ROOT
from tests.evaluation.test_run import SMALL, make_clips, write_archive
from tests.models.tiny_method.config import get_config


@pytest.fixture(scope="module")
def method():
  """The line in the registry, for these tests."""
  registry.METHODS["tiny"] = "tests.models.tiny_method"
  yield
  del registry.METHODS["tiny"]


@pytest.fixture(scope="module")
def folder(method, tmp_path_factory):
  """Its run after two steps."""
  folder = tmp_path_factory.mktemp("tiny") / "run"
  assert int(training.run(get_config(), folder).step) == 2
  return folder


def test_it_is_trained_loaded_and_asked(folder):
  model = mj.load(folder)
  assert isinstance(model, mj.Model) and [word for word in ABILITIES if model.can(word)] == ["generate"]
  waves = model.generate(["a person waves", "a person walks"], [24, 40], seeds=[1, 2])
  alone = model.generate("a person walks", 40, seeds=[2])[0]
  assert waves.joints.shape == (2, 40, 22, 3)
  np.testing.assert_allclose(waves[1].joints, alone.joints, atol=1e-4)
  assert (alone.meta["guidance_scale"], alone.meta["spread"], alone.meta["seed"]) == (2.0, 0.1, 2)
  still = model.generate("a person walks", 40, seeds=[3], spread=0)[0].features
  assert np.array_equal(still, model.generate("a person walks", 40, seeds=[4], spread=0)[0].features)
  with pytest.raises(TypeError, match="generate has no argument 'lag'; it has .*guidance_scale, spread"):
    model.generate("a person walks", 40, lag=2)
  with pytest.raises(TypeError, match="did you mean seeds?"):
    model.generate("a person walks", 40, seedss=[2])
  with pytest.raises(ValueError, match="got spread 11, expected a number from 0 to 10"):
    model.generate("a person walks", 40, spread=11)


@pytest.mark.slow
def test_the_command_line_knows_its_choices(folder, tmp_path, monkeypatch, capsys):
  monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
  made = ["generate", "a person walks", "--num-frames", "24", "--model", str(folder), "--out", f"{tmp_path}/made.npz"]
  assert cli.main([*made, "--spread", "0.2"]) == 0
  assert mj.export.load(tmp_path / "made.npz").meta["spread"] == 0.2
  assert cli.main([*made, "--lag", "2"]) == 1
  assert "got --lag for the model run@" in capsys.readouterr().err
  with pytest.raises(SystemExit):
    cli.main(["generate", "--help-all"])
  told = capsys.readouterr().out
  assert "TINY models:" in told and "--spread" in told
  assert cli.main(["models", str(folder)]) == 0
  printed = capsys.readouterr().out
  assert "tiny.regressor" in printed and "  generate " in printed and "  edit " not in printed
  assert {line.split()[0]: line.split()[1] for line in printed.splitlines() if line.startswith("  --")} == {
      "--guidance-scale": "2.0", "--spread": "0.1"}


def test_a_run_or_config_of_a_method_that_is_not_installed_names_it(folder, tmp_path, monkeypatch):
  monkeypatch.delitem(registry.METHODS, "tiny")
  missing = "'tiny.regressor', expected one of .*; install the package that adds the method 'tiny'"
  with pytest.raises(ValueError, match=missing):
    mj.load(folder)
  with pytest.raises(ValueError, match=missing):
    training.run(get_config(), tmp_path / "run")
  assert not (tmp_path / "run").exists()


@pytest.mark.slow
def test_it_is_judged(folder, tmp_path):
  archive = write_archive(tmp_path / "archive", make_clips())
  protocol = dataclasses.replace(SMALL, replications=1, multimodality_batches=0)
  judge = lambda protocol, **more: run.evaluate(Request([folder], [archive], protocol, out=tmp_path / "out",
      force=True, verbose=False, evaluator=fresh_evaluator("t2m"), clip_evaluator="none", **more))
  result = judge(protocol, vary=[dict(spread=0.5), dict(spread=0.1)])
  assert result.row_order == ["real", "run, spread 0.5", "run, spread 0.1"]
  assert np.isfinite([result.rows[row]["fid"]["mean"] for row in result.row_order]).all()
  assert result.provenance["models"][0]["sampler"] == {"guidance_scale": 2.0, "spread": 0.1}
  with pytest.raises(ValueError, match="has no 'edit' .* needs the run of a cdamd.generator"):
    judge(protocols.get_protocol("editing"))


def test_the_docs_have_the_choices_of_all_methods():
  docs = (ROOT / "docs" / "sampling.md").read_text()
  for method, chosen in registry.options().items():
    assert options.table(chosen) in docs or method == "tiny", f"docs/sampling.md lacks the table of {method}'s choices"
