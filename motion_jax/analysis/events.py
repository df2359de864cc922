"""Detect events in joints: walks, turns, kicks, raised and waving hands, jumps, squats, rests.

Every rule has a zone of doubt in which it detects nothing. Thresholds are metres, seconds and degrees of an adult,
calibrated on labelled clips (docs/captions.md). numpy, whole clips of HumanML3D's 22 joints.
"""
from typing import NamedTuple

import numpy as np

from motion_jax.analysis.signals import JOINT, PAIR, SIDES, Body, course_of, turning_points
from motion_jax.motion.contacts import majority, velocity
from motion_jax.motion.smoothing import find_peaks
from motion_jax.shapes import Array, Num

_G = 9.81
PUNCH = 2.2  # metres a second: least speed of a fist
_RISE = 1.5  # seconds: longest rise of a hand to above its shoulder
LONG = 0.4  # metres: least travel of the pelvis in the flight of a long jump


class Event(NamedTuple):
  """An action or state between two times of a motion, seconds.

  side: left, right, both or "". count: repetitions, 0 if uncertain. amount: speed of walk and run, metres a second;
  degrees to the left of turn; metres of jump and raise; degrees of knee or trunk of squat and bow; cycles a second of
  wave; else 0. way: direction of a walk (forward, backward, left, right, forward-left, ...) or jump, or "". path: of a
  walk: straight, curve, circle, u-turn, zigzag or ""; of a single jump forward: "long" beyond `LONG`.
  """
  kind: str
  start: float
  end: float
  side: str = ""
  count: int = 0  # type: ignore[assignment]  # shadows tuple.count
  amount: float = 0.0
  way: str = ""
  path: str = ""


def find_events(joints: Num[Array, "t 22 3"], fps: float = 20.0) -> list[Event]:
  """Detects the events of joints (T, 22, 3), metres, y up, sorted by start; none in less than half a second."""
  if len(joints) < max(0.5 * fps, 4):
    return []
  body = Body(np.asarray(joints, np.float64), fps)
  events = [event for rule in (_locomotion, _turns, _kicks, _hands, _punches, _arm_circles, _jumps, _squats, _bows,
                              _floor_reaches, _lies, _rests) for event in rule(body)]
  # Knees that bend before a jump or on the way to the ground are no squat. Several squats may have small jumps between.
  squats = sum(event.count for event in events if event.kind == "squat")
  if squats > 1:
    events = [event for event in events if event.kind != "jump" or event.count > 1 or event.amount > 0.2]
  others = [event for event in events if event.kind in ("jump", "hop", "reach-floor", "lie-down", "bow", "kick")]
  events = [event for event in events if event.kind != "squat" or not any(
      other.start - 0.8 < event.end and event.start < other.end + 0.8 for other in others)]
  # An arm raised in front of the body and lowered at its side describes a circle, too.
  hands = {event.side for event in events if event.kind in ("raise", "wave")}
  events = [event for event in events if event.kind != "arm-circle" or not hands or event.side == "both" == max(hands)]
  return sorted(events, key=lambda event: (event.start, event.end, event.kind, event.side))


# --- locomotion ------------------------------------------------------------------------------------------------------

_WAYS = (("forward", 0, 15), ("forward-{}", 20, 60), ("{}", 67, 113), ("backward-{}", 120, 148), ("backward", 155, 180))


def _locomotion(body):
  for first, past in body.spans(body.speed > 0.3, least=0.8, gap=0.4):
    path = body.smooth(body.path, 0.3)[first:past]
    steps = np.diff(path, axis=0)
    length = np.linalg.norm(steps, axis=-1).sum()
    if length < 0.7 or body.trunk[first:past].max() > 60 or body.pelvis[first:past].min() < 0.5:
      continue
    lifted = np.percentile(body.air[first:past], 90) - np.percentile(body.air[first:past], 10)
    pace = float(np.median(body.speed[first:past]))
    together = (np.abs(np.subtract(*body.joints[first:past, PAIR["foot"]].transpose(1, 0, 2)))[:, [0, 2]] ** 2).sum(-1)
    if np.sqrt(together.max()) < 0.35:  # no stride: hops, shuffles
      continue
    run = pace > 2.3 and lifted > 0.04 or pace > 1.8 and lifted > 0.05
    walk = pace < 1.75 and lifted < 0.045 or pace < 1.45 and lifted < 0.07
    kind = "run" if run else "walk" if walk else ""
    if kind:
      yield _event(body, kind, first, past, amount=pace, way=_way(body, first, past), path=_shape(path, length))


