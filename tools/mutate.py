"""Break important lines one at a time and run the tests that should notice: python tools/mutate.py [NAME ...]

The files of `tools/mutations/` list what is broken: a file, a snippet that stands there exactly once, its replacement,
and the tests that should fail. The tree is copied to a temporary folder, where the tests run once without a mutation
(they must pass, or their failures would mean nothing) and then once for each mutation. Prints a table in Markdown:
killed, by which test; survived; or what went wrong. The exit status is 1 if a mutation survived, 2 if the tests fail
without one.

  python tools/mutate.py                 all of them, before a release
  python tools/mutate.py ema kl-ramp     some, by name
  python tools/mutate.py --room core     those of tools/mutations/core.py
  python tools/mutate.py --check         only that every snippet and every test is there
"""
import argparse
import importlib.util
import os
import pathlib
import re
import runpy
import shutil
import subprocess
import sys
import tempfile
import time
from typing import NamedTuple

ROOT = pathlib.Path(__file__).parents[1]
COPIED = ("motion_jax", "motion_jax_studio", "tests", "configs", "tools", "benchmarks", "examples", "blender", "site",
          "docs", "launch.py", "eval.py", "pyproject.toml", "README.md")
MUTATIONS = ROOT / "tools" / "mutations"
LIMIT = 600  # seconds for the tests of one mutation: one that never ends is noticed, too


class Mutation(NamedTuple):
  """snippet stands exactly once in file; tests are pytest's names, such as
  tests/training/test_train.py::test_the_loss_falls.

  reason: why nothing need notice, for one that is known to survive.
  """
  name: str
  file: str
  snippet: str
  replacement: str
  tests: tuple[str, ...]
  reason: str = ""


def problems(mutations, root=ROOT):
  """What is wrong with a list of mutations, one line each: none of them would say what it seems to say."""
  found = []
  names = [m.name for m in mutations]
  found += [f"{name}: the name is given {names.count(name)} times" for name in sorted(set(names))
            if names.count(name) > 1]
  for m in mutations:
    path = pathlib.Path(root) / m.file
    count = path.read_text(encoding="utf-8").count(m.snippet) if path.is_file() else None
    if count != 1:
      where = f"there is no {m.file}" if count is None else f"{m.file} has it {count} times, expected once"
      found.append(f"{m.name}: {where}: {m.snippet!r}; bring the list up to date with the code")
    elif m.snippet == m.replacement:
      found.append(f"{m.name}: the replacement is the piece itself")
    if not m.tests:
      found.append(f"{m.name}: no test is named that ought to notice")
    for test in m.tests:
      file, _, function = test.partition("::")
      source = pathlib.Path(root) / file
      if not source.is_file() or function and not re.search(rf"^def {function.split('[')[0]}\(", source.read_text(
          encoding="utf-8"), re.MULTILINE):
        found.append(f"{m.name}: there is no test {test}")
  return found


def copy_tree(root, folder):
  """The parts of a tree that tests need, in a new folder; files that are no Python are links."""
  copy = lambda source, target: (shutil.copy2 if source.endswith(".py") else os.symlink)(source, target)
  for name in COPIED:
    source = pathlib.Path(root) / name
    if source.is_dir():
      shutil.copytree(source.resolve(), folder / name, copy_function=copy,
                      ignore=shutil.ignore_patterns("__pycache__", "*.pyc", "node_modules"))
    elif source.is_file():
      shutil.copy2(source, folder / name)


def run_tests(folder, tests, limit=LIMIT):
  """(exit status of pytest or None if it did not end, its output), from a folder and against the code in it."""
  environment = os.environ | {"PYTHONPATH": str(folder), "JAX_PLATFORMS": "cpu"}
  environment.pop("PYTHONDONTWRITEBYTECODE", None)  # the copy is read again for each mutation: see write_source
  command = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "-p", "no:cacheprovider", "--no-bounds",
             "-m", "not exhaustive", *tests]
  try:
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=limit,
                          check=False)
  except subprocess.TimeoutExpired:
    return None, f"no end within {limit} s"
  return done.returncode, done.stdout + done.stderr


