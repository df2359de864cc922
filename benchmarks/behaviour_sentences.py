"""Sentences that no caption of the archives holds word for word, each with the rule that its motion must obey."""
from collections.abc import Callable
from typing import NamedTuple

from behaviour_rules import (
  at_once,
  both,
  bows,
  circles,
  dances,
  gets_up,
  in_order,
  jumps,
  keeps_straight,
  kicks,
  makes_a_u_turn,
  on_one_leg,
  punches,
  raises,
  raises_one,
  runs,
  sits,
  squats,
  stands_still,
  stays,
  stops,
  turns,
  turns_around,
  walks,
  waves,
  waves_one,
  zigzags,
)


class Group(NamedTuple):
  """Sentences that mean the same. seconds: how long their motions are; None, as long as such captions usually are."""
  category: str
  rule: Callable
  sentences: tuple[str, ...]
  seconds: float | None = None


forward = walks()
backward = walks((135, 225), pace=(0.3, 1.1), least=0.5)
left_turn, right_turn = turns(40, 140), turns(-140, -40)
left_wave, right_wave, both_wave = waves(True, False), waves(False, True), waves(True, True)
left_up, right_up, both_up = raises(True, False), raises(False, True), raises(True, True)
still = both(stands_still, stays)

GROUPS = (
    Group("walk", both(forward, keeps_straight), (
        "a person walks straight ahead", "someone is walking in a straight line", "a man strolls forward",
        "the woman walks ahead", "he takes a few steps forward", "walk forward", "a figure marches ahead",
        "the person keeps walking forward")),
    Group("walk backward", backward, (
        "a person walks backwards", "someone takes a few steps back", "a man is walking backward",
        "she steps backward", "the person moves back while facing forward", "walk backward")),
    Group("walk diagonally", walks((12, 75)), (
        "a person walks diagonally forward to the left", "someone walks ahead and to the left without turning")),
    Group("walk diagonally", walks((-75, -12)), (
        "a person walks diagonally forward to the right", "someone walks ahead and to the right without turning")),
    Group("turn", both(walks(least=0.5), left_turn), (
        "a person turns left while walking", "someone walks and makes a left turn",
        "a man walks forward and turns left",
        "the person takes a left turn", "she walks, turning to the left", "walk and turn left")),
    Group("turn", both(walks(least=0.5), right_turn), (
        "a person turns right while walking", "someone walks and makes a right turn",
        "a man walks forward and turns right", "the person takes a right turn", "she walks, turning to the right",
        "walk and turn right")),
    Group("turn", turns_around, (
        "a person turns around", "someone walks and turns around", "a man turns 180 degrees",
        "she turns around to the left"), 5.0),
    Group("path", circles(), (
        "a person walks in a circle", "someone walks around in a circle", "a man is walking in circles",
        "she walks one full circle"), 9.0),
    Group("path", circles(1), (
        "a person walks in a circle to the left", "someone walks in a counterclockwise circle"), 9.0),
    Group("path", circles(-1), (
        "a person walks in a circle to the right", "someone walks in a clockwise circle"), 9.0),
    Group("path", makes_a_u_turn, (
        "a person walks and makes a u-turn", "someone walks in a half circle", "a man makes a u-turn while walking"),
          7.0),
    Group("path", zigzags, ("a person walks in a zigzag", "someone is walking in zigzags"), 9.0),
    Group("path", circles(), ("a person runs in a circle", "someone jogs around in a circle"), 9.0),
    Group("speed", walks(pace=(0.15, 0.9), least=0.4), (
        "a person walks slowly", "someone is walking very slowly", "a man strolls at a slow pace",
        "she slowly walks forward", "the person takes slow steps ahead", "an old man walks slowly")),
    Group("speed", walks(pace=(1.4, 2.6)), (
        "a person walks quickly", "someone is walking fast", "a man walks forward at a fast pace",
        "she hurries ahead", "the person walks briskly", "a woman quickly walks forward")),
    Group("speed", runs((3.2, 7.0)), ("a person runs fast", "someone sprints ahead", "a man dashes forward quickly")),
    Group("run", runs(), (
        "a person runs straight ahead", "someone goes for a run", "a man jogs forward", "she is running",
        "run forward", "the person runs ahead", "a woman is jogging", "a jogger runs by")),
    Group("stop", stops, (
        "a person walks forward and stops", "someone walks ahead, then comes to a stop",
        "a man walks a few steps and stands still", "the person walks and then stops", "a person runs and stops",
        "she jogs forward, then stops"), 6.0),
    Group("stop", still, (
        "a person stands still", "someone is standing still", "a man does nothing", "the person stands in place",
        "she does not move", "stand still"), 5.0),
    Group("raise", left_up, (
        "a person lifts the left hand", "someone raises their left arm", "the left hand goes up in the air",
        "she puts her left hand up", "a man holds up his left hand")),
    Group("raise", right_up, (
        "a person lifts the right hand", "someone raises their right arm", "the right hand goes up in the air",
        "she puts her right hand up", "a man holds up his right hand")),
    Group("raise", both_up, (
        "a person lifts both hands", "someone raises both arms over the head", "she puts her hands up",
        "a man throws both hands up in the air", "both arms go up")),
    Group("raise", raises_one, ("a person raises a hand", "someone puts one arm up in the air")),
    Group("wave", left_wave, (
        "a person waves with the left hand", "someone waves their left arm", "she waves hello with her left hand",
        "a man is waving his left hand")),
    Group("wave", right_wave, (
        "a person waves with the right hand", "someone waves their right arm", "she waves hello with her right hand",
        "a man is waving his right hand")),
    Group("wave", both_wave, (
        "a person waves with both hands", "someone waves both arms above the head", "she waves both hands",
        "a man is waving both arms")),
    Group("wave", waves_one, (
        "a person waves", "someone waves goodbye", "a man waves at a friend", "she waves her hand", "wave")),
    Group("kick", kicks(), (
        "a person kicks", "someone kicks a ball", "a man kicks into the air", "she does a front kick")),
    Group("kick", kicks(0), (
        "a person kicks with the left foot", "someone kicks with their left leg", "a left-footed kick")),
    Group("kick", kicks(1), (
        "a person kicks with the right foot", "someone kicks with their right leg", "a right-footed kick")),
    Group("punch", punches(), (
        "a person throws a punch", "someone is boxing", "a man punches forward", "she strikes with the fist",
        "the person punches the air")),
    Group("punch", punches(0), ("a person punches with the left hand", "someone throws a left punch")),
    Group("punch", punches(1), ("a person punches with the right hand", "someone throws a right punch")),
    Group("jump", jumps(), (
        "a person jumps up", "someone jumps into the air", "a man hops up with both feet", "she leaps up",
        "the person jumps high")),
    Group("jump", jumps(ahead=0.4), (
        "a person jumps ahead", "someone leaps forward", "a man jumps forward with both feet")),
    Group("count", kicks(None, 2), ("a person kicks twice", "someone kicks two times")),
    Group("count", kicks(1, 3), ("a person kicks three times with the right foot",)),
    Group("count", jumps(2), ("a person jumps twice", "someone jumps up two times")),
    Group("count", jumps(3), ("a person jumps three times", "someone does three jumps")),
    Group("count", squats(2), ("a person squats twice", "someone does two squats")),
    Group("count", squats(3), ("a person does three squats", "someone squats three times")),
    Group("count", bows(2), ("a person bows twice", "someone takes two bows")),
    Group("squat, sit", squats(), (
        "a person squats", "someone squats down and stands up again", "a man does a squat",
        "she crouches and gets up")),
    Group("squat, sit", sits, (
        "a person sits down", "someone takes a seat", "a man sits down on a stool", "she sits on a chair")),
    Group("squat, sit", gets_up, ("a person stands up from a chair", "someone gets up from a seat")),
    Group("bow", bows(), (
        "a person bows", "someone takes a deep bow", "a man bows politely", "she bends forward in a bow",
        "the person bows to greet somebody", "bow")),
    Group("balance", on_one_leg, (
        "a person balances on one leg", "someone stands on one foot with the arms outstretched")),
    Group("dance", dances, (
        "a person dances salsa", "someone is dancing", "a man dances", "she does some dance steps",
        "the person performs a dance")),
    Group("then", in_order(forward, waves_one), (
        "a person walks forward, then waves", "someone walks ahead and then waves with one hand",
        "a man walks a few steps. He waves.", "she walks forward and waves afterwards",
        "before waving, a person walks forward")),
    Group("then", in_order(forward, right_up), (
        "a person walks forward and then raises the right hand", "after walking ahead, someone lifts the right arm")),
    Group("then", in_order(waves_one, forward), (
        "a person waves, then walks away", "someone waves a hand before walking forward")),
    Group("then", in_order(forward, bows()), (
        "a person walks forward, then bows", "someone walks up and takes a bow")),
    Group("then", in_order(bows(), forward), ("a person bows and then walks forward",)),
    Group("then", in_order(forward, sits), (
        "a person walks forward, then sits down", "someone walks ahead and takes a seat")),
    Group("then", in_order(gets_up, forward), ("a person stands up and walks forward",)),
    Group("then", in_order(forward, kicks()), (
        "a person walks forward, then kicks", "someone walks up and kicks a ball")),
    Group("then", in_order(kicks(), punches()), ("a person kicks, then punches",)),
    Group("then", in_order(punches(), kicks()), ("a person throws a punch and then kicks",)),
    Group("then", in_order(forward, left_turn, forward), (
        "a person walks forward, turns left, and walks on",
        "someone walks ahead, then turns left, then keeps walking")),
    Group("then", in_order(forward, right_turn, forward), ("a person walks forward, turns right and walks on",)),
    Group("then", in_order(walks(pace=(0.3, 1.8)), runs()), (
        "a person walks, then runs", "someone starts to walk and then breaks into a run")),
    Group("then", in_order(runs(), walks(pace=(0.3, 1.8))), ("a person runs and then slows down to a walk",)),
    Group("then", in_order(forward, backward), ("a person walks forward, then backward",)),
    Group("then", in_order(forward, jumps(), forward), ("a person walks, jumps and walks on",)),
    Group("then", in_order(right_up, left_up), ("a person raises the right hand, then the left hand",)),
    Group("then", in_order(waves_one, still), ("someone waves until they stop and stand still",)),
    Group("then", in_order(both_up, bows()), ("a person raises both arms, then bows",)),
    Group("at once", at_once(forward, waves_one), (
        "a person waves while walking", "someone walks forward and waves at the same time",
        "a man walks ahead, waving his hand")),
    Group("at once", at_once(forward, right_up), (
        "a person walks with the right hand raised", "someone raises the right hand while walking forward")),
    Group("at once", at_once(forward, both_up), ("a person walks forward with both arms up",)),
    Group("at once", at_once(runs(), waves_one), ("someone waves while running", "a person jogs and waves as they go")),
    Group("at once", at_once(runs(), both_up), ("a person runs with both hands up",)),
    Group("at once", both(backward, waves_one), ("a person walks backward while waving",)),
    Group("seconds", in_order(forward, still), (
        "a person walks for three seconds and then stands still", "someone stands still after walking for 4 seconds"),
          7.0),
    Group("seconds", in_order(still, forward), (
        "a person stands still for two seconds, then walks forward", "someone waits for two seconds and then walks"),
          6.0),
)

