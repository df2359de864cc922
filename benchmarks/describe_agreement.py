"""How often do captions by kinematics and the sources' labels agree? Over the archives, statement by statement.

  python benchmarks/describe_agreement.py path/to/bandai path/to/cmu path/to/cmu2 path/to/hdm05 [--pictures FOLDER]

A label states something ("kick front, left leg", twice); the rules of `motion.events` find it, find something else, or
find nothing. Prints two markdown tables: statements of labels with what the rules found, and, for each kind of event,
the clips of labels that do not speak of it in which it is found all the same. --pictures draws what disagrees.
"""
import argparse
import collections
import json
import pathlib
from typing import NamedTuple

from motion_jax import export
from motion_jax.analysis.describe import UNKNOWN, spoken_of
from motion_jax.analysis.event_words import pace
from motion_jax.analysis.events import Event, find_events
from motion_jax.data.datasets.archive import read_archive


class Statement(NamedTuple):
  """What the labels of some clips state: kind of event, and found(event, row) -> whether an event of it agrees."""
  name: str
  labels: tuple[str, ...]
  kind: str
  found: object


def _side(side):
  return lambda event, row: event.side == side


def _way(way):
  return lambda event, row: event.way == way


def _times(event, row):
  return event.count == row["reps"]


def _any(event, row):
  return True


STATEMENTS = [
    *(Statement(f"{kind} {side}", (f"{content}-{side}-hand{'s' * (side == 'both')}",), kind, _side(side))
      for kind, content in (("raise", "raise-up"), ("wave", "wave")) for side in ("left", "right", "both")),
    Statement("raise right (grab high)", ("grab high, right hand",), "raise", _side("right")),
    Statement("kick left", ("kick front, left leg",), "kick", _side("left")),
    Statement("kick: how often", ("kick front, left leg",), "kick", _times),
    Statement("squat", ("squat",), "squat", _any),
    Statement("squat: how often", ("squat",), "squat", _times),
    Statement("jump forward", ("hop on both legs", "forward jump"), "jump", _way("forward")),
    Statement("jump: how often", ("hop on both legs",), "jump", _times),
    Statement("jump", ("jump",), "jump", _any),
    Statement("turn left", ("walk-turn-left", "jog left circle, 4 steps"), "turn", _side("left")),
    Statement("turn right", ("walk-turn-right",), "turn", _side("right")),
    Statement("turn by 90 degrees", ("walk-turn-left", "walk-turn-right"), "turn",
              lambda event, row: 70 <= abs(event.amount) <= 110),
    Statement("walk forward", ("walk", "slow walk", "sneak 2 steps, left start"), "walk", _way("forward")),
    Statement("walk backward", ("walk-back",), "walk", _way("backward")),
    Statement("walk to the left", ("walk-left",), "walk", _way("left")),
    Statement("walk to the right", ("walk-right",), "walk", _way("right")),
    Statement("run", ("run", "dash", "run/jog", "jog left circle, 4 steps"), "run", _any),
    Statement("circle", ("jog left circle, 4 steps",), "run", lambda event, row: event.path == "circle"),
    Statement("bow", ("bow",), "bow", _any),
    Statement("to the floor, right hand", ("deposit item on floor, right hand",), "reach-floor", _side("right")),
    Statement("lie down", ("lie down on floor",), "lie-down", _any),
    Statement("circle arms backward", ("rotate both arms backward",), "arm-circle", _way("backward")),
]
# Styles of the walks, runs and waves that bear on the pace: which pace they mean.
PACES = {"exhausted": "slowly", "elderly": "slowly", "old": "slowly", "tired": "slowly", "sad": "slowly",
         "not-confident": "slowly", "active": "quickly", "angry": "quickly"}


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("folders", nargs="+")
  parser.add_argument("--pictures", help="folder for strips of the clips of which rule and label disagree")
  parser.add_argument("--most", type=int, default=3, help="pictures of a statement")
  args = parser.parse_args()
  clips, rows = [], {}
  for folder in args.folders:
    clips += read_archive(folder, faults=[])
    lines = pathlib.Path(folder, "captions.jsonl").read_text().splitlines()
    rows |= {row["id"]: row for row in map(json.loads, lines)}
  events = {clip.id: find_events(clip.joints, clip.fps) for clip in clips}
  print(f"{len(clips)} clips\n\n| label states | clips | found | something else | nothing | precision |\n"
        "|---|---|---|---|---|---|")
  for statement in STATEMENTS:
    _tell(statement, clips, rows, events, args)
  for kind in ("walk", "run", "wave"):
    for said in ("slowly", "quickly"):
      _tell_pace(kind, said, clips, events)
  _tell_false_alarms(clips, events)