def write_source(path, text):
  """Writes a module and drops what was compiled from it: Python compares whole seconds and sizes, so it would run the
  old bytecode after two breaks of one length within a second."""
  path.write_text(text, encoding="utf-8")
  pathlib.Path(importlib.util.cache_from_source(path)).unlink(missing_ok=True)


def judge(status, output):
  """(killed, survived or broken; by what) of one run of pytest."""
  failed = re.search(r"^(?:FAILED|ERROR) \S*?([\w-]+\.py(?:::\S+)?)", output, re.MULTILINE)
  if status is None:
    return "killed", output
  if status == 0:
    return "survived", ""
  if status in (1, 2, 4) and failed:  # 2 and 4: the module could not even be imported
    return "killed", failed[1].replace(".py::", ": ").split("[")[0]
  return "broken", " ".join(output.split()[-12:])


def table_row(mutation, verdict, by, seconds):
  code = lambda text: f"`{' '.join(text.split())}`".replace("|", "\\|")
  verdict = f"survived: {mutation.reason}" if verdict == "survived" and mutation.reason else verdict
  return (f"| {mutation.name} | {mutation.file.removeprefix('motion_jax/')} | {code(mutation.snippet)} | "
          f"{code(mutation.replacement)} | {verdict}{f', {by}' if by else ''} | {seconds:.0f} |")


def run(mutations, root=ROOT, out=print, limit=LIMIT, baseline=True):
  """Prints the table -> {name: verdict}. Raises ValueError for a list that does not fit the tree, RuntimeError where
  the tests fail without any mutation, which baseline=False does not try."""
  wrong = problems(mutations, root)
  if wrong:
    raise ValueError("\n".join(wrong))
  with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    copy_tree(root, folder)
    if baseline and (tried := run_tests(folder, sorted({t for m in mutations for t in m.tests}), 6 * limit))[0] != 0:
      raise RuntimeError(f"the tests fail without any mutation, so they tell nothing:\n{tried[1][-3000:]}")
    out("| name | file | the line | broken to | noticed | s |\n| --- | --- | --- | --- | --- | --- |")
    verdicts = {}
    for m in mutations:
      path = folder / m.file
      whole, began = path.read_text(encoding="utf-8"), time.time()
      try:
        write_source(path, whole.replace(m.snippet, m.replacement))
        verdicts[m.name], by = judge(*run_tests(folder, m.tests, limit))
      finally:
        write_source(path, whole)
      out(table_row(m, verdicts[m.name], by, time.time() - began))
    return verdicts


def main(argv=None):
  parser = argparse.ArgumentParser(description="Breaks important lines one at a time; says which tests notice.")
  parser.add_argument("names", nargs="*", help="mutations to run; all if left out")
  parser.add_argument("--check", action="store_true", help="only check the list against the tree")
  parser.add_argument("--passed", action="store_true", help="the tests are known to pass as the tree is: do not try")
  parser.add_argument("--room", default="*",
                      help="only those of tools/mutations/ROOM.py")
  args = parser.parse_args(argv)
  mutations = load_lists(args.room)
  unknown = set(args.names) - {m.name for m in mutations}
  if unknown:
    parser.error(f"got {', '.join(sorted(unknown))}; the list has {', '.join(m.name for m in mutations)}")
  chosen = [m for m in mutations if m.name in args.names or not args.names]
  try:
    if args.check:
      wrong = problems(chosen)
      print("\n".join(wrong) or f"{len(chosen)} mutations fit the tree")
      return 2 if wrong else 0
    verdicts = list(run(chosen, out=lambda line: print(line, flush=True), baseline=not args.passed).values())
  except (ValueError, RuntimeError) as error:
    print(error, file=sys.stderr)
    return 2
  print(f"\n{verdicts.count('killed')} of {len(verdicts)} were noticed")
  known = sum(bool(m.reason) for m in chosen)
  if "broken" in verdicts:
    return 2
  return 1 if verdicts.count("survived") > known else 0


def load_lists(room="*", folder=MUTATIONS):
  """MUTATIONS of the files of a folder, each a tuple of Mutation's fields."""
  rows = []
  for path in sorted(folder.glob(f"{room}.py")):
    rows += runpy.run_path(str(path))["MUTATIONS"]
  return [Mutation(*row) for row in rows]


if __name__ == "__main__":
  raise SystemExit(main())
