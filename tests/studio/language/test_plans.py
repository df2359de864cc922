"""Plans of sentences with several actions, and sentences that must stay whole. Rules with examples: `test_grammar`."""
import time

import pytest

from motion_studio.language import parse

# Sentence -> what is done: "|" after each other, "+" at once, [seconds]; all of them begin with "a person" if they do.
COMPOSED = {
    # one after the other
    "a person walks forward then waves the right hand.": "walks forward | waves the right hand",
    "a person walks forward and then sits down": "walks forward | sits down",
    "a person walks forward and then he sits down": "walks forward | sits down",
    "A person WALKS, THEN WAVES!": "WALKS | WAVES",
    "a person walks... then waves": "walks | waves",
    "a person walks - then waves": "walks | waves",
    "a person walks (slowly), then waves": "walks (slowly) | waves",
    "a person walks forward, turns left, walks forward again, and sits down":
        "walks forward | turns left | walks forward again | sits down",
    "a person bends down and picks up a box": "bends down | picks up a box",
    "a person picks up a cup, drinks from it and puts it down": "picks up a cup | drinks from it | puts it down",
    "a person punches and kicks": "punches | kicks",
    "a person raises both arms and lowers them": "raises both arms | lowers them",
    "a person turns around and walks back": "turns around | walks forward",
    "a person runs, jumps up, and lands": "runs | jumps up, and lands",
    "a man leaps forward, then lands on both feet and bows": "leaps forward, then lands on both feet | bows",
    "a person bows and waves": "bows | waves",
    "a person stretches, bends and twists": "stretches | bends | twists",
    "a person waves goodbye and leaves": "waves goodbye | leaves",
    "a person walks followed by a jump": "walks | jumps",
    "a person walks and then, after a moment, waves": "walks | waves",
    "someone rubs their hands together, then warms them": "rubs their hands together | warms them",
    "a person first walks, then runs": "walks | runs",
    "First, a person walks. After that, they run. Finally they stop.": "walks | runs | stands still",
    "a man walks forward, stumbles, and then regains his balance": "walks forward | stumbles | regains his balance",
    "a person throws a ball with the right hand and catches it with the left hand":
        "throws a ball with the right hand | catches it with the left hand",
    # before, after, until, when
    "after sitting, he walks": "sits | walks",
    "a person walks before he runs": "walks | runs",
    "a person walks and then waves with the left hand before sitting down":
        "walks | waves with the left hand | sits down",
    "a person walks until he falls": "walks | falls",
    "until he falls, a person walks": "walks | falls",
    "having walked, he sits": "walks | sits",
    # subjects before "then", and the past tense
    "a person hops on his left leg. the man then waves": "hops on his left leg | waves",
    "a person raises both arms, they then squat": "raises both arms | squats",
    "a man lowers the right arm followed by the left one and then squats":
        "lowers the right arm followed by the left one | squats",
    "the person jumped twice and then sat down": "jumps 2 times | sits down",
    "a person walked forward": "walks forward",
    "a person appears to be pushed, then falls": "is pushed | falls",
    "they are pushed, then they fell": "are pushed | fall",
    # verbs in front of the verb that says the action
    "a man walks and tries to kick with the right foot": "walks | kicks with the right foot",
    "a person turns and manages to sit down": "turns | sits down",
    "a man pretends to throw a ball, then appears to look around": "throws a ball | looks around",
    "he looks to be walking, then sits": "walks | sits",
    # verbs of everyday actions, commands
    "she tiptoes to the door, listens, and knocks": "tiptoes to the door | listens | knocks",
    "a man is pushed, recovers and checks his watch": "is pushed | recovers | checks his watch",
    "a person lays down and repeats it": "lies down | repeats it",
    "bow respectfully, then back away": "bows respectfully | walks backward",
    "a person walks straight then looks like it takes a couple steps up":
        "walks straight | looks like it takes a couple steps up",
    # single steps, halts as participles, the way back, half turns
    "a man is standing still and then steps back": "stands still | walks backward [0.8] | stands still",
    "a person steps forward with the left foot and kicks": "walks forward with the left foot [0.8] | kicks",
    "a man takes a few steps forward, stopping with the feet apart":
        "takes a few steps forward | stands still with the feet apart",
    "a person walks forward, then turns around and goes the other direction":
        "walks forward | turns around | goes back",
    "she jumps and does a 360 to the left": "jumps | turns 360 degrees to the left",
    # how somebody is before the first action
    "a person is on the floor, then gets up": "lies on the floor | gets up",
    "a man was laying down and then he got up": "lies down | gets up",
    "she is on her knees and then gets up": "kneels | gets up",
    "a man is hunched over, then takes a bow": "is hunched over | bows",
    "a man is ready, then walks and turns left": "walks | turns left",
    "a person who is standing with his hands by his sides steps forward and kicks":
        "walks forward [0.8] | kicks",
    "a person standing with his arms out takes two steps forward and bows":
        "walks forward with his arms out [1.1] | bows",
    "a person standing with the arms out lowers them, then bows": "lowers them | bows",
    "a figure spins with arms outstretched then adjusts sleeves": "spins with arms outstretched | adjusts sleeves",
    # exercises that are named by two words
    "a man does two push ups, then stands up": "does two push-ups | stands up",
    # stops
    "a person walks forward and stops": "walks forward | stands still",
    "a person runs and comes to a sudden halt": "runs | stands still",
    "a person walks, stops, and waves": "walks | stands still | waves",
    "a person walks then stops walking": "walks | stands still",
    "a person starts walking, then stops": "walks | stands still",
    "a person walks, then stops with both hands on the hips": "walks | stands still with both hands on the hips",
    "a person walks, then stops with both feet": "walks | stands still",
    # a pose that is kept
    "a person sits down, stays seated for three seconds, then gets up": "sits down | holds still [3] | gets up",
    "a person kneels and remains there for two seconds": "kneels | holds still [2]",
    "a person raises both arms, keeps them there, then walks": "raises both arms | holds still | walks",
    "someone kicks and holds the pose": "kicks | holds still",
    "a person sits down and doesn't move": "sits down | holds still",
    "a person does not move": "stands still",
    "a person bows and waits": "bows | stands still",
    "a person kneels and stays kneeling while waving": "kneels | holds still + waves",
    # arms act above a pose that is low
    "a man crouches, claps for three seconds and stays there": "crouches | holds still + claps [3] | holds still",
    "a person sits down, raises the left hand for two seconds and gets up":
        "sits down | holds still + raises the left hand | holds still [2] | gets up",
    "a person sits down, then waves while nodding": "sits down | holds still + waves + nods",
    "a person kneels down and picks something up with the right hand":
        "kneels down | picks something up with the right hand",
    "a person sits down, gets up and waves": "sits down | gets up | waves",
    "a person sits down and bows": "sits down | bows",
    "someone kicks and holds the pose, then stands still while waving": "kicks | holds still | stands still + waves",
    # a pace of counted steps
    "a person takes two slow steps back and bows": "walks backward slowly [1.82] | bows",
    "a person walks, then stands still while waving": "walks | stands still + waves",
    "a person runs and keeps up": "runs | keeps up",
    "a person raises the left hand 3 times for 4 seconds": "raises the left hand 3 times [4]",
    "a person rests a hand on the table and walks": "rests a hand on the table | walks",
    # at once
    "a person walks while waving the left hand": "walks + waves the left hand",
    "a person waves with their right hand as they walk": "walks + waves with their right hand",
    "while a person walks, he waves": "walks + waves",
    "while walking, a person waves and nods": "walks + waves + nods",
    "a person waves both hands and walks in place": "walks in place + waves both hands",
    "a person is walking and waving": "walks + waves",
    "a man is sitting and clapping": "sits + claps",
    "a person jumps and claps": "jumps + claps",
    "a person kicks and punches simultaneously": "kicks + punches",
    "a person dances while clapping": "dances + claps",
    "a person nods and waves": "waves + nods",
    "a person walks in a circle and waves the left hand, then bows twice":
        "walks in a circle + waves the left hand | bows 2 times",
    "a person crouches then leaps, reaching up": "crouches | leaps + reaches up",
    # a verb that is said once, a pace that changes
    "a person punches with the right hand twice, then once with the left":
        "punches with the right hand 2 times | punches with the left hand",
    "waves the left hand three times and then the right hand twice":
        "waves the left hand 3 times | waves the right hand 2 times",
    "raise your right hand then your left hand": "raises your right hand | raises your left hand",
    "a person kicks once, then twice": "kicks | kicks 2 times",
    "a person jumps once and then walks": "jumps | walks",
    "a person walks three steps forward, two steps backward":
        "walks three steps forward [1.65] | walks backward [1.3] | stands still",
    "a person takes a step back, then waves": "walks backward [0.8] | waves",
    "someone takes three steps to the right while waving":
        "walks sideways to the right + waves [1.65] | stands still",
    "a person takes a couple of steps back, then runs": "walks backward [1.3] | runs",
    "someone walks two steps while waving": "walks two steps + waves [1.1] | stands still",
    "a person starts walking slowly, speeds up and begins to run": "walks slowly | walks quickly | runs",
    "a person runs fast and slows down": "runs fast | runs slowly",
    "a person walks slowly at first, then faster": "walks slowly at first | walks quickly",
    "someone punches twice with the right hand and once with the left":
        "punches with the right hand 2 times | punches with the left hand",
    "a person punches left, right, left":
        "punches with the left hand | punches with the right hand | punches with the left hand",
    "someone slowly walks backwards and then quickly forwards": "slowly walks backwards | walks quickly forwards",
    "he walks a bit, waits for 3 seconds and goes on": "walks a bit | stands still [3] | walks a bit",
    "a person walks in a wide circle clockwise, then counterclockwise":
        "walks in a wide circle clockwise | walks in a wide circle counterclockwise",
    "a person bows and goes on": "bows | goes on",
    "a person runs, then walks, stops and goes on": "runs | walks | stands still | walks",
    "a person slowly walks, stops and goes on": "slowly walks | stands still | walks",
    "a person waves, then goes faster": "waves | goes faster",
    "a person takes two steps left and waves": "walks sideways to the left [1.1] | waves",
    "a person takes three steps forward for 5 seconds": "walks forward [5]",
    # a verb behind no connector, and clauses that are no action
    "a man walks forward sits in a chair": "walks forward | sits in a chair",
    "a person turns around walks back and waves": "turns around | walks forward + waves",
    "a person standing raises the left knee, then claps": "raises the left knee | claps",
    "a man who is standing with his hands by his sides takes two steps forward and waves":
        "walks forward [1.1] | waves",
    "a person starts in a spot, walks ahead, then stops": "walks ahead | stands still",
    "from a standing position, the person slowly walks in a circle, and then stops":
        "slowly walks in a circle | stands still",
    "a person jogs, stops to bend over, then continues jogging": "jogs | bends over | jogs",
    "a person bends at the waist with both arms to the right, then the left":
        "bends at the waist with both arms to the right | bends to the left",
    "a person picks something up and walks forward": "picks something up | walks forward",
    "a person dancing and clapping both hands": "dances + claps both hands",
    "a man lifts and bends his right leg, then his left leg": "lifts and bends his right leg | lifts his left leg",
    "a man sits down, brings his hands to his face and stands up":
        "sits down | holds still + brings his hands to his face | stands up",
    "he turns left, returns his left foot and waves": "turns left | returns his left foot | waves",
    "a person side-stepping to their left, then side stepping to their right":
        "walks sideways to the left | walks sideways to the right",
    "the man takes a large sideways step to the left": "walks sideways to the left",
    # a main clause behind no comma
    "once he sits down he waves": "sits down | holds still + waves",
    "before the man sits down he bows": "bows | sits down",
    # how often, how long
    "a person jumps three times, then bows": "jumps 3 times | bows",
    "a person nods twice while standing": "stands + nods 2 times",
    "a person spins around 4 times and then falls": "spins around 4 times | falls",
    "a person makes a couple of jumps": "jumps 2 times",
    # a noun that says what is done
    "someone walks up and takes a bow": "walks up | bows",
    "a man walks a few steps and stands still": "walks a few steps | stands still",
    "she puts her hands up": "raises both hands", "someone puts up the left hand": "raises the left hand",
    "they take a left turn": "walk | turn left",
    "a man takes a left turn and then a right turn": "walks | turns left | turns right",
    "she walks on and takes a right turn and keeps walking": "walks on | turns right | walks",
    "a person makes a right turn while walking": "turns right while walking",
    "a man takes two steps forward, then a step back":
        "walks forward [1.1] | walks backward [0.8] | stands still",
    "someone waves and begins dancing": "waves | dances",
    "a person waves while doing a jump": "jumps + waves",
    "a person walks for five seconds": "walks [5]",
    "a person jogs in place for 4s while punching": "jogs in place + punches [4]",
    # what is not said again
    "a person walks forward then backward": "walks forward | walks backward",
    "a person raises the left hand then the right hand": "raises the left hand | raises the right hand",
    "a person kicks with the left foot then the right foot": "kicks with the left foot | kicks with the right foot",
    "Walk forward, then wave": "walks forward | waves",
    "a person hops on the left leg, then on the right leg": "hops on the left leg | hops on the right leg",
    "a person moves forward and backward then left and right": "moves forward and backward | moves left and right",
}
PLAIN = """
a person carefully stepping backward
a person clasps and unclasps his hands
a person walks forward and keeps walking
a person turns left and continues turning
the person on the right turns left
a person takes slow steps through the mud
a person takes a break dance
a person hurries to the left
someone puts the hands up and down
a man puts his hand up his sleeve
she puts up hands on hips
a person walks forward
a person walks up and down
a person walks back and forth
a person walks backwards and forwards
a person steps from side to side and up and down
a person looks left and right
a person turns left and right
a person waves the left and right hand
a person raises the left and the right hand
a person raises the right knee and the left arm
a person crawls on hands and knees
a person gestures with hands and arms
a person walks with confidence and pride
a person walks happily and proudly
a person throws punches and kicks
a person exercises with jumping jacks, side twists, bends and jogging
a person nods more than twice
a person climbs three steps
a person takes 0 steps
a person takes half a step
a person walks one step at a time
a person walks up three steps
a person does a front kick
a person does a kick flip
a person takes the ball
a person makes a phone call
a person gives a thumbs up
a person does jumps
a person walks and makes a u-turn
the person marches forward, directed to the right
a person practices leg kicks
a person walks up steps
a person stands
someone runs, makes a circle
a person takes turns
someone is doing squats and then jumping jacks
a person sits with legs crossed and arms folded
a person says goodbye by waving
a person walks as if drunk
a person walks like he is drunk
a person runs as fast as he can
a person walks before the door
a person walks after the ball
a person walks for a while
a person walks while his arms swing
a person turns to the left while walking
while walking, a person turns left
a person walks, turning left
a person dribbles a basketball while moving backward
a person stands still
a person stays seated
a person stays on one leg
a person is happy and then sad
a person throws a ball, then another ball
a person walks in the rain, then under the sun
a woman sits while a man waves
he walks, she waves
a person walks, then another person waves
walk
then
, , ,
and and and then then
😀 then 😀
...
before after until
""".strip().splitlines()


