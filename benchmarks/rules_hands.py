"""Rules on arms and hands that only captions need (behaviour_rules.py has the others)."""
import numpy as np
from behaviour_rules import FPS, LEFT, RIGHT, above_shoulders, both, either

from motion_jax.analysis.signals import JOINT, PAIR, turning_points
from motion_jax.motion.contacts import velocity


def reaches_head(side):
  """A hand comes within 0.28 m of the head. side: which one; None: either."""
  def rule(body):
    away = np.linalg.norm(body.joints[:, PAIR["wrist"]] - body.joints[:, [JOINT["head"]]], axis=-1).min(0)
    return bool(away.min() < 0.28 if side is None else away[side] < 0.28)
  return rule


def spreads_arms(body):
  """Both hands are half a metre or more from the trunk, to the sides."""
  out = np.abs(body.local("wrist", "shoulder")[..., 0]) > 0.3
  return bool(out.all(-1).any())


def hands_meet(body):
  """The hands come within 0.2 m of each other."""
  hands = body.joints[:, PAIR["wrist"]]
  return bool(np.linalg.norm(hands[:, 0] - hands[:, 1], axis=-1).min() < 0.2)


def reaches_low(body):
  """A hand comes within 0.45 m of the ground."""
  return bool((body.joints[:, PAIR["wrist"], 1] - body.floor).min() < 0.45)


def lifts_hand(side):
  """A hand comes up to 0.2 m under its shoulder, or higher."""
  return lambda body: bool(body.local("wrist", "shoulder")[:, side, 1].max() > -0.2)


def lifts_one(body):
  return lifts_hand(LEFT)(body) or lifts_hand(RIGHT)(body)


def reaches_out(side, ahead=False):
  """A hand is 0.35 m or more from its shoulder (ahead: to the front), and not far under it."""
  def rule(body):
    line = body.local("wrist", "shoulder")[:, side]
    away = line[:, 2] if ahead else np.hypot(line[:, 0], line[:, 2])
    return bool(((away > 0.35) & (line[:, 1] > -0.25)).any())
  return rule


def reaches_aside(side):
  """A hand is 0.35 m or more out from its shoulder to its own side, and not far under it."""
  sign = 1 if side == LEFT else -1
  return hand_is(side, lambda left, up, ahead: (sign * left > 0.35) & (up > -0.25))


def sweeps(side, count=1, least=0.15):
  """A hand goes sideways by `least` metres or more, and turns round `count` times or more."""
  def rule(body):
    left = body.local("wrist", "shoulder")[:, side, 0]
    return bool(np.ptp(left) >= least and len(turning_points(left, least)) - 2 >= count)
  return rule


def lowers(side):
  """A hand ends 0.3 m or more under its shoulder, after it was higher by 0.15 m."""
  def rule(body):
    last = above_shoulders(body)[-5:, side].mean()
    return bool(last < -0.3 and above_shoulders(body)[:, side].max() > last + 0.15)
  return rule


def pumps(side, count=3, least=0.12):
  """A hand goes up and down against its shoulder by `least` metres, and turns round `count` times or more."""
  return lambda body: len(turning_points(above_shoulders(body)[:, side], least)) - 2 >= count


def _top_speed(body):
  return np.linalg.norm(velocity(body.joints[:, PAIR["wrist"]] - body.joints[:, :1], FPS), axis=-1).max(0)


def fast(side, least=1.9):
  """A hand is as fast as that against the pelvis, metres a second."""
  return lambda body: bool(_top_speed(body)[side] >= least)


def throws(side=None, least=2.0):
  """A hand is lifted, and as fast as that, and no slower than the other."""
  def rule(body):
    top = _top_speed(body)
    return any(lifts_hand(hand)(body) and top[hand] >= max(least, top[1 - hand])
               for hand in (LEFT, RIGHT) if side in (None, hand))
  return rule


