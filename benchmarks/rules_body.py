"""Rules on the way, the trunk and the whole body that only captions need (behaviour_rules.py has the others)."""
import numpy as np
from behaviour_rules import FPS, LEFT, RIGHT, above_shoulders, jumps, turned_course, walks

from motion_jax.analysis.signals import JOINT, PAIR, turning_points
from motion_jax.motion.contacts import velocity


def leads(low, high, least=0.6):
  """Ends `least` metres or more from where it began, low to high degrees from where it faced then (left positive)."""
  def rule(body):
    way = body.path[-1] - body.path[0]
    beyond = (np.degrees(np.arctan2(way[0], way[1]) - body.heading[0]) - low) % 360
    return bool(np.linalg.norm(way) >= least and beyond <= high - low)
  return rule


def goes(low, high):
  """Its way over the ground is low to high metres long."""
  return lambda body: low <= np.linalg.norm(np.diff(body.smooth(body.path, 0.3), axis=0), axis=-1).sum() <= high


def comes_back(body):
  """Goes a metre or more away, and ends within 45 % of the furthest distance."""
  away = np.linalg.norm(body.path - body.path[:1], axis=-1)
  return bool(away.max() > 0.8 and away[-1] < 0.45 * away.max())


def paces(count=1, least=0.4):
  """Goes to and fro along one line by `least` metres or more, and turns round `count` times or more."""
  def rule(body):
    way = body.path - body.path.mean(0)
    line = way @ np.linalg.svd(way, full_matrices=False)[2][0]
    return len(turning_points(line, least)) - 2 >= count
  return rule


def strolls(low, high):
  """Walks, maybe slowly, into a direction from low to high degrees."""
  return walks((low, high), (0.15, 1.8), 0.6)


def shifts(way, least=0.2):
  """Goes `least` metres or more, in all, into a direction as the body sees it (degrees, left positive)."""
  def rule(body):
    step = np.gradient(body.path, axis=0)
    there = (np.cos(np.arctan2(step[:, 0], step[:, 1]) - body.heading - np.radians(way)) > 0.6) & (body.speed > 0.12)
    return bool(np.linalg.norm(step, axis=-1)[there].sum() >= least)
  return rule


def strays(side, least):
  """At some time it is `least` metres or more to the side of where it began. side: 1 left, -1 right."""
  def rule(body):
    x, z = (body.path - body.path[0]).T
    return bool((side * (x * np.cos(body.heading[0]) - z * np.sin(body.heading[0]))).max() >= least)
  return rule


def turned(side, least=30):
  """At some time it turns by `least` degrees or more. side: 1 left, -1 right, 0 either."""
  return lambda body: bool(max(_most_rise(way * np.degrees(body.heading)) for way in (1, -1) if side != -way) >= least)


def whirls(side, least=300):
  """The hips turn by `least` degrees or more, however fast (`turned` smooths). side: 1 left, -1 right, 0 either."""
  return lambda body: bool(max(_most_rise(way * _yaw(body, "hip")) for way in (1, -1) if side != -way) >= least)


def veers(*sides, least=30):
  """The way over the ground turns by `least` degrees or more to these sides, one after another (1 left, -1 right)."""
  def rule(body):
    course, _ = turned_course(body)
    swings = np.diff(course[turning_points(course, least)])
    turns_taken = iter(np.sign(swings[np.abs(swings) >= least]))
    return all(side in turns_taken for side in sides)
  return rule


def _most_rise(values):
  return (values - np.minimum.accumulate(values)).max()


def swivels(count=0, least=30):
  """The shoulders turn by `least` degrees or more, and turn round `count` times or more."""
  def rule(body):
    x, _, z = (body.joints[:, PAIR["shoulder"][LEFT]] - body.joints[:, PAIR["shoulder"][RIGHT]]).T
    yaw = np.degrees(np.unwrap(np.arctan2(z, x)))
    return bool(np.ptp(yaw) >= least and len(turning_points(yaw, least)) - 2 >= count)
  return rule