def _way(body, first, past):
  """Direction of a walk relative to the body, "" if uncertain or changing."""
  step = np.gradient(body.path, axis=0)[first:past]
  moving = body.speed[first:past] > 0.3
  angle = np.arctan2(step[:, 0], step[:, 1]) - body.heading[first:past]
  mean = np.exp(1j * angle[moving]).mean() if moving.any() else 0
  if abs(mean) < 0.93:
    return ""
  away = np.degrees(np.angle(mean))
  named = next((name for name, least, most in _WAYS if least <= abs(away) <= most), "")
  return named.format("left" if away > 0 else "right")


def _shape(path, length):
  """The shape of a path over the ground (N, 2)."""
  course = course_of(path)
  turned = course - course[0]
  chord = np.linalg.norm(path[-1] - path[0]) / length
  total = turned[-1]
  swing = np.diff(turned[turning_points(turned, 25.0)])
  if len(swing) >= 4 and chord > 0.5:
    return "zigzag"
  if chord > 0.97 and np.ptp(turned) < 25:
    return "straight"
  one_way = np.ptp(turned) < abs(total) + 25
  if abs(total) >= 300 and chord < 0.25 and one_way:
    return "circle"
  if 150 <= abs(total) <= 210 and chord < 0.8 and one_way:
    return "u-turn"
  return "curve" if 35 <= abs(total) <= 300 and one_way else ""


def _turns(body):
  """Turns of the heading, positive to the left, of at least 35 degrees."""
  rate = np.degrees(np.gradient(body.heading)) * body.fps
  for sign in (1, -1):
    for first, past in body.spans(sign * rate > 15, least=0.3, gap=0.3):
      angle = float(np.degrees(body.heading[past - 1] - body.heading[first]))
      if abs(angle) >= 35 and body.trunk[first:past].max() < 60:
        yield _event(body, "turn", first, past, side="left" if sign > 0 else "right", amount=angle)


# --- legs ------------------------------------------------------------------------------------------------------------


def _kicks(body):
  """Kicks: a fast, high foot on a stretched leg while the other foot stands."""
  height = body.joints[:, PAIR["foot"], 1]
  peaks = []
  for side in (0, 1):
    over = height[:, side] - height[:, 1 - side]
    for peak in find_peaks(over, height=0.35, distance=max(1, int(0.3 * body.fps)), prominence=0.25):
      near = slice(max(0, peak - int(0.4 * body.fps)), peak + int(0.4 * body.fps) + 1)
      fast, other = body.toes[near, side].max(), body.toes[near, 1 - side].max()
      if (fast > 3.5 and fast > 1.5 * other and body.knees[near, side][over[near] > 0.3].max() > 125
          and body.stands[near, 1 - side].mean() > 0.25 and body.air[near].max() < 0.2
          and np.median(body.speed[near]) < 1.5):
        peaks.append((near.start, min(near.stop, body.num), side))
  yield from _grouped(body, "kick", peaks, gap=2.5)


def feet_up(body: "Body") -> int:
  """Number of times that a foot rises 0.4 m above the other one while the body stays in place: kicks, and kick-like
  movements that are slow or with a bent leg."""
  height, near = body.joints[:, PAIR["foot"], 1], int(0.4 * body.fps)
  peaks = [peak for side in (0, 1) for peak in find_peaks(
      height[:, side] - height[:, 1 - side], height=0.4, distance=max(near, 1), prominence=0.25)]
  return sum(bool(np.median(body.speed[max(0, peak - near):peak + near + 1]) < 1.5) for peak in peaks)


