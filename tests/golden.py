"""Runs recorded numbers of the references against our code: python -m tests.golden FOLDER [NAME ...]

Every file of the folder that has a runner is computed in float32 and in float64 and printed as a row: name, largest
difference in both, tolerance, ok. The exit status is 1 if one fails. Tests call `check`, so the table and the tests
cannot disagree. A runner is registered by

  @golden("causal_dit")
  def causal_dit(fixture, dtype):
    return {"block3/velocity": ...}   # the names under out/ and out64/ in the file

in the test module of the part, or here for CMDM's denoiser. A recorded output that no runner returns is an error too.
"""
import argparse
import importlib
import json
import pathlib
import re
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

FLOAT64_BOUND = 1e-10  # what numpy, written from the facts, stays far below (2e-15)
GRADIENT_BOUND = 1e-5  # relative; recorded in float32 only
RUNNERS = {}


class Runner(NamedTuple):
  run: object
  leave_out: tuple[str, ...]  # prefixes of outputs that are not ours to give
  bounds: dict                # prefix -> (float32, float64) bounds where the file's tolerance is in words


class Fixture:
  """One recorded file: arrays by name, its meta, its parameters as a float32 state dict."""

  def __init__(self, path):
    with np.load(path, allow_pickle=False) as file:
      self.arrays = {name: file[name] for name in file.files}
    self.meta = json.loads(str(self.arrays.pop("meta")))
    self.config = self.meta.get("config", {})

  def __getitem__(self, name):
    return self.arrays[name]

  @property
  def params(self):
    return params_of(self.arrays)

  def under(self, prefix):
    """The arrays below a prefix, by the rest of their names."""
    return {name[len(prefix):]: array for name, array in self.arrays.items() if name.startswith(prefix)}


class Row(NamedTuple):
  """Largest |difference| / max(1, largest |value|) over all outputs, or None where nothing is recorded."""
  name: str
  float32: float
  float64: float | None
  tolerance: str
  failures: tuple[str, ...]

  def __str__(self):
    show = lambda value: "-" if value is None else f"{value:.1e}"
    return (f"{self.name:22s} {show(self.float32):>9s} {show(self.float64):>9s}   {self.tolerance:24s} "
            f"{'ok' if not self.failures else 'FAILED: ' + '; '.join(self.failures[:3])}")


def params_of(fixture):
  """{torch name: float32 array} of an opened file; they are stored as float16 without loss."""
  names = fixture.files if hasattr(fixture, "files") else fixture
  return {name[6:]: np.asarray(fixture[name], np.float32) for name in names if name.startswith("param/")}


def golden(name, leave_out=(), bounds=None):
  """Registers run(fixture, dtype) -> {output: array} for the file NAME.npz; see the top of this file."""
  def register(run):
    RUNNERS[name] = Runner(run, tuple(leave_out), bounds or {})
    return run
  return register


def check(path):
  """Runs one file in both precisions -> Row."""
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no fixture {path}; tests never skip one")
  fixture, runner = Fixture(path), RUNNERS[path.stem]
  worst, failures, told = {}, [], []
  for kind, prefix in (("float32", "out/"), ("float64", "out64/")):
    expected = {name: array for name, array in fixture.under(prefix).items() if not name.startswith(runner.leave_out)}
    if not expected:
      continue
    with jax.enable_x64(kind == "float64"), jax.default_matmul_precision("highest"):
      made = {name: np.asarray(array) for name, array in runner.run(fixture, jnp.dtype(kind)).items()}
    failures += [f"{kind} {name} is not computed" for name in sorted(expected.keys() - made.keys())]
    worst[kind] = 0.0
    for name in sorted(expected.keys() & made.keys()):
      difference, bound = _difference(made[name], expected[name], name), _bound(fixture, runner, name, kind)
      if not name.startswith("grad/"):
        worst[kind] = max(worst[kind], difference)
      else:
        worst["gradient"] = max(worst.get("gradient", 0.0), difference)
      if not difference <= bound:
        failures.append(f"{kind} {name} differs by {difference:.1e} > {bound:.0e}")
  tolerance = fixture.meta.get("tolerance")
  told = f"{tolerance:.0e}, 1e-10" if isinstance(tolerance, float) else "by output"
  if "gradient" in worst:
    told += f"; grad {worst['gradient']:.1e}"
  return Row(path.stem, worst.get("float32", 0.0), worst.get("float64"), told, tuple(failures))


def _difference(made, expected, name):
  if made.shape != expected.shape:
    raise ValueError(f"{name} has shape {made.shape}, recorded is {expected.shape}")
  floor = 1e-12 if name.startswith("grad/") else 1.0
  if not np.isfinite(made).all():
    return np.inf
  return float(np.abs(made.astype(np.float64) - expected).max() / max(floor, np.abs(expected).max()))


def _bound(fixture, runner, name, kind):
  for prefix, bounds in runner.bounds.items():
    if name.startswith(prefix):
      return bounds[kind == "float64"]
  if name.startswith("grad/"):
    return GRADIENT_BOUND
  return FLOAT64_BOUND if kind == "float64" else fixture.meta["tolerance"]


def import_runners():
  """Imports the test modules that register runners: those that say so."""
  root = pathlib.Path(__file__).parents[1]
  for path in sorted((root / "tests").rglob("test_*.py")):
    if re.search(r"^@(golden\.)?golden\(", path.read_text(encoding="utf-8"), re.MULTILINE):
      importlib.import_module(".".join(path.relative_to(root).with_suffix("").parts))


def main(argv=None):
  parser = argparse.ArgumentParser(description="Compares our numbers with recorded ones of the references.")
  parser.add_argument("folder", type=pathlib.Path)
  parser.add_argument("names", nargs="*", help="files to run, without .npz; all known ones if left out")
  args = parser.parse_args(argv)
  import_runners()
  files = sorted(args.folder.glob("*.npz"))
  if not files:
    parser.error(f"{args.folder} holds no .npz file")
  known = [path for path in files if path.stem in RUNNERS and (not args.names or path.stem in args.names)]
  print(f"{'name':22s} {'float32':>9s} {'float64':>9s}   {'tolerance':24s}")
  rows = []
  for path in known:
    rows.append(check(path))
    print(rows[-1], flush=True)
  unknown = [path.stem for path in files if path.stem not in RUNNERS]
  if unknown:
    print(f"no runner yet: {', '.join(unknown)}")
  failed = sum(bool(row.failures) for row in rows)
  print(f"{len(rows) - failed} of {len(rows)} fixtures agree")
  return 1 if failed or not rows else 0


if __name__ == "__main__":
  # The test modules import this file by its real name; its registry is the one to use.
  raise SystemExit(importlib.import_module("tests.golden").main())
