"""A fourth list of captions, of the same file as those of caption_rules.py, drawn and judged as caption_rules_blind.py.

How it was drawn: of the file's 4,042 lines those in KINDS of caption_rules.py and caption_rules_blind.py were taken
out, and others of the same text, lower-cased and with left and right exchanged; of lines that are the same but for left
and right the first was kept. The 1,989 that are left, in the order of the file, were shuffled by
`numpy.random.default_rng(48)`. Of the first 123 of them 120 were kept; no rule on joints can judge lines 1321 (acts
like a horse), 1459 (reseals a package) and 1540 (garbled).

The rules were written from the captions' words alone: before any motion or any plan of these captions was seen, and
without sight of the code that reads prompts. Objects, faces, moods and where the eyes look are not judged, nor the
sense in which a hand circles. The figures of 2026-11-27 are blind; later ones are not.
"""
# ruff: noqa: I001 (several names a line)
import pathlib
from collections.abc import Callable

import numpy as np
from behaviour_rules import (
  FPS, LEFT, RIGHT, above_shoulders, body_of, both, circles, gets_up, in_order, jumps, keeps_straight, none_of, punches,
  raises, raises_one, runs, sits, squats, stands_still, stays, stops, turns, walks, waves, zigzags,
)
from caption_rules import (
  Kind, comes_back, crouches, goes, hands_meet, leads, lies, lifts_foot, lifts_hand, reaches_head, reaches_low,
  read_captions, rows_of, spreads_arms, steps_in_place, trunk_bends,
)
from caption_rules_blind import (
  bends_elbow, climbs, either, fast, hand_at, hops, kicks_with_both, kneels_on, leans, lowers, pumps, reaches_down,
  reaches_out, seated, shifts, swivels, throws, turned, veers,
)

from motion_jax.analysis.signals import JOINT, PAIR, turning_points
from motion_jax.motion.contacts import velocity

# --- rules that the other lists do not need --------------------------------------------------------------------------


def in_turn(*rules, grid=0.2):
  """One after another: each part, as short as can be, obeys its rule, and the rest the last. Unlike `in_order` it lets
  a part obey the next rule, too."""
  def rule(body):
    first, least = 0, int(0.5 * FPS)
    for one in rules[:-1]:
      cuts = range(first + least, body.num - least + 1, int(grid * FPS))
      first = next((cut for cut in cuts if one(body_of(body.joints, first, cut))), None)
      if first is None:
        return False
    return bool(rules[-1](body_of(body.joints, first)))
  return rule


def pauses(pace):
  """Is as fast as that, then nearly stands, then is as fast again."""
  def rule(body):
    return any(body.speed[:first].max(initial=0) > pace and body.speed[past:].max(initial=0) > pace
               for first, past in body.spans(body.speed < 0.5, least=0.15))
  return rule


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
    return any(_way(body, body.joints[:, PAIR["wrist"][one]] - body.joints[:, JOINT[joint]],
                    _away(body, one, joint) < away) >= least for one in (LEFT, RIGHT) if side in (None, one))
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


def takes_off(side):
  """At some time it leaves the ground, that foot last."""
  def rule(body):
    low = body.joints[:, [PAIR["ankle"], PAIR["foot"]], 1].min(1)
    return any(low[max(0, first - 1), side] < low[max(0, first - 1), 1 - side]
               for first, _ in body.spans(body.air > 0.06, least=0.1, gap=0.1))
  return rule


def stands_at_end(body):
  return bool(body.trunk[-5:].mean() < 25 and body.knees[-5:].mean() > 145 and body.speed[-5:].max() < 0.35)


def steps(low, high):
  """The feet are put elsewhere low to high times, in all."""
  def rule(body):
    pace = np.linalg.norm(velocity(body.joints[:, PAIR["foot"]], FPS)[..., [0, 2]], axis=-1)
    return low <= sum(len(body.spans(pace[:, side] > 0.45, least=0.1, gap=0.1)) for side in (LEFT, RIGHT)) <= high
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


def ducks(body):
  """The head sinks by 0.25 m or more."""
  head = body.joints[:, JOINT["head"], 1]
  return bool((np.maximum.accumulate(head) - head).max() >= 0.25)


