"""Processor time of each test, and what its tier allows: a plugin of pytest, loaded by tests/conftest.py.

Walls mislead on shared cores, so everything here is processor time: of the worker, of the processes that it started and
of theirs. A test that takes more than its tier allows fails with the number. The time to set up a fixture that several
tests share is not charged to the test that happens to need it first. Both count towards the tier's total, and a run
that exceeds a total fails, too. Bounds are of the machine in docs/lab/test-times.md; a slower one gets more, by a
measured factor, never less.

  python -m pytest -q -n auto --times times.json     keeps the figures for tools/test_times.py
  python -m pytest -q --no-bounds ...                measures and fails nothing: for debuggers and profilers
"""
import collections
import gc
import json
import os
import pathlib
import resource
import time
from typing import NamedTuple

import pytest


class Tier(NamedTuple):
  """Seconds of processor time that a test, a shared fixture and the whole tier may take."""
  test: float
  fixture: float
  total: float


TIERS = {"quick": Tier(2, 10, 8 * 60), "slow": Tier(30, 30, 25 * 60),
         "exhaustive": Tier(300, 300, float("inf")), "torch": Tier(60, 60, float("inf"))}
REFERENCE = 0.055  # seconds of `_work` on the machine of docs/lab/test-times.md
NOISE = 1.2  # times a bound that a test may take: the same work takes more where cores share caches with others
GARBAGE = "garbage"  # among the shared fixtures of a report: what collecting garbage took
SLOW = 1.5  # times the reference: the summary says that the machine is slow
SHOWN = 15  # longest tests in the summary


def tier_of(marks):
  """The tier of a test with these marks, or keywords of its report."""
  return next((name for name in ("torch", "exhaustive", "slow") if name in marks), "quick")


def room_of(nodeid):
  """tests/studio/cli/test_cli.py::test_x -> studio/cli; files at the top are a room, "repository"."""
  parts = pathlib.PurePosixPath(nodeid.partition("::")[0].removeprefix("tests/")).parts[:-1]
  return "/".join(parts[:2]) or "repository"


def tree_seconds():
  """Processor seconds of this process, its children and theirs, ended ones included; without /proc, of ended children
  and of itself only."""
  own = sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
  return own + (sum(_running_children()) / os.sysconf("SC_CLK_TCK") if _has_children() else 0.0)


def _has_children():
  """Whether there is any; walking through /proc for each of thousands of tests would take minutes in all."""
  try:
    os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
  except (ChildProcessError, AttributeError):
    return False
  return True


def _running_children():
  """Clock ticks of each process below this one that still runs."""
  children, ticks = collections.defaultdict(list), {}
  for folder in pathlib.Path("/proc").glob("[0-9]*"):
    try:
      fields = (folder / "stat").read_bytes().rpartition(b") ")[2].split()
    except OSError:  # it has just ended
      continue
    pid = int(folder.name)
    children[int(fields[1])].append(pid)
    ticks[pid] = sum(map(int, fields[11:15]))  # utime, stime and those of its own ended children
  below = list(children[os.getpid()])
  while below:
    pid = below.pop()
    yield ticks[pid]
    below += children[pid]


def _work():
  """Always the same piece of work for the interpreter -> its processor seconds."""
  began = time.thread_time()
  total = 0
  for number in range(1_500_000):
    total += number & 7
  return time.thread_time() - began


def slowness():
  """How many times slower than the reference this machine is right now; at least 1."""
  return max(1.0, min(_work() for _ in range(2)) / REFERENCE)


def forecast():
  """What to expect of the quick and slow tests on this machine, one line."""
  factor, cores = slowness(), len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
  minutes = (TIERS["quick"].total + TIERS["slow"].total) / 60 * factor
  speed = f"{factor:.1f} times slower than" if factor > SLOW else "as fast as"
  return (f"this machine is {speed} that of docs/lab/test-times.md: the tests may take {minutes:.0f} processor "
          f"minutes, {minutes / cores:.0f} by the clock on {cores} {'cores' if cores > 1 else 'core'}")


