"""What starting a command imports: help no array library, generating nothing that only other commands use."""
import json
import subprocess
import sys

import pytest

from tests.conftest import ROOT, devices_env

# Run main, then print which of the modules named after the marker were imported.
CODE = """
import json, sys
from motion_jax_studio import cli
at = sys.argv.index("HEAVY")
try:
  status = cli.main(sys.argv[1:at])
except SystemExit as stopped:
  status = stopped.code
print(json.dumps([status, [name for name in sys.argv[at + 1:] if name in sys.modules]]))
"""


def imported(arguments, names, **env):
  """(exit status, which of these modules a command imports)."""
  done = subprocess.run([sys.executable, "-c", CODE, *arguments, "HEAVY", *names], capture_output=True, text=True,
                        env=devices_env(1) | env, cwd=ROOT)
  assert done.returncode == 0, done.stderr
  return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("arguments, status", [
    (["--help"], 0), (["generate", "--help"], 0), (["train", "--help"], 0), (["evaluate", "--help"], 0),
    (["generate", "a person walks", "--sede", "3"], 2), (["generat"], 2)])
def test_help_and_mistakes_import_no_array_library(arguments, status):
  names = ["jax", "numpy", "flax", "ml_collections", "importlib.metadata", "asyncio"]
  assert imported(arguments, names) == [status, []]


@pytest.mark.slow
def test_generating_imports_nothing_that_only_other_commands_use(tiny_run, tmp_path):
  """Once programs and shapes are in the cache, a command neither traces nor loads what traces."""
  names = ["scipy", "orbax", "optax", "chex", "PIL", "tensorstore", "jinja2", "motion_jax.training.loop",
           "motion_jax.models.cdamd.model", "motion_jax.models.cmdm.losses"]
  arguments = ["generate", "a person walks", "--num-frames", "20", "--model", str(tiny_run), "--out",
               str(tmp_path / "walk.bvh")]
  for _ in range(2):
    status, found = imported(arguments, names, XDG_CACHE_HOME=str(tmp_path / "cache"))
    assert status == 0
  assert found == []
