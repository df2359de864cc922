"""Share of motions that do what their sentence says, evaluated by rules on the joints.

Seven lists, always reported apart: 225 sentences of this project in 17 categories, 317 captions in people's words, of
two halves, 150, 120, 99 and 161 further captions, and 200 sentences of KIT Motion-Language.

  python benchmarks/behaviour.py [--model cmdm-small ...] [--only turn path] [--pictures FOLDER] [--out FILE]
  python benchmarks/behaviour.py --captions humanml3d_test_captions.txt [--half final]      the captions
  python benchmarks/behaviour.py --captions humanml3d_test_captions.txt --half blind        the 150; blind2 to blind4
  python benchmarks/behaviour.py --captions kit_captions.jsonl --half kit        the 200
  python benchmarks/behaviour.py --real path/to/bandai path/to/cmu ...      the rules on real clips

Sentences and their rules: behaviour_sentences.py. Each model is measured three
times, always with pinned feet: one pass of the network with the prompt as given (one pass); with a plan, the best of
several attempts by the checks (best of 4); and the whole application, which also poses and corrects each attempt (with
corrections and poses). Prints, in Markdown, the share of each category in the three, with 95 % intervals by a bootstrap
over sentences, the speed of planted feet, and the result of each sentence. --out writes everything as JSON.
--pictures draws the first failing seed of each sentence of the application, or its first.
"""
import argparse
import collections
import json
import pathlib

import numpy as np
from behaviour_rules import FPS, body_of
from behaviour_sentences import BLIND, COUNTED, DEVELOPMENT, FINAL, KIT, PACED, REAL, captions, outside, sentences

from motion_jax import export
from motion_jax.data.datasets.archive import read_archive
from motion_jax.loading import load
from motion_jax.metrics.physics import planted_speed
from motion_jax_studio import Pipeline
from motion_jax_studio.checks import MAX_ATTEMPTS
from motion_jax_studio.pipeline import STEPS as STEPS_OF_APPLICATION

MOST = 24  # motions in one batch
ONE_PASS, BEST, CORRECTED = "one pass", f"best of {MAX_ATTEMPTS}", "with corrections and poses"
STEPS = {ONE_PASS: ("cleanup", "sample"), BEST: ("plan", "cleanup", "sample", "check"), CORRECTED: None}
DRAWS = 10_000  # of the bootstrap