def _jumps(body):
  """Flights: jumps from both feet, hops on one leg."""
  flights = []
  usual = np.median(body.pelvis)
  for first, past in body.spans(body.air > 0.05, least=0.1):
    rise = body.pelvis[first:past].max() - usual
    before, after = slice(max(0, first - int(0.3 * body.fps)), first), slice(past, past + int(0.3 * body.fps))
    whole = first > 0 and past < body.num
    if rise < 0.05:
      continue
    apart = body.joints[first:past, PAIR["foot"]]
    spread = np.linalg.norm((apart[:, 0] - apart[:, 1])[:, [0, 2]], axis=-1).max()
    uneven = np.abs(apart[:, 0, 1] - apart[:, 1, 1]).max()
    lifted = body.joints[:, PAIR["foot"], 1] - body.floor > 0.12
    legs = [side for side in (0, 1) if whole and min(lifted[near, 1 - side].mean() for near in (before, after)) > 0.6]
    moved = np.linalg.norm(body.joints[past - 1, 0, [0, 2]] - body.joints[first, 0, [0, 2]])
    seconds = (past - first) / body.fps
    height = float(rise) if abs(rise - _G * seconds ** 2 / 8) < 0.35 * rise + 0.03 else 0.0
    if legs:
      flights.append((first, past, "hop", SIDES[legs[0]], height, moved, whole))
    elif uneven < 0.25 and spread < 0.6 and rise > 0.08:
      flights.append((first, past, "jump", "", height, moved, whole))
  for kind, side in sorted({flight[2:4] for flight in flights}):
    same_kind = [flight for flight in flights if flight[2:4] == (kind, side)]
    for group in _near(same_kind, 2.5 * body.fps):
      first, past = group[0][0], group[-1][1]
      count = len(group) * all(flight[6] for flight in group)  # uncertain if the clip cuts off a flight
      if not any(flight[6] for flight in group):
        continue
      moved = np.mean([flight[5] for flight in group]) > 0.3
      heights = [flight[4] for flight in group]
      height = float(np.median(heights)) if min(heights) else 0.0
      way = _way(body, first, past) if moved else ""
      long = kind == "jump" and way == "forward" and len(group) == 1 and group[0][5] > LONG
      yield _event(body, kind, first, past, side=side, count=count, amount=height, way=way, path="long" if long else "")


def _squats(body):
  """Squats: both knees bend and stretch again, the trunk fairly upright, feet on the ground."""
  bent = body.knees.max(1)
  low = (bent < 105) & (body.trunk < 55) & (body.air < 0.15) & (body.pelvis > 0.2)
  down = []
  for first, past in body.spans(low, least=0.15, gap=0.2):
    rose = body.knees.max(1)[past:past + int(1.5 * body.fps)]
    sank = body.knees.max(1)[max(0, first - int(1.5 * body.fps)):first]
    if (past - first < 3 * body.fps and len(rose) and rose.max() > 130 and len(sank) and sank.max() > 130
        and body.speed[first:past].max() < 0.8):
      down.append((first, past, bent[first:past].min()))
  for group in _near(down, 2.5 * body.fps):
    depth = float(np.median([angle for _, _, angle in group]))
    yield _event(body, "squat", group[0][0], group[-1][1], count=len(group), amount=depth)


# --- trunk -----------------------------------------------------------------------------------------------------------


def _bows(body):
  """Bows: the trunk bends forward over straight knees, hands off the ground."""
  ahead = np.stack([np.sin(body.heading), 0 * body.heading, np.cos(body.heading)], -1)
  forward = ((body.joints[:, JOINT["neck"]] - body.joints[:, 0]) * ahead).sum(-1) > 0
  hands = body.joints[:, PAIR["wrist"], 1].min(1) - body.floor
  for first, past in body.spans((body.trunk > 30) & forward, least=0.2, gap=0.3):
    straight = body.knees[first:past].min() > 130
    if (straight and body.trunk[first:past].max() < 100 and hands[first:past].min() > 0.35 and first > 0
        and past < body.num and body.speed[first:past].max() < 0.6 and body.stands[first:past].all(1).mean() > 0.8
        and body.trunk[:first].min() < 20 and body.trunk[past:].min() < 20):
      yield _event(body, "bow", first, past, count=1, amount=float(body.trunk[first:past].max()))


def _floor_reaches(body):
  """Reaches to the floor: a hand moves to the ground and up again while the body stands on its feet."""
  hands = body.joints[:, PAIR["wrist"], 1] - body.floor
  for first, past in body.spans(hands.min(1) < 0.3, least=0.1, gap=0.4):
    lowest = hands[first:past].min(0)
    side = "both" if np.ptp(lowest) < 0.06 else SIDES[int(lowest.argmin())] if np.ptp(lowest) > 0.2 else ""
    feet = body.stands[first:past].any(1).mean() > 0.7 and body.pelvis[first:past].min() > 0.25
    if feet and first > 0 and past < body.num and hands[:first].min(1).max() > 0.5 and hands[past:].min(1).max() > 0.5:
      yield _event(body, "reach-floor", first, past, side=side, count=1)


