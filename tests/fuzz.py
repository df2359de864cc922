"""A fuzzer of our own: damaged inputs of every kind, by the thousand, each the same again from its seed.

  python -m tests.fuzz --cases 10000               a table of what came of them; exit status 1 where something failed
  python -m tests.fuzz --cases 500 --kind npz,bvh  of some kinds only
  python -m tests.fuzz --replay npz:0:123          one case (kind, seed, number) again, with its files and its traceback

A case is `accepted`, or refused in one line of our own words. Everything else is a failure: a traceback; an error that
some library wrote (`not our words`: it was not raised by a statement of this package, or has more than one line); more
than 10 s of the processor; more than 2 GB of memory; and, after a refusal, anything left in the folder of outputs that
was not there before. Failures are saved below --out with their files.

Cases run in processes of their own, which are watched from outside and replaced if they hang.
"""
import argparse
import collections
import contextlib
import io
import json
import multiprocessing
import multiprocessing.connection
import opcode
import os
import pathlib
import resource
import shutil
import sys
import tempfile
import time
import traceback
import warnings
from typing import NamedTuple

import numpy as np

SECONDS, GIGABYTES = 10, 2
PATIENCE = 90  # seconds by the clock after which a process that uses no processor time hangs, too
ROOT = pathlib.Path(__file__).parents[1]
RESULTS = ("accepted", "refused", "traceback", "not our words", "over 10 s", "over 2 GB", "half-written")
FAILURES = RESULTS[2:]


class Outcome(NamedTuple):
  """What came of a case: one of RESULTS, the words that were said, what was run, processor seconds, MB that it took."""
  result: str
  told: str = ""
  what: str = ""
  seconds: float = 0.0
  megabytes: int = 0


# --- one case ----------------------------------------------------------------------------------------------------


def run_case(kind, seed, number, folder, show=False) -> Outcome:
  """Makes case `number` of a kind in an empty folder and runs it there."""
  from tests.fuzz_kinds import KINDS
  rng = np.random.default_rng((seed, sum(map(ord, kind)), number))
  made = folder / "out"
  made.mkdir(parents=True)
  try:
    case = KINDS[kind][1](rng, folder)
  except Exception as error:
    return Outcome("traceback", "while the case was made: " + "".join(traceback.format_exception(error))[-3000:])
  if rng.random() < 0.3:  # what lies there already must survive a refusal
    (made / "made.npz").write_bytes(b"before")
  before, out, err = _contents(made), io.StringIO(), io.StringIO()
  _reset_peak()
  held, start, here = _peak(), time.process_time(), os.getcwd()  # a test's process holds what other tests left
  try:
    os.chdir(folder)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), warnings.catch_warnings():
      warnings.simplefilter("always")
      try:
        result, told = _judged(case.call)
      except SystemExit as end:  # argparse: usage, and a line that says what is wrong
        result, told = ("accepted", "") if not end.code else ("refused", err.getvalue().strip().split("\n")[-1])
  except BaseException as error:
    if show:
      traceback.print_exc()
    result, told = "traceback", "".join(traceback.format_exception(error))[-3000:]
  finally:
    os.chdir(here)
  seconds, megabytes = time.process_time() - start, _peak() - held
  after = _contents(made)
  if result == "refused" and after != before:
    result, told = "half-written", f"{sorted(after.keys() ^ before.keys()) or 'changed'} after: {told}"
  elif result == "accepted" and any(part.startswith(".") for name in after for part in pathlib.Path(name).parts):
    result, told = "half-written", f"{sorted(after)}"
  elif result == "accepted" and " encountered in " in err.getvalue():
    result, told = "not our words", err.getvalue()
  if result not in FAILURES:
    result = "over 10 s" if seconds > SECONDS else "over 2 GB" if megabytes > 1000 * GIGABYTES else result
  if show:
    print(f"{out.getvalue()}{err.getvalue()}")
  return Outcome(result, told[:3000], case.what, seconds, megabytes)


def _judged(call):
  """(result, told) of call(), whose errors the command line would catch."""
  from motion_jax_studio import cli
  known, message = cli._KNOWN_ERRORS, cli._message
  cli._message = lambda error: None  # they come here, with where they were raised
  try:
    call()  # a status of 1 without an error is the doctor's: it has told what is wrong
  except known as error:
    told = str(error)
    chain = [error]
    while (one := chain[-1].__cause__ or chain[-1].__context__) is not None and one not in chain:
      chain.append(one)
    if any(isinstance(one, MemoryError) for one in chain):
      return "over 2 GB", "".join(traceback.format_exception(error))
    if not _raised_by_us(error) or not told.strip() or len(told.split("\n")) > 1 or len(told) > 1000:
      return "not our words", "".join(traceback.format_exception(error))
    return "refused", told
  except MemoryError as error:
    return "over 2 GB", "".join(traceback.format_exception(error))
  finally:
    cli._message = message
  return "accepted", ""


