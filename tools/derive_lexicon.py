"""Derive the lexical table of `motion_jax.text.wordnet` from the database files of WordNet 3.0.

  apt-get download wordnet-base && dpkg-deb -x wordnet-base_*.deb FOLDER
  python tools/derive_lexicon.py FOLDER/usr/share/wordnet

The table has a line per word: "v" and a verb with the verbs of movement that it may stand for, each with a confidence
and the words of its manner ("v amble walk:0.90:slowly"), "v~" where it is more often a noun; "n" and a noun with the
verb of its action ("n curtsy curtsy"); "m" and an adjective or adverb with the pace that it means ("m brisk quickly").
"""
import argparse
import collections
import pathlib
import re

from motion_jax.text.lexicon import ACTIONS, FUNCTION_WORDS, TAGGED_VERBS, VERBS
from motion_jax.text.wordnet import LOST, TABLE

# Files of verbs by topic, and how likely a verb in a sentence about a body is meant in a sense of that topic: motion,
# contact, body, competition, consumption, perception, creation, communication.
TOPICS = {38: 1.0, 35: 0.9, 29: 0.9, 33: 0.9, 34: 0.85, 39: 0.8, 36: 0.8, 32: 0.75}
ACTS = {4, 5, 10, 11}  # files of nouns: acts, (animals,) communication, events
_BY_RANK, _BY_DISTANCE, _BY_SENSE, _GENUS = 0.96, (1.0, 0.9, 0.7), (1.0, 0.8), 0.85
_UNSAID = 0.95  # for each word of a definition that the target does not express
_LEAST, _MOST = 0.5, 4  # confidence, and targets of a verb
# Verbs of any change of place: with a direction they mean a walk. "travel" begins the synset of a body's own movement.
_TRAVEL, _TRAVEL_ROOT = {"move", "go", "travel", "come", "proceed", "pass", "locomote", "withdraw", "leave"}, "travel"
_TO_AND_FRO = re.compile(r"\b(?:back and forth|to and fro|from side to side|up and down)\b")
_DIRECTIONS = {"backward": "backward", "backwards": "backward", "back": "backward", "forward": "forward",
               "forwards": "forward", "ahead": "forward", "sideways": "sideways", "sidewise": "sideways"}
_FAST, _SLOW = {"fast", "hurried"}, {"slow", "unhurried"}
# Adverbs that say nothing of how it looks, and other words that do: a target does not express these (LOST).
_NO_MANNER = {"usually", "often", "especially", "typically", "normally", "apparently", "only"}
_LOOKS = set("as like impeded unable gait toes legs knees feet hands arms waist steps stride weight".split())
# Verbs whose object says the action ("takes a bow"), and verbs without a movement, are no targets.
TARGETS = (ACTIONS | TAGGED_VERBS | {"sleep", "flinch"}) - VERBS[""] - set(
    "do perform play practice take get put set place hold move direct land exercise call clean bring use work".split())


class Synset(collections.namedtuple("Synset", "topic words pointers gloss")):
  """One line of a database file: [(symbol, offset, part of speech)] are its pointers."""


def read_synsets(path):
  """{offset: Synset} of a database file."""
  found = {}
  for line in path.read_text("utf-8").splitlines():
    if line.startswith("  "):
      continue
    head, _, gloss = line.partition("|")
    fields = head.split()
    count = int(fields[3], 16)
    words = [re.sub(r"\(\w+\)$", "", word.lower()).replace("_", " ") for word in fields[4:4 + 2 * count:2]]
    first = 5 + 2 * count
    pointers = [tuple(fields[i:i + 3]) for i in range(first, first + 4 * int(fields[first - 1]), 4)]
    found[fields[0]] = Synset(int(fields[1]), words, pointers, gloss.strip())
  return found


def read_senses(path):
  """{word: offsets, the most frequent sense first} of an index file."""
  rows = (line.split() for line in path.read_text("utf-8").splitlines() if not line.startswith("  "))
  return {row[0].replace("_", " "): row[-int(row[2]):] for row in rows}


def frequencies(path):
  """{(word, "n" or "v"): how often a tagged text has it}."""
  found = collections.Counter()
  for line in path.read_text("utf-8").splitlines():
    key, _, count = line.split()
    word, _, rest = key.partition("%")
    found[word.replace("_", " "), {"1": "n", "2": "v"}.get(rest[0], "")] += int(count)
  return found