def _lies(body):
  lying = (body.trunk > 65) & (body.pelvis < 0.3)
  for first, past in body.spans(lying, least=0.4, gap=0.5):
    if first > 0 and body.pelvis[:first].max() > 0.7 and past == body.num:
      yield _event(body, "lie-down", first, past)


# --- arms ------------------------------------------------------------------------------------------------------------


def _hands(body):
  """Raised and waving hands: above the shoulders, after rising from below.

  A hand that is up, or rising, at the beginning of the motion may wave, but is not raised. One that has been near its
  shoulder for longer does neither.
  """
  over = body.local("wrist", "shoulder")[..., 1]
  raised = majority(over > 0.0, body.fps)
  both, frames, spans = np.asarray(raised.all(1)), np.arange(body.num), []
  for side in (0, 1):
    for first, past in body.spans(raised[:, side], least=0.3, gap=0.5):
      start = max(0, first - int(_RISE * body.fps))
      comes_up = bool((over[start:first, side] < -0.25).any())
      top = first + int(over[first:past, side].argmax())
      if (comes_up or not start) and over[top, side] > 0.08 and body.elbows[top, side] > 65:
        spans.append((first, past, side, comes_up))
  for first, past, side, comes_up in spans:
    together = both[first:past].mean() > 0.6
    if together and side:
      continue
    named = "both" if together else SIDES[side]
    hangs = (over[:, 1 - side] < -0.2) & (first <= frames) & (frames < past)
    whole = together or hangs.sum() == past - first
    if not whole:  # a wave of one hand counts only while the other hand is lowered
      first, past = max(body.spans(hangs, least=1.0, gap=0.0), key=np.ptp, default=(0, 0))
    swings = [_swings(body, first, past, each) for each in ((0, 1) if named == "both" else (side,))]
    if all(count >= 3 for count, _, _ in swings):
      sure = len({count for count, _, _ in swings}) == 1 and all(sure for _, sure, _ in swings)
      yield _event(body, "wave", first, past, side=named, count=swings[0][0] if sure else 0,
                       amount=float(np.mean([rate for _, _, rate in swings])))
    elif comes_up and whole and all(count <= 1 for count, _, _ in swings):
      yield _event(body, "raise", first, past, side=named, count=1, amount=float(over[first:past, side].max()))


def _punches(body):
  """Punches: a fast fist, level and ahead, from a bent arm to a nearly stretched one, and back."""
  line, reach, fast, there = _fists(body)
  frames = lambda seconds: max(1, int(seconds * body.fps))
  peaks = []
  for side in (0, 1):
    for peak in find_peaks(fast[:, side], height=PUNCH, distance=frames(0.3)).tolist():
      before, soon = slice(max(0, peak - frames(0.4)), peak + 1), slice(peak, peak + frames(0.25))
      top = peak + int(reach[soon, side].argmax())
      near = slice(max(0, peak - frames(0.3)), min(peak + frames(0.3) + 1, body.num))
      if (there[soon, side].any() and np.median(body.speed[near]) < 1.5
          and body.elbows[before, side].min() < 110 and line[before, side, 1].min() > -0.35
          and reach[top, side] - reach[top:top + frames(0.6), side].min() > 0.1):
        peaks.append((near.start, near.stop, side))
  yield from _grouped(body, "punch", peaks, gap=0.8)


def _fists(body):
  """Signals of both fists: vector from the shoulder (T, 2, 3); of shape (T, 2) its length, the speed relative to the
  pelvis while the arm stretches (else 0), and whether the arm is nearly stretched, level and ahead."""
  line = body.local("wrist", "shoulder")
  reach = np.linalg.norm(line, axis=-1)
  out = np.gradient(body.smooth(reach, 0.05), axis=0) * body.fps
  speed = np.linalg.norm(velocity(body.joints[:, PAIR["wrist"]] - body.joints[:, :1], body.fps), axis=-1)
  there = (np.abs(line[..., 1]) < 0.22) & (line[..., 2] > 0.2) & (body.elbows > 115)
  return line, reach, np.where(out > 0.3, speed, 0.0), there