def judge(pipeline, listed, seeds, pictures=None):
  """A row per sentence: dict(category, sentence, passed (a bool per seed), planted (m/s), seconds, kept (attempt))."""
  rows = []
  per_call = max(1, MOST // seeds)
  by_length = collections.defaultdict(list)
  for entry in listed:
    by_length[entry[3] or 0].append(entry)
  for seconds, entries in by_length.items():
    for first in range(0, len(entries), per_call):
      chunk = entries[first:first + per_call]
      # As many motions in every call, the last made more than once, so that a rest compiles nothing.
      full = [*chunk, *[chunk[-1]] * (per_call - len(chunk))]
      prompts = [sentence for _, sentence, *_ in full for _ in range(seeds)]
      sampled = pipeline(prompts, seconds=seconds or None, seeds=list(range(seeds)) * len(full))
      for index, (category, sentence, rule, _) in enumerate(chunk):
        motions = sampled[index * seeds:(index + 1) * seeds]
        passed = [bool(rule(body_of(motion.joints))) for motion in motions]
        rows.append(dict(category=category, sentence=sentence, passed=passed, seconds=len(motions[0].joints) / FPS,
                         planted=[float(planted_speed(motion.joints)) for motion in motions],
                         kept=[number_kept(motion) for motion in motions], noted=bool(pipeline.notes([sentence]))))
        if pictures:
          pictures.mkdir(parents=True, exist_ok=True)
          worst = passed.index(False) if False in passed else 0
          name = f"{category}_{sentence}_{sum(passed)}of{seeds}".replace(" ", "_").replace(",", "").replace(".", "")
          export.strip(motions[worst], pictures / f"{name}.png", caption=f"{sentence} ({sum(passed)} of {seeds})")
  return rows


def number_kept(motion):
  """The number of the attempt that was kept, from 1."""
  return next((attempt["number"] for attempt in motion.meta.get("attempts", ()) if attempt["kept"]), 1)


def table(rows_of, name):
  """The shares of categories in each column, and the sentences by their result, as lines.

  found: {column: rows}.
  """
  columns = list(rows_of)
  lines = [f"{name}: " + ", ".join(f"{column} {_share(rows_of[column])} {_interval(rows_of[column])}"
                                   for column in columns), "",
           f"| category | sentences | {' | '.join(columns)} | planted feet, m/s |", "| --- " * (3 + len(columns)) + "|"]
  for category in dict.fromkeys(row["category"] for row in rows_of[columns[0]]):
    of_category = {column: [row for row in rows if row["category"] == category] for column, rows in rows_of.items()}
    planted = np.mean([speed for row in of_category[columns[-1]] for speed in row["planted"]])
    lines.append(f"| {category} | {len(of_category[columns[0]])} | "
                 + " | ".join(_share(of_category[column]) for column in columns) + f" | {planted:.3f} |")
  for column, rows in rows_of.items():
    lines += ["", f"{column}:", *(f"{sum(row['passed'])} of {len(row['passed'])}  {row['category']}: {row['sentence']}"
                                  for row in sorted(rows, key=lambda row: sum(row["passed"])))]
  return lines


def summary(rows_of):
  """Shares of kinds that the shipped models' data shows and of the others, and failures without a note, as lines."""
  beyond, lines = outside(), []
  for column, rows in rows_of.items():
    known, other = ([row for row in rows if (row["category"] in beyond) == is_other] for is_other in (False, True))
    silent = [dict(passed=[not good and not row["noted"] for good in row["passed"]]) for row in other]
    lines.append(f"{column}: {_share(known)} {_interval(known)} of what the data shows; {_share(other)} of the rest, "
                 f"{_share(silent)} of it wrong without a note")
  return ["", *lines]


def _share(rows):
  good, number = (sum(measure(row["passed"]) for row in rows) for measure in (sum, len))
  return f"{good} of {number}, {100 * good / max(number, 1):.0f} %"


def _interval(rows):
  """The 95 % interval of a share in percent, as text: a bootstrap over sentences, each with all of its seeds."""
  passed = np.array([np.mean(row["passed"]) for row in rows])
  drawn = np.random.default_rng(0).integers(len(passed), size=(DRAWS, len(passed)))
  low, high = np.percentile(100 * passed[drawn].mean(1), [2.5, 97.5])
  return f"[{low:.0f}, {high:.0f}]"


def check_rules(folders):
  """A table of real clips: how many of each kind pass a rule, and how many of the others."""
  clips = [clip for folder in folders for clip in read_archive(folder, faults=[]) if clip.num_frames >= 1.2 * FPS]
  rows = {row["id"]: row for folder in folders
          for row in map(json.loads, pathlib.Path(folder, "captions.jsonl").read_text().splitlines())}
  bodies = {clip.id: body_of(clip.joints) for clip in clips}
  lines = [f"{len(clips)} clips", "",
           "| rule | clips of the kind | pass | share | others | pass | share | planted feet, m/s |",
           "| --- | --- | --- | --- | --- | --- | --- | --- |"]

  def add(name, passed, meant, others):
    if not meant:
      return
    good, wrong = sum(map(passed, meant)), [clip for clip in others if passed(clip)]
    most = ", ".join(f"{kind} {count}" for kind, count in collections.Counter(map(_label, wrong)).most_common(3))
    planted = np.mean([planted_speed(clip.joints.astype(np.float64)) for clip in meant])
    lines.append(f"| {name} | {len(meant)} | {good} | {100 * good / len(meant):.0f} % | {len(others)} | {len(wrong)}"
                 f"{f' ({most})' if most else ''} | {100 * len(wrong) / max(len(others), 1):.1f} % | {planted:.3f} |")

  for name, rule, labels, doubtful in REAL:
    add(name, lambda clip, rule=rule: rule(bodies[clip.id]), [clip for clip in clips if _label(clip) in labels],
         [clip for clip in clips if _label(clip) not in labels and _label(clip) != "Unknown"
          and not any(word in _label(clip) for word in doubtful)])
  for name, rule, labels in COUNTED:
    meant = [clip for clip in clips if _label(clip) in labels and rows[clip.id].get("reps")]
    add(name, lambda clip, rule=rule: rule(rows[clip.id]["reps"])(bodies[clip.id]), meant, [])
  for name, rule, styles, doubtful in PACED:
    walking = [clip for clip in clips if _label(clip) == "walk" and rows[clip.id].get("style")]
    add(name, lambda clip, rule=rule: rule(bodies[clip.id]),
         [clip for clip in walking if rows[clip.id]["style"] in styles],
         [clip for clip in walking if rows[clip.id]["style"] not in styles + doubtful])
  return lines


def _label(clip):
  return str(clip.meta.get("content") or clip.meta.get("label") or "")


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("--model", nargs="*", default=["cmdm-small"],
                      help="shipped names or run folders (default: cmdm-small)")
  parser.add_argument("--seeds", type=int, default=4)
  parser.add_argument("--only", nargs="*", help="categories (default: all)")
  parser.add_argument("--captions", type=pathlib.Path, help="the file of captions: judge those, not our own sentences")
  parser.add_argument("--half", choices=(DEVELOPMENT, FINAL, *BLIND, KIT), default=DEVELOPMENT,
                      help="which half of the captions; final: only for figures that end a piece of work; blind to "
                      "blind4: the further lists; kit: the list of KIT's sentences, with --captions kit_captions.jsonl")
  parser.add_argument("--real", nargs="*", default=[], help="archives of real motion: apply the rules to their "
                      "clips, and evaluate no model")
  parser.add_argument("--pictures", type=pathlib.Path, help="folder for a strip of each sentence")
  parser.add_argument("--out", type=pathlib.Path, help="JSON file for the results")
  args = parser.parse_args()
  if args.real:
    print(*check_rules(args.real), sep="\n")
    return
  every = captions(args.captions, args.half) if args.captions else sentences()
  listed = [entry for entry in every if not args.only or entry[0] in args.only]
  if not listed:
    parser.error(f"no such category; there are {', '.join(dict.fromkeys(entry[0] for entry in every))}")
  judged = {}
  for name in args.model:
    pictures = args.pictures and args.pictures / pathlib.Path(name).name
    model, judged[name] = load(name), {}
    for column, kept in STEPS.items():
      pipeline = Pipeline(model, [step for step in STEPS_OF_APPLICATION if kept is None or step.name in kept])
      judged[name][column] = judge(pipeline, listed, args.seeds, pictures if column == CORRECTED else None)
    print(*table(judged[name], name), *(summary(judged[name]) if args.captions else ()), sep="\n", flush=True)
    if args.out:
      args.out.write_text(json.dumps(judged, indent=1))


if __name__ == "__main__":
  main()