@pytest.mark.parametrize("text", COMPOSED)
def test_a_sentence_of_several_actions(text):
  plan = parse(text)
  assert not plan.is_plain and plan.text == text
  assert plan.summary.lower() == COMPOSED[text].lower()


@pytest.mark.parametrize("text", PLAIN)
def test_a_sentence_that_is_not_parted(text):
  plan = parse(text)
  assert plan.is_plain and plan.prompts == [text]


def test_everybody_keeps_being_who_they_are():
  assert parse("an old man with a cane walks slowly, then he sits, and then the man waves").prompts == [
      "an old man with a cane walks slowly", "an old man with a cane sits", "an old man with a cane waves"]
  assert parse("before sitting down, she waves").prompts == ["she waves", "she sits down"]
  assert parse("walk, then wave").prompts == ["a person walks", "a person waves"]
  assert parse("two people walk and then wave").prompts == ["two people walk", "two people wave"]


def test_who_does_something_while_standing_still_does_not_rest():
  resting = lambda text: [segment.is_pause for segment in parse(text).segments]
  assert resting("a person walks, then stands still while waving") == [False, False]
  assert resting("a person walks, then stands still") == [False, True]
  assert resting("a person kneels and stays kneeling") == [False, True]


def test_a_caption_that_was_learned_stays_whole():
  learned = {"a person walks forward and turns left", "a person jumps twice"}
  known = lambda text: text in learned
  assert parse("a person jumps twice", known).is_plain
  assert parse("a person walks forward and turns left, then waves", known).summary == (
      "walks forward and turns left | waves")
  assert parse("a person walks forward and turns left, then waves").summary == "walks forward | turns left | waves"


