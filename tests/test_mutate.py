"""Deliberate breaks say what they seem to say: a piece stands once, a test exists, what survives is told."""
import os
import runpy
import subprocess
import sys

import pytest

from tests.conftest import ROOT

TOOL = runpy.run_path(str(ROOT / "tools" / "mutate.py"))
Mutation, problems, run, table_row = (TOOL[name] for name in ("Mutation", "problems", "run", "table_row"))


def test_the_list_fits_the_code():
  """If this fails: a listed line has changed; bring tools/mutations up to date."""
  mutations = TOOL["load_lists"]()
  assert not problems(mutations) and len(mutations) >= 60


def write_tree(root):
  for name, text in (("motion_jax/__init__.py", ""), ("motion_jax/sums.py", "def add(a, b):\n  return a + b\n"),
                     ("tests/__init__.py", ""),
                     ("tests/conftest.py", "def pytest_addoption(parser):\n  parser.addoption('--no-bounds', "
                      "action='store_true')\n"),
                     ("tests/test_sums.py", "from motion_jax.sums import add\n\n\ndef test_adds():\n"
                      "  assert add(2, 2) == 4\n\n\ndef test_fails():\n  assert add(1, 1) == 3\n")):
    (root / name).parent.mkdir(exist_ok=True, parents=True)
    (root / name).write_text(text)
  return root


def broken_to(replacement, name="sum", snippet="a + b", test="test_adds", **fields):
  return Mutation(name, "motion_jax/sums.py", snippet, replacement, (f"tests/test_sums.py::{test}",), **fields)


@pytest.mark.slow
def test_what_is_noticed_and_what_survives(tmp_path):
  rows, tree = [], write_tree(tmp_path)
  verdicts = run([broken_to("a * b", "times"), broken_to("a - b", "minus"), broken_to("a +", "cut")], tree, rows.append)
  assert verdicts == {"times": "survived", "minus": "killed", "cut": "killed"}
  assert "| survived |" in rows[1] and "| killed, test_sums: test_adds |" in rows[2] and "`a + b` | `a - b`" in rows[2]
  assert (tree / "motion_jax" / "sums.py").read_text() == "def add(a, b):\n  return a + b\n"
  with pytest.raises(RuntimeError, match="fail without any mutation"):
    run([broken_to("a - b", test="test_fails")], tree, rows.append)
  assert "survived: 2 + 2 is 2 * 2" in table_row(broken_to("a * b", reason="2 + 2 is 2 * 2"), "survived", "", 1.0)


@pytest.mark.parametrize("mutation, told", [
    (broken_to("c", snippet="a - b"), "has it 0 times, expected once"),
    (broken_to("c", snippet="a"), "has it 3 times, expected once"),
    (broken_to("a + b"), "the replacement is the piece itself"),
    (broken_to("c", test="test_absent"), "no test tests/test_sums.py::test_absent"),
    (broken_to("c")._replace(file="motion_jax/none.py"), "there is no motion_jax/none.py")])
def test_a_list_that_does_not_fit_is_refused(tmp_path, mutation, told):
  with pytest.raises(ValueError, match=told):
    run([mutation], write_tree(tmp_path), print)


def test_a_broken_module_is_compiled_anew(tmp_path):
  """Of two modules of one length and one second, Python would run the first's bytecode again."""
  module, said = tmp_path / "said.py", []
  for text in ("print(1)", "print(2)"):
    TOOL["write_source"](module, text)
    os.utime(module, (1e9, 1e9))
    said.append(subprocess.run([sys.executable, "-c", "import said"], cwd=tmp_path, capture_output=True, text=True,
                               env=os.environ | {"PYTHONDONTWRITEBYTECODE": ""}, check=True).stdout.strip())
  assert said == ["1", "2"]