def comes_up(body):
  """The head ends 0.2 m or more over its lowest."""
  head = body.joints[:, JOINT["head"], 1]
  return bool(head[-5:].mean() - head.min() >= 0.2)


def rolls_head(body):
  """The head goes 3 cm or more to and fro, and so far to the sides, over the neck."""
  x, _, z = (body.joints[:, JOINT["head"]] - body.joints[:, JOINT["neck"]]).T
  sin, cos = np.sin(body.heading), np.cos(body.heading)
  return bool(np.ptp(x * cos - z * sin) >= 0.03 and np.ptp(x * sin + z * cos) >= 0.03)


def dangles(body):
  """The trunk is bent for half a second, both hands under the shoulders."""
  return bool(body.spans((body.trunk > 30) & (above_shoulders(body).max(1) < -0.3), least=0.5))


# short ones: how often it jumps, a hand is mostly half up, an elbow bends and stretches, a hand is behind its shoulder,
# the hands hang at the end, both knees are bent far for long, the legs are stiff, the feet 0.3 m wider than the hips
jumps_often = lambda least: lambda body: any(jumps(count)(body) for count in range(least, 40))
half_up = lambda side: lambda body: bool(np.median(above_shoulders(body)[:, side]) > -0.4)
flexes = lambda side, count=3: lambda body: len(turning_points(body.elbows[:, side], 40)) - 2 >= count
behind = lambda side: lambda body: bool((body.local("wrist", "shoulder")[:, side, 2] < -0.1).any())
hangs = lambda body: bool((above_shoulders(body)[-5:].mean(0) < -0.3).all())
squatting = lambda body: bool(np.mean(body.knees.max(1) < 130) > 0.4)
stiff_legged = lambda body: bool(np.percentile(body.knees, 5) > 140)
feet_apart = lambda body: bool((np.ptp(body.local("ankle", "hip")[..., 0], axis=1) > 0.3).any())

# --- the captions ----------------------------------------------------------------------------------------------------

forward, slowly = walks(least=0.6), walks(pace=(0.15, 1.0), least=0.5)
straight = both(forward, keeps_straight)
run_walk, go = runs((1.5, 6.5)), goes(0.4, 99)
diagonal = either(leads(8, 80, 0.4), leads(-80, -8, 0.4))
walk_back = both(walks(least=0.5), comes_back)
arms_out = both(reaches_out(LEFT), reaches_out(RIGHT))
hands_lifted = both(lifts_hand(LEFT), lifts_hand(RIGHT))
hands_low = none_of(either(lifts_hand(LEFT), lifts_hand(RIGHT)))
gesture, gesture_both = either(gestures(LEFT), gestures(RIGHT)), both(gestures(LEFT), gestures(RIGHT))
handles = either(gesture, reaches_low)
circle_left = circles_hand(LEFT, 1, 0.3)
out_and_back = in_turn(foot_goes(LEFT, 0, 0.25, 0.08), foot_goes(RIGHT, 2, -0.15, 0.25), goes(0.3, 99))
sways = either(swivels(3, 10), both(leans(1, 3), leans(-1, 3)))
unfolded = none_of(hand_at(LEFT, "right_elbow", 0.4), hand_at(RIGHT, "left_elbow", 0.4))
ways = either(turned(0), shifts(90), shifts(-90), shifts(180))
fold = both(hand_at(LEFT, "right_elbow", 0.3), hand_at(RIGHT, "left_elbow", 0.3))
bend_low = both(trunk_bends, reaches_low)
step_ahead = both(goes(0.2, 99), leads(-60, 60, 0.2))
on_thighs = both(hand_at(LEFT, "left_knee", 0.4), hand_at(RIGHT, "right_knee", 0.4))
reach = either(reaches_low, reaches_out(LEFT), reaches_out(RIGHT))
reach_right = either(reaches_down(RIGHT), reaches_out(RIGHT))