def punch_speed(body: "Body", side: str = "") -> float:
  """Largest speed, metres a second, of a fist of a side ("left", "right", "": either) before it reaches the end pose of
  a punch, whether or not it is one; 0 if it never does."""
  if body.num < 4:
    return 0.0
  _, _, fast, there = _fists(body)
  soon = max(1, int(0.25 * body.fps))
  reaches = np.stack([there[at:at + soon].any(0) for at in range(len(there))])
  speed = np.where(reaches, fast, 0.0).max(0)
  return float(speed.max() if not side else speed[("left", "right").index(side)])


def _swings(body, first, past, side):
  """(number of swings, whether it is certain, swings per second) of a raised hand."""
  line = body.local("wrist", "shoulder")[first:past, side]
  edge = int(0.25 * body.fps)  # a hand does not wave while it rises and falls
  line = line[edge:-edge] if len(line) > 4 * edge else line[:0]
  if len(line) < 4:
    return 0, False, 0.0
  slow = body.smooth(line, 0.6)
  line = line - slow
  axis = np.linalg.svd(line - line.mean(0), full_matrices=False)[2][0]
  wave = body.smooth(line @ axis, 0.05)
  reach = np.ptp(wave)
  if reach < 0.06:
    return 0, False, 0.0
  gap = max(1, int(0.2 * body.fps))
  tops, bottoms = (find_peaks(sign * wave, prominence=max(0.3 * reach, 0.05), distance=gap) for sign in (1, -1))
  count = max(len(tops), len(bottoms))
  period = np.median(np.diff(tops)) if len(tops) > 1 else len(wave)
  even = len(tops) > 2 and np.diff(tops).max() < 1.6 * np.diff(tops).min()
  sure = even and len(tops) == len(bottoms) and abs(_period(wave) - period) < 0.15 * period
  return count, bool(sure), body.fps / period


def _period(wave):
  """Period of a signal in frames, by autocorrelation; 0 if there is none."""
  wave = wave - wave.mean()
  same = np.correlate(wave, wave, mode="full")[len(wave) - 1:] / np.arange(len(wave), 0, -1)
  peaks = find_peaks(same[:max(4, int(0.7 * len(wave)))])
  return int(peaks[same[peaks].argmax()]) if len(peaks) else 0


def _arm_circles(body):
  """Arm circles: straight arms that turn about their shoulders by a full turn or more."""
  line = body.local("wrist", "shoulder")
  turned = np.degrees(np.unwrap(np.arctan2(line[..., 1], line[..., 2]), axis=0))  # ahead to up: backward
  aside = np.abs(line[..., 0]) / np.linalg.norm(line, axis=-1)
  total = turned[-1] - turned[0]
  going = [abs(total[side]) > 290 and np.ptp(turned[:, side]) < abs(total[side]) + 60
           and body.elbows[:, side].mean() > 125 and np.median(aside[:, side]) < 0.75 for side in (0, 1)]
  if any(going):
    side = "both" if all(going) and np.sign(total[0]) == np.sign(total[1]) else (
        SIDES[going.index(True)] if sum(going) == 1 else "")
    if side:
      angle = total[0 if side != "right" else 1]
      yield _event(body, "arm-circle", 0, body.num, side=side, way="backward" if angle > 0 else "forward")


# --- rests -----------------------------------------------------------------------------------------------------------


def _rests(body):
  """Rests: half a second or more in which no joint is faster than 0.1 m/s."""
  fastest = np.linalg.norm(velocity(body.joints, body.fps, 0.2), axis=-1).max(1)
  for first, past in body.spans(fastest < 0.1, least=0.5, gap=0.1):
    if body.trunk[first:past].max() < 25 and body.knees[first:past].min() > 140:
      yield _event(body, "still", first, past)


# --- groups ----------------------------------------------------------------------------------------------------------


def _event(body, kind, first, past, **about):
  """An event of the frames first:past."""
  return Event(kind, first / body.fps, past / body.fps, **about)


def _near(items, frames):
  """Groups of items (first, past, ...) that follow one another within `frames`."""
  groups: list[list] = []
  for item in sorted(items):
    if groups and item[0] - groups[-1][-1][1] <= frames:
      groups[-1].append(item)
    else:
      groups.append([item])
  return groups


def _grouped(body, kind, items, gap):
  """One event for each group of (first, past, side): of one side, or of both if they alternate."""
  for group in _near(items, gap * body.fps):
    sides = {side for _, _, side in group}
    yield _event(body, kind, group[0][0], group[-1][1], side=SIDES[sides.pop()] if len(sides) == 1 else "both",
                     count=len(group))
