"""A seeded grammar of sentences about movement, with synonyms grouped by what the body does.

`CONCEPTS` says which words and phrases mean one movement: "walk", "stroll" and "go on foot" are one concept. The
distillation of the small text encoder (tools/distill_words.py) reads its sentences and its synonym labels here.
Phrases are written in the base form; verbs are inflected by `inflect`.
"""
import random
import re

# concept -> phrases, commonest first. A phrase that begins with a verb is inflected at its first word.
VERBS = {
    "walk": "walk; stroll; saunter; march; stride; pace; amble; wander; hike; go on foot; plod; trudge; tread; roam; "
            "strut; take a walk; go for a stroll; mosey; shamble; traipse; promenade; take several steps; take a few "
            "steps; step along; parade",
    "run": "run; jog; sprint; dash; race; rush; hurry; bolt; gallop; charge; scurry; trot; go running; go for a run; "
           "break into a run; speed along; scamper; take off running; hasten",
    "jump": "jump; hop; leap; bounce; spring; skip; vault; bound; jump up; leap up; hop up and down; spring up; do a "
            "jump; make a jump; do jumping jacks; jump for joy; leapfrog",
    "kick": "kick; boot; do a kick; throw a kick; kick out; perform a roundhouse kick; give a kick; kick a ball; swing "
            "a leg; punt; lash out with a foot; deliver a kick",
    "punch": "punch; jab; strike; box; hit; throw a punch; throw punches; swing a fist; throw a jab; thump; pummel; "
             "deliver a blow; land a hook; throw an uppercut; spar; shadowbox; smack; sock; clobber; swing the fists",
    "slash": "slash; swing a sword; cut; chop; slice; stab; thrust a sword; hack; wield a blade; fence; duel",
    "wave": "wave; greet; wave goodbye; wave hello; say hello; say goodbye; wave bye bye; greet someone with a hand; "
            "give a wave; flap a hand; hail; signal with a hand; swing a hand to wave; beckon; welcome someone; bid "
            "farewell",
    "bow": "bow; take a bow; bend forward in a bow; curtsy; bow down; bow politely; make a bow; bow the head; bend at "
           "the waist; stoop in respect",
    "sit": "sit; sit down; take a seat; be seated; seat oneself; settle into a chair; plop down; lower oneself onto a "
           "chair; rest on a stool; sit on a chair; have a seat",
    "stand": "stand; stand up; rise; get up; get to the feet; rise from a chair; arise; stand still; rise to the feet; "
             "stand upright; come to a standing position",
    "lie": "lie down; lie; lay down; recline; stretch out on the floor; lie on the back; sprawl; go to sleep; nap",
    "kneel": "kneel; kneel down; drop to the knees; get on one knee; go down on a knee; genuflect",
    "squat": "squat; crouch; duck; do a squat; bend the knees; hunker down; crouch down; lower the body; stoop",
    "crawl": "crawl; creep; move on all fours; crawl on hands and knees; slither; go on all fours",
    "dance": "dance; waltz; tango; salsa; do a dance; groove; boogie; perform a dance; breakdance; do ballet; twirl to "
             "the music; move to the music; do the twist; tap dance; sway to the music; move with the rhythm; do a "
             "pirouette; pirouette; rumba; samba; jive",
    "turn": "turn; rotate; spin; pivot; swivel; revolve; spin around; turn around; turn back; make a turn; twirl; "
            "whirl; face the other way; do an about face; wheel around; circle; change direction; veer",
    "raise": "raise; lift; put up; hold up; bring up; throw up; stick up; elevate; hoist; reach up with; thrust up",
    "lower": "lower; drop; put down; bring down; let down; take down; let fall",
    "throw": "throw; toss; pitch; hurl; fling; lob; cast; throw a ball; toss a ball; chuck; sling",
    "catch": "catch; grab; catch a ball; seize; snatch; grasp; receive a ball; clutch",
    "pick": "pick up; pick something up; lift a box; take something from the floor; scoop up; collect; gather",
    "put": "put something down; set down; place an object; lay something on the table; deposit",
    "push": "push; shove; press; push away; nudge; thrust away; force away",
    "pull": "pull; drag; tug; haul; yank; tow; draw back",
    "climb": "climb; climb up; go up the stairs; ascend; scale a wall; climb a ladder; walk up steps; clamber; mount "
             "the stairs; go upstairs",
    "descend": "descend; go down the stairs; climb down; walk down steps; step down; go downstairs",
    "balance": "balance; stand on one leg; keep the balance; walk on a beam; walk a tightrope; hold a pose; stand on "
               "one foot",
    "stumble": "stumble; trip; stagger; lurch; limp; hobble; wobble; totter; fall down; fall; lose the balance; slip; "
               "tumble; topple over; collapse; reel",
    "clap": "clap; applaud; clap the hands; give applause",
    "stretch": "stretch; stretch out; stretch the arms; warm up; loosen up; reach for the sky",
    "drink": "drink; take a drink; sip; drink from a bottle; have a drink; gulp; swig; raise a cup to the mouth",
    "eat": "eat; have a meal; chew; bite; take a bite; nibble",
    "phone": "call someone on the phone; answer the phone; talk on a phone; make a call; take a phone call; speak into "
             "a telephone",
    "point": "point; point at something; point a finger; indicate; show the way; guide someone; direct traffic",
    "wash": "wash; wash the hands; scrub; clean; wipe; wipe a window; rinse; polish; mop; sweep the floor",
    "dribble": "dribble; dribble a ball; bounce a ball; play basketball; shoot a basketball; shoot hoops",
    "golf": "swing a golf club; play golf; putt a ball; swing a bat; hit a baseball; swing a racket; play tennis",
    "swim": "swim; do the breaststroke; paddle; row a boat; swim the front crawl",
    "nod": "nod; nod the head; shake the head; tilt the head; look around; look up; look down; turn the head",
    "shake": "shake hands; shake someone's hand; shake; tremble; shiver; shudder",
    "hug": "hug; embrace; hold someone; cuddle",
    "lean": "lean; lean forward; lean back; tilt; bend over; bend down; bend; lean over; bow over; slouch",
    "step": "step; sidestep; shuffle; step over; take a step; lunge; step aside; tiptoe; move off; sneak; walk on the "
            "toes",
    "stop": "stop; halt; come to a stop; pause; freeze; stand motionless; wait; remain in place; stay put",
    "flip": "flip; do a cartwheel; somersault; do a backflip; do a handstand; roll; roll over; cartwheel; tumble over",
    "cry": "cry; weep; sob; wipe away tears; mourn",
    "laugh": "laugh; giggle; chuckle; cheer; celebrate; rejoice",
    "think": "think; ponder; scratch the head; rest the chin on a hand; wonder; respond; answer",
    "fight": "fight; block; defend; practice karate; do martial arts; dodge; attack; wrestle; grapple",
    "carry": "carry; carry a box; hold; bear a load; lug; transport",
    "open": "open a door; open; open a bottle; unscrew a cap; close a door; close; shut; slam a door",
    "play": "play the guitar; play the violin; play the piano; play the drums; strum; conduct an orchestra",
    "stamp": "stomp; stamp; march in place; stamp the feet; goose step; walk in place; run in place",
}
ADVERBS = {  # how; the first is the style's commonest adverb. Adjectives for "a happy person" stand in STYLES.
    "happy": "happily; cheerfully; joyfully; merrily; gladly; gleefully; joyously; with joy; in a happy way; in a good "
             "mood",
    "sad": "sadly; unhappily; gloomily; sorrowfully; miserably; mournfully; with sorrow; in a sad way; dejectedly; "
           "downcast",
    "angry": "angrily; furiously; madly; in anger; with rage; in a rage; irritably; in an angry way; crossly",
    "tired": "tiredly; wearily; in exhaustion; exhaustedly; sleepily; drowsily; with no energy; sluggishly; in a tired "
             "way; without any strength",
    "proud": "proudly; arrogantly; haughtily; with pride; pompously; in a proud way; smugly; boastfully",
    "timid": "timidly; shyly; without confidence; nervously; hesitantly; fearfully; anxiously; meekly; bashfully; "
             "cautiously",
    "active": "energetically; actively; vigorously; with energy; lively; enthusiastically; full of energy; "
              "powerfully; dynamically",
    "old": "like an old person; like an elderly person; like an old man; like an old woman; like a grandfather; "
           "feebly; in an elderly way; like a senior",
    "young": "in a youthful way; youthfully; like a young person; like a teenager; like a youth",
    "child": "like a child; childishly; in a childish way; like a kid; like a toddler; playfully",
    "masculine": "in a masculine way; like a man; in a manly way; macho",
    "feminine": "in a feminine way; like a woman; in a ladylike way; like a lady; gracefully; elegantly",
    "thug": "like a thug; thuggishly; like a gangster; menacingly; aggressively; like a hooligan",
    "giant": "like a giant; heavily; with heavy steps; like a monster; like an elephant; ponderously",
    "robot": "like a robot; robotically; mechanically; stiffly; in a robotic way",
    "zombie": "like a zombie; like a ghost; like the undead; creepily",
    "animal": "like a chicken; like a dog; like a cat; like a monkey; like a bear; like a bird; like a penguin",
    "drunk": "drunkenly; like a drunk; unsteadily; dizzily; in a drunken way",
    "musical": "in a musical way; musically; to the beat; rhythmically; with rhythm",
    "normal": "normally; in a normal way; casually; naturally; as usual; calmly; relaxedly",
    "slow": "slowly; at a slow pace; unhurriedly; leisurely; gently; gradually; carefully",
    "fast": "fast; quickly; very fast; at high speed; rapidly; swiftly; speedily; briskly; in a hurry; at full speed; "
            "hastily",
    "quiet": "quietly; silently; softly; stealthily; on tiptoe; without a sound; secretly",
    "big": "with big movements; with long steps; exaggeratedly; in large strides; widely",
    "small": "with small steps; with tiny movements; slightly; a little",
    "strong": "strongly; forcefully; hard; with force; with all one's might; violently",
}
DIRECTIONS = {
    "left": "left; to the left; leftward; to the left side; toward the left; leftwards",
    "right": "right; to the right; rightward; to the right side; toward the right; rightwards",
    "forward": "forward; forwards; ahead; straight ahead; to the front; straight forward; onward",
    "backward": "backward; backwards; back; in reverse; to the rear; rearward",
    "sideways": "sideways; to the side; laterally; from side to side",
    "up": "up; upward; upwards; up the stairs; up high",
    "down": "down; downward; downwards; to the ground; to the floor",
    "around": "around; in a circle; in circles; in a curve; in a big circle; all the way around; round and round",
    "clockwise": "clockwise; in a clockwise circle",
    "counterclockwise": "counterclockwise; anticlockwise; counter clockwise; in a counterclockwise circle",
    "zigzag": "in a zigzag; zigzag; in a wavy line; weaving in and out",
    "place": "in place; on the spot; without moving forward",
}
STYLES = {
    "happy": "happy cheerful joyful glad merry", "sad": "sad unhappy gloomy depressed miserable",
    "angry": "angry furious mad annoyed", "tired": "tired exhausted weary sleepy drowsy",
    "proud": "proud arrogant haughty confident", "timid": "timid shy nervous scared anxious",
    "active": "active energetic lively vigorous enthusiastic", "old": "old elderly aged ancient",
    "young": "young youthful teenage", "child": "childish childlike", "masculine": "masculine manly",
    "feminine": "feminine ladylike graceful elegant", "thug": "thuggish menacing aggressive", "giant": "giant huge",
    "robot": "robotic mechanical stiff", "drunk": "drunk drunken dizzy", "musical": "musical rhythmic",
    "normal": "normal ordinary calm relaxed casual", "zombie": "undead zombielike", "slow": "slow",
    "fast": "fast quick",
}
PARTS = {"arm": "arm forearm elbow", "hand": "hand wrist palm fist finger", "leg": "leg thigh shin", "knee": "knee",
         "foot": "foot heel ankle toe", "head": "head chin neck", "shoulder": "shoulder", "hip": "hip waist",
         "torso": "torso back chest body"}