def spins(side=0, degrees=300):
  """Turns round on one spot. side: 1 left, -1 right."""
  def rule(body):
    turned = np.degrees(np.ptp(np.unwrap(body.heading)))
    net = np.degrees(body.heading[-1] - body.heading[0])
    return bool(turned >= degrees and (not side or side * net > 0.5 * degrees))
  return rule


def halts(body):
  """Goes nowhere in the last half second."""
  return bool(body.speed[-int(0.5 * FPS):].max() < 0.25)


def climbs(least):
  """Ends so much higher, metres, than it began; a negative number: lower."""
  def rule(body):
    change = body.pelvis[-5:].mean() - body.pelvis[:5].mean()
    return bool(change >= least if least > 0 else change <= least)
  return rule


def stands_at_end(body):
  return bool(body.trunk[-5:].mean() < 25 and body.knees[-5:].mean() > 145 and body.speed[-5:].max() < 0.35)


def stands_last(body):
  """No joint is fast in the last 0.4 s."""
  return bool(np.linalg.norm(velocity(body.joints, FPS, 0.2), axis=-1)[-int(0.4 * FPS):].max() < 0.5)


def trunk_bends(body):
  return bool((body.trunk > 30).any())


def leans(side, degrees=5):
  """The neck is that far (degrees) to the side of the feet. side: 1 left, -1 right."""
  def rule(body):
    x, y, z = (body.joints[:, JOINT["neck"]] - body.joints[:, PAIR["ankle"]].mean(1)).T
    left = x * np.cos(body.heading) - z * np.sin(body.heading)
    return bool((side * np.degrees(np.arctan2(left, y))).max() >= degrees)
  return rule


def stoops(body):
  return bool(np.median(body.trunk) > 15)


def straightens(body):
  """The trunk is bent, and upright after that."""
  bent = np.flatnonzero(body.trunk > 30)
  return bool(len(bent) and body.trunk[bent[0]:].min() < 20)


def bent_back(body):
  """For a quarter of the time the neck is 6 degrees or more behind the pelvis."""
  x, y, z = (body.joints[:, JOINT["neck"]] - body.joints[:, 0]).T
  back = -np.degrees(np.arctan2(x * np.sin(body.heading) + z * np.cos(body.heading), y))
  return bool(np.percentile(back, 75) >= 6)


def staggers(body):
  """The trunk swings by 8 degrees."""
  return bool(np.ptp(body.smooth(body.trunk, 0.1)) >= 8)


def twists_right(body):
  """The shoulders turn by 15 degrees to the right of where they began."""
  return bool((_yaw(body, "shoulder")[0] - _yaw(body, "shoulder")).max() >= 15)


def twists_waist(body):
  """The shoulders turn by 20 degrees against the hips."""
  return bool(np.abs((_yaw(body, "shoulder") - _yaw(body, "hip") + 180) % 360 - 180).max() >= 20)


def _yaw(body, part):
  """Degrees (T,) to the left that the line between both shoulders or hips is turned."""
  x, _, z = (body.joints[:, PAIR[part][LEFT]] - body.joints[:, PAIR[part][RIGHT]]).T
  return -np.degrees(np.unwrap(np.arctan2(z, x)))


def rolls_head(body):
  """The head goes 3 cm or more to and fro, and so far to the sides, over the neck."""
  x, _, z = (body.joints[:, JOINT["head"]] - body.joints[:, JOINT["neck"]]).T
  sin, cos = np.sin(body.heading), np.cos(body.heading)
  return bool(np.ptp(x * cos - z * sin) >= 0.03 and np.ptp(x * sin + z * cos) >= 0.03)


def ducks(body):
  """The head sinks by 0.25 m or more."""
  head = body.joints[:, JOINT["head"], 1]
  return bool((np.maximum.accumulate(head) - head).max() >= 0.25)


def comes_up(body):
  """The head ends 0.2 m or more over its lowest."""
  head = body.joints[:, JOINT["head"], 1]
  return bool(head[-5:].mean() - head.min() >= 0.2)