def test_long_texts_take_no_time():
  start = time.process_time()  # not of what else the machine does
  for text in ("a person walks and waves, then " * 160, "and " * 1250, "walking " * 600, "a , " * 1200, "😀" * 5000):
    parse(text)
  assert time.process_time() - start < 5


def test_a_plan_keeps_what_the_text_says_beside_what_a_model_has_learned():
  text = "a person walks forward and turns left"
  plan, whole = parse(text), parse(text, lambda text: True)
  assert plan.summary == "walks forward | turns left" and whole.is_plain and whole.prompts == [text]
  assert whole.actions == plan.actions and whole.requirements == plan.requirements
  assert whole.fully_split() == plan.fully_split() == plan
  assert whole.single.verb == "walk" and parse("a person walks, then waves").single is None
  assert plan.with_segments(plan.segments[:1]).requirements == plan.requirements


def test_somebody_who_only_is_somehow_keeps_the_name():
  plan = parse("an old man is ready, then walks and turns left")
  assert plan.prompts == ["an old man walks", "an old man turns left"]


@pytest.mark.parametrize("text, subject, done, at_ease", [
    ("a man bows.", "a man", True, True), ("bow twice", "a person", True, True),
    ("she raises a hand", "she", True, False), ("a person walks", "a person", False, False)])
def test_an_action_that_ends_by_itself(text, subject, done, at_ease):
  action = parse(text).single
  assert (action.subject, action.is_done_once, action.leaves_at_ease) == (subject, done, at_ease)


def test_a_plan_is_immutable():
  plan = parse("a person walks, then waves")
  with pytest.raises(AttributeError):
    plan.text = "a person runs"
  assert plan == parse(plan.text) and hash(plan) == hash(parse(plan.text))