def hand_at(side, joint, away=0.25):
  """A hand (None: either) comes so near to a joint."""
  def rule(body):
    near = np.linalg.norm(body.joints[:, PAIR["wrist"]] - body.joints[:, [JOINT[joint]]], axis=-1).min(0)
    return bool((near.min() if side is None else near[side]) < away)
  return rule


def reaches_down(side):
  """That hand comes within 0.45 m of the ground."""
  return lambda body: bool((body.joints[:, PAIR["wrist"][side], 1] - body.floor).min() < 0.45)


def bends_elbow(side):
  return lambda body: bool(body.elbows[:, side].min() < 110)


def strokes(body):
  """The hands go apart and together by 0.25 m, again and again."""
  hands = body.joints[:, PAIR["wrist"]]
  return len(turning_points(np.linalg.norm(hands[:, 0] - hands[:, 1], axis=-1), 0.25)) >= 4


def _away(body, side, joint):
  return np.linalg.norm(body.joints[:, PAIR["wrist"][side]] - body.joints[:, JOINT[joint]], axis=-1)


def _way(body, line, there):
  """Metres that a line (T, 3) moves in the frames `there`."""
  return np.linalg.norm(np.gradient(body.smooth(line, 0.05), axis=0), axis=-1)[there].sum()


def gestures(side, least=0.4):
  """A hand moves by `least` metres or more in all while it is 0.35 m under its shoulder or higher, and does not run."""
  def rule(body):
    there = (above_shoulders(body)[:, side] > -0.35) & (body.speed < 1.2)
    return bool(_way(body, body.local("wrist", "shoulder")[:, side], there) >= least)
  return rule


def rubs(side, joint, away=0.3, least=0.25):
  """A hand (None: either) moves by `least` metres or more, in all, so near to a joint."""
  def rule(body):
    return any(_way(body, body.joints[:, PAIR["wrist"][hand]] - body.joints[:, JOINT[joint]],
                    _away(body, hand, joint) < away) >= least for hand in (LEFT, RIGHT) if side in (None, hand))
  return rule


def works(side, count=3, least=0.06):
  """A hand goes to and fro against its shoulder by `least` metres, and turns round `count` times or more."""
  def rule(body):
    line = body.local("wrist", "shoulder")[:, side]
    line = line - body.smooth(line, 0.6)
    axis = np.linalg.svd(line - line.mean(0), full_matrices=False)[2][0]
    return len(turning_points(line @ axis, least)) - 2 >= count
  return rule


def circles_hand(side, count=1, least=0.1):
  """A hand goes round against its shoulder, `least` metres wide or more, by 300 degrees for each time."""
  def rule(body):
    line = body.smooth(body.local("wrist", "shoulder")[:, side], 0.06)
    going = np.linalg.norm(np.gradient(line, axis=0), axis=-1) * FPS > 0.25
    if going.sum() < 0.4 * FPS:
      return False
    flat = (line - line[going].mean(0)) @ np.linalg.svd(line[going] - line[going].mean(0), full_matrices=False)[2][:2].T
    course = np.angle(np.gradient(flat, axis=0) @ [1, 1j])
    round_ = np.degrees(np.cumsum(np.where(going[1:] & going[:-1], np.angle(np.exp(1j * np.diff(course))), 0.0)))
    return bool(np.ptp(round_) >= 300 * count and np.ptp(flat[going, 1]) >= least)
  return rule


def on_hip(side):
  """A hand is within 0.3 m of its hip, the elbow bent."""
  joint = ("left_hip", "right_hip")[side]
  return lambda body: bool(((_away(body, side, joint) < 0.3) & (body.elbows[:, side] < 130)).any())


def on_knees(left, right):
  """At some time just these hands are within 0.3 m of their knees."""
  def rule(body):
    return bool((((_away(body, LEFT, "left_knee") < 0.3) == left)
                 & ((_away(body, RIGHT, "right_knee") < 0.3) == right)).any())
  return rule