def _raised_by_us(error):
  """Whether an error comes from a raise statement of our packages, not from a library that stumbled."""
  last = error.__traceback__
  while last.tb_next is not None:
    last = last.tb_next
  code = last.tb_frame.f_code
  return (code.co_filename.startswith((str(ROOT / "motion_jax"), str(ROOT / "motion_jax_studio")))
          and code.co_code[last.tb_lasti] == opcode.opmap["RAISE_VARARGS"])


def _contents(folder):
  size = lambda path: path.stat().st_size
  return {path.relative_to(folder).as_posix(): "" if path.is_dir() else path.read_bytes() if size(path) < 1000
          else size(path) for path in folder.rglob("*")}


def _reset_peak():
  with contextlib.suppress(OSError):
    pathlib.Path("/proc/self/clear_refs").write_text("5")


def _peak():
  """The most memory that this process has held since `_reset_peak`, MB; where Linux does not tell, since it began."""
  try:
    status = pathlib.Path("/proc/self/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) // 1000
  except (OSError, IndexError):
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000


# --- many cases --------------------------------------------------------------------------------------------------


def _work(pipe, home):
  """A process that runs one case after the other, each in a folder that is gone afterwards."""
  os.environ["XDG_CACHE_HOME"] = str(home / "cache")
  from tests.fuzz_kinds import check_stubs, stub_networks
  stub_networks()
  check_stubs(home / "healthy")
  if os.path.exists("/proc/self/statm"):  # what wants much more fails here, instead of taking the machine's memory
    size = int(pathlib.Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (size + (GIGABYTES + 4) * 10**9,) * 2)
  pipe.send(None)
  with contextlib.suppress(EOFError):
    while case := pipe.recv():
      folder = home / "case"
      shutil.rmtree(folder, ignore_errors=True)
      pipe.send(run_case(*case, folder))


class _Worker:
  """One such process, and what it is at."""

  def __init__(self, home):
    self.home = pathlib.Path(tempfile.mkdtemp(dir=home))
    context = multiprocessing.get_context("spawn")
    self.pipe, other = context.Pipe()
    self.process = context.Process(target=_work, args=(other, self.home), daemon=True)
    self.process.start()
    other.close()
    self.case, self.since, self.ready, self.over = None, (0.0, 0.0), False, False

  def look(self):
    """The Outcome of its case once there is one; afterwards it is `over` if it cannot take another."""
    if self.pipe.poll():
      try:
        outcome = self.pipe.recv()
        self.ready = True
        return outcome
      except (EOFError, OSError):
        self.over = True
        self.process.join()
        return Outcome("traceback", f"the process ended with status {self.process.exitcode}")
    used, waited = self.used() - self.since[1], time.monotonic() - self.since[0]
    if self.case is not None and (used > SECONDS + 2 or waited > PATIENCE):
      self.over = True
      return Outcome("over 10 s", f"no end after {used:.0f} s of the processor, {waited:.0f} s by the clock", "", used)
    return None

  def give(self, case):
    self.case, self.since = case, (time.monotonic(), self.used())
    self.pipe.send(case)

  def used(self):
    """Processor seconds so far."""
    try:
      fields = pathlib.Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
      return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    except (OSError, IndexError):
      return time.monotonic()

  def end(self):
    self.process.kill()
    self.process.join()
    self.pipe.close()


def plan(cases, seed, kinds=None):
  """[(kind, seed, number)] of so many cases, kinds mixed by their shares."""
  from tests.fuzz_kinds import KINDS
  shares = {name: share for name, (share, _) in KINDS.items() if not kinds or name in kinds}
  total, made, due, numbers = sum(shares.values()), [], collections.Counter(), collections.Counter()
  for _ in range(cases):
    for name, share in shares.items():
      due[name] += share / total
    name = max(due, key=due.get)
    due[name] -= 1
    made.append((name, seed, numbers[name]))
    numbers[name] += 1
  return made


def run(cases, workers=2, out=None):
  """{kind: Counter of RESULTS and of what they cost} of a plan's cases, and [(case, Outcome)] of those that failed.

  These are saved in out."""
  waiting, table, failures = list(reversed(cases)), collections.defaultdict(collections.Counter), []
  with tempfile.TemporaryDirectory() as home:
    crew = [_Worker(home) for _ in range(min(workers, len(cases)))]
    try:
      done = 0
      while done < len(cases):
        multiprocessing.connection.wait([worker.pipe for worker in crew], timeout=0.5)
        for place, worker in enumerate(crew):
          outcome = worker.look()
          if outcome is not None and worker.case is None:
            raise RuntimeError(f"the fuzzer's own process does not start: {outcome.told}")
          if outcome is not None:
            done += 1
            row = table[worker.case[0]]
            row[outcome.result] += 1
            row["seconds"] += outcome.seconds
            row["slowest s"] = max(row["slowest s"], outcome.seconds)
            row["most MB"] = max(row["most MB"], outcome.megabytes)
            if outcome.result in FAILURES:
              failures.append((worker.case, outcome))
              if out is not None:
                _save(worker, outcome, pathlib.Path(out))
            if done % 500 == 0:
              print(f"{done} cases, {len(failures)} failures", file=sys.stderr, flush=True)
            worker.case = None
          if worker.over:
            worker.end()
            crew[place] = _Worker(home)
          elif worker.ready and worker.case is None and waiting:
            worker.give(waiting.pop())
    finally:
      for worker in crew:
        worker.end()
  return table, failures


def _save(worker, outcome, out):
  folder = out / "-".join(map(str, worker.case))
  shutil.rmtree(folder, ignore_errors=True)
  if (worker.home / "case").is_dir():
    shutil.copytree(worker.home / "case", folder)
  folder.mkdir(parents=True, exist_ok=True)
  about = {"case": ":".join(map(str, worker.case)), **outcome._asdict()}
  (folder / "case.json").write_text(json.dumps(about, indent=1) + "\n")


def format_table(table) -> str:
  """Kinds down, results across, with sums."""
  lines = [f"{'kind':<12}{'cases':>7}" + "".join(f"{name:>15}" for name in RESULTS) + f"{'slowest':>11}{'most':>9}"]
  total = sum(table.values(), collections.Counter())
  for name in ("slowest s", "most MB"):
    total[name] = max(row[name] for row in table.values())
  for name, row in [*sorted(table.items()), ("all", total)]:
    counts = [row[result] for result in RESULTS]
    lines.append(f"{name:<12}{sum(counts):>7}" + "".join(f"{count:>15}" for count in counts)
                 + f"{row['slowest s']:>9.1f} s{row['most MB']:>6.0f} MB")
  return "\n".join(lines)


def main(argv=None):
  parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Damaged inputs by the thousand.")
  parser.add_argument("--cases", type=int, default=1000, help="how many (1000)")
  parser.add_argument("--seed", type=int, default=0, help="another seed, other cases (0)")
  parser.add_argument("--kind", help="of these kinds only, parted by commas")
  parser.add_argument("--workers", type=int, default=2, help="processes (2)")
  parser.add_argument("--out", default="fuzz-failures", help="folder where failures are saved (fuzz-failures)")
  parser.add_argument("--replay", metavar="KIND:SEED:NUMBER", help="run one case again, here, with its traceback")
  args = parser.parse_args(argv)
  from tests.fuzz_kinds import KINDS, check_stubs, stub_networks
  kinds = args.kind.split(",") if args.kind else None
  if args.replay:
    stub_networks()
    kind, seed, number = args.replay.split(":")
    folder = pathlib.Path(args.out) / "replay"
    shutil.rmtree(folder, ignore_errors=True)
    check_stubs(folder.absolute() / "healthy")
    outcome = run_case(kind, int(seed), int(number), folder.absolute() / "case", show=True)
    print(f"{outcome.told}\n{outcome.what}\n{outcome.result}, {outcome.seconds:.1f} s, {outcome.megabytes} MB; "
          f"files in {folder}")
    return int(outcome.result in FAILURES)
  if kinds and set(kinds) - set(KINDS):
    parser.error(f"got --kind {args.kind}, expected some of {', '.join(KINDS)}")
  start = time.monotonic()
  table, failures = run(plan(args.cases, args.seed, kinds), args.workers, args.out)
  print(format_table(table))
  print(f"seed {args.seed}, {args.workers} processes, {time.monotonic() - start:.0f} s")
  for case, outcome in failures[:20]:
    last = outcome.told.strip().split("\n")[-1]
    print(f"{':'.join(map(str, case))}  {outcome.result}: {last[:200]}")
  if failures:
    print(f"{len(failures)} failures, saved in {args.out}")
  return int(bool(failures))


if __name__ == "__main__":
  sys.exit(main())
