"""From a sentence to a file: what the command line costs with an empty program cache, and once it is filled.

  python benchmarks/time_to_motion.py --out time_to_motion.json            every kind of request, cold and then warm
  python benchmarks/time_to_motion.py --checkout FOLDER --out before.json  the same of another version of the code
  python benchmarks/time_to_motion.py --compare before.json after.json     both, side by side

Each request is a process of its own. The first column of every kind is its first request after those above it, in one
cache that was empty before the first of all; the warm columns are medians of later requests (--rounds). Seconds of
processors (user and system) and on the clock; "compiled": programs that XLA compiled in the first request and the
seconds which that took on the clock, by JAX's log of compilations. "studio" is the time from the start of
`motion-jax studio` to the first frame of a stream. A row during which other work used more than 0.2 cores is marked.
Three minutes on two quiet cores; --kinds chooses, also kinds that are not measured by default. --each-cold empties the
cache before every kind instead.
"""
import argparse
import json
import os
import pathlib
import re
import shlex
import shutil
import signal
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib

import machine  # benchmarks/machine.py, beside this file

from motion_jax_studio.client import Client

ROOT = pathlib.Path(__file__).parents[1]
WALK = "a person walks forward"
KINDS = {
    "plain": [WALK],
    "kicks twice": ["a person kicks twice"],
    "two prompts": ["a person walks forward, then waves"],
    "path": [WALK, "--path", "0,0 0,2 1,3"],
    "cdamd": [WALK, "--model", "cdamd-small"],
    "student": [WALK, "--model", "cmdm-small-fast"],
    "studio": None,
    "30 seconds": [WALK, "--seconds", "30"],
    "4 samples": [WALK, "--num-samples", "4"],
    "10 prompts": ["prompts.txt"],
}
DEFAULT = ("plain", "kicks twice", "two prompts", "path", "cdamd", "student", "studio")
PROMPTS = ("a person walks forward", "a person jumps up", "a person waves the right hand", "a person sits down",
           "a person turns left", "a person runs forward", "a person kicks", "a person walks backward",
           "a person bows", "a person steps to the side")
_COMPILED = re.compile(r"Finished XLA compilation of (\S+) in ([\d.]+) sec")
_HIT = re.compile(r"cache hit for '(\S+)'", re.IGNORECASE)


def command(checkout):
  """The start of a command line: that of the console script which the checkout's pyproject.toml declares."""
  scripts = tomllib.loads((checkout / "pyproject.toml").read_text())["project"]["scripts"]
  module, function = scripts["motion-jax"].split(":")
  return [sys.executable, "-c", f"import sys; sys.argv[0] = 'motion-jax'; from {module} import {function}; "
          f"sys.exit({function}())"]


def environment(checkout, folder):
  """Variables of a process that runs the code of checkout, with its cache in folder, and logs compilations."""
  env = dict(os.environ, PYTHONPATH=os.fspath(checkout), XDG_CACHE_HOME=os.fspath(folder / "cache"),
             XDG_STATE_HOME=os.fspath(folder / "state"), JAX_LOG_COMPILES="1")
  env.pop("JAX_COMPILATION_CACHE_DIR", None)
  return env


def request(checkout, folder, args):
  """Runs one command -> its measurements; folder: its home, with the cache."""
  env = environment(checkout, folder)
  with machine.cost() as cost:
    ran = subprocess.run(command(checkout) + args, env=env, cwd=folder, capture_output=True, text=True)
  if ran.returncode:
    lines = [line for line in ran.stderr.splitlines() if not line.startswith(("Finished", "Compiling"))]
    raise SystemExit(f"motion-jax {shlex.join(args)} of {checkout} ended with {ran.returncode}:\n" +
                     "\n".join(lines[-20:]))
  return dict(wall=cost.wall, processor=cost.processor, others=cost.others, **compiled(ran.stderr))


def first_frame(checkout, folder):
  """Starts a studio, reads the first block of a stream and stops it -> measurements; wall ends with that block."""
  with tempfile.TemporaryFile("w+", dir=folder) as log, machine.cost() as cost:
    start = time.perf_counter()
    studio = subprocess.Popen(command(checkout) + ["studio", "--port", "0", "--model", "cmdm-small"], cwd=folder,
                              env=environment(checkout, folder), stdout=subprocess.PIPE, stderr=log, text=True)
    try:
      address = studio.stdout.readline().split("is at ")[1].strip()
      with connected(Client(address)) as live:
        next(iter(live))
      wall = time.perf_counter() - start
    finally:
      studio.send_signal(signal.SIGINT)
      studio.communicate(timeout=60)
      log.seek(0)
      text = log.read()
  return dict(wall=wall, processor=cost.processor, others=cost.others, **compiled(text))


def connected(client, attempts=30):
  """A stream of a studio that may still be busy with its start, when a connection can time out."""
  for attempt in range(attempts):
    try:
      return client.stream(WALK, seed=0, speed=0)
    except TimeoutError:
      if attempt == attempts - 1:
        raise
  raise ValueError(f"got {attempts} attempts, expected at least one")


def compiled(log):
  """What JAX's log of compilations holds -> dict(programs, compile_seconds, longest: [[name, seconds], ...])."""
  hits, found = [name for name in _HIT.findall(log)], []
  for name, seconds in _COMPILED.findall(log):
    found.append((name, float(seconds)))
  return dict(programs=len(found) - len(hits), read=len(hits), compile_seconds=sum(seconds for _, seconds in found),
              longest=sorted(found, key=lambda one: -one[1])[:5])


