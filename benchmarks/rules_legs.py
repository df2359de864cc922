"""Rules on legs and feet that only captions need (behaviour_rules.py has the others)."""
import numpy as np
from behaviour_rules import FPS, LEFT, RIGHT, kick_peaks, stays

from motion_jax.analysis.signals import PAIR
from motion_jax.motion.contacts import velocity


def _over_other(body, side):
  height = body.joints[:, PAIR["foot"], 1]
  return height[:, side] - height[:, 1 - side]


def steps_in_place(body):
  """Each foot is lifted twice or more, and the body stays."""
  return bool(stays(body) and all(len(body.spans(_over_other(body, side) > 0.06, least=0.05)) >= 2
                                  for side in (LEFT, RIGHT)))


def lifts_foot(side):
  """One foot is 0.15 m or more over the other."""
  return lambda body: bool(_over_other(body, side).max() > 0.15)


def lifts_either(body):
  return lifts_foot(LEFT)(body) or lifts_foot(RIGHT)(body)


def bends_knees(body):
  return bool(body.knees.min() < 150)


def lifts_high(body):
  """A foot is lifted by 0.25 m or more."""
  return bool(np.ptp(body.joints[:, PAIR["foot"], 1], axis=0).max() > 0.25)


def kicks_with_both(body):
  return bool(kick_peaks(body, LEFT) and kick_peaks(body, RIGHT))


def hops(count=2):
  """Leaves the ground with one foot over the other, `count` times or more."""
  return lambda body: len(body.spans(
      (body.air > 0.05) & (np.ptp(body.joints[:, PAIR["foot"], 1], axis=1) > 0.08), gap=0.1)) >= count


def balances(side, count=1):
  """Stands on that foot for half a second, the other in the air, `count` times or more."""
  def rule(body):
    height = body.joints[:, PAIR["foot"], 1] - body.floor
    return len(body.spans((height[:, 1 - side] > 0.12) & (height[:, side] < 0.12), least=0.5)) >= count
  return rule


def stance(side, least=0.15):
  """That foot is so far ahead of the other."""
  def rule(body):
    x, _, z = (body.joints[:, PAIR["ankle"][side]] - body.joints[:, PAIR["ankle"][1 - side]]).T
    return bool((x * np.sin(body.heading) + z * np.cos(body.heading)).max() >= least)
  return rule


def foot_goes(side, axis, least, over):
  """A foot is so far from its hip (axis 0: left, 2: ahead; negative: right, back), and so far over the other."""
  def rule(body):
    height, away = body.joints[:, PAIR["foot"], 1], body.local("foot", "hip")[:, side, axis]
    return bool(((np.sign(least) * away > abs(least)) & (height[:, side] - height[:, 1 - side] > over)).any())
  return rule


def drags(side):
  """That foot is lifted by less than four fifths of the other."""
  def rule(body):
    high = np.ptp(np.percentile(body.joints[:, PAIR["ankle"], 1], (5, 95), axis=0), axis=0)
    return bool(high[side] < 0.8 * high[1 - side])
  return rule


def crosses_legs(body):
  """The pelvis low, an ankle is over the line of the other or near to its knee."""
  across = body.joints[:, PAIR["ankle"]]
  x, _, z = (across[:, 0] - across[:, 1]).T
  near = np.linalg.norm(across - body.joints[:, PAIR["knee"][::-1]], axis=-1).min(1) < 0.25
  return bool(((body.pelvis < 0.75) & (near | (x * np.cos(body.heading) - z * np.sin(body.heading) < 0.03))).any())


def steps(low, high):
  """The feet are put elsewhere low to high times, in all."""
  return lambda body: low <= sum(map(len, _swings(body))) <= high


def _swings(body):
  """The spans of frames, of each foot, in which it is put elsewhere."""
  pace = np.linalg.norm(velocity(body.joints[:, PAIR["foot"]], FPS)[..., [0, 2]], axis=-1)
  return [body.spans(pace[:, side] > 0.45, least=0.1, gap=0.1) for side in (LEFT, RIGHT)]


def first_step(side):
  """That foot is put elsewhere before the other."""
  def rule(body):
    first, other = (min((start for start, _ in _swings(body)[foot]), default=body.num) for foot in (side, 1 - side))
    return first < other
  return rule


def pivots(side, degrees=90, least=0.6):
  """Turns by `degrees` or more on that foot, which stays on the ground within 0.2 m, in `least` to 2.5 seconds."""
  def rule(body):
    ankle, heading = body.joints[:, PAIR["ankle"][side]], np.degrees(body.heading)
    for first in range(0, body.num, 2):
      away = np.linalg.norm(ankle[first:first + int(2.5 * FPS)] - ankle[first], axis=-1) > 0.2
      past = first + (int(away.argmax()) if away.any() else len(away))
      if past - first >= least * FPS and np.ptp(heading[first:past]) >= degrees:
        return True
    return False
  return rule


def crosses_feet(count=1):
  """Upright, one foot is put across the line of the other, `count` times or more."""
  def rule(body):
    x, _, z = (body.joints[:, PAIR["ankle"][LEFT]] - body.joints[:, PAIR["ankle"][RIGHT]]).T
    left = x * np.cos(body.heading) - z * np.sin(body.heading)
    return len(body.spans((left < -0.03) & (body.trunk < 45) & (body.pelvis > 0.6), least=0.1)) >= count
  return rule


def stiff_legged(body):
  """No knee bends far."""
  return bool(np.percentile(body.knees, 5) > 140)


def feet_apart(body):
  """The feet are 0.3 m further apart than the hips."""
  return bool((np.ptp(body.local("ankle", "hip")[..., 0], axis=1) > 0.3).any())


def stretches_leg(side):
  """That leg is straight, its foot 0.3 m or more from under its hip."""
  def rule(body):
    x, _, z = body.local("foot", "hip")[:, side].T
    return bool(((np.hypot(x, z) > 0.3) & (body.knees[:, side] > 145)).any())
  return rule


def slides(side):
  """That foot gets 0.25 m or more from its first place, at its furthest diagonally ahead."""
  def rule(body):
    way = body.joints[:, PAIR["foot"][side]][:, [0, 2]]
    way = way - way[0]
    x, z = way[np.linalg.norm(way, axis=-1).argmax()]
    angle = np.degrees(np.angle(np.exp(1j * (np.arctan2(x, z) - body.heading[0]))))
    return bool(np.hypot(x, z) >= 0.25 and 8 <= abs(angle) <= 82)
  return rule


def _most_over(body, part, side):
  """Metres by which a knee or a foot comes up over the other one."""
  return np.diff(body.joints[:, PAIR[part], 1][:, [1 - side, side]], axis=1).max()


def lifts_knee(side, least=0.15):
  """The knee comes up by `least` metres over the other one."""
  return lambda body: bool(_most_over(body, "knee", side) >= least)


def foot_over(side, least=0.08):
  """The foot comes up by `least` metres over the other one."""
  return lambda body: bool(_most_over(body, "foot", side) >= least)
