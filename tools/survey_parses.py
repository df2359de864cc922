"""Print how sentences of a file are understood: plan, requirements and notes of a model.

  python tools/survey_parses.py humanml3d_test_captions.txt [--model cmdm-small] [--sample 150 --seed 40]

Prints a block per sentence, with its line from 1, and last the numbers of plans, of sentences with a requirement that
is checked, and of those with a note. Judgements by hand: docs/lab/parses.md.
"""
import argparse
import pathlib

import numpy as np

from motion_jax_studio import Pipeline


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("file", type=pathlib.Path, help="sentences, one a line")
  parser.add_argument("--model", default="cmdm-small")
  parser.add_argument("--sample", type=int, help="number of lines drawn at random; default: all")
  parser.add_argument("--seed", type=int, default=40)
  args = parser.parse_args()
  lines = args.file.read_text("utf-8").splitlines()
  rows = range(len(lines)) if args.sample is None else sorted(
      np.random.default_rng(args.seed).choice(len(lines), args.sample, replace=False).tolist())
  pipeline, plans, checked, noted = Pipeline(args.model), 0, 0, 0
  for row in rows:
    plan = pipeline.plan(lines[row])
    notes = pipeline.notes([plan])
    plans, checked, noted = plans + (not plan.is_plain), checked + bool(plan.requirements), noted + bool(notes)
    print(f"{row + 1}: {lines[row]}")
    print(f"  {'as it is' if plan.is_plain else plan.summary}; requires "
          f"{', '.join(' '.join(filter(None, one[:2])) for one in plan.requirements) or 'nothing that can be checked'}")
    print(*(f"  note: {note}" for note in notes), sep="\n", end="\n" if notes else "")
  print(f"{len(rows)} sentences: {plans} plans, {checked} with requirements, {noted} with notes")


if __name__ == "__main__":
  main()
