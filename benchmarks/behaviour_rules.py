"""Rules on joints: does a motion do what a sentence says? Each takes a `Body` (20 frames a second) and says yes or no.

Not the rules by which captions are made (motion_jax.analysis.events): these have no zone of doubt, for a model that
does
half of what is said has failed. Thresholds are metres, seconds and degrees; `python benchmarks/behaviour.py --real
ARCHIVES` tells how many real clips of each kind they pass, and how many others.
"""
import numpy as np
from scipy.signal import find_peaks

from motion_jax.analysis.signals import JOINT, PAIR, Body, course_of, turning_points
from motion_jax.motion.contacts import velocity

FPS = 20.0
LEFT, RIGHT = 0, 1


def body_of(joints, first=0, past=None):
  return Body(np.asarray(joints[first:past], np.float64), FPS)


# --- where the body goes ---------------------------------------------------------------------------------------------


def _course(body):
  """(length of the way, frames in which the body goes somewhere, degrees between its heading and its way)."""
  step = np.gradient(body.path, axis=0)
  going = body.speed > 0.3
  away = np.arctan2(step[:, 0], step[:, 1]) - body.heading
  mean = np.exp(1j * away[going]).mean() if going.any() else 0.0
  return float(np.linalg.norm(np.diff(body.path, axis=0), axis=-1).sum()), going, float(np.degrees(np.angle(mean)))


def walks(way=(-45, 45), pace=(0.35, 1.8), least=0.8):
  """Goes `least` metres or more at such a pace, on the ground, into a direction as the body sees it (left positive)."""
  def rule(body):
    length, going, away = _course(body)
    if length < least or going.sum() < 0.6 * FPS:
      return False
    low, high = way
    ahead = low <= away <= high or low <= away + 360 <= high
    upright = np.median(body.trunk) < 45 and np.median(body.pelvis) > 0.6
    return bool(ahead and upright and pace[0] <= np.median(body.speed[going]) <= pace[1] and not _flies(body))
  return rule


def _flies(body):
  """Whether both feet leave the ground by more than a walk lifts them, again and again."""
  return np.percentile(body.air, 90) - np.percentile(body.air, 10) > 0.12


def runs(pace=(1.8, 6.5)):
  """The fastest second is as fast as a run, forward."""
  def rule(body):
    length, going, away = _course(body)
    if length < 1.0 or len(body.speed) < FPS:
      return False
    best = np.convolve(body.speed, np.ones(int(FPS)) / FPS, mode="valid").max()
    return bool(abs(away) < 45 and pace[0] <= best <= pace[1])
  return rule