def crouches(body):
  """The pelvis sinks by a fifth of its height or more, for half a second."""
  return bool(body.spans(body.pelvis < 0.8 * np.percentile(body.pelvis, 95), least=0.5))


def squatting(body):
  """Both knees are bent far for 40 % of the time."""
  return bool(np.mean(body.knees.max(1) < 130) > 0.4)


def seated(body):
  """For most of the time the pelvis is low, a knee bent and the trunk upright."""
  return bool(np.mean((body.knees.min(1) < 130) & (body.pelvis < 0.7) & (body.trunk < 60)) > 0.7)


def on_the_ground(body):
  """Sits on the ground: for half a second the pelvis is within 0.35 m of it, the head over it by 0.4 m or more."""
  high = body.joints[:, JOINT["head"], 1] - body.joints[:, 0, 1]
  return bool(body.spans((body.pelvis < 0.35) & (high > 0.4), least=0.5))


def head_bowed(body):
  """For half of the time the line from the neck to the head leans ahead by 50 degrees or more."""
  x, y, z = (body.joints[:, JOINT["head"]] - body.joints[:, JOINT["neck"]]).T
  return bool(np.median(np.degrees(np.arctan2(x * np.sin(body.heading) + z * np.cos(body.heading), y))) >= 50)


def kneels(body):
  """A knee comes within 0.2 m of the ground, the pelvis low."""
  knees = body.joints[:, PAIR["knee"], 1].min(1) - body.floor
  return bool(((knees < 0.2) & (body.pelvis < 0.75)).any())


def kneels_on(side):
  """That knee comes within 0.2 m of the ground, the pelvis low."""
  return lambda body: bool(((body.joints[:, PAIR["knee"][side], 1] - body.floor < 0.2) & (body.pelvis < 0.75)).any())


def crawls(body):
  """Hands and pelvis are low for a second or more."""
  hands = body.joints[:, PAIR["wrist"], 1].max(1) - body.floor
  return bool(body.spans((hands < 0.45) & (body.pelvis < 0.65), least=1.0))


def lies(body):
  """The head comes within 0.4 m of the ground."""
  return bool((body.joints[:, JOINT["head"], 1] - body.floor).min() < 0.4)


def push_ups(body):
  """Hands on the ground, trunk far from upright, and the shoulders turn round once or more by 8 cm."""
  level = (body.trunk > 50) & (body.joints[:, PAIR["wrist"], 1].max(1) - body.floor < 0.35)
  high = body.joints[:, PAIR["shoulder"], 1].mean(1)
  return any(len(turning_points(high[first:past], 0.08)) > 2 for first, past in body.spans(level, least=1.0))


def turns_over(count=1):
  """A foot is over the head, the pelvis not on the ground, `count` times or more."""
  return lambda body: len(body.spans((body.joints[:, PAIR["foot"], 1].max(1) > body.joints[:, JOINT["head"], 1])
                                     & (body.pelvis > 0.4), least=0.1, gap=0.2)) >= count


def takes_off(side):
  """At some time it leaves the ground, that foot last."""
  def rule(body):
    low = body.joints[:, [PAIR["ankle"], PAIR["foot"]], 1].min(1)
    return any(low[max(0, first - 1), side] < low[max(0, first - 1), 1 - side]
               for first, _ in body.spans(body.air > 0.06, least=0.1, gap=0.1))
  return rule


def jumps_often(least):
  """Jumps `least` times or more."""
  return lambda body: any(jumps(count)(body) for count in range(least, 40))


def dangles(body):
  """The trunk is bent for half a second, both hands under the shoulders."""
  return bool(body.spans((body.trunk > 30) & (above_shoulders(body).max(1) < -0.3), least=0.5))


def pauses(pace):
  """Is as fast as that, then nearly stands, then is as fast again."""
  def rule(body):
    return any(body.speed[:first].max(initial=0) > pace and body.speed[past:].max(initial=0) > pace
               for first, past in body.spans(body.speed < 0.5, least=0.15))
  return rule