def carries(*sides, least=0.15):
  """The middle of the hands is to these sides of the pelvis, one after another, as the body faced at first: 1 left,
  -1 right, 0 the middle."""
  def rule(body):
    x, _, z = (body.joints[:, PAIR["wrist"]].mean(1) - body.joints[:, 0]).T
    left = x * np.cos(body.heading[0]) - z * np.sin(body.heading[0])
    where = iter(np.where(np.abs(left) < least / 2, 0, np.where(np.abs(left) >= least, np.sign(left), 9)))
    return all(side in where for side in sides)
  return rule


def swings_club(body):
  """The hands are together for half a second, and then as fast as 1.9 metres a second."""
  hands = body.joints[:, PAIR["wrist"]]
  speed = np.linalg.norm(velocity(hands.mean(1) - body.joints[:, 0], FPS), axis=-1)
  near = np.linalg.norm(hands[:, 0] - hands[:, 1], axis=-1) < 0.35
  return any(speed[first:past].max() >= 1.9 for first, past in body.spans(near, least=0.5))


def over_head(body):
  """Both hands are over the head joint at once."""
  return bool((body.joints[:, PAIR["wrist"], 1].min(1) > body.joints[:, JOINT["head"], 1]).any())


def lifts_load(count, least=0.3):
  """The hands rise by `least` metres or more, `count` times."""
  def rule(body):
    high = body.joints[:, PAIR["wrist"], 1].mean(1)
    return int((np.diff(high[turning_points(high, least)]) >= least).sum()) == count
  return rule


def half_up(side):
  """The hand is mostly half way up, or higher."""
  return lambda body: bool(np.median(above_shoulders(body)[:, side]) > -0.4)


def flexes(side, count=3):
  """The elbow bends and stretches by 40 degrees, `count` times or more."""
  return lambda body: len(turning_points(body.elbows[:, side], 40)) - 2 >= count


def behind(side):
  """The hand is once behind its shoulder."""
  return lambda body: bool((body.local("wrist", "shoulder")[:, side, 2] < -0.1).any())


def hangs(body):
  """Both hands hang at the end."""
  return bool((above_shoulders(body)[-5:].mean(0) < -0.3).all())


def _height(body, side):
  return body.joints[:, PAIR["wrist"][side], 1]


def _rise(values):
  return (values - np.minimum.accumulate(values)).max()


def _apart(body):
  """Metres (T,) between the hands."""
  hands = body.joints[:, PAIR["wrist"]]
  return np.linalg.norm(hands[:, 0] - hands[:, 1], axis=-1)


def hand_is(side, test, share=0.0):
  """For more than that share of the time test(left, up, ahead) of a hand against its shoulder is true."""
  return lambda body: bool(np.mean(test(*body.local("wrist", "shoulder")[:, side].T)) > share)


def keeps_at(side, *shares, elbow=180):
  """For half of the time or more a hand is within 0.3 m of its thigh, at such shares of the way to the knee."""
  def rule(body):
    hip, knee = body.joints[:, PAIR["hip"][side]], body.joints[:, PAIR["knee"][side]]
    hand = body.joints[:, PAIR["wrist"][side]]
    near = np.min([np.linalg.norm(hand - hip - share * (knee - hip), axis=-1) for share in shares], axis=0) < 0.3
    return bool(np.mean(near & (body.elbows[:, side] < elbow)) > 0.5)
  return rule


def in_lap(body):
  """Both hands are over the thighs at once, the knees bent."""
  x, y, z = np.moveaxis(body.local("wrist", "hip"), -1, 0)
  return bool((((np.abs(x) < 0.3) & (y > -0.1) & (y < 0.35) & (z > 0.12) & (z < 0.55)).all(-1)
               & (body.knees.min(1) < 130)).any())


def ends_in_t(body):
  """In the last half second both arms are out to the sides, about level."""
  line = body.local("wrist", "shoulder")[-int(0.5 * FPS):]
  return bool(((np.abs(line[..., 0]) > 0.35) & (np.abs(line[..., 1]) < 0.25)).all(-1).any())


