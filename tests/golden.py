"""Runs recorded numbers of the references against our code: python -m tests.golden FOLDER [NAME ...]

Every file of the folder is computed in float32 and in float64 and printed as a row: name, largest difference in both,
tolerance, ok or what is wrong. The exit status is 1 if one fails, be it for a number, a missing output, a runner that
raises or a file that no runner knows. Tests call `check`, so the table and the tests cannot disagree. A runner is
registered by

  @golden("causal_dit")
  def causal_dit(fixture, dtype):
    return {"block3/velocity": ...}   # the names under out/ and out64/ in the file

in the test module of the part or, of a further method, in tests/models/METHOD/runners.py; it takes all sizes from the
file, so that recordings of other sizes, lengths and seeds run too, under their own names or ours (`runner_name`).
Several methods record an "edit" or a "pipeline": such a runner is registered as "momask/edit", and computes files whose
meta names that method's repository (`SOURCES`) or, where it names none of them, files in a folder of that name.
"""
import argparse
import importlib
import json
import pathlib
import re
import sys
import traceback
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.nets.naming import by_reference

FLOAT64_BOUND = 1e-10  # what numpy, written from docs/papers, stays far below (2e-15)
GRADIENT_BOUND = 1e-5  # relative; recorded in float32 only
PRECISIONS = {"float32": "out/", "float64": "out64/"}  # where a file has what was recorded in each
RUNNERS = {}
SOURCES = {  # repositories of the references, as the meta of a file names them -> the method in a runner's name
    "EricGuo5513/momask-codes": "momask", "Mael-zys/T2M-GPT": "t2m_gpt", "GuyTevet/motion-diffusion-model": "mdm",
    "ChenFengYe/motion-latent-diffusion": "mld", "zju3dv/MotionStreamer": "motionstreamer", "YU1ut/CMDM": "cmdm",
    "fly-dk/CDAMD": "cdamd", "neu-vi/MARDM": "cdamd",
}
WIDTH = 24  # of a name in the table


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

  @property
  def sizes(self):
    """The arguments that the reference was made with."""
    return self.meta["arguments"]

  def inputs(self, dtype, *names):
    """Some of its inputs, numbers in the precision of the run and integers as they are; of one name that array."""
    arrays = [jnp.asarray(self[f"in/{name}"], None if self[f"in/{name}"].dtype.kind in "iub" else dtype)
              for name in names]
    return arrays if len(names) > 1 else arrays[0]

  def stated(self, pattern, name=None):
    """A number that stands only in the words about an array, or about the whole file: the group of a pattern."""
    words = self.meta["arrays"][name]["what"] if name else self.meta["convention"]
    match = re.search(pattern, words)
    if match is None:
      raise ValueError(f"the recording's words about {name or 'the file'} have no {pattern!r}: {words!r}")
    return float(match[1])

  def under(self, prefix):
    """The arrays below a prefix, by the rest of their names."""
    return {name[len(prefix):]: array for name, array in self.arrays.items() if name.startswith(prefix)}


class Row(NamedTuple):
  """Largest |difference| / max(1, largest |value|) over all outputs, or None where nothing is recorded."""
  name: str
  float32: float | None
  float64: float | None
  tolerance: str
  failures: tuple[str, ...]

  def __str__(self):
    show = lambda value: "-" if value is None else f"{value:.1e}"
    return (f"{self.name:{WIDTH}s} {show(self.float32):>9s} {show(self.float64):>9s}   {self.tolerance:24s} "
            f"{'ok' if not self.failures else 'FAILED: ' + '; '.join(self.failures[:3])}")


def params_of(fixture):
  """{torch name: float32 array} of an opened file; they are stored as float16 without loss."""
  names = fixture.files if hasattr(fixture, "files") else fixture
  return {name[6:]: np.asarray(fixture[name], np.float32) for name in names if name.startswith("param/")}


def loss_and_grads(loss, params, table):
  """(value, more, {"grad/NAME": gradient, under the reference's names}) of loss(params) -> (value, more)."""
  (value, more), grads = jax.jit(jax.value_and_grad(loss, has_aux=True))(params)
  return value, more, {f"grad/{name}": array for name, array in by_reference(grads["params"], table).items()}


