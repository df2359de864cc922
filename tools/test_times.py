"""Write docs/lab/test-times.md: the processor time of the tests by room and tier, cold and warm.

  python tools/test_times.py                              runs the quick and slow tests from an empty cache, and again
  python tools/test_times.py --cold A.json --warm B.json  from files of `pytest --times FILE`, of this machine

The figures are those of tests/processor_time.py: processor seconds of tests, of fixtures that they share and of the
processes that they start.
"""
import argparse
import datetime
import json
import os
import pathlib
import platform
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from tests import processor_time  # noqa: E402

PAGE = ROOT / "docs" / "lab" / "test-times.md"
SHOWN = 30


def measure(file, cache):
  """Runs the quick and slow tests and writes their times to a file."""
  command = [sys.executable, "-m", "pytest", "-q", "-n", "auto", "-m", "not exhaustive", "--no-bounds",
             "--times", str(file)]
  subprocess.run(command, cwd=ROOT, check=True, env=os.environ | {"XDG_CACHE_HOME": str(cache)})


def processor():
  lines = pathlib.Path("/proc/cpuinfo").read_text().splitlines() if pathlib.Path("/proc/cpuinfo").exists() else []
  models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
  return models[0] if models else platform.processor() or platform.machine()


def section(title, times):
  """Lines of one run: totals by room and tier, the counts, what starting took."""
  rows = times["tests"]
  counts = {tier: sum(row["tier"] == tier for row in rows.values()) for tier in processor_time.TIERS}
  started = sum(start["seconds"] for start in times["workers"])
  yield f"## {title}"
  yield ""
  yield (", ".join(f"{count:,} {tier} tests" for tier, count in counts.items() if count)
         + f"; starting {len(times['workers'])} workers took {started:.0f} s more.")
  yield ""
  yield from processor_time.table(processor_time.totals(rows))
  yield ""


def page(cold, warm):
  rows = cold["tests"]
  yield f"""# Processor time of the tests

{datetime.date.today()}, {platform.python_implementation()} {platform.python_version()}, {os.cpu_count()} cores of
{processor()}. Written by `python tools/test_times.py`. Processor seconds, since walls mislead on shared cores; what
each tier may take stands in `tests/processor_time.py`: {'; '.join(
    f"{name}: {tier.test:g} s a test, {tier.total / 60:g} minutes in all"
    for name, tier in processor_time.TIERS.items() if tier.total < float("inf"))}.
"""
  yield from section("From an empty cache", cold)
  if warm:
    yield from section("With compiled programs kept from the run before", warm)
  yield from (f"## The {SHOWN} longest tests, from an empty cache", "", "| test | tier | s |", "| --- | --- | ---: |")
  for nodeid, row in sorted(rows.items(), key=lambda item: -item[1]["seconds"])[:SHOWN]:
    yield f"| `{nodeid.removeprefix('tests/')}` | {row['tier']} | {row['seconds']:.1f} |"


def main(argv=None):
  parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
  parser.add_argument("--cold", type=pathlib.Path, help="times of a run from an empty cache")
  parser.add_argument("--warm", type=pathlib.Path, help="times of a second run")
  parser.add_argument("--out", type=pathlib.Path, default=PAGE, help=f"the page ({PAGE.relative_to(ROOT)})")
  args = parser.parse_args(argv)
  if args.warm and not args.cold:
    parser.error("got --warm without --cold; the page needs a run from an empty cache")
  if args.cold:
    times = [json.loads(path.read_text()) if path else None for path in (args.cold, args.warm)]
  else:
    with tempfile.TemporaryDirectory() as folder:
      files = [pathlib.Path(folder, name) for name in ("cold.json", "warm.json")]
      for file in files:
        measure(file, pathlib.Path(folder, "cache"))
      times = [json.loads(file.read_text()) for file in files]
  args.out.write_text("\n".join(page(*times)) + "\n")
  print(f"wrote {args.out}")


if __name__ == "__main__":
  main()