LIMBS = ("arm", "hand", "leg", "knee", "foot", "elbow", "wrist", "shoulder", "fist", "heel", "palm")
PLURAL = {"foot": "feet", "knee": "knees", "fist": "fists"}
COUNTS = ("once", "twice", "three times", "four times", "five times", "several times", "a few times", "again",
          "repeatedly", "over and over", "many times", "two times", "10 times", "for a while", "for 5 seconds",
          "again and again", "one time", "six times")
DEGREES = ("90 degrees", "180 degrees", "360 degrees", "45 degrees", "ninety degrees", "a full turn", "halfway",
           "a quarter turn")
SUBJECTS = ("a person", "someone", "a man", "a woman", "the person", "the man", "the woman", "a figure", "the figure",
            "the character", "a boy", "a girl", "an athlete", "a dancer", "he", "she", "a human", "this person",
            "a guy", "the body", "a boxer", "a soldier", "somebody", "an adult", "a child", "the actor")
PLURAL_SUBJECTS = ("they", "people", "two people", "the people", "three men", "we", "both of them")
PLACES = ("across the room", "in the park", "on a path", "through a field", "toward the camera", "over an obstacle",
          "on the street", "along a line", "on uneven ground", "on a balance beam", "over a puddle", "near a chair",
          "on stage", "away from the door", "with a friend", "at the gym", "on a treadmill", "in the snow")

