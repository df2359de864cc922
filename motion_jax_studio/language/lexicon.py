"""All word lists of the parser, by topic. Verbs of movement and their body parts: `motion_jax.text.lexicon`."""
import functools
import re

from motion_jax.text.lexicon import VERBS
from motion_jax.text.wordnet import LOST, Target

PAUSE, HOLD = "stands still", "holds still"  # the words of a pause, and of a pose that is kept

# Spellings and turns of phrase, each with the words that all rules read.
_SPELT = ((r"\b(do|does|did)n['’]t\b", r"\1 not"), (r"\bzig[- ]zag", "zigzag"),
          (r"\b(?:counter|anti)[- ]*clock[- ]?wise\b", "counterclockwise"),
          (r"\bsemi[- ]?circle|\bhalf(?: of)? an? circle|\bhalf-circle", "half circle"), (r"\bu turn", "u-turn"),
          (r"\b(?:is|was) on (?:his|her|their) knees\b", "kneels"),
          (r"\b(?:is|was) (?:laying|lying|laid)(?= (?:down|on)\b)|\b(?:is|was)(?= on the (?:floor|ground)\b)", "lies"),
          (r"(\b(?:then|and),? (?:walk|run|jog|go|move|head)(?:s|es)?) (?:back )?(?:(?:in|to|towards) )?(?:the )?"
           r"(?:other|opposite) (?:direction|way)\b", r"\1 back"),
          (r"\blays(?= (?:down|on|back)\b)", "lies"), (r"\bside[ -]step", "sidestep"),
          (r"(^|then |and |, )back (?:away|off)$", r"\1walk backward"),
          (r"(?<!and )(?<!then )(?<!, )\btake(s?) a (left|right) turn\b", r"walk\1 and make\1 a \2 turn"),
          (r"\bturn(s|ing)?((?: \w+)?) to (walk|run|jog|go)(?= back\b)", r"turn\1\2 and \3\1"),
          (r"\b(push|sit|pull|chin|press)[ -](ups?)(?= *$|[,.]| (?:and|then|on)\b)", r"\1-\2"),
          (r"\bserpentine\b|\bs[- ](?:shape|curve)\b|\b(?:s[- ](?:shaped|curved)|wavy|winding|wiggly|snaking)"
           r" (?:line|path|route|course|way|motions?|manner)\b", "zigzag"),
          (r"\b(?:the (?:shape|form|pattern) of an?|(?:an? |the )?figure(?:[ -]of)?(?:[ -]an)?)[ -](?:eight|8)s?\b"
           r"(?:[ -](?:shape|pattern|loop|path)\b)?", "a figure-eight"),
          (r"\bback(s|ing|ed) (?:up|away|off)\b(?! (?:the|a|an|his|her|their|its)\b)", r"walk\1 backward"))


def spelt(text: str) -> str:
  """The text in the spellings and words that all rules read."""
  return functools.reduce(lambda result, rule: re.sub(*rule, result, flags=re.IGNORECASE), _SPELT, text)


# --- who --------------------------------------------------------------------------------------------------------------

PEOPLE = set("person man woman boy girl child kid guy lady figure human dancer boxer player character people men "
             "women children somebody someone anybody everyone one he she they i you we it who him her them athlete "
             "actor soldier robot zombie giant thug teenager adult".split())
DEFAULT_SUBJECT = ["a", "person"]
PRONOUNS = {"he", "she", "they", "it", "who", "i", "you", "we"}
SUBJECT_PRONOUNS = {"he", "she", "they", "i"}  # a main clause may begin with them without a comma
PLURAL_SUBJECTS = set("people men women children they we i you".split())
POSSESSIVES = {"his", "her", "their", "its", "my", "your", "our"}
DETERMINERS = {"the", "a", "an", "this", "that"}

# --- numbers ----------------------------------------------------------------------------------------------------------

NUMBERS = {word: number for number, word in enumerate(
    "zero one two three four five six seven eight nine ten eleven twelve".split())} | {
        "a": 1, "an": 1, "half": 0.5, "couple": 2, "few": 3, "several": 3, "many": 4}
INEXACT_NUMBERS = ("zero", "half", "few", "several", "many")
ARTICLES = {"a", "an", "another", "the"}
ONE_MORE = ("a", "an", "another")

# --- where to, how fast -----------------------------------------------------------------------------------------------

SIDES = {"left": "right", "right": "left"}  # each with its opposite
DIRECTIONS = set("left right forward forwards backward backwards back sideways up down around ahead away clockwise "
                 "counterclockwise again".split())
BACKWARD = {"back", "backward", "backwards"}
PATH_NOUNS = {"u-turn", "circle", "circles", "figure-eight", "loop", "zigzag", "arc", "detour"}  # shapes of a path

