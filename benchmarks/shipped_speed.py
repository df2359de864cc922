"""How fast the models that ship make motion, beside one another in one run on this machine.

  python benchmarks/shipped_speed.py [--models cmdm-small cmdm-small-fast] [--rounds 7]

Models take turns, round after round. Columns, medians in milliseconds: the first block of a stream, from the call to
joints; each next block; 6 seconds at once without cleanup, words read before, and how many frames a second that is;
the same with all that `generate` does (cleanup, one try). Everything is compiled before it is timed. Rows of cmdm-small
with 50 steps and guidance 3 are how it shipped before its third pass.
"""
import argparse
import functools
import statistics
import time

import jax

from motion_jax import loading

FRAMES, BLOCKS = 120, 12
PROMPT = "a person walks forward"
COLUMNS = ("model", "first block, ms", "next block, ms", "6 s, ms", "frames a second", "6 s, cleaned, ms")


def timed(act):
  start = time.perf_counter()
  act()
  return 1000 * (time.perf_counter() - start)


def one_round(model, options, seed):
  """(first block, next block, 6 s, 6 s cleaned) in milliseconds."""
  stream = model.stream(PROMPT, seed=seed, **options)
  first = timed(lambda: jax.block_until_ready(next(stream)))
  following = [timed(lambda: jax.block_until_ready(next(stream))) for _ in range(BLOCKS)]
  make = functools.partial(model.generate, [PROMPT], num_frames=FRAMES, seeds=[seed], **options)
  whole, cleaned = (timed(functools.partial(make, cleanup=cleanup)) for cleanup in (False, True))
  return first, statistics.median(following), whole, cleaned


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("--models", nargs="+", default=["cmdm-small", "cmdm-small-fast"])
  parser.add_argument("--rounds", type=int, default=7)
  args = parser.parse_args()
  rows = []
  for name in args.models:
    model = loading.load(name)
    rows.append((name, model, {}))
    if name == "cmdm-small":
      rows.append(("cmdm-small, 50 steps, guidance 3", model, dict(num_steps=50, guidance_scale=3.0)))
  for _, model, options in rows:
    one_round(model, options, 0)
  found = [[] for _ in rows]
  for seed in range(1, args.rounds + 1):
    for row, (_, model, options) in zip(found, rows):
      row.append(one_round(model, options, seed))
  lines = []
  for (name, _, _), own in zip(rows, found):
    first, following, whole, cleaned = map(statistics.median, zip(*own))
    lines.append((name, f"{first:.0f}", f"{following:.1f}", f"{whole:.0f}", f"{1000 * FRAMES / whole:.0f}",
                  f"{cleaned:.0f}"))
  for line in (COLUMNS, ["---"] * len(COLUMNS), *lines):
    print("| " + " | ".join(line) + " |")


if __name__ == "__main__":
  main()