class Meter:
  """In the process that runs tests: adds `processor_seconds`, `shared_seconds` and `slowness` to each report, and
  fails tests above their bound."""

  def __init__(self, bounded):
    self.bounded, self.slowness, self.last = bounded, slowness(), tree_seconds()
    self.shared, self.depth, self.own, self.collection = {}, 0, 0.0, 0.0
    gc.callbacks.append(self._collects)

  def _collects(self, phase, info):
    """The garbage of thousands of tests is collected while one of them runs, which takes a second: not that test's."""
    if phase == "start":
      self.collection = time.process_time()
    else:
      self.shared[GARBAGE] = self.shared.get(GARBAGE, 0.0) + time.process_time() - self.collection

  def pytest_sessionfinish(self):
    gc.callbacks.remove(self._collects)

  @pytest.hookimpl(wrapper=True)
  def pytest_fixture_setup(self, fixturedef):
    outermost = fixturedef.scope != "function" and not self.depth
    if not outermost:
      return (yield)
    self.depth, began = 1, tree_seconds()  # a fixture that it needs in turn is part of it
    try:
      return (yield)
    finally:
      self.depth = 0
      self.shared[fixturedef.argname] = self.shared.get(fixturedef.argname, 0.0) + tree_seconds() - began

  @pytest.hookimpl(wrapper=True)
  def pytest_runtest_makereport(self, item, call):
    report = yield
    now = tree_seconds()
    spent, self.last = max(0.0, now - self.last), now  # less where a process leaves the tree that it came from
    shared, self.shared = self.shared, {}
    own = max(0.0, spent - sum(shared.values()))
    self.own = own if report.when == "setup" else self.own + own
    report.processor_seconds, report.shared_seconds = own, shared
    if report.when == "call" and report.passed and self.bounded:
      name = tier_of(report.keywords)
      over = [(f"this {name} test", self.own, TIERS[name].test)]
    elif report.when == "setup" and report.passed and self.bounded:
      name = tier_of(report.keywords)
      over = [(f"the fixture {fixture} of {name} tests", seconds, TIERS[name].fixture)
              for fixture, seconds in shared.items() if fixture != GARBAGE]
    else:
      over = []
    for what, seconds, bound in over:
      if seconds > bound * NOISE * self.slowness:
        factor = max(self.slowness, slowness())  # perhaps it is the machine, just now
        self.last = tree_seconds()
        if seconds > bound * NOISE * factor:
          report.outcome = "failed"
          report.longrepr = exceeded(what, seconds, bound, factor)
    return report


def exceeded(what, seconds, bound, slowness):
  return (f"{what} took {seconds:.1f} processor seconds; {bound:g} are allowed"
          f"{f', times {slowness:.1f} on a machine as slow as this' if slowness > 1.05 else ''}: make it smaller, "
          "share what it compiles, or give it another mark (docs/testing.md)")