# --- when -------------------------------------------------------------------------------------------------------------

SIMULTANEOUS = {"at the same time", "simultaneously", "at once", "meanwhile"}
PAUSE_SECONDS = {"a moment": 1.0, "a while": 4.0, "a long time": 6.0}
SHORT_TIMES = set("for a little short long while moment bit time second".split())  # "for a little while"
NOT_A_CONNECTOR_AFTER_AS = ("if", "though", "well", "a", "an")
AFTER_ONCE = set("with on to in at from by and again more".split())  # "kicks left, then once with the right"
BEFORE_WHILE = ("a", "little", "short", "long", "good")  # "rests for a while"

# --- verbs by what they do in a sentence ------------------------------------------------------------------------------

# Verbs in front of the verb that says the action: "starts walking", "keeps waving".
ASPECTS = ("be", "start", "begin", "continue", "keep", "proceed", "resume", "will", "can", "seem", "appear")
# A participle after these belongs to them: "starts waving", "stops by waving".
BEFORE_A_PARTICIPLE = set("be start begin continue keep proceed resume go stop quit finish do try practice perform "
                          "pause like by and".split())
RELATIVE = {"who", "that", "which"}  # between a subject and what is said of it
SUBORDINATE = {"where", "how"}  # words after which no clause of its own begins: "back to where they started"
BEING = {"is", "are", "was", "were"}
IDLE = {"stand", "face"}  # a participle of these after the subject is no action: "a person standing waves"
# Objects of these are things that they are done with: "practices leg kicks".
WITH_ACTIONS_AS_OBJECTS = {"practice", "alternate", "try", "do", "make", "take", "throw", "give", "perform", "work"}
STARTING, AT_A_PLACE = {"start", "begin"}, {"in", "at", "on"}  # "starts in a spot" is no action
HALTING_VERBS = {"stop", "pause", "halt", "freeze"}
PAUSING_VERBS = HALTING_VERBS | {"wait", "rest"}
# Before "to" and the verb that says the action: "tries to wave".
BEFORE_TO = PAUSING_VERBS | {"try", "attempt", "manage", "pretend", "look", "decide", "prepare"}
BEFORE_ACTIONS = BEFORE_TO | set(ASPECTS)
# Meanings that `motion_jax.text.wordnet` does not have.
HELD = "held"  # a manner: the pose is kept for a while
OWN_MEANINGS = {
    "hurry": Target("walk", 1.0, ("quickly",)), "rush": Target("walk", 1.0, ("quickly",)),
    "wander": Target("walk", 1.0), "circle": Target("walk", 1.0), "zigzag": Target("walk", 1.0),
    "return": Target("walk", 1.0, ("back",)), "march": Target("walk", 1.0, (LOST,)),
    "sidestep": Target("walk", 1.0, ("sideways",)), "dribble": Target("bounce", 1.0), "sneak": Target("creep", 1.0),
    "crouch": Target("squat", 1.0, (HELD,))}
# Paces that WordNet does not have as such, and words of its clusters of fast and slow that are no pace ("").
OWN_PACES = {"brisk": "quickly", "briskly": "quickly"} | dict.fromkeys(
    "easy easygoing lazy lazily instant instantly instantaneous outright straightaway deliberately dilatory".split(),
    "")
LIGHT_VERBS = {"take", "do", "make", "throw", "give", "perform"}  # their object says the action: "takes a bow"
STEP_VERBS = set("take step walk go move march run jog make do".split())  # their steps may be counted
ONE_ARM_EACH = {"wave", "raise", "lift", "hold", "stretch", "extend", "lower", "swing", "put"}
OF_AN_OBJECT = {"raise", "lift", "lower", "extend", "clasp"}  # never without something that they move
# Actions that end by themselves and leave the body standing.
DONE_ONCE = set("bow kick turn squat duck raise lift lower throw toss catch pick point salute grab reach hug slap "
                "strike pull push put place drop greet shrug cross".split())