# Real clips of a kind: name, rule, labels that mean it, labels that may or may not show it.
REAL = (
    ("walk", forward, ("walk", "slow walk", "walk-turn-left", "walk-turn-right", "walk/stride"), (
        "walk", "navigate", "run/jog", "respond", "guide", "ZombieWalk", "step")),
    ("walk backward", backward, ("walk-back",), ("navigate",)),
    ("turn left", left_turn, ("walk-turn-left",), ("run", "jog", "walk on", "navigate")),
    ("turn right", right_turn, ("walk-turn-right",), ("run", "jog", "walk on", "navigate")),
    ("run", runs(), ("run", "dash", "run/jog"), ("jog", "jump", "kick")),
    ("raise left", left_up, ("raise-up-left-hand",), (
        "wave", "bye", "throw", "grab", "traffic", "wash", "reach", "call")),
    ("raise right", right_up, ("raise-up-right-hand",), (
        "wave", "bye", "throw", "grab", "traffic", "wash", "reach", "call", "scoop", "slash", "drink")),
    ("raise both", both_up, ("raise-up-both-hands",), (
        "wave", "bye", "throw", "grab", "traffic", "wash", "reach", "rotate", "dance", "jump", "slash")),
    ("wave left", left_wave, ("wave-left-hand",), ("bye", "rotate", "traffic", "wash")),
    ("wave right", right_wave, ("wave-right-hand",), ("bye", "rotate", "traffic", "wash", "drink", "throw")),
    ("wave both", both_wave, ("wave-both-hands",), ("rotate", "traffic", "wash")),
    ("kick", kicks(), ("kick front, left leg", "kick", "Front Kick", "Mawashigeri", "soccer - kick ball"), (
        "Yokogeri", "Heiansyodan", "swing legs", "dance")),
    ("kick left", kicks(0), ("kick front, left leg",), (
        "Kick", "kick", "geri", "Heiansyodan", "swing legs", "dance", "balance")),
    ("punch", punches(), ("punch", "boxing", "Oiduki"), (
        "Empi", "Gedanbarai", "Heiansyodan", "Syutouuke", "elbow", "slash", "throw", "Kick", "geri", "traffic",
        "signals", "raise", "wave", "rotate", "grab", "run", "jump")),
    ("jump", jumps(), ("jump", "forward jump", "hop on both legs"), ("jump", "hop", "run", "dash", "jog", "backflip",
                                                                      "Kick", "geri")),
    ("squat", squats(), ("squat",), ("squat", "sit", "jump", "floor", "scoop", "lie", "hop", "backflip", "bend")),
    ("sit", sits, ("sit on stepstool, stand up", "sit on high stool, stand up"), (
        "sit", "squat", "floor", "scoop", "lie", "bend", "jump", "hop")),
    ("bow", bows(), ("bow",), ("bend", "scoop", "floor", "squat", "sit", "guide", "lie")),
    ("balance", on_one_leg, ("balance on one leg, outstretched arms",), ("balance", "kick", "Kick", "geri", "elbow")),
    ("dance", dances, ("salsa dance", "dance-short", "lambada dance"), ("walk", "run", "jump", "hop")),
)


# Rules of a number, by clips whose rows say how often: name, rule of a number, labels.
COUNTED = (("kick, how often", lambda number: kicks(0, number), ("kick front, left leg",)),
           ("jump, how often", jumps, ("hop on both legs",)),
           ("squat, how often", squats, ("squat",)))
# Rules of a pace, by walks of a style that means it: name, rule, styles, styles between the paces.
PACED = (("walk slowly", walks(pace=(0.15, 0.9), least=0.4), ("elderly", "old", "sad", "proud", "not-confident"), (
             "childish", "exhausted", "tired", "giant")),
         ("walk quickly", walks(pace=(1.4, 2.6)), ("active", "happy"), ("angry", "musical", "youthful", "masculine")))


def sentences():
  """[(category, sentence, rule, seconds)], each sentence once."""
  listed = [(group.category, sentence, group.rule, group.seconds) for group in GROUPS for sentence in group.sentences]
  assert len({sentence for _, sentence, *_ in listed}) == len(listed)
  return listed