def golden(name, leave_out=(), bounds=None):
  """Registers run(fixture, dtype) -> {output: array} for the file NAME.npz, or for METHOD/NAME that of one method only;
  see the top of this file."""
  def register(run):
    RUNNERS[name] = Runner(run, tuple(leave_out), bounds or {})
    return run
  return register


def method_of(meta, folder=""):
  """The method whose reference a file was recorded from: by the source in its meta, else by the name of its folder."""
  sources = (meta or {}).get("source")
  for source in sources if isinstance(sources, list) else [sources]:
    if isinstance(source, dict) and source.get("repo") in SOURCES:
      return SOURCES[source["repo"]]
  return folder


def runner_name(stem, meta=None, folder=""):
  """Which runner computes a file of this name: one of its method (`method_of`), else one of any method. Of these that
  of its own name, of the one recorded in meta, of the longest name that it begins with (causal_dit_seed7), or of one
  that differs in its last number only (evaluators_66). None if there is none, or if two runners claim it.
  """
  names = [name for name in ((meta or {}).get("fixture"), stem) if isinstance(name, str)]
  for method in (f"{method_of(meta, folder)}/", ""):
    known = {name[len(method):]: runner.run for name, runner in RUNNERS.items()
             if name.startswith(method) and "/" not in name[len(method):]}
    found = _runner_among(known, names)
    if found is not None:
      return method + found
  return None


def _runner_among(known, names):
  """The key of known {name: run} for the first of names that has one."""
  for name in names:
    if name in known:
      return name
  for name in names:
    begun = [one for one in known if name.startswith(one) and re.match(r"[_.-]|\d", name[len(one):])]
    if begun:
      return max(begun, key=len)
  base = lambda name: re.sub(r"[_-]?\d+$", "", name)
  for name in names:
    alike = [one for one in known if base(one) == base(name)]
    if alike and len({known[one] for one in alike}) == 1:
      return alike[0]
  return None


def recordings(*names, sharp=(), single=(), slow=(), rare=()):
  """Marks a test(name, precision) of recordings: each in one precision, in the other one among the exhaustive tests.

  The first one is float32, in which all outputs are recorded; of `sharp` ones it is float64, for what a solver with
  steps of its own makes of rounding leaves float32 little to say. single: recorded in float32 alone. slow: whose first
  one is slow, as it compiles much. rare: exhaustive in both, as others show the same.
  """
  first = lambda name, precision: (precision == "float64") == (name in sharp)
  marks = lambda name, precision: pytest.mark.exhaustive if name in rare or not first(name, precision) else (
      pytest.mark.slow if name in slow else ())
  return pytest.mark.parametrize("name, precision", [
      pytest.param(name, precision, marks=marks(name, precision))
      for name in dict.fromkeys((*names, *sharp, *single, *slow, *rare)) for precision in PRECISIONS
      if name not in single or first(name, precision)])


def check(path, precisions=tuple(PRECISIONS)):
  """Runs one file in these precisions -> Row. What is wrong with it, or with its runner, is in the row's failures."""
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no fixture {path}; tests never skip one")
  failed = lambda *failures: Row(path.stem, None, None, "-", failures)
  try:
    fixture = Fixture(path)
  except Exception as error:  # numpy, zipfile and json each have their own
    return failed(f"cannot be read: {_told(error)}")
  name = runner_name(path.stem, fixture.meta, path.parent.name)
  if name is None:
    return failed("no runner knows this fixture")
  runner = RUNNERS[name]
  worst, failures = {}, []
  for kind in precisions:
    expected = {name: array for name, array in fixture.under(PRECISIONS[kind]).items()
                if not name.startswith(runner.leave_out)}
    if not expected:
      continue
    try:
      with jax.enable_x64(kind == "float64"), jax.default_matmul_precision("highest"):
        made = {name: np.asarray(array) for name, array in runner.run(fixture, jnp.dtype(kind)).items()}
    except Exception as error:
      traceback.print_exc()
      failures.append(f"{kind} raised {_told(error)}")
      continue
    failures += [f"{kind} {name} is not computed" for name in sorted(expected.keys() - made.keys())]
    worst[kind] = 0.0
    for name in sorted(expected.keys() & made.keys()):
      if made[name].shape != expected[name].shape:
        failures.append(f"{kind} {name} has shape {made[name].shape}, recorded is {expected[name].shape}")
        continue
      difference, bound = _difference(made[name], expected[name], name), _bound(fixture, runner, name, kind)
      part = "gradient" if name.startswith("grad/") else kind
      worst[part] = max(worst.get(part, 0.0), difference)
      if bound is None:
        failures.append(f"{kind} {name} has no tolerance")
      elif not difference <= bound:
        failures.append(f"{kind} {name} differs by {difference:.1e} > {bound:.0e}")
  if not worst and not failures:
    failures.append("nothing of it is compared")
  told = _tolerance(fixture, runner) + (f"; grad {worst['gradient']:.1e}" if "gradient" in worst else "")
  return Row(path.stem, worst.get("float32"), worst.get("float64"), told, tuple(failures))