NOT_AT_EASE = {"kick", "raise", "lift", "strike"}  # of these, those after which an arm or a leg may be in the air
LOW = {"sit", "kneel", "crouch", "lie"}  # after these the body is low, and stays low in a pause
FROM_THE_FLOOR = {"pick", "place", "drop", "take", "lift"}  # the whole body goes down and up again with the arms
AT_A_THING = set("open grab press knock wipe screw type".split())  # done with a thing where it stands
# Seconds of one cycle of actions that a clip shows many times.
CYCLES = {"wave": 0.8, "clap": 0.6, "nod": 0.8, "shake": 0.6, "punch": 1.0, "jab": 0.8, "stomp": 0.8, "stamp": 0.8}
# Repetitions of these verbs are sampled one by one, those of others by a prompt with their number. Right numbers, one
# by one and by a prompt: 12 and 4 of 24 kicks and squats, 0 and 9 of 18 jumps and bows.
COUNTED_ONE_BY_ONE = {"kick", "squat"}
# Their object is what moves: "turns the head"; "walks with the hands up" still walks.
MOVED_BY_OBJECT = (VERBS["arms"] | VERBS["head"] | {
    "turn", "rotate", "spin", "move", "circle", "bend", "tilt", "twist", "bounce", "roll", "bring", "keep"}) - {
    "scratch", "wipe", "rub", "wash", "brush", "slap", "point", "grab", "reach", "pick", "hug", "carry"}  # with a hand

# --- poses that are kept ----------------------------------------------------------------------------------------------

LOW_POSES = set("seated sitting low down crouched crouching kneeling squatting lying bent".split())
POSE_NOUNS = set("it them that this still pose position posture there steady".split())
POSE_WORDS = LOW_POSES | POSE_NOUNS | set("here put up standing motionless frozen in on the his her their its out high "
                                          "place floor chair air like so as".split())

# --- nouns ------------------------------------------------------------------------------------------------------------

AFTER_AN_OBJECT = set("with to toward towards above over at on behind near against".split())
ARM_PARTS = {"arm", "hand", "wrist", "elbow", "fist", "finger", "shoulder"}
SIDED_ARM_PARTS = {"arm", "hand", "wrist", "elbow", "fist"}
BODY_PARTS = (("legs", {"leg", "knee", "foot", "feet", "heel", "toe", "ankle", "thigh"}),
              ("head", {"head", "chin", "neck"}),
              ("torso", {"torso", "hip", "waist", "chest"}),
              ("arms", ARM_PARTS))
BODY = set().union(*(things for _, things in BODY_PARTS))
LIMBS = BODY | {f"{part}s" for part in BODY}
NO_POSTURE = {"left", "right", "side", "sides", "again", "slightly", "first", "it's"}
BEFORE_A_LIMB = set("the with on left right both other one".split())
WITH_A_LIMB = POSSESSIVES | set("the a an one both left right".split())  # between "with" and a limb
# Nouns that name another verb: "takes a seat".
IDIOMS = {"seat": "sit down", "rest": "rest", "break": "pause", "breather": "pause", "pause": "pause"}
# Nouns that have rules of their own after a light verb.
NO_ACTION_NOUNS = PATH_NOUNS | {"step", "look", "move", "stop", "halt"}
ADVERBS = {"forward": "forward", "backward": "backward", "sharp": "sharply", "full": "fully"}  # of a noun's adjectives
LIMB_OF_ACTION = {"kick": "foot", "punch": "hand", "jab": "hand", "wave": "hand", "salute": "hand"}
# Words that may follow the noun of an action; others change its meaning ("does a kick flip").
AFTER_A_NOUN = set("to in into on onto at with from for over towards toward forward forwards backward backwards back "
                   "left right up down around high again quickly slowly fast upwards sideways while".split())
STANDSTILLS = {"stop", "halt", "standstill"}
PUTTING_VERBS = {"put", "throw", "stick", "bring", "hold", "shoot", "fling", "get"}  # "puts her hands up"

# --- requirements -----------------------------------------------------------------------------------------------------

# Kinds of detected events by verb.
EVENTS = {"kick": "kick", "punch": "punch", "jab": "punch", "box": "punch", "shadowbox": "punch", "jump": "jump",
          "hop": "hop", "squat": "squat", "bow": "bow", "wave": "wave", "turn": "turn", "spin": "turn", "pivot": "turn",
          "sit": "sit", "crouch": "crouch"}
SIDED_EVENTS = {"kick", "punch", "wave", "turn", "sideways", "foot", "balance"}
ARMS = {"hand", "hands", "arm", "arms"}
TURNING = {"turn", "spin", "pivot", "rotate"}
GOING_ASIDE = {"step", "take", "move", "slide", "sidestep", "go", "jump", "hop"}  # to a side, as walks do
IN_PLACE = "in place, on place, in spot, on spot, in one spot, on one spot"
STAIRS = {"stairs", "stair", "steps", "staircase", "stairway", "ladder", "hill", "slope", "ramp"}
NEGATIONS = {"without", "not", "no", "never", "nor", "don't", "doesn't"}

# --- paths ------------------------------------------------------------------------------------------------------------

# Verbs of actions on the spot; a jump may also go somewhere.
STAYING_VERBS = set("sit stand stop rest wait stay pause halt squat crouch kneel lie kick bow lean".split())