# Never in any training sentence: how well the encoder copes with these is what the model card measures.
HELD_OUT_WORDS = ("amble", "scamper", "bound", "pummel", "sprawl", "hurl", "swivel", "merrily", "gloomily", "wearily",
                  "stealthily", "hoist", "haughty", "furious", "leapfrog", "traipse", "clobber")

IRREGULAR = {  # base: (third person, gerund)
    "be": ("is", "being"), "do": ("does", "doing"), "go": ("goes", "going"), "have": ("has", "having"),
    "lie": ("lies", "lying"), "sit": ("sits", "sitting"), "run": ("runs", "running"), "get": ("gets", "getting")}
DOUBLING = frozenset(
    "jog hop skip jab hit chop stab spin step trip slip clap plop drop stop nod hug lug put cut nap squat sip bid "
    "strum tug grab drag swim let pat tap mop flip bat trot strut wrap dip plod set".split())


def inflect(phrase):
  """(base, third person, gerund) of a phrase that begins with a verb: take a seat, takes a seat, taking a seat."""
  verb, _, rest = phrase.partition(" ")
  rest = f" {rest}" if rest else ""
  if verb in IRREGULAR:
    third, gerund = IRREGULAR[verb]
  else:
    if re.search(r"(s|sh|ch|x|z)$", verb):
      third = verb + "es"
    elif re.search(r"[^aeiou]y$", verb):
      third = verb[:-1] + "ies"
    else:
      third = verb + "s"
    if verb in DOUBLING:
      gerund = verb + verb[-1] + "ing"
    elif verb.endswith("e") and not verb.endswith("ee") and not verb.endswith("oe"):
      gerund = verb[:-1] + "ing"
    else:
      gerund = verb + "ing"
  return phrase, third + rest, gerund + rest


