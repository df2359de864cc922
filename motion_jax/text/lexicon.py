"""Words of captions and prompts: verbs of movement by body part, and words that carry no movement.

The body part of a verb is the one that SINC (Athanasiou et al. 2023) counted most often for it: walking is of the legs,
waving of the arms, bowing of the torso, nodding of the head.
"""

# Verbs that the tagger of captions knows. The tokens of the classic evaluators depend on these: add none.
_TAGGED = {part: set(words.split()) for part, words in {
    # Continuous actions of the legs, beside which other parts may act;
    "gait": "walk run jog stroll stride march hop skip jump leap crawl tiptoe sprint dash trot wade shuffle "
            "sidestep strafe move stand stay circle waddle step go come bounce",
    # and single ones.
    "legs": "turn spin rotate sit kneel squat crouch kick fall lie rise climb stumble lunge stamp duck land "
            "return descend get",
    "body": "dance exercise roll fight practice perform do swim fly balance box play slide",
    "torso": "bow bend lean twist tilt",
    "arms": "wave clap raise lift lower throw catch punch jab drink pick point salute grab reach swing shake "
            "gesture wipe scratch cross answer push pull put rub wash fold hold flap extend draw shoot stretch "
            "strike slash brush open screw take place drop sweep tap block",
    "head": "look",
    "": "sing laugh shout call say think show respond direct make give keep start stop rest use work switch "
        "follow touch hit hang rock lift blow",
}.items()}
# Verbs of prompts that the tagger reads as nouns.
_FURTHER = {part: set(words.split()) for part, words in {
    "gait": "sneak creep limp wander pace hurry rush gallop strut saunter stagger remain amble hike prowl stalk "
            "hustle lumber catwalk grapevine",
    "legs": "pivot trip stomp dodge approach collapse faint",
    "body": "cartwheel flip somersault shadowbox skate waltz",
    "torso": "stoop hunch slouch sway slump wiggle",
    "arms": "toss eat hug pray cheer juggle drum beckon snap greet carry stir pour shrug slap pump applaud swat "
            "clasp unclasp uncross check gather spread dust knock type press shield claw slice sprinkle pass aim",
    "head": "nod glance stare listen",
    "": "talk speak smile cry yell whisper yawn breathe begin continue pause wait halt freeze finish quit resume "
        "proceed lose regain recover repeat hesitate adjust try attempt manage pretend seem appear want face "
        "bring set leave enter",
}.items()}
VERBS = {part: verbs | _FURTHER.get(part, set()) for part, verbs in _TAGGED.items()}
ACTIONS = set().union(*VERBS.values())
# With verbs that are no action of a prompt here.
TAGGED_VERBS = set().union(*_TAGGED.values()) | set(
    "clean close dangle dribble glide jack let pirouette pose scoop scrub shower signal thrust unscrew".split())

# Words without a movement of their own; a prompt gets no warning for them.
FUNCTION_WORDS = frozenset(
    "a about after again all also an and another any are as at be been before being both but by can could did do does "
    "done each either else every few for from had has have having he her hers herself him himself his how i if in into "
    "is it its itself just let like many may me might more most much must my myself no nor not of off on once one only "
    "onto or other our out over own per please quite same shall she should so some something somewhat such than that "
    "the their theirs them themselves then there these they this those though through till to too toward towards "
    "until up us very was we were what when where which while who whom whose why will with within without would you "
    "your s t re ll d m ve".split())

# Further ones: politeness and fillers, unnamed things and parts of the body (their actions are judged as phrases),
# requests for a motion, time and certainty, numbers, units.
WORDS_WITHOUT_MOTION = FUNCTION_WORDS | frozenset(
    "kindly thanks thank sorry hey hi hello ok okay um uh er erm hmm well oh ah wow yes yeah no nope really so now "
    "named maybe perhaps probably possibly actually basically simply literally totally truly exactly rather pretty "
    "somehow anyway kind sort bit lot lots extremely fairly completely entirely approximately roughly nearly almost "
    "lol alright sure dear bro "
    "doing done together similar whilst series repeatedly repeat repeats repeating moderate regular original position "
    "thing things stuff object objects item items head waist chest stomach face shoulder shoulders forearm forearms "
    "knee knees toe toes hip hips neck elbow elbows ear ears mouth "
    "show shows showing see want wants need needs give generate create render animate animation animated motion "
    "motions movement movements action actions clip video scene imagine try tries trying attempt attempts depicts "
    "depicted character actor avatar individual people persons everybody anybody nobody "
    "start starts starting started begin begins beginning began continue continues continuing continued keep keeps "
    "proceed proceeds decide decides seem seems seemingly appear appears appearing finish finishes finished end ends "
    "first firstly second secondly third next later finally last lastly eventually immediately suddenly soon meanwhile "
    "simultaneously afterwards afterward already always never often sometimes usually today ever still yet till "
    "moment instant duration time times pause pauses "
    "don doesn didn isn aren wasn weren won wouldn couldn shouldn can cannot hasn haven hadn ain gonna wanna gotta "
    "zero two three four five six seven eight nine ten eleven twelve thirteen fourteen fifteen sixteen seventeen "
    "eighteen nineteen twenty thirty forty fifty sixty seventy eighty ninety hundred thousand half quarter dozen "
    "couple pair thrice single double triple st nd rd th "
    "meter meters metre metres centimeter centimeters centimetre centimetres millimeters kilometer kilometers "
    "kilometre kilometres mile miles inch inches ft yard yards cm mm km kmh kph mph second seconds sec secs minute "
    "minutes min mins hour hours degree degrees deg percent frames fps kg per hz".split())
NAMES = frozenset(
    "john james david michael robert william tom tim jim joe sam ben dan alex chris paul peter george harry henry "
    "charlie mary anna anne emma lisa laura sarah sara kate jane julia maria susan linda emily alice lucy sophie eva "
    "nina mia olivia noah liam leo adam simon martin thomas daniel matthew andrew steve kevin brian eric hans carlos "
    "juan jose pedro ali mohammed ahmed omar yuki mr mrs ms dr".split())
DETERMINERS = frozenset("a an the this that these those one two three another some any each every no".split())
