"""Bounds of processor time: what exceeds one fails with the number, whoever spends it."""
import json

import pytest

from tests import processor_time
from tests.processor_time import Tier

pytest_plugins = ["pytester"]
CONFTEST = """
import pytest
from tests import processor_time
def pytest_addoption(parser): processor_time.add_options(parser)
def pytest_configure(config):
  config.addinivalue_line("markers", "slow: ...")
  processor_time.configure(config)
def pytest_collection_finish(session): processor_time.collected(session)
"""
TESTS = """
import subprocess, sys, time, pytest
def work(seconds):
  began = time.process_time()
  while time.process_time() - began < seconds: pass
@pytest.fixture(scope="module")
def shared(): work(0.2)
def test_rests(): time.sleep(0.2)
def test_shares(shared): pass
def test_works(): work(0.2)
def test_starts_a_process():
  subprocess.run([sys.executable, "-S", "-c", "import time\\nwhile time.process_time() < 0.2: pass"])
@pytest.mark.slow
def test_slow(): work(0.2)
"""


@pytest.fixture
def run(pytester, monkeypatch):
  """run(quick tier, *arguments) -> pytest's result of TESTS where the quick tier is as given."""
  def run(quick, *arguments):
    pytester.makeconftest(CONFTEST)
    pytester.makepyfile(TESTS)
    with monkeypatch.context() as patch:
      patch.setitem(processor_time.TIERS, "quick", quick)
      return pytester.runpytest_inprocess("-q", "-p", "no:cacheprovider", *arguments)
  return run


def test_a_test_that_exceeds_its_bound_fails_with_the_number(run):
  result = run(Tier(test=0.05, fixture=2, total=99))
  result.assert_outcomes(passed=3, failed=2)
  result.stdout.fnmatch_lines(["*this quick test took 0.? processor seconds; 0.05 are allowed*"])
  result.stdout.fnmatch_lines_random(["FAILED *test_works*", "FAILED *test_starts_a_process*"])


def test_a_fixture_that_tests_share_has_a_bound_of_its_own(run):
  result = run(Tier(test=2, fixture=0.05, total=99))
  result.assert_outcomes(passed=4, errors=1)
  result.stdout.fnmatch_lines(["*the fixture shared of quick tests took 0.? processor seconds; 0.05 are allowed*"])


def test_a_run_fails_if_its_tests_together_exceed_their_tier(run):
  result = run(Tier(test=2, fixture=2, total=0.1))
  result.assert_outcomes(passed=5)
  assert result.ret == pytest.ExitCode.TESTS_FAILED
  result.stdout.fnmatch_lines(["the quick tests took 0.0 processor minutes in all; 0.00166667 are allowed*"])


def test_times_are_kept_and_bounds_can_be_left_out(run, pytester):
  assert run(Tier(test=0.1, fixture=0.1, total=0.1), "--no-bounds", "--times", "times.json").ret == 0
  rows = json.loads((pytester.path / "times.json").read_text())["tests"]
  seconds = {nodeid.rpartition("::")[2]: row["seconds"] for nodeid, row in rows.items()}
  assert seconds["test_rests"] < 0.1 < 0.15 < min(seconds["test_works"], seconds["test_starts_a_process"])
  assert {row["tier"] for row in rows.values()} == {"quick", "slow"}
  totals = processor_time.totals(rows)
  assert totals["quick", "repository"] > 0.55 and totals["slow", "repository"] > 0.15  # the shared fixture included


def test_rooms_are_folders_of_the_tests():
  assert processor_time.room_of("tests/studio/cli/test_cli.py::test_x[a/b]") == "studio/cli"
  assert processor_time.room_of("tests/quant/test_vq.py::test_x") == "quant"
  assert processor_time.room_of("tests/test_smoke.py::test_x") == "repository"