def _told(error):
  return f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}"


def _difference(made, expected, name):
  if expected.dtype.kind not in "biufc":  # words
    return 0.0 if np.array_equal(made, expected) else np.inf
  finite = np.isfinite(expected)
  if not np.array_equal(made[~finite], expected[~finite], equal_nan=True) or not np.isfinite(made[finite]).all():
    return np.inf
  floor = 1e-12 if name.startswith("grad/") else 1.0
  size = np.abs(expected[finite]).max(initial=floor)
  return float(np.abs(made[finite].astype(np.float64) - expected[finite]).max(initial=0) / size)


def _bound(fixture, runner, name, kind):
  for prefix, bounds in runner.bounds.items():
    if name.startswith(prefix):
      return bounds[kind == "float64"]
  if name.startswith("grad/"):
    return GRADIENT_BOUND
  if kind == "float64":
    return FLOAT64_BOUND
  tolerance = fixture.meta.get("tolerance")
  return tolerance if isinstance(tolerance, float) else None


def _tolerance(fixture, runner):
  """The bounds as the table shows them: the file's own, else the runner's by output."""
  tolerance = fixture.meta.get("tolerance")
  told = [f"{tolerance:.0e}, {FLOAT64_BOUND:.0e}"] if isinstance(tolerance, float) else []
  told += [f"{prefix} {bounds[0]:.0e}".strip() for prefix, bounds in runner.bounds.items()]
  return "; ".join(told[:3]) + (", ..." if len(told) > 3 else "")


def import_runners():
  """Imports the modules of tests that register runners: those that say so. One that cannot be imported is told."""
  root = pathlib.Path(__file__).parents[1]
  for path in sorted((root / "tests").rglob("*.py")):
    if re.search(r"^@(golden\.)?golden\(", path.read_text(encoding="utf-8"), re.MULTILINE):
      try:
        importlib.import_module(".".join(path.relative_to(root).with_suffix("").parts))
      except Exception as error:
        print(f"{path.relative_to(root)} cannot be imported: {_told(error)}", file=sys.stderr)


def main(argv=None):
  parser = argparse.ArgumentParser(description="Compares our numbers with recorded ones of the references.")
  parser.add_argument("folder", type=pathlib.Path)
  parser.add_argument("names", nargs="*", help="files to run, without .npz; all if left out")
  args = parser.parse_args(argv)
  files = sorted(args.folder.glob("*.npz"))
  if not files:
    parser.error(f"{args.folder} holds no .npz file")
  absent = set(args.names) - {path.stem for path in files}
  if absent:
    parser.error(f"{args.folder} holds no {', '.join(sorted(absent))}")
  import_runners()
  print(f"{'name':{WIDTH}s} {'float32':>9s} {'float64':>9s}   {'tolerance':24s}")
  rows = []
  for path in files:
    if not args.names or path.stem in args.names:
      rows.append(check(path))
      print(rows[-1], flush=True)
  failed = sum(bool(row.failures) for row in rows)
  print(f"{len(rows) - failed} of {len(rows)} fixtures agree")
  return 1 if failed else 0


if __name__ == "__main__":
  # The test modules import this file by its real name; its registry is the one to use.
  raise SystemExit(importlib.import_module("tests.golden").main())