INSIDE = (
    Kind("walk", forward, (2749,)),
    Kind("walk straight", straight, (2789,)),
    Kind("walk slowly", slowly, (110,)),
    Kind("walk, tired", walks(pace=(0.15, 1.2), least=0.5), (3410,)),
    Kind("walk straight, carefully", both(walks(pace=(0.15, 1.2), least=0.5), keeps_straight), (2607,)),
    Kind("walk, legs stiff", both(forward, stiff_legged), (1413,)),
    Kind("walk straight, arms out", both(straight, spreads_arms), (1623,)),
    Kind("walk and stop", both(forward, stops), (1836,)),
    Kind("walk straight and stop", both(straight, stops), (1125,)),
    Kind("walk slowly and stop, arms down", both(slowly, stops, hands_low), (1934,)),
    Kind("four slow steps, arms out", both(slowly, stops, spreads_arms, steps(3, 5)), (1653,)),
    Kind("stand, then a step back", in_order(stands_still, both(goes(0.15, 1.6), leads(120, 240, 0.15))), (1206,)),
    Kind("walk backward straight", both(walks((135, 225), (0.2, 1.4), 0.4), keeps_straight), (944,)),
    Kind("walk backward carefully", walks((135, 225), (0.15, 1.0), 0.4), (1667,)),
    Kind("backward, turn around, backward", in_turn(shifts(180, 0.4), turned(0, 120), shifts(180, 0.4)), (187,)),
    Kind("backward, shaking", both(shifts(180, 0.3), works(LEFT), works(RIGHT), swivels(2, 10)), (1171,)),
    Kind("diagonally", both(walks((-80, 80), least=0.6), keeps_straight, diagonal), (99,)),
    Kind("slowly, a little to the right", both(walks((-80, 45), (0.15, 1.0), 0.5), leads(-60, -5, 0.5)), (1280,)),
    Kind("walk straight, then turn left", both(in_order(straight, turned(1)), turns(40, 140)), (678,)),
    Kind("walk, turning right", both(walks(least=0.5), turns(-200, -30)), (45,)),
    Kind("turn and walk back", both(walk_back, turned(0, 90)), (540, 591)),
    Kind("turn left, walk back", both(walk_back, turned(1, 90)), (955,)),
    Kind("turn right, walk back", both(walk_back, turned(-1, 90)), (237,)),
    Kind("circle to the right", circles(-1), (752,)),
    Kind("slow circle to the left", both(circles(1), walks((-60, 60), (0.15, 1.0), 0.5)), (3315,)),
    Kind("clockwise, dragging a foot", both(walks(least=0.5), turned(-1, 90), drags(RIGHT)), (2509,)),
    Kind("figure of eight", both(forward, either(veers(1, -1, least=180), veers(-1, 1, least=180))), (1282,)),
    Kind("zigzag", both(goes(1.0, 99), zigzags), (3748,)),
    Kind("circle, jump back, hop", both(in_turn(both(circles(), walks((-60, 60), (0.15, 1.2), 0.5)), both(jumps(),
         shifts(180, 0.15))), jumps_often(2)), (1546,)),
    Kind("walk in place", steps_in_place, (1972,)),
    Kind("walk, left foot out, right foot back", both(forward, out_and_back), (1270,)),
    Kind("run, pause, run", both(run_walk, leads(-45, 45), pauses(1.3)), (1252,)),
    Kind("run and stop", both(runs(), stops), (936,)),
    Kind("jog and stop", both(run_walk, stops), (801,)),
    Kind("run straight, a hand half up", both(runs(), keeps_straight, half_up(LEFT)), (1815,)),
    Kind("run diagonally, pivot, run", both(run_walk, in_turn(diagonal, turned(0, 45), goes(0.6, 99))), (1877,)),
    Kind("run, jump, run", both(run_walk, takes_off(LEFT), in_turn(goes(0.8, 99), jumps(), goes(0.6, 99))), (448,)),
    Kind("run and duck", both(run_walk, ducks), (13,)),
    Kind("duck, step, stand up", both(in_turn(ducks, shifts(0, 0.2)), in_turn(ducks, comes_up)), (1641,)),
    Kind("jump and spin left", both(jumps(), turned(1, 90)), (141,)),
    Kind("jump ahead, then stand", both(jumps(), leads(-45, 45, 0.3), stands_at_end), (1938,)),
    Kind("a hop ahead", both(jumps(1), leads(-45, 45, 0.15)), (703,)),
    Kind("jump ahead, then hop and hop", both(jumps_often(3), leads(-60, 60)), (1272,)),
    Kind("jump on the spot", both(jumps(), stays, raises(False, False)), (1369,)),
    Kind("jump and stumble back", in_turn(jumps(), shifts(180, 0.15)), (1554,)),
    Kind("jump to the left", both(jumps(), leads(30, 150, 0.3)), (1092,)),
    Kind("kick with each leg", kicks_with_both, (1679,)),
    Kind("punches on the move", both(punches(), goes(0.8, 99), ways), (1869,)),
    Kind("shadow boxing", in_turn(punches(), punches()), (1052,)),
    Kind("swing an arm wide", both(fast(LEFT, 1.5), reaches_out(LEFT)), (543,)),
    Kind("turn around, fling the arms up", in_turn(turned(1, 120), both(raises(True, True), pumps(LEFT, 2, 0.25),
         pumps(RIGHT, 2, 0.25))), (1263,)),
    Kind("gestures, a hand on the hip, gestures", in_turn(gesture_both, on_hip(RIGHT), gesture), (1022,)),
    Kind("a gesture", gesture, (2592,)),
    Kind("both hands do something", gesture_both, (2316,)),
    Kind("wave left, then both overhead", in_turn(waves(True, None), both(waves(True, True), over_head)), (1112,)),
    Kind("an arm up twice, then bent", both(lifts_hand(RIGHT), bends_elbow(RIGHT), pumps(RIGHT, 3, 0.15)), (210,)),
    Kind("arms out, one to and fro", in_turn(arms_out, works(RIGHT, 2, 0.1)), (1848,)),
    Kind("fold and drop the arms", both(fold, lowers(LEFT), lowers(RIGHT)), (61,)),
    Kind("fold and unfold the arms", in_order(fold, unfolded), (32,)),
    Kind("wiggle", both(stays, sways, works(LEFT), works(RIGHT)), (1188,)),
    Kind("stand, moving a little", both(stays, stands_still, none_of(ducks)), (1708,)),
    Kind("bent, arms dangling", dangles, (1373,)),
    Kind("raise both and squat", in_turn(hands_lifted, squats(), squats()), (1780,)),
    Kind("walk, sit, walk back", both(in_order(go, sits, go), comes_back), (940,)),
    Kind("walk, turn, sit, walk back", both(in_order(go, sits, go), turned(0, 60), comes_back), (706,)),
    Kind("back, sit, stand", in_turn(shifts(180, 0.15), sits, gets_up), (1133,)),
    Kind("right foot back, sit, stand", in_turn(stance(LEFT), sits, gets_up), (1617,)),
)