def _net_turn(body):
  count = max(1, min(5, body.num // 4))
  return float(np.degrees(body.heading[-count:].mean() - body.heading[:count].mean()))


def turns(low, high):
  """The heading changes in all by low to high degrees, to the left positive."""
  return lambda body: low <= _net_turn(body) <= high


def turns_around(body):
  return 130 <= abs(_net_turn(body)) <= 230


def turned_course(body):
  """Degrees by which the way over the ground turns in all, of the frames in which the body goes somewhere."""
  path = body.smooth(body.path, 0.3)[body.speed > 0.3]
  if len(path) < 10:
    return np.zeros(1), path
  return course_of(path), path


def circles(side=0):
  """Goes round by 270 degrees or more, in one sense. side: 1 left, -1 right, 0 either."""
  def rule(body):
    course, path = turned_course(body)
    total = course[-1] - course[0]
    length = np.linalg.norm(np.diff(path, axis=0), axis=-1).sum() if len(path) > 1 else 0.0
    return bool(abs(total) >= 270 and np.ptp(course) < abs(total) + 30 and length > 2.0 and side * total >= 0)
  return rule


def makes_a_u_turn(body):
  course, _ = turned_course(body)
  total = abs(course[-1] - course[0])
  return bool(140 <= total <= 225 and np.ptp(course) < total + 40)


def zigzags(body):
  course, path = turned_course(body)
  swings = len(turning_points(course, 25.0)) - 1
  chord = np.linalg.norm(path[-1] - path[0]) if len(path) else 0.0
  return bool(swings >= 3 and chord > 1.0)


def keeps_straight(body):
  course, _ = turned_course(body)
  return bool(np.ptp(course) < 45)


def stands_still(body):
  """No joint is faster than 0.33 m/s for most of the time, none is ever fast, and the body stays in place."""
  fastest = np.linalg.norm(velocity(body.joints, FPS, 0.2), axis=-1).max(1)
  moved = np.linalg.norm(body.path - body.path[:1], axis=-1).max()
  return bool(np.mean(fastest < 0.35) > 0.7 and fastest.max() < 1.2 and moved < 0.3 and np.median(body.trunk) < 30)


def stops(body):
  """Goes at least 0.8 m, and in the last 0.7 s nowhere."""
  last = int(0.7 * FPS)
  return bool(_course(body)[0] > 0.8 and (body.speed > 0.4).any() and body.speed[-last:].max() < 0.2)


def stays(body):
  """Does not leave its place."""
  return bool(np.linalg.norm(body.path - body.path[:1], axis=-1).max() < 0.7)


# --- arms ------------------------------------------------------------------------------------------------------------


def above_shoulders(body):
  """Height (T, 2) of the wrists over their shoulders."""
  return body.local("wrist", "shoulder")[..., 1]


def raises(left, right):
  """Which hands go over their shoulders: True must, False must not, None may."""
  def rule(body):
    top = above_shoulders(body).max(0)
    return bool(all(wanted is None or (height > 0.0) == wanted for wanted, height in zip((left, right), top)))
  return rule


def raises_one(body):
  return bool(above_shoulders(body).max() > 0.0)


def _swings(body, side):
  """How often a raised wrist turns round by 6 cm or more against its shoulder."""
  high = above_shoulders(body)[:, side] > -0.05
  if high.sum() < 0.5 * FPS:
    return 0
  line = body.local("wrist", "shoulder")[high, side]
  line = line - body.smooth(line, 0.6)
  axis = np.linalg.svd(line - line.mean(0), full_matrices=False)[2][0]
  return len(turning_points(line @ axis, 0.06)) - 2


def waves(left, right):
  """Which hands swing to and fro, raised: True must, False must not be raised for long, None may."""
  def rule(body):
    over = above_shoulders(body)
    for side, wanted in enumerate((left, right)):
      if wanted is True and _swings(body, side) < 3:
        return False
      if wanted is False and np.mean(over[:, side] > 0.0) > 0.2:
        return False
    return True
  return rule


def waves_one(body):
  return max(_swings(body, LEFT), _swings(body, RIGHT)) >= 3


def _punches(body, side):
  """Frames in which a fist is at its fastest on its way out: over 1.9 m/s against the pelvis, to an arm that is nearly
  stretched and nearly level, ahead."""
  wrist = body.joints[:, PAIR["wrist"][side]] - body.joints[:, 0]
  line = body.local("wrist", "shoulder")[:, side]
  out = np.gradient(body.smooth(np.linalg.norm(line, axis=-1), 0.05)) * FPS
  speed = np.linalg.norm(velocity(wrist, FPS), axis=-1)
  there = (np.abs(line[:, 1]) < 0.22) & (line[:, 2] > 0.2) & (body.elbows[:, side] > 115)
  peaks = find_peaks(np.where(out > 0.3, speed, 0.0), height=1.9, distance=int(0.3 * FPS))[0]
  return [peak for peak in peaks if there[peak:peak + 5].any()]


def punches(side=None):
  def rule(body):
    counts = [len(_punches(body, hand)) for hand in (LEFT, RIGHT)]
    return bool(max(counts) if side is None else counts[side])
  return rule


# --- legs ------------------------------------------------------------------------------------------------------------


def kick_peaks(body, side):
  """Frames in which a foot is highest over the other one, 0.3 m or more, after 2.2 m/s or more."""
  height = body.joints[:, PAIR["foot"], 1]
  over = height[:, side] - height[:, 1 - side]
  peaks = find_peaks(over, height=0.3, distance=int(0.4 * FPS), prominence=0.2)[0]
  near = lambda peak: slice(max(0, peak - int(0.4 * FPS)), peak + int(0.4 * FPS))
  return [peak for peak in peaks if body.toes[near(peak), side].max() > 2.2 and body.air[near(peak)].max() < 0.25
          and np.median(body.speed[near(peak)]) < 1.5]


def kicks(side=None, count=None):
  """side: the foot, None either. count: how often, None once or more."""
  def rule(body):
    numbers = [len(kick_peaks(body, foot)) for foot in (LEFT, RIGHT)]
    number = sum(numbers) if side is None else numbers[side]
    if side is not None and numbers[1 - side]:
      return False
    return number >= 1 if count is None else number == count
  return rule


def _jumps(body):
  """Spans in which both feet are off the ground and the pelvis is higher than usual."""
  usual = np.median(body.pelvis)
  return [span for span in body.spans(body.air > 0.06, least=0.1, gap=0.1)
          if body.pelvis[span[0]:span[1]].max() > usual + 0.06]


def jumps(count=None, ahead=None):
  """count: how often, None once or more. ahead: metres that all of it must lead forward."""
  def rule(body):
    number = len(_jumps(body))
    if not number or count is not None and number != count:
      return False
    face = np.array([np.sin(body.heading[0]), np.cos(body.heading[0])])
    return ahead is None or bool((body.path[-1] - body.path[0]) @ face > ahead)
  return rule


def squats(count=None):
  def rule(body):
    bent = body.knees.max(1)
    deep = [span for span in body.spans(bent < 115, least=0.15, gap=0.2)
            if bent[:span[0]].max(initial=0) > 130 and bent[span[1]:].max(initial=0) > 130]
    low = body.air.max() < 0.25 and body.pelvis.min() > 0.15
    return bool(low and (len(deep) >= 1 if count is None else len(deep) == count))
  return rule


def sits(body):
  """The pelvis sinks by 0.12 m or more and stays there for half a second, trunk upright, knees bent."""
  low = (body.pelvis < body.pelvis.max() - 0.12) & (body.knees.min(1) < 130) & (body.speed < 0.3)
  return any(np.median(body.trunk[first:past]) < 60 for first, past in body.spans(low, least=0.5))


def gets_up(body):
  return bool(body.pelvis[:10].min() < body.pelvis[-10:].max() - 0.2)


def on_one_leg(body):
  """One foot is off the ground for a second while the other stands."""
  height = body.joints[:, PAIR["foot"], 1] - body.floor
  return any(body.spans((height[:, side] > 0.12) & (height[:, 1 - side] < 0.12), least=1.0) for side in (LEFT, RIGHT))


# --- trunk and all of it ---------------------------------------------------------------------------------------------


def _bends(body):
  ahead = np.stack([np.sin(body.heading), 0 * body.heading, np.cos(body.heading)], -1)
  forward = ((body.joints[:, JOINT["neck"]] - body.joints[:, 0]) * ahead).sum(-1) > 0
  return [span for span in body.spans((body.trunk > 28) & forward, least=0.2, gap=0.3)
          if body.trunk[:span[0]].min(initial=90) < 22 and body.trunk[span[1]:].min(initial=90) < 25]


def bows(count=None):
  """The trunk bends forward by 28 degrees or more, and comes up again, on one spot."""
  def rule(body):
    number = len(_bends(body))
    return bool(stays(body) and (number >= 1 if count is None else number == count))
  return rule


def dances(body):
  """Hands and feet move for most of the time, and it is no walk to somewhere."""
  hands = np.linalg.norm(velocity(body.joints[:, PAIR["wrist"]] - body.joints[:, :1], FPS), axis=-1).max(1)
  feet = np.linalg.norm(velocity(body.joints[:, PAIR["foot"]], FPS), axis=-1).max(1)
  away = np.linalg.norm(body.path[-1] - body.path[0])
  return bool(np.mean(hands > 0.25) > 0.6 and np.mean(feet > 0.25) > 0.5 and away < max(1.0, 0.6 * _course(body)[0]))


# --- several ---------------------------------------------------------------------------------------------------------


def both(*rules):
  return lambda body: all(rule(body) for rule in rules)


def either(*rules):
  return lambda body: any(rule(body) for rule in rules)


def none_of(*rules):
  return lambda body: not any(rule(body) for rule in rules)


def in_order(*rules, grid=0.3):
  """One after another: the motion can be cut so that each part obeys its rule, and none has obeyed the next before."""
  def rule(body):
    cuts = np.arange(int(0.5 * FPS), body.num - int(0.5 * FPS) + 1, int(grid * FPS))
    known = {}

    def holds(index, first, past):
      if (index, first, past) not in known:
        known[index, first, past] = bool(rules[index](body_of(body.joints, first, past)))
      return known[index, first, past]

    def fits(index, first):
      if index == len(rules) - 1:
        return body.num - first >= 0.5 * FPS and holds(index, first, body.num)
      return any(holds(index, first, cut) and not holds(index + 1, first, cut) and fits(index + 1, cut)
                 for cut in map(int, cuts) if cut - first >= 0.5 * FPS)

    return fits(0, 0)
  return rule


def at_once(*rules):
  """Within the same two seconds, and that in a quarter or more of all pairs of seconds."""
  def rule(body):
    length = min(int(2 * FPS), body.num)
    held = [all(rule(body_of(body.joints, first, first + length)) for rule in rules)
            for first in range(0, body.num - length + 1, int(0.4 * FPS))]
    return bool(np.mean(held) >= 0.25)
  return rule


def in_turn(*rules, grid=0.2):
  """One after another: each part, as short as can be, obeys its rule, and the rest the last. Unlike `in_order` it lets
  a part obey the next rule, too."""
  def rule(body):
    first, least = 0, int(0.5 * FPS)
    for part in rules[:-1]:
      cuts = range(first + least, body.num - least + 1, int(grid * FPS))
      first = next((cut for cut in cuts if part(body_of(body.joints, first, cut))), None)
      if first is None:
        return False
    return bool(rules[-1](body_of(body.joints, first)))
  return rule