class WordNet:
  """What the table needs of a folder of WordNet."""

  def __init__(self, folder):
    self.verbs, self.nouns = read_synsets(folder / "data.verb"), read_synsets(folder / "data.noun")
    self.verb_senses, self.noun_senses = read_senses(folder / "index.verb"), read_senses(folder / "index.noun")
    self.counts = frequencies(folder / "cntlist.rev")
    self.paces = self._paces(read_synsets(folder / "data.adj"), read_senses(folder / "index.adj"),
                             read_synsets(folder / "data.adv"))

  def _paces(self, adjectives, senses, adverbs):
    """{adjective or adverb: "quickly" or "slowly"}: the clusters of fast and slow, and what is derived from them."""
    heads = {senses[word][0]: pace for words, pace in ((_FAST, "quickly"), (_SLOW, "slowly")) for word in words}
    found, pace_of = {}, {}
    for offset, synset in adjectives.items():
      pace = next((heads[at] for at in (offset, *(to for symbol, to, _ in synset.pointers if symbol == "&"))
                   if at in heads), "")
      if pace:
        pace_of[offset] = pace
        found |= {word: pace for word in synset.words if senses[word][0] == offset}
    for synset in adverbs.values():
      paces = {pace_of[at] for symbol, at, _ in synset.pointers if symbol == "\\" and at in pace_of}
      if len(paces) == 1:
        found |= dict.fromkeys(synset.words, next(iter(paces)))
    return {word: pace for word, pace in found.items() if word.isalpha()}

  def chain(self, offset):
    """[(distance, verbs)] of a synset and its hypernyms."""
    level, seen = [offset], set()
    for distance in range(len(_BY_DISTANCE)):
      yield distance, [(word, at) for at in level for word in self.verbs[at].words]
      seen.update(level)
      level = [to for at in level for symbol, to, part in self.verbs[at].pointers
               if symbol == "@" and part == "v" and to not in seen]

  def targets(self, verb):
    """[(confidence, verb, words of its manner)] of what a verb may stand for, the surest first."""
    found = {}
    for rank, offset in enumerate(self.verb_senses[verb]):
      synset = self.verbs[offset]
      sure = TOPICS.get(synset.topic, 0) * _BY_RANK ** rank
      if not sure or synset.topic == 32 and not self._is_gesture(offset):
        continue
      genus, manner, unsaid = self._definition(synset.gloss)
      options = [(sure * _BY_DISTANCE[d] * self._usual(one, at) * (_UNSAID ** unsaid if d else 1), one,
                  manner if d else ()) for d, words in self.chain(offset) for one, at in words]
      options += [(sure * _GENUS * _UNSAID ** unsaid, one, manner) for one in genus]
      travels = any(word == _TRAVEL_ROOT for _, words in self.chain(offset) for word, _ in words)
      for confidence, one, words in options:
        if travels and one in _TRAVEL and one != verb and set(words) & set(_DIRECTIONS.values()):
          one = "walk"
        elif one in _TRAVEL or one == verb or one not in TARGETS:
          continue
        found[one] = max(found.get(one, (0, ())), (confidence, words))
    best = sorted(((confidence, one, words) for one, (confidence, words) in found.items() if confidence >= _LEAST),
                  key=lambda row: (-row[0], row[1]))
    return best[:_MOST]

  def _is_gesture(self, offset):
    return any(word in ("gesticulate", "greet") for _, words in self.chain(offset) for word, _ in words)

  def _usual(self, verb, offset):
    """How usual it is that a verb in a sentence about a body has this sense: 1 of its first bodily sense, then less."""
    bodily = [at for at in self.verb_senses.get(verb, ()) if self.verbs[at].topic in TOPICS]
    return _BY_SENSE[bodily.index(offset)] if offset in bodily[:len(_BY_SENSE)] else 0.0

  def _definition(self, gloss):
    """(verbs that a definition begins with, words of its manner, number of words that neither expresses)."""
    text = _TO_AND_FRO.sub("", re.split(r"[;(\"]", gloss)[0])
    words = re.findall(r"[a-z]+", re.sub(r"^to ", "", text))
    genus = []
    for place, word in enumerate(words):
      if word in self.verb_senses and (not place or words[place - 1] == "or" and len(genus) == place // 2):
        genus.append(word)
    manner, unsaid = [], 0
    for word in words[len(genus):]:
      said = _DIRECTIONS.get(word) or self.paces.get(word) or (
          word if word.endswith("ly") and word not in _NO_MANNER else LOST if word in _LOOKS else "")
      if said and said not in manner:
        manner.append(said)
      elif not said and word not in {*FUNCTION_WORDS, *genus, *_TRAVEL}:
        unsaid += 1
    return genus, tuple(manner), unsaid

  def rows(self):
    """The lines of the table."""
    for verb in sorted(self.verb_senses):
      if re.fullmatch(r"[a-z]{3,}( (?:up|down|back|away|off|over|around|out|forward))?", verb) and (
          targets := self.targets(verb)):
        rare = "~" if self.counts[verb, "n"] > self.counts[verb, "v"] and verb not in ACTIONS else ""
        yield f"v{rare}\t{verb}\t" + "\t".join(
            f"{one}:{confidence:.2f}" + (f":{' '.join(words)}" if words else "") for confidence, one, words in targets)
    for noun in sorted(self.noun_senses):
      if re.fullmatch(r"[a-z]{3,}", noun) and (verb := self._verb_of(noun)):
        yield f"n\t{noun}\t{verb}"
    for word in sorted(self.paces):
      yield f"m\t{word}\t{self.paces[word]}"

  def _verb_of(self, noun):
    """The verb of movement that a noun of an act is derived from or shares its form with, "" where there is none."""
    for offset in self.noun_senses[noun][:8]:
      synset = self.nouns[offset]
      if synset.topic not in ACTS:
        continue
      kinds = [(synset, [noun]), *((self.nouns[at], self.nouns[at].words) for symbol, at, _ in synset.pointers
                                   if symbol == "@")]  # an uppercut is a punch
      for kind, names in kinds:
        derived = [word for symbol, at, part in kind.pointers if symbol == "+" and part == "v"
                   for word in self.verbs[at].words if self.verbs[at].topic in TOPICS]
        for verb in sorted(derived, key=lambda one: one != noun):
          if any(verb[:3] == name[:3] for name in names) and (verb in TARGETS or verb == noun and self.targets(verb)):
            return verb
    return ""


if __name__ == "__main__":
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("folder", type=pathlib.Path, help="folder with data.verb, index.verb and the like")
  lines = list(WordNet(parser.parse_args().folder).rows())
  TABLE.write_text("\n".join(lines) + "\n", "utf-8")
  print(f"{TABLE}: {len(lines)} words, {TABLE.stat().st_size / 1e3:.0f} kB")