OUTSIDE = (
    Kind("sit and cross the legs", both(sits, crosses_legs), (1735,)),
    Kind("sit, swap legs", both(seated, in_turn(lifts_foot(LEFT), lifts_foot(RIGHT))), (1040,)),
    Kind("sit, rub the belly", in_turn(sits, rubs(None, "spine1")), (897,)),
    Kind("sit, rub a leg, hand up", both(seated, in_turn(rubs(RIGHT, "right_knee", 0.4), raises(None, True))), (3194,)),
    Kind("sit, hands on knees", both(seated, in_turn(hands_meet, on_knees(True, True),
         on_knees(False, True))), (1110,)),
    Kind("hands together, on thighs, out", in_turn(hands_meet, on_thighs, spreads_arms), (180,)),
    Kind("hand at the head", reaches_head(None), (1169, 992)),
    Kind("hand at the head", reaches_head(RIGHT), (1521,)),
    Kind("hands near the face", both(hand_at(LEFT, "head", 0.35), hand_at(RIGHT, "head", 0.35), gesture_both), (1327,)),
    Kind("hands together, at the head", in_turn(hands_meet, rubs(None, "head")), (3286,)),
    Kind("together, hand at the head, together", in_turn(hands_meet, reaches_head(RIGHT), hands_meet), (323,)),
    Kind("one hand down, one up", both(either(lowers(RIGHT), reaches_down(RIGHT)), reaches_head(LEFT)), (846,)),
    Kind("step and drink", in_turn(step_ahead, reaches_head(None)), (1852,)),
    Kind("grab the head, back", in_turn(diagonal, reaches_head(LEFT), shifts(180, 0.15), both(turned(1), go)), (1499,)),
    Kind("lower the arms, roll the head", in_turn(both(lowers(LEFT), lowers(RIGHT)), rolls_head), (1902,)),
    Kind("squat, circle a hand", both(squatting, circles_hand(RIGHT)), (1063,)),
    Kind("circle a hand", circles_hand(RIGHT), (3462,)),
    Kind("stir", circles_hand(LEFT, 2), (3110,)),
    Kind("circle both hands", both(circles_hand(LEFT), circles_hand(RIGHT)), (1646,)),
    Kind("circle one arm, then both", in_order(circle_left, both(circle_left, circles_hand(RIGHT, 1, 0.3))), (332,)),
    Kind("jump shot", in_turn(either(hops(), steps_in_place), circles_hand(RIGHT), both(jumps(), raises_one)), (974,)),
    Kind("flex an arm", flexes(RIGHT), (355,)),
    Kind("wash an arm", rubs(LEFT, "right_elbow", 0.35), (1586,)),
    Kind("knead", both(stays, either(works(LEFT, 4), works(RIGHT, 4)), gesture, raises(False, False)), (224,)),
    Kind("tend to something", gesture_both, (640,)),
    Kind("step and scratch", in_turn(step_ahead, gestures(LEFT)), (3858,)),
    Kind("walk and hammer", in_turn(forward, both(pumps(RIGHT), gestures(RIGHT))), (1837,)),
    Kind("violin", both(hands_lifted, works(LEFT, 3, 0.08)), (1558,)),
    Kind("clap", hands_meet, (1953,)),
    Kind("golf", both(stays, swings_club, swivels()), (480, 2000)),
    Kind("arm back, throw", both(throws(LEFT), in_turn(behind(LEFT), reaches_out(LEFT, ahead=True))), (3902,)),
    Kind("dribble backward", both(shifts(180, 0.4), either(pumps(LEFT), pumps(RIGHT))), (693,)),
    Kind("jumping jacks", both(jumps(), raises(True, True), over_head, hands_meet, feet_apart), (910,)),
    Kind("jump rope", both(jumps_often(2), raises(False, False)), (648,)),
    Kind("twists and bends", both(swivels(1), leans(1), leans(-1), trunk_bends), (1320,)),
    Kind("twist, bend left and right", both(swivels(), leans(1), leans(-1), arms_out), (500,)),
    Kind("lean right, left, hand at the face", both(stays, in_turn(leans(-1), leans(1), reaches_head(RIGHT))), (1324,)),
    Kind("lift twice", lifts_load(2), (1148,)),
    Kind("pick up, to the right and back", both(reach, carries(-1, 0)), (1697,)),
    Kind("right to left", both(carries(-1, 1), reach), (3915,)),
    Kind("low left, then right, arms down", both(reaches_low, carries(1, -1), hangs), (838,)),
    Kind("lunge, lift, turn", in_turn(stance(RIGHT, 0.3), handles, both(turned(-1), handles)), (1261,)),
    Kind("walk, pick up, back, put down", in_turn(go, reach_right, both(go, turned(0, 100)), reach_right), (1451,)),
    Kind("walk, pick up low, back, put down", in_turn(go, bend_low, both(turned(0, 100), go), trunk_bends), (1087,)),
    Kind("hands overhead, crouch, stand", in_turn(over_head, both(crouches, reaches_low), gets_up), (51,)),
    Kind("brace, kneel, pick up", in_turn(both(trunk_bends, reach_right), both(kneels_on(LEFT), kneels_on(RIGHT)),
         reaches_down(RIGHT)), (483,)),
    Kind("rise, circle, lie down", in_turn(lies, gets_up, circles(-1), lies), (1374,)),
    Kind("upstairs", both(go, climbs(0.2)), (791,)),
    Kind("walk, then upstairs", in_turn(go, climbs(0.2)), (335,)),
    Kind("upstairs at a rail", both(go, climbs(0.2), either(half_up(LEFT), half_up(RIGHT))), (497,)),
)

KINDS = INSIDE + tuple(kind._replace(outside=True) for kind in OUTSIDE)


def sentences(path: str | pathlib.Path) -> list[tuple[str, str, Callable, None]]:
  """[(kind, caption, rule, None)] of the list; path: the file of captions."""
  return rows_of(KINDS, read_captions(path))