class Times:
  """In the process that shows results: adds up what the workers measured, prints it, and fails a run whose tiers
  exceed their totals."""

  def __init__(self, file):
    self.file, self.rows, self.workers, self.began = file, {}, [], tree_seconds()

  def pytest_runtest_logreport(self, report):
    if not hasattr(report, "processor_seconds"):
      return
    row = self.rows.setdefault(report.nodeid, {"tier": tier_of(report.keywords), "seconds": 0.0, "shared": {}})
    row["seconds"] += report.processor_seconds
    row["shared"].update(report.shared_seconds)

  @pytest.hookimpl(optionalhook=True)
  def pytest_testnodedown(self, node):
    self.workers.append(getattr(node, "workeroutput", {}).get("start", {}))

  @property
  def slowness(self):
    return max((start["slowness"] for start in self.workers if start), default=1.0)

  def over_budget(self):
    """One line for each tier above its total."""
    sums = collections.Counter()
    for (tier, _), seconds in totals(self.rows).items():
      sums[tier] += seconds
    return [f"the {tier} tests took {sums[tier] / 60:.1f} processor minutes in all; {TIERS[tier].total / 60:g} are "
            f"allowed{f', times {self.slowness:.1f} on a machine as slow as this' if self.slowness > 1.05 else ''}"
            for tier in sums if sums[tier] > TIERS[tier].total * self.slowness]

  @pytest.hookimpl(trylast=True)
  def pytest_sessionfinish(self, session):
    if self.file:
      starts = [start for start in self.workers if start]
      pathlib.Path(self.file).write_text(json.dumps({"tests": self.rows, "workers": starts}, indent=0) + "\n")
    if not session.config.getoption("--no-bounds") and session.exitstatus == 0 and self.over_budget():
      session.exitstatus = pytest.ExitCode.TESTS_FAILED

  def pytest_terminal_summary(self, terminalreporter):
    write = terminalreporter.write_line
    for line in table(totals(self.rows)):
      write(line)
    longest = sorted(((row["seconds"], nodeid) for nodeid, row in self.rows.items()), reverse=True)[:SHOWN]
    write("longest: " + ", ".join(f"{nodeid.removeprefix('tests/')} {seconds:.1f}" for seconds, nodeid in longest
                                  if seconds > 1))
    starts = [start["seconds"] for start in self.workers if start]
    if starts:
      write(f"{len(starts)} workers started in {sum(starts) / len(starts):.0f} s each, imports and collection")
    if self.slowness > SLOW:
      write(f"this machine is {self.slowness:.1f} times slower than that of docs/lab/test-times.md, and bounds are "
            "wider by as much")
    for line in self.over_budget():
      write(line, red=True)


def totals(rows):
  """{(tier, room): seconds, with the fixtures that tests share} of rows by test."""
  totals = collections.Counter()
  for nodeid, row in rows.items():
    totals[row["tier"], room_of(nodeid)] += row["seconds"] + sum(row["shared"].values())
  return totals


def table(totals):
  """Lines of a Markdown table: processor seconds by room and tier, the largest room first."""
  rooms = collections.Counter()
  for (_, room), seconds in totals.items():
    rooms[room] += seconds
  tiers = [name for name in TIERS if any(tier == name for tier, _ in totals)]
  line = lambda name, cells: f"| {name} | " + " | ".join(f"{cell:.0f}" for cell in cells) + " |"
  yield "| processor seconds | " + " | ".join(tiers) + " | all |"
  yield "| --- |" + " ---: |" * (len(tiers) + 1)
  for room, whole in rooms.most_common():
    yield line(room, [*(totals[tier, room] for tier in tiers), whole])
  yield line("all", [*(sum(totals[tier, room] for room in rooms) for tier in tiers), sum(rooms.values())])


def add_options(parser):
  parser.addoption("--times", metavar="FILE", help="write the processor time of each test to a JSON file")
  parser.addoption("--no-bounds", action="store_true", help="fail no test for the processor time that it takes")


def configure(config):
  """Registers what measures where tests run, and what adds up where results are shown."""
  if not hasattr(config, "workerinput"):
    config.pluginmanager.register(Times(config.getoption("--times")), "processor times")


def collected(session):
  """After collection: measuring starts, and a worker keeps what starting it took."""
  config = session.config
  if config.option.collectonly or getattr(config.option, "dist", "no") != "no" and not hasattr(config, "workerinput") \
      and getattr(config.option, "tx", None):
    return
  meter = Meter(not config.getoption("--no-bounds"))
  config.pluginmanager.register(meter, "processor time meter")
  start = {"seconds": meter.last, "slowness": meter.slowness}
  if hasattr(config, "workeroutput"):
    config.workeroutput["start"] = start
  elif times := config.pluginmanager.get_plugin("processor times"):
    times.workers.append(start)
