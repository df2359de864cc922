"""The methods are twins: the same files, one way to ask what a model can do, choices of sampling described once."""
import ast
import dataclasses
import importlib
import pathlib
import re
import subprocess
import sys

import pytest

from motion_jax.diffusion import samplers
from motion_jax.models import registry
from motion_jax.models.base import ABILITIES, TextToMotionModel
from motion_jax.models.cdamd.options import MASKS, CdamdSampling
from motion_jax.models.cdamd.options import SOLVERS as CDAMD_SOLVERS
from motion_jax.models.cmdm import ddpm_forcing
from motion_jax.models.cmdm.options import SOLVERS as CMDM_SOLVERS
from motion_jax.models.cmdm.options import CmdmSampling
from motion_jax.nets.masks import LATENT_MASKS
from tests.conftest import ROOT, load_config

MODELS = ROOT / "motion_jax" / "models"


def test_each_method_has_its_files_and_imports_no_other():
  for method in registry.METHODS:
    files = {path.name for path in (MODELS / method).glob("*.py")}
    assert files >= {"__init__.py", "losses.py", "stages.py", "sampling.py", "setup.py", "model.py", "options.py",
                     "weights.py"}
    others = [f"motion_jax.models.{other}" for other in registry.METHODS if other != method]
    for path in (MODELS / method).glob("*.py"):
      for node in ast.walk(ast.parse(path.read_text())):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else (
            [f"{node.module}.{alias.name}" for alias in node.names] if isinstance(node, ast.ImportFrom) else [])
        assert not any(name.startswith(other) for name in names for other in others), f"{path} imports {names}"


@pytest.mark.parametrize("method", registry.METHODS)
def test_what_a_model_can_do_are_methods_of_it(method):
  for stage, model in importlib.import_module(f"{registry.METHODS[method]}.model").MODELS.items():
    assert stage.startswith(f"{method}.") and issubclass(model, TextToMotionModel) and "generate" in model.abilities
    assert set(model.abilities) <= set(ABILITIES)
    assert all(callable(getattr(model, ability)) for ability in model.abilities)
    assert registry.model_of(stage) is model and stage in registry.setups()
  assert set(registry.model_stages("edit")) >= {"cdamd.generator", "momask.masked"}
  assert "cmdm.denoiser" in registry.model_stages("stream")
  assert set(registry.model_stages("edit")) >= {"cdamd.generator", "mdm.denoiser"}
  assert set(registry.model_stages("stream")) >= {"cmdm.denoiser", "mdm.dip", "motionstreamer.generator"}
  with pytest.raises(ValueError, match="got the ability 'fly', expected one of generate"):
    object.__new__(TextToMotionModel).can("fly")


def test_nobody_asks_a_model_what_it_is():
  """Neither its class, nor whether it has a method, nor a function's signature: `model.can`."""
  asked = re.compile(r"inspect\.signature|hasattr\((\w+\.)*(model|loaded|subject)\b|"
                     r"isinstance\((\w+\.)*(model|loaded), (?!nn)\w*Model")
  for folder in ("motion_jax/evaluation", "motion_studio/cli", "motion_jax/models", "benchmarks"):
    for path in (ROOT / folder).rglob("*.py"):
      assert not asked.search(path.read_text()), path


def test_choices_are_those_that_there_are():
  assert set(CMDM_SOLVERS["flow"]) == set(samplers.SOLVERS) and CMDM_SOLVERS["ddpm"] == ddpm_forcing.SOLVERS
  assert set(CDAMD_SOLVERS) == {*samplers.METHODS, "dopri5", "ddpm"} and set(MASKS) == set(LATENT_MASKS)


def test_choices_are_the_configs_where_nobody_makes_them():
  cmdm, cdamd = load_config("cmdm_denoiser", "full"), load_config("cdamd_generator", "full")
  chosen = CmdmSampling(num_steps=4).resolved(cmdm, context=48)
  assert dataclasses.asdict(chosen) == dict(guidance_scale=3.0, schedule="fss", num_steps=4, lag=2, solver="euler",
                                            context=48, memory=None, contrast_scale=0.0)
  assert CmdmSampling(schedule="ar", num_steps=7).resolved(cmdm, context=48).about()["lag"] == 7
  assert {hash(chosen), hash(CmdmSampling(num_steps=4).resolved(cmdm, context=48))} == {hash(chosen)}
  unmasking = CdamdSampling(num_iterations=3).resolved(cdamd)
  assert (unmasking.num_iterations, unmasking.num_steps, unmasking.order) == (
      3, cdamd.sampler.num_steps, cdamd.sampler.order)
  with pytest.raises(ValueError, match="got solver 'ancestral', this model knows euler, heun: it was trained to pred"):
    CmdmSampling(solver="ancestral").resolved(cmdm, context=48)
  for wrong, told in ((dict(num_steps=0), "num_steps 0, expected a whole number from 1 to 1,000"),
                      (dict(unmasked_only="no"), "unmasked_only 'no', expected true or false"),
                      (dict(mask="dcm"), "mask 'dcm', expected one of causal, dccm"),
                      (dict(temperature=-1), "temperature -1, expected a number from 0 to 100")):
    with pytest.raises(ValueError, match=told):
      CdamdSampling(**wrong)


def test_the_command_line_reads_choices_without_jax():
  code = ("import sys, motion_studio.cli; from motion_jax.models import registry; registry.options(); "
          "sys.exit('jax' in sys.modules)")
  assert subprocess.run([sys.executable, "-c", code], cwd=pathlib.Path(ROOT), check=False).returncode == 0
