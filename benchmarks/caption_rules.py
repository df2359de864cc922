"""A second list of sentences, in people's own phrasing: captions of HumanML3D's test split, each with a rule.

The captions themselves are not in this repository: CAPTIONS names them by their line, from 0, in a file of one caption
a line (4,042 lines; `SHA256`). They were drawn by `random.Random(40)` from the different ones, and kept where rules on
joints can tell whether a motion does what is said. Rules were written before any motion of these sentences was made.

Half of each kind is for development; the other half is opened only for final figures (`halves`). A third list, drawn
when both had been seen: caption_rules_blind.py.
"""
import hashlib
import pathlib
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from behaviour_rules import (
  LEFT,
  RIGHT,
  both,
  circles,
  dances,
  gets_up,
  in_order,
  jumps,
  keeps_straight,
  kicks,
  on_one_leg,
  raises,
  runs,
  sits,
  squats,
  stays,
  stops,
  turns,
  turns_around,
  walks,
  waves,
  zigzags,
)

from motion_jax.analysis.signals import JOINT, PAIR, Body

SHA256 = "5d3e6db2df11a9c22e65863b339f27e944b32eda8a3d29220051977d4ab35ac0"
DEVELOPMENT, FINAL = "development", "final"


class Kind(NamedTuple):
  """Captions that one rule judges. outside: no capture of the shipped models' data shows it."""
  name: str
  rule: Callable[[Body], bool]
  lines: tuple[int, ...]
  outside: bool = False


# --- rules that the first list does not need -------------------------------------------------------------------------


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


def _over_other(body, side):
  height = body.joints[:, PAIR["foot"], 1]
  return height[:, side] - height[:, 1 - side]


def lifts_foot(side):
  """One foot is 0.15 m or more over the other."""
  return lambda body: bool(_over_other(body, side).max() > 0.15)


def lifts_either(body):
  return lifts_foot(LEFT)(body) or lifts_foot(RIGHT)(body)


def steps_in_place(body):
  """Each foot is lifted twice or more, and the body stays."""
  return bool(stays(body) and all(len(body.spans(_over_other(body, side) > 0.06, least=0.05)) >= 2
                                  for side in (LEFT, RIGHT)))


def crouches(body):
  """The pelvis sinks by a fifth of its height or more, for half a second."""
  return bool(body.spans(body.pelvis < 0.8 * np.percentile(body.pelvis, 95), least=0.5))


def kneels(body):
  """A knee comes within 0.2 m of the ground, the pelvis low."""
  knees = body.joints[:, PAIR["knee"], 1].min(1) - body.floor
  return bool(((knees < 0.2) & (body.pelvis < 0.75)).any())


def crawls(body):
  """Hands and pelvis are low for a second or more."""
  hands = body.joints[:, PAIR["wrist"], 1].max(1) - body.floor
  return bool(body.spans((hands < 0.45) & (body.pelvis < 0.65), least=1.0))


def lies(body):
  """The head comes within 0.4 m of the ground."""
  return bool((body.joints[:, JOINT["head"], 1] - body.floor).min() < 0.4)


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


def spins(side=0, degrees=300):
  """Turns round on one spot. side: 1 left, -1 right."""
  def rule(body):
    turned = np.degrees(np.ptp(np.unwrap(body.heading)))
    net = np.degrees(body.heading[-1] - body.heading[0])
    return bool(turned >= degrees and (not side or side * net > 0.5 * degrees))
  return rule


def trunk_bends(body):
  return bool((body.trunk > 30).any())


# --- the captions ----------------------------------------------------------------------------------------------------

forward, straight = walks(least=0.6), both(walks(least=0.6), keeps_straight)
slowly, quickly = walks(pace=(0.15, 1.0), least=0.5), walks(pace=(0.9, 2.6))
backward = walks((135, 225), pace=(0.2, 1.4), least=0.4)
left_side, right_side = walks((45, 135), (0.15, 2.0), 0.3), walks((-135, -45), (0.15, 2.0), 0.3)
left_turn, right_turn = turns(40, 140), turns(-140, -40)
to_left, to_right = leads(30, 150), leads(-150, -30)