def _phrases(table, split=";"):
  return {name: [phrase.strip() for phrase in text.split(split) if phrase.strip()] for name, text in table.items()}


def is_held_out(phrase):
  stems = [word[:-1] if word.endswith("e") else word for word in HELD_OUT_WORDS]
  return any(re.match(rf"{stem}(e|es|s|ing|ling|d|ed)?$", word) for word in phrase.split() for stem in stems)


class Grammar:
  """Sentences and the concept of their phrases; `held_out` keeps or hides the held-out words."""

  def __init__(self, held_out=False):
    keep = lambda table: {name: [phrase for phrase in phrases if held_out or not is_held_out(phrase)]
                          for name, phrases in table.items()}
    self.verbs, self.adverbs = keep(_phrases(VERBS)), keep(_phrases(ADVERBS))
    self.directions, self.styles = keep(_phrases(DIRECTIONS)), keep(_phrases(STYLES, " "))
    self.concept_of = {}  # phrase, as it stands in a sentence -> concept
    for name, phrases in self.verbs.items():
      for phrase in phrases:
        for form in inflect(phrase):
          self.concept_of.setdefault(form, name)
    for kind in (self.adverbs, self.directions, self.styles):
      for name, phrases in kind.items():
        for phrase in phrases:
          self.concept_of.setdefault(phrase, name)
    for name, words in _phrases(PARTS, " ").items():
      for word in words:
        self.concept_of.setdefault(word, name)
        self.concept_of.setdefault(PLURAL.get(word, word + "s"), name)
    self.concepts = sorted(set(self.concept_of.values()))
    longest_first = sorted(self.concept_of, key=lambda phrase: (-len(phrase), phrase))
    self._finder = re.compile(r"(?<![\w'])(" + "|".join(map(re.escape, longest_first)) + r")(?![\w'])")

  def spans(self, sentence):
    """[(start, end, concept)] of the phrases in a sentence that mean a known movement, style, direction, part."""
    return [(m.start(), m.end(), self.concept_of[m.group(1)]) for m in self._finder.finditer(sentence.lower())]

  def _pick(self, rng, table):
    """A phrase, the commonest first ones oftener, so that plain words stay the anchors of their concept."""
    phrases = table[rng.choice(sorted(table))]
    return phrases[min(int(rng.expovariate(3.0 / len(phrases))), len(phrases) - 1)] if rng.random() < 0.5 \
        else rng.choice(phrases)

  def _limb(self, rng):
    limb = rng.choice(LIMBS)
    if rng.random() < 0.25:
      return f"{rng.choice(('both', 'the', 'their'))} {PLURAL.get(limb, limb + 's')}"
    return f"{rng.choice(('the', 'his', 'her', 'their', 'the'))} {rng.choice(('left', 'right'))} {limb}"

  def _act(self, rng):
    """(base phrase of the act, its tail)."""
    kind = rng.random()
    if kind < 0.18:  # a named limb: where left and right are learned
      more = ["move", "swing", "bend", "wave", "extend", "shake"]
      verb = rng.choice(self.verbs["raise"] + self.verbs["lower"] + more)
      tail = [self._limb(rng)]
    elif kind < 0.3:
      verb, tail = rng.choice(self.verbs["turn"][:12]), [self._pick(rng, self.directions)]
    elif kind < 0.38:
      verb = rng.choice(("kick", "punch", "strike", "hit", "wave", "point", "jab", "hop", "throw", "push"))
      tail = [f"with {self._limb(rng)}"]
    else:
      verb, tail = self._pick(rng, self.verbs), []
      if rng.random() < 0.45:
        tail.append(self._pick(rng, self.directions))
    if rng.random() < 0.3:
      tail.append(self._pick(rng, self.adverbs))
    if rng.random() < 0.15:
      tail.append(rng.choice(COUNTS))
    elif rng.random() < 0.08:
      tail.append(rng.choice(PLACES))
    elif verb in self.verbs["turn"] and rng.random() < 0.2:
      tail.append(rng.choice(DEGREES))
    return verb, " ".join(tail)

  def _form(self, rng, form):
    verb, tail = self._act(rng)
    return f"{inflect(verb)[form]} {tail}".strip()

  def sentence(self, rng):
    """One sentence, drawn with random.Random rng."""
    subject = rng.choice(SUBJECTS[:3] if rng.random() < 0.5 else SUBJECTS)
    if rng.random() < 0.15:
      style = self._pick(rng, self.styles)
      subject = f"{'an' if style[0] in 'aeiou' else 'a'} {style} {rng.choice(('person', 'man', 'woman'))}"
    base, third, gerund = (lambda: self._form(rng, 0)), (lambda: self._form(rng, 1)), (lambda: self._form(rng, 2))
    plural = rng.choice(PLURAL_SUBJECTS)
    shapes = (
        (30, lambda: f"{subject} {third()}"), (8, lambda: f"{subject} is {gerund()}"), (6, lambda: base()),
        (5, lambda: gerund()), (4, lambda: f"{plural} {base()}"), (2, lambda: f"{plural} are {gerund()}"),
        (8, lambda: f"{subject} {third()} and {third()}"), (7, lambda: f"{subject} {third()}, then {third()}"),
        (5, lambda: f"{subject} {third()} while {gerund()}"), (3, lambda: f"after {gerund()}, {subject} {third()}"),
        (3, lambda: f"{subject} {third()} before {gerund()}"), (3, lambda: f"{base()} and then {base()}"),
        (2, lambda: f"{subject} starts to {base()}"), (2, lambda: f"{subject} begins {gerund()}"),
        (2, lambda: f"{subject} {third()}, {third()}, and finally {third()}"),
        (1, lambda: f"someone who {third()}"), (1, lambda: f"please {base()}"),
        (1, lambda: f"{subject} keeps {gerund()}"))
    text = rng.choices([shape for _, shape in shapes], [weight for weight, _ in shapes])[0]()
    return text + ("." if rng.random() < 0.75 else "")

  def sentences(self, count, seed=0):
    """`count` different sentences."""
    rng, found = random.Random(seed), {}
    while len(found) < count:
      found[self.sentence(rng)] = None
    return list(found)

  def minimal(self):
    """Every phrase in one plain sentence and alone: no synonym goes unseen."""
    found = {}
    for phrases in self.verbs.values():
      for phrase in phrases:
        base, third, gerund = inflect(phrase)
        found.update(dict.fromkeys((base, gerund, f"a person {third}.", f"someone is {gerund}.")))
    for kind in (self.adverbs, self.directions):
      for phrases in kind.values():
        for phrase in phrases:
          found.update(dict.fromkeys((phrase, f"a person walks {phrase}.", f"someone moves {phrase}.")))
    for phrases in self.styles.values():
      for word in phrases:
        article = "an" if word[0] in "aeiou" else "a"
        found.update(dict.fromkeys((word, f"{article} {word} person.", f"{article} {word} person walks.")))
    for limb in LIMBS:
      for side in ("left", "right"):
        found.update(dict.fromkeys((f"a person raises the {side} {limb}.", f"the {side} {limb}")))
    return list(found)


