"""How well a distilled text encoder keeps its teacher's sentence similarities, and its synonyms and opposites apart."""
import numpy as np
import scipy.stats

from motion_jax.text.encoder import load_text_encoder

QUERIES = ("a person strolls.", "a person hops.", "someone swings a fist.", "a person takes a seat.",
           "a person greets someone by moving a hand.", "a man jogs forward", "somebody rotates to the left",
           "a person ambles ahead merrily")
WORD_PAIRS = (  # sentence, sentence, the words compared
    ("a person turns left.", "a person turns right.", "left", "right"),
    ("a person raises the left hand.", "a person raises the right hand.", "left", "right"),
    ("a person walks forward.", "a person walks backward.", "forward", "backward"),
    ("a person sits down.", "a person stands up.", "sits", "stands"),
    ("a person walks.", "a person strolls.", "walks", "strolls"),
    ("a person jumps.", "a person hops.", "jumps", "hops"),
    ("a person runs.", "a person jogs.", "runs", "jogs"),
    ("a person walks happily.", "a person walks joyfully.", "happily", "joyfully"),
    ("a person walks happily.", "a person walks sadly.", "happily", "sadly"),
    ("a person walks.", "a person kicks.", "walks", "kicks"),
    ("a person walks.", "a person ambles.", "walks", "ambles"),      # held out
    ("a person walks happily.", "a person walks merrily.", "happily", "merrily"))


def rank_correlation(ours, theirs):
  """Spearman's of the pairwise similarities of two sets of unit vectors of the same sentences."""
  upper = np.triu_indices(len(ours), 1)
  return float(scipy.stats.spearmanr((ours @ ours.T)[upper], (theirs @ theirs.T)[upper]).statistic)


def report(folder, teacher, sets, captions):
  encoder = load_text_encoder(folder)
  for name, sentences in sets.items():
    if sentences:
      ours, theirs = encoder.sentence(sentences), teacher(sentences)[0]
      print(f"{name}: {len(sentences)} sentences never seen, Spearman {rank_correlation(ours, theirs):.3f}, "
            f"mean cosine to the teacher {(ours * theirs).sum(-1).mean():.3f}")
  if captions:
    table, their_table = encoder.sentence(captions), teacher(captions)[0]
    for query in QUERIES:
      near = np.argsort(-(encoder.sentence([query]) @ table.T)[0])[:3]
      theirs = np.argmax(teacher([query])[0] @ their_table.T)
      print(f"{query!r} -> {[captions[i] for i in near]} (teacher: {captions[theirs]!r})")
  for first, second, one, other in WORD_PAIRS:
    a, b = encoder.word(first, one), encoder.word(second, other)
    print(f"{one} / {other}: word cosine {a @ b / np.linalg.norm(a) / np.linalg.norm(b):.3f}")
