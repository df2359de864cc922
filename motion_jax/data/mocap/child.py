"""Modules of ours in a Python of their own, since native readers may crash, hang or take all memory."""
import os
import pathlib
import subprocess
import sys

_ROOT = pathlib.Path(__file__).parents[3]
_CODE = """
import sys
root, module, memory = sys.argv[1:4]
del sys.argv[1:4]
sys.path.append(root)
if float(memory):
  try:
    import resource
    resource.setrlimit(resource.RLIMIT_AS, 2 * (int(float(memory)),))
  except (ImportError, ValueError, OSError):
    pass
import runpy
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""


def command(module: str, *arguments: str, memory: float = 0.0) -> list[str]:
  """The command that runs a module of this checkout or installation, from whatever folder.

  The current folder is not on the child's path, where a file `numpy.py` beside a motion would run. memory: bytes of
  address space at most, where the system can limit it; 0 for no limit.
  """
  return [sys.executable, "-P", "-c", _CODE, str(_ROOT), module, str(memory), *map(str, arguments)]


def environment() -> dict[str, str]:
  """This process' environment for a child: one thread for linear algebra, and no relative folder on its path."""
  variables = os.environ | {"OPENBLAS_NUM_THREADS": "1", "PYTHONSAFEPATH": "1"}
  folders = [folder for folder in variables.pop("PYTHONPATH", "").split(os.pathsep) if os.path.isabs(folder)]
  return variables | ({"PYTHONPATH": os.pathsep.join(folders)} if folders else {})


def run(module: str, *arguments: str, seconds: float, memory: float = 0.0) -> subprocess.CompletedProcess:
  """Waits for a module's end. Raises subprocess.TimeoutExpired after `seconds`."""
  return subprocess.run(command(module, *arguments, memory=memory), env=environment(), capture_output=True, text=True,
                        errors="replace", timeout=seconds, check=False)
