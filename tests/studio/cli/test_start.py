"""What starting a command imports: help no array library, generating nothing that only other commands use."""
import json
import os
import subprocess
import sys

import pytest

from tests.conftest import ROOT, devices_env

# Run main with each list of arguments, then print which of the modules named after the marker were imported.
CODE = """
import json, sys
from motion_studio import cli
statuses = []
for arguments in json.loads(sys.argv[1]):
  try:
    statuses.append(cli.main(arguments))
  except SystemExit as stopped:
    statuses.append(stopped.code)
print(json.dumps([statuses, [name for name in sys.argv[2:] if name in sys.modules]]))
"""


def imported(commands, names, **env):
  """(exit statuses, which of these modules some commands import)."""
  done = subprocess.run([sys.executable, "-c", CODE, json.dumps(commands), *names], capture_output=True, text=True,
                        env=devices_env(1) | env, cwd=ROOT)
  assert done.returncode == 0, done.stderr
  return json.loads(done.stdout.splitlines()[-1])


def test_help_and_mistakes_import_no_array_library():
  commands = [["--help"], ["generate", "--help"], ["train", "--help"], ["evaluate", "--help"],
              ["generate", "a person walks", "--sede", "3"], ["generat"]]
  names = ["jax", "numpy", "flax", "ml_collections", "importlib.metadata", "asyncio"]
  assert imported(commands, names) == [[0, 0, 0, 0, 2, 2], []]


@pytest.mark.slow
def test_generating_imports_nothing_that_only_other_commands_use(tiny_run, tmp_path):
  """Once programs and shapes are in the cache, a command neither traces nor loads what traces."""
  names = ["scipy", "orbax", "optax", "chex", "PIL", "tensorstore", "jinja2", "motion_jax.training.loop",
           "motion_jax.models.cmdm.model", "motion_jax.models.cmdm.losses"]
  outputs = ",".join(os.fspath(tmp_path / f"walk.{kind}") for kind in ("npz", "bvh", "html"))
  command = ["generate", "a person walks", "--num-frames", "20", "--model", str(tiny_run), "--out", outputs]
  for _ in range(2):
    statuses, found = imported([command], names, XDG_CACHE_HOME=str(tmp_path / "cache"))
    assert statuses == [0]
  assert found == []
