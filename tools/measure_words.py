"""How well a distilled text encoder keeps its teacher's sentence similarities, its synonyms together and its opposites
apart, and how far its features lie from those of another version."""
import re

import contrast_sentences
import numpy as np
import scipy.stats

from motion_jax.text.encoder import load_text_encoder

QUERIES = ("a person strolls.", "a person hops.", "someone swings a fist.", "a person takes a seat.",
           "a person greets someone by moving a hand.", "a man jogs forward", "somebody rotates to the left",
           "a person walks quickly.", "a person walks slowly.", "a person ambles ahead merrily")
WORD_PAIRS = (  # sentence, sentence, the words compared
    ("a person walks slowly.", "a person walks quickly.", "slowly", "quickly"),
    ("a person walks slowly.", "a person walks fast.", "slowly", "fast"),
    ("a person turns left.", "a person turns right.", "left", "right"),
    ("a person raises the left hand.", "a person raises the right hand.", "left", "right"),
    ("a person raises both hands.", "a person raises one hand.", "both", "one"),
    ("a person walks forward.", "a person walks backward.", "forward", "backward"),
    ("a person reaches up.", "a person reaches down.", "up", "down"),
    ("a person jumps twice.", "a person jumps once.", "twice", "once"),
    ("a person jumps three times.", "a person jumps four times.", "three", "four"),
    ("a person turns 90 degrees.", "a person turns 180 degrees.", "90", "180"),
    ("a person walks with confidence.", "a person walks without confidence.", "with", "without"),
    ("a person walks confidently.", "a person walks timidly.", "confidently", "timidly"),
    ("a person stands still.", "a person walks still.", "stands", "walks"),
    ("a person walks and stops.", "a person walks and continues.", "stops", "continues"),
    ("a person turns clockwise.", "a person turns counterclockwise.", "clockwise", "counterclockwise"),
    ("a person walks in a circle.", "a person walks in a zigzag.", "circle", "zigzag"),
    ("a person walks in a circle.", "a person walks in a line.", "circle", "line"),
    ("a person takes small steps.", "a person takes large steps.", "small", "large"),
    ("a person jumps high.", "a person jumps low.", "high", "low"),
    ("a person sits down.", "a person stands up.", "sits", "stands"),
    ("a person walks happily.", "a person walks sadly.", "happily", "sadly"),
    ("a person walks.", "a person kicks.", "walks", "kicks"))
SYNONYMS = (
    ("a person walks.", "a person strolls.", "walks", "strolls"),
    ("a person jumps.", "a person hops.", "jumps", "hops"),
    ("a person runs.", "a person jogs.", "runs", "jogs"),
    ("a person walks happily.", "a person walks joyfully.", "happily", "joyfully"),
    ("a person walks quickly.", "a person walks rapidly.", "quickly", "rapidly"),
    ("a person walks quickly.", "a person walks fast.", "quickly", "fast"),
    ("a person raises a hand.", "a person lifts a hand.", "raises", "lifts"),
    ("a person walks.", "a person ambles.", "walks", "ambles"),      # held out
    ("a person walks happily.", "a person walks merrily.", "happily", "merrily"))
SENTENCE_PAIRS = (("a person walks quickly.", "a person walks slowly."),
                  ("a person walks confidently.", "a person walks without confidence."),
                  ("a person does nothing.", "a person stands still."), ("do nothing", "a person stands still."),
                  ("a person turns left.", "a person turns right."))
DRAWN = 60 * len(contrast_sentences.CONTRASTS)  # pairs of the table, drawn with another seed than those of training


def cosine(a, b):
  return float(a @ b / np.linalg.norm(a) / np.linalg.norm(b))


def rank_correlation(ours, theirs):
  """Spearman's of the pairwise similarities of two sets of unit vectors of the same sentences."""
  upper = np.triu_indices(len(ours), 1)
  return float(scipy.stats.spearmanr((ours @ ours.T)[upper], (theirs @ theirs.T)[upper]).statistic)


def report(folder, before, teacher, sets, captions):
  """Prints all that this module measures of the encoder in a folder, and of `before`, if given, beside it.

  teacher: gives sentence vectors, or None to leave out what compares with it. sets: {name: sentences never trained on}.
  """
  encoders = ([load_text_encoder(before)] if before else []) + [load_text_encoder(folder)]
  if len(encoders) == 2:
    print(f"numbers before and after: {before}, {folder}")
  if teacher:
    for name, sentences in sets.items():
      if sentences:
        _compare(name, sentences, encoders, teacher(sentences)[0])
    if captions:
      _nearest(encoders, captions, teacher)
  _words(encoders)
  _drawn(encoders)
  if len(encoders) == 2 and captions:
    _drift(*encoders, captions)