def unseen_sentences():
  """Sentences of shapes that the grammar does not make, with the held-out words among them: for measuring only."""
  grammar, rng = Grammar(held_out=True), random.Random(20)
  found = {}
  while len(found) < 400:
    base, third, gerund = (inflect(grammar._pick(rng, grammar.verbs))[form] for form in range(3))
    where, how = grammar._pick(rng, grammar.directions), grammar._pick(rng, grammar.adverbs)
    shape = rng.choice((
        "the subject can be seen {gerund} {where}", "in this clip a student {third} {how}",
        "an actor who {third} {where}", "it looks like somebody is {gerund} {how}", "a motion of {gerund} {where}",
        "{how}, a young lady {third}", "the guy decides to {base} {where} {how}", "a skeleton {third} as if {gerund2}"))
    gerund2 = inflect(grammar._pick(rng, grammar.verbs))[2]
    found[shape.format(base=base, third=third, gerund=gerund, gerund2=gerund2, where=where, how=how)] = None
  for word in HELD_OUT_WORDS[:8]:
    if word not in ("merrily",):
      found.update(dict.fromkeys((f"a person {inflect(word)[1]}.", f"someone is {inflect(word)[2]} forward")))
  for word in ("merrily", "gloomily", "wearily", "stealthily"):
    found[f"a person walks {word}."] = None
  return list(found)


if __name__ == "__main__":
  grammar = Grammar()
  print("\n".join(grammar.sentences(60)))
  print(len(grammar.concepts), "concepts,", len(grammar.concept_of), "phrases,", len(grammar.minimal()), "minimal")