def _label(clip):
  return str(clip.meta.get("content") or clip.meta.get("label") or "")


def _tell(statement, clips, rows, events, args):
  counts, odd = collections.Counter(), []
  for clip in clips:
    row = rows[clip.id]
    if _label(clip) not in statement.labels or statement.found is _times and not row.get("reps"):
      continue
    own = [event for event in events[clip.id] if event.kind == statement.kind]
    sure = [event for event in own if statement.found is not _times or event.count]
    if statement.found in (_any, _times):
      others = sure
    else:  # an event that leaves open what the label states says nothing
      others = [event for event in sure if event.side or event.way or event.path]
    kind = "found" if any(statement.found(event, row) for event in sure) else "other" if others else "nothing"
    counts[kind] += 1
    if kind == "other" or kind == "nothing":
      odd.append((kind != "other", clip))
  told = counts["found"] + counts["other"]
  precision = f"{100 * counts['found'] / told:.1f} %" if told else "-"
  print(f"| {statement.name} | {counts.total()} | {counts['found']} | {counts['other']} | {counts['nothing']} | "
        f"{precision} |", flush=True)
  if args.pictures:
    for _, clip in sorted(odd, key=lambda pair: pair[0])[:args.most]:
      path = pathlib.Path(args.pictures, f"{statement.name}_{clip.id}".replace(" ", "_").replace(":", "") + ".png")
      path.parent.mkdir(parents=True, exist_ok=True)
      found = " ".join(" ".join(str(part) for part in (e.kind, e.side, e.way, e.path, e.count or "") if part)
                       for e in events[clip.id])
      export.strip(clip, path, caption=f"{_label(clip)} | {found or 'nothing'}", height=240)


def _tell_pace(kind, said, clips, events):
  """Of the clips of a style that means a pace: how often the rule says it, says the opposite, says nothing."""
  counts = collections.Counter()
  for clip in clips:
    style = PACES.get(str(clip.meta.get("style"))) or ("slowly" if _label(clip).startswith("slow ") else None)
    own = {pace(event) for event in spoken_of(events[clip.id], _label(clip)) if event.kind == kind}
    if style == said and own:
      counts["found" if said in own else "other" if own - {""} else "nothing"] += 1
  told = counts["found"] + counts["other"]
  print(f"| {kind} {said} (a style) | {counts.total()} | {counts['found']} | {counts['other']} | {counts['nothing']} | "
        f"{100 * counts['found'] / max(told, 1):.1f} % |")


def _tell_false_alarms(clips, events):
  print("\n| event | clips whose labels do not speak of it | found all the same | share |\n|---|---|---|---|")
  alarms, silent = collections.defaultdict(collections.Counter), collections.Counter()
  kinds = sorted({event.kind for own in events.values() for event in own})
  for clip in clips:
    words = " ".join([_label(clip), *(caption.text for caption in clip.captions)])
    for kind in kinds:
      if UNKNOWN.search(words) or spoken_of([Event(kind, 0, 1)], words):
        continue
      silent[kind] += 1
      alarms[kind][_label(clip)] += any(event.kind == kind for event in events[clip.id])
  for kind in kinds:
    found = alarms[kind].total()
    most = ", ".join(f"{name} {count}" for name, count in alarms[kind].most_common(3) if count)
    print(f"| {kind} | {silent[kind]} | {found} ({most}) | {100 * found / max(silent[kind], 1):.1f} % |")


if __name__ == "__main__":
  main()