def lifts_up(body):
  """The hands, 0.7 m or less apart and ahead of the hips, rise by 0.25 m or more together."""
  high = body.joints[:, PAIR["wrist"], 1].mean(1)
  load = (_apart(body) < 0.7) & (body.local("wrist", "hip")[..., 2].min(1) > 0.12)
  return any(_rise(high[first:past]) >= 0.25 for first, past in body.spans(load, least=0.4))


def up_and_down(side, least=0.12):
  """A hand rises over the ground by `least` metres or more, and sinks as far after that."""
  def rule(body):
    high = _height(body, side)
    top = high.argmax()
    return bool(high[top] - max(high[:top + 1].min(), high[top:].min()) >= least)
  return rule


def hand_to_side(body):
  """A hand is 0.45 m or more to the right of the pelvis, as the body faced at first."""
  x, _, z = np.moveaxis(body.joints[:, PAIR["wrist"]] - body.joints[:, :1], -1, 0)
  return bool((x * np.cos(body.heading[0]) - z * np.sin(body.heading[0])).min() <= -0.45)


def flings(count, least=1.8):
  """A hand is as fast as that against the pelvis, metres a second, `count` times or more."""
  def rule(body):
    speed = np.linalg.norm(velocity(body.joints[:, PAIR["wrist"]] - body.joints[:, :1], FPS), axis=-1).max(1)
    return len(body.spans(speed > least, gap=0.3)) >= count
  return rule


def alternates(body):
  """The hands do not go up and down together."""
  left, right = (above_shoulders(body) - above_shoulders(body).mean(0)).T
  return bool((left * right).sum() < 0.4 * np.sqrt((left ** 2).sum() * (right ** 2).sum()))


def hands_near(body):
  """The hands are near each other and not low."""
  return bool(((_apart(body) < 0.3) & (above_shoulders(body).min(1) > -0.45)).any())


def hands_part(body):
  """The hands are apart, both over their shoulders."""
  return bool(((_apart(body) > 0.5) & (above_shoulders(body).min(1) > 0)).any())


def moves_hand(side):
  """The hand is at places 0.25 m from each other."""
  return lambda body: bool(np.ptp(body.local("wrist", "shoulder")[:, side], axis=0).max() >= 0.25)


def rises(side):
  """The hand rises by 0.1 m."""
  return lambda body: bool(_rise(above_shoulders(body)[:, side]) >= 0.1)


def bobs(side, count=2, least=0.12):
  """The hand goes up and down by `least` metres, `count` times or more."""
  return lambda body: len(turning_points(_height(body, side), least)) - 2 >= count


def before(side):
  """The hand is ahead of its shoulder and not low."""
  return hand_is(side, lambda x, y, z: (z > 0.15) & (y > -0.4))


def held(side):
  """The hand does not hang, for half of the time."""
  return hand_is(side, lambda x, y, z: (y > -0.42) | (np.hypot(x, z) > 0.28), 0.5)


def ahead(side):
  """The hand is ahead of its shoulder, for half of the time."""
  return hand_is(side, lambda x, y, z: z > 0.12, 0.5)


def reaches(side):
  """The hand reaches out at a table's height, or down to the ground."""
  return either(reaches_down(side), hand_is(side, lambda x, y, z: (np.hypot(x, z) > 0.3) & (y > -0.45)))


def at_mouth(side):
  """The hand is near the mouth."""
  return hand_at(side, "head", 0.32)


def strikes(side, count):
  """The hand goes fast up and down, `count` times or more."""
  return both(pumps(side, count, 0.15), fast(side, 1.5))


def embraces(side):
  """One arm is bent while the other hand, lifted, moves."""
  return both(bends_elbow(side), lifts_hand(1 - side), works(1 - side, 2))


def across_right(body):
  """The right hand is across the chest."""
  return hand_is(RIGHT, lambda x, y, z: (x > 0.1) & (y > -0.4) & (z > 0.1))(body)