KINDS = (
    Kind("walk", forward, (1681, 728, 1524, 561, 546, 407, 2666, 960, 751, 1659, 3680, 2955, 780, 28, 679, 638,
        1699, 798, 5, 3056, 759, 3248, 921, 289, 3432, 722)),
    Kind("walk slowly", slowly, (692, 1006, 305, 1778, 875, 654, 94, 772)),
    Kind("walk quickly", quickly, (512,)),
    Kind("walk backward", backward, (2545, 878, 277, 669)),
    Kind("walk backward quickly", walks((135, 225), pace=(0.6, 2.6), least=0.5), (2, 3710)),
    Kind("walk backward and stop", both(backward, stops), (166, 411)),
    Kind("a step", both(goes(0.2, 1.6), leads(-60, 60, 0.2)), (1765, 178, 1551, 1582)),
    Kind("a step back", both(goes(0.15, 1.6), leads(120, 240, 0.15)), (206,)),
    Kind("walk and stop", both(forward, stops), (345, 1587, 1418)),
    Kind("walk in a direction", leads(-45, 45), (1342,)),
    Kind("walk to the left", to_left, (2360, 1608, 3163, 1315, 1730, 2345)),
    Kind("walk to the right", to_right, (3629, 963, 324, 336, 2449)),
    Kind("diagonally", walks((-80, 80), least=0.6), (276,)),
    Kind("diagonally", leads(-80, -10), (232, 3019)),
    Kind("walk, turning left", both(walks(least=0.5), turns(30, 200)), (3744, 1606, 1264, 600, 2370, 1853, 2098)),
    Kind("walk, turning right", both(walks(least=0.5), turns(-200, -30)), (590, 3285, 2251, 27, 240, 3889)),
    Kind("turn and walk back", both(walks(least=0.5), comes_back), (1477, 2422, 2959, 1358, 2976, 858, 3790, 989,
        3769, 312, 874)),
    Kind("turn around", both(walks(least=0.5), turns_around), (1610, 527, 3210, 82)),
    Kind("walk to and fro", both(walks((-180, 180), (0.2, 2.0), 0.8), goes(1.2, 99)), (402, 1197, 1970, 2249, 1439,
        999, 372, 1762)),
    Kind("circle", circles(), (25, 3971, 3777, 1420, 412, 1384, 3259, 1492)),
    Kind("circle to the left", circles(1), (2514, 3264, 3222, 2530, 2652, 2068, 380, 1756, 1841, 384)),
    Kind("circle to the right", circles(-1), (4013, 157, 170, 198, 1201, 1294, 3862)),
    Kind("half a circle", both(walks(least=0.5), turns(90, 290)), (1908, 1816)),
    Kind("winding", zigzags, (1350, 1001, 1937)),
    Kind("circle and sit", in_order(circles(-1), sits), (769,)),
    Kind("side step left", left_side, (3311, 879, 3962, 149, 476)),
    Kind("side step right", right_side, (2900, 501, 1351, 2497)),
    Kind("side steps", both(walks((-180, 180), (0.1, 2.0), 0.3), goes(0.5, 99)), (3444, 1752, 2238, 2954, 1549,
        2224, 421, 2679, 658)),
    Kind("run", runs(), (848, 1448, 1722, 2982, 1788, 696)),
    Kind("run and stop", both(runs(), stops), (623, 743, 2764)),
    Kind("run left", both(runs(), to_left), (196,)),
    Kind("run right", both(runs(), to_right), (2217,)),
    Kind("jog diagonally", both(goes(1.0, 99), leads(-80, 80)), (839,)),
    Kind("jog, then walk", both(goes(1.5, 99), leads(10, 90)), (2426,)),
    Kind("jog in a circle", both(circles(-1), goes(3.0, 99)), (1200,)),
    Kind("jog in place", steps_in_place, (1213, 4032, 478, 163, 1159)),
    Kind("march in place", steps_in_place, (2269, 1663)),
    Kind("jump", jumps(), (612, 2308, 142, 1948, 382)),
    Kind("jump twice", jumps(2), (1210, 1343)),
    Kind("jump with a side", both(jumps(), to_left), (604,)),
    Kind("jump with a side", both(jumps(), to_right), (2625,)),
    Kind("jump and turn", both(jumps(), turns_around), (234,)),
    Kind("jump up and down", jumps(), (1713, 279)),
    Kind("kick and jump", in_order(kicks(RIGHT), jumps()), (650,)),
    Kind("skip", both(goes(1.0, 99), leads(-45, 45)), (811,)),
    Kind("jumping jacks", both(jumps(), raises(True, True)), (463, 176, 844, 1139, 1857), outside=True),
    Kind("jumping jacks and kick", in_order(both(jumps(), raises(True, True)), kicks(RIGHT)), (284,), outside=True),
    Kind("one leg", on_one_leg, (1275, 3296, 134, 3191)),
    Kind("kick left", kicks(LEFT), (2185, 3526, 2020, 1695, 264)),
    Kind("kick right", kicks(RIGHT), (966, 828)),
    Kind("hands up and kick left", kicks(LEFT), (2849,)),
    Kind("lift a leg", lifts_foot(LEFT), (3978, 1364)),
    Kind("lift both legs", both(lifts_foot(LEFT), lifts_foot(RIGHT)), (2042,)),
    Kind("kick left and right", both(lifts_foot(LEFT), lifts_foot(RIGHT)), (3606,)),
    Kind("wave left", waves(True, None), (3483, 4039, 3298, 4038, 2600, 64)),
    Kind("wave right", waves(None, True), (4, 358, 2057)),
    Kind("wave both", waves(True, True), (1685, 1160)),
    Kind("wave right, then left", both(waves(None, True), waves(True, None)), (684,)),
    Kind("hand up", raises(True, None), (3143,)),
    Kind("raise both", raises(True, True), (997, 1960, 3612)),
    Kind("raise and lower one", lifts_hand(RIGHT), (1009,)),
    Kind("raise left then right", both(raises(True, None), raises(None, True)), (1256,)),
    Kind("walk, then raise both", in_order(forward, raises(True, True)), (610,)),
    Kind("hand at the head", reaches_head(RIGHT), (649, 108, 3312, 1253, 1529, 1303), outside=True),
    Kind("hand at the head", reaches_head(LEFT), (2539, 2129, 3770), outside=True),
    Kind("hand at the head", reaches_head(None), (688,), outside=True),
    Kind("both hands at the head", both(reaches_head(LEFT), reaches_head(RIGHT)), (734,), outside=True),
    Kind("point", lifts_hand(LEFT), (2770,)),
    Kind("clap", hands_meet, (1409, 3980, 664, 1879), outside=True),
    Kind("squat", squats(), (1380,)),
    Kind("crouch", crouches, (1918, 901)),
    Kind("squat and stand", squats(), (634, 812)),
    Kind("walk and crouch", in_order(forward, crouches), (3839,)),
    Kind("crouched walk", both(crouches, goes(0.6, 99)), (4016, 165, 357)),
    Kind("bow twice", both(trunk_bends, left_turn), (3052,)),
    Kind("bend", trunk_bends, (458, 1244)),
    Kind("bend and touch", both(trunk_bends, reaches_low), (1377,)),
    Kind("sit and stand", in_order(sits, gets_up), (1607, 267, 1118, 2534)),
    Kind("walk and sit", in_order(forward, sits), (773,)),
    Kind("step back and sit", sits, (1602,)),
    Kind("dance", dances, (625, 58, 1297, 1161, 1422)),
    Kind("spin", spins(), (3216, 1195)),
    Kind("spin right", spins(-1, 900), (1039,)),
    Kind("kneel", kneels, (889, 3334), outside=True),
    Kind("kneel and stand", in_order(kneels, gets_up), (175, 1928), outside=True),
    Kind("crawl", crawls, (1319, 781, 496, 733), outside=True),
    Kind("walk, crawl, stand", both(crawls, goes(0.8, 99)), (970,), outside=True),
    Kind("crawl and stand", in_order(crawls, gets_up), (220,), outside=True),
    Kind("lie down", lies, (2175,), outside=True),
    Kind("step and turn", both(turns_around, goes(0.5, 99)), (144, 1891, 2880)),
    Kind("walk and run back", both(turns_around, comes_back), (1019,)),
    Kind("run, then jump", both(goes(1.0, 99), jumps()), (553,)),
    Kind("walk, speeding up", both(forward, goes(1.0, 99)), (1797,)),
    Kind("walk and side step", both(forward, goes(1.0, 99)), (2889, 2037, 3411)),
    Kind("turn left, walk left", both(goes(0.5, 99), to_left), (3458,)),
    Kind("turn right by the way", both(goes(0.8, 99), turns(-140, -30)), (3741,)),
    Kind("walk, then run", runs((1.5, 6.5)), (3737,)),
    Kind("turn and run", both(turns_around, runs((1.5, 6.5))), (835,)),
    Kind("run then left", both(runs((1.5, 6.5)), leads(5, 120)), (3332,)),
    Kind("jog, turning left", both(goes(1.0, 99), leads(0, 100)), (2648,)),
    Kind("run and stop and run", both(runs((1.5, 6.5)), leads(-45, 45)), (348, 2368)),
    Kind("pivot", both(goes(0.5, 99), turns_around), (697,)),
    Kind("jump and side step", both(jumps(), leads(30, 150, 0.2)), (280,)),
    Kind("walk and kick", both(goes(0.5, 99), lifts_foot(RIGHT)), (2244,)),
    Kind("walk and kick", both(goes(0.5, 99), kicks()), (3668,)),
    Kind("squat and jump aside", both(jumps(), leads(30, 150, 0.2)), (565,)),
    Kind("squat and jump aside", both(jumps(), leads(-150, -30, 0.2)), (2586,)),
    Kind("jump with a turn", both(jumps(), turns(20, 100)), (1454,)),
    Kind("jump with a turn", both(jumps(), turns(-100, -20)), (3475,)),
    Kind("walk, then to the left", both(goes(0.8, 99), leads(5, 150)), (1506,)),
    Kind("walk and spin", both(goes(0.5, 99), spins()), (1840,)),
    Kind("bend while jogging", both(goes(1.0, 99), trunk_bends), (1292,)),
    Kind("walk and wave", both(goes(0.6, 99), waves(None, True)), (566,)),
    Kind("walk and wave", both(goes(0.6, 99), lifts_hand(LEFT)), (3338,)),
    Kind("walk and wave", both(goes(0.6, 99), lifts_hand(RIGHT)), (1317,)),
    Kind("a step aside", leads(-150, -30, 0.15), (2568, 1208)),
    Kind("a step aside", leads(30, 150, 0.15), (547, 3229)),
    Kind("walk backward diagonally", walks((95, 265), pace=(0.2, 1.6), least=0.4), (442,)),
)


def read_captions(path: str | pathlib.Path) -> list[str]:
  """The lines of the file that KINDS counts. Raises ValueError for another file."""
  content = pathlib.Path(path).read_bytes()
  if hashlib.sha256(content).hexdigest() != SHA256:
    raise ValueError(f"{path} is not the list of captions that the rules were written for (sha256 {SHA256[:12]}..)")
  return content.decode().splitlines()


def sentences(path: str | pathlib.Path, half: str = DEVELOPMENT) -> list[tuple[str, str, Callable, None]]:
  """[(kind, caption, rule, None)] of one half, each kind's captions in turn for the one and the other."""
  return halves(read_captions(path))[half]


def halves(captions: list[str]) -> dict[str, list[tuple[str, str, Callable, None]]]:
  """{half: rows as of `sentences`} of all captions."""
  rows = rows_of(KINDS, captions)
  return {DEVELOPMENT: rows[::2], FINAL: rows[1::2]}


def rows_of(kinds: tuple[Kind, ...], captions: list[str]) -> list[tuple[str, str, Callable, None]]:
  """[(kind, caption, rule, None)] of kinds, whose lines `captions` are."""
  return [(kind.name, captions[line], kind.rule, None) for kind in kinds for line in kind.lines]