def _compare(name, sentences, encoders, theirs):
  ours = [encoder.sentence(sentences) for encoder in encoders]
  print(f"{name}: {len(sentences)} sentences never seen, Spearman "
        f"{_numbers(rank_correlation(one, theirs) for one in ours)}, mean cosine to the teacher "
        f"{_numbers((one * theirs).sum(-1).mean() for one in ours)}")


def _nearest(encoders, captions, teacher):
  table, their_table = encoders[-1].sentence(captions), teacher(captions)[0]
  for query in QUERIES:
    near = np.argsort(-(encoders[-1].sentence([query]) @ table.T)[0])[:3]
    theirs = np.argmax(teacher([query])[0] @ their_table.T)
    print(f"{query!r} -> {[captions[i] for i in near]} (teacher: {captions[theirs]!r})")


def _words(encoders):
  for title, rows in (("words that must part", WORD_PAIRS), ("words that must not", SYNONYMS)):
    print(f"{title}, cosine in otherwise equal sentences:")
    for first, second, one, other in rows:
      print(f"  {one} / {other} ({first}): "
            f"{_numbers(cosine(encoder.word(first, one), encoder.word(second, other)) for encoder in encoders)}")
  print("sentences:")
  for one, other in SENTENCE_PAIRS:
    print(f"  {one} / {other}: {_numbers(cosine(*encoder.sentence([one, other])) for encoder in encoders)}")


def _drawn(encoders):
  """A row for each contrast: pairs of words that mean different things, and of those that mean the same."""
  pairs = contrast_sentences.pairs(DRAWN, seed=99)
  near = [[_near(encoder, one, other) for _, one, other, _ in pairs] for encoder in encoders]
  print("contrast | apart: mean cosine | the worst tenth | together: mean cosine")
  for name in [*sorted(contrast_sentences.CONTRASTS), "all"]:
    rows = {alike: [i for i, pair in enumerate(pairs) if name in (pair[0], "all") and pair[3] == alike]
            for alike in (False, True)}
    apart, together = ([[one[i] for i in rows[alike]] for one in near] for alike in (False, True))
    print(f"{name} | {_numbers(map(np.mean, apart))} | {_numbers(np.quantile(one, 0.9) for one in apart)} | "
          f"{_numbers(map(np.mean, together)) if rows[True] else '-'}")


def _near(encoder, one, other):
  return cosine(*(np.mean([_feature(encoder, marked.text, span) for span in marked.spans], axis=0)
                  for marked in (one, other)))


def _feature(encoder, text, span):
  pieces = [i for i, (a, b) in enumerate(encoder._encode(text).offsets) if span[0] <= a < b <= span[1]]
  return encoder._feature(text)[pieces].mean(0)


def _drift(before, after, captions):
  """How near the word features of two encoders are in captions: of all word pieces, and of those in no contrast."""
  contrasted = {one.text[a:b] for pair in contrast_sentences.pairs(DRAWN, seed=99) if not pair[3]
                for one in pair[1:3] for a, b in one.spans}
  every, plain, words = [], [], {}
  for caption in captions:
    old, new = before._feature(caption), after._feature(caption)
    near = (old * new).sum(-1) / np.linalg.norm(old, axis=-1) / np.linalg.norm(new, axis=-1)
    offsets = before._encode(caption).offsets
    every += list(near)
    for word in re.finditer(r"[\w-]+", caption):
      rows = [i for i, (a, b) in enumerate(offsets) if word.start() <= a < b <= word.end()]
      words.setdefault(word[0], []).extend(near[rows])
      plain += [] if word[0] in contrasted else list(near[rows])
  print(f"word features of {len(captions)} captions before and after: mean cosine {np.mean(every):.3f}, of words in no "
        f"contrast {np.mean(plain):.3f}")
  far = sorted((float(np.mean(found)), word) for word, found in words.items() if len(found) >= 5)[:12]
  print("moved most: " + ", ".join(f"{word} {value:.2f}" for value, word in far))


def _numbers(values):
  return " -> ".join(f"{value:.3f}" for value in values)