def measure(checkout, kinds, rounds, each_cold):
  """{kind: dict(cold: a request's measurements, warm: [them, ...])}, after a request for help."""
  rows = {}
  with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    (folder / "prompts.txt").write_text("\n".join(PROMPTS) + "\n")
    request(checkout, folder, ["--help"])  # bytecode is written, files are read once: not what is measured
    rows["--help"] = dict(warm=[request(checkout, folder, ["--help"]) for _ in range(max(rounds, 1))])
    say("--help", rows["--help"])
    call = lambda kind: (first_frame(checkout, folder) if kind == "studio" else request(checkout, folder, [
        "generate", *KINDS[kind], "--seed", "0", "--out", f"{kind.replace(' ', '-')}.npz"]))
    for kind in kinds:
      if each_cold:
        shutil.rmtree(folder / "cache", ignore_errors=True)
      rows[kind] = dict(cold=call(kind), warm=[])
      if each_cold:
        rows[kind]["warm"] = [call(kind) for _ in range(rounds)]
      say(kind, rows[kind])
    for _ in range(0 if each_cold else rounds):
      for kind in kinds:
        rows[kind]["warm"].append(call(kind))
    if not each_cold:
      for kind in kinds:
        say(kind, dict(warm=rows[kind]["warm"]))
  return rows


def say(kind, row):
  parts = []
  if cold := row.get("cold"):
    parts.append(f"cold {cold['processor']:.1f} processor s, {cold['wall']:.1f} s, {cold['programs']} programs")
  if row["warm"]:
    parts.append(f"warm {median(row['warm'], 'processor'):.2f} processor s, {median(row['warm'], 'wall'):.2f} s")
  print(f"{kind}: {'; '.join(parts)}", file=sys.stderr, flush=True)


def median(rows, key):
  return statistics.median(row[key] for row in rows)


def table(found) -> str:
  """The measurements as a Markdown table, below a line about the machine."""
  lines = [f"{machine.words(found['machine'])}; commit {found['commit']}, {found['date']}.", "",
           "| request | cold, processor s | cold, s | compiled: programs | s | warm, processor s | warm, s | remark |",
           "| --- " * 8 + "|"]
  for kind, row in found["rows"].items():
    cold, warm = row.get("cold"), row["warm"]
    first = [f"{cold['processor']:.1f}", f"{cold['wall']:.1f}", str(cold["programs"]),
             f"{cold['compile_seconds']:.1f}"] if cold else [""] * 4
    later = [f"{median(warm, 'processor'):.2f}", f"{median(warm, 'wall'):.2f}"] if warm else [""] * 2
    others = [one["others"] for one in [*([cold] if cold else []), *warm] if one["others"] is not None]
    lines.append("| " + " | ".join([kind, *first, *later, machine.mark(max(others, default=None))]) + " |")
  return "\n".join(lines)


def comparison(before, after) -> str:
  """Two measurements side by side, processor seconds and seconds on the clock."""
  lines = [f"before: commit {before['commit']}, {before['date']}; after: commit {after['commit']}, {after['date']}; "
           f"{machine.words(after['machine'])}.", "",
           "| request | cold, processor s | cold, s | programs | warm, processor s | warm, s |", "| --- " * 6 + "|"]
  for kind, row in after["rows"].items():
    if (old := before["rows"].get(kind)) is None:
      continue
    cells = [pair(old, row, "cold", key, form) for key, form in (("processor", ".1f"), ("wall", ".1f"),
                                                                 ("programs", ".0f"))]
    cells += [pair(old, row, "warm", key, ".2f") for key in ("processor", "wall")]
    lines.append("| " + " | ".join([kind, *cells]) + " |")
  return "\n".join(lines)


def pair(old, row, part, key, form):
  """A number of two rows as "old → new", "" where one of them lacks it."""
  found = [one[part] if isinstance(one.get(part), list) else [one[part]] if one.get(part) else [] for one in (old, row)]
  return " → ".join(f"{median(one, key):{form}}" for one in found) if all(found) else ""


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("--checkout", type=pathlib.Path, default=ROOT, help="code to measure (this checkout)")
  parser.add_argument("--kinds", nargs="+", choices=KINDS, default=DEFAULT)
  parser.add_argument("--rounds", type=int, default=3, help="warm requests of each kind (3)")
  parser.add_argument("--each-cold", action="store_true", help="empty the cache before every kind")
  parser.add_argument("--out", type=pathlib.Path, help="JSON file to write")
  parser.add_argument("--compare", nargs=2, type=pathlib.Path, metavar=("BEFORE", "AFTER"))
  args = parser.parse_args()
  if args.compare:
    print(comparison(*(json.loads(path.read_text()) for path in args.compare)))
    return
  checkout = args.checkout.resolve()
  found = dict(commit=machine.commit(checkout), date=machine.today(), machine=machine.describe(), rounds=args.rounds,
               each_cold=args.each_cold, rows=measure(checkout, args.kinds, args.rounds, args.each_cold))
  print(table(found))
  if args.out:
    args.out.parent.mkdir(parents=True, exist_ok=True)
    args.out.write_text(json.dumps(found, indent=1) + "\n")
    print(f"wrote {args.out}")


if __name__ == "__main__":
  main()
