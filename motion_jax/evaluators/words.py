"""Text input of the classic evaluators: a vector and a class for each word.

Source: docs/papers/cdamd.md#words. A token is "lemma/POS", as in the benchmarks' text files. The vectors come from the
usual glove/our_vab_* files, two of which are pickles: they are read once, with a reader that accepts only lists, dicts,
words and numbers, and stored as an .npz file beside them.
"""
import hashlib
import io
import pathlib
import pickle

import numpy as np

from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.input_files import load_npy, load_npz

CLASSES = ("VERB", "NOUN", "DET", "ADP", "NUM", "AUX", "PRON", "ADJ", "ADV",
           "Loc_VIP", "Body_VIP", "Obj_VIP", "Act_VIP", "Desc_VIP", "OTHER")
# Words whose class goes before their part of speech; the first list that has a word decides.
SPECIAL = {name: frozenset(words.split()) for name, words in {
    "Loc_VIP": "left right clockwise counterclockwise anticlockwise forward back backward up down straight curve",
    "Body_VIP": "arm chin foot feet face hand mouth leg waist eye knee shoulder thigh",
    "Obj_VIP": "stair dumbbell chair window floor car ball handrail baseball basketball",
    "Act_VIP": "walk run swing pick bring kick put squat throw hop dance jump turn stumble stop sit lift lower raise "
               "wash stand kneel stroll rub bend balance flap jog shuffle lean rotate spin spread climb",
    "Desc_VIP": "slowly carefully fast careful slow quickly happy angry sad happily angrily sadly"}.items()}
MAX_WORDS = 20
GLOVE_FILES = ("our_vab_data.npy", "our_vab_words.pkl", "our_vab_idx.pkl")
CONVERTED = "our_vab.npz"


class WordVectors:
  """A vocabulary: words, and a row of vectors (V, D) for each; "sos", "eos" and "unk" must be there."""

  def __init__(self, words, vectors):
    self.vectors = np.asarray(vectors, np.float32)
    self.rows = {str(word): row for row, word in enumerate(words)}
    if self.vectors.ndim != 2 or len(self.rows) != len(self.vectors):
      raise ValueError(f"got {len(self.rows)} different words and vectors of shape {self.vectors.shape}, expected a "
                       "row for each word")
    missing = [word for word in ("sos", "eos", "unk") if word not in self.rows]
    if missing:
      raise ValueError(f"the vocabulary lacks {', '.join(missing)}; expected the benchmark's own (our_vab_*)")

  @property
  def dim(self) -> int:
    return self.vectors.shape[1]

  @property
  def fingerprint(self) -> str:
    """sha256 of words and vectors."""
    return hashlib.sha256("\n".join(self.rows).encode() + self.vectors.tobytes()).hexdigest()

  def __call__(self, sentences, max_words=MAX_WORDS):
    """Evaluator input for captions, each a list of tokens "lemma/POS" or a line of them.

    -> words (B, max_words + 2, D), classes one-hot (B, max_words + 2, 15), lengths (B,), which count sos and eos.
    """
    padded, lengths = _padded(sentences, max_words)
    ids = np.array([[self.rows.get(word, self.rows["unk"]) for word, _ in tokens] for tokens in padded])
    # Parity: a word without a vector is of class OTHER, also one of the special lists.
    return self.vectors[ids], _classes(padded, lambda word: word in self.rows), lengths

  def save(self, path):
    """Writes words and vectors as a plain .npz file."""
    with atomic_path(path) as temporary:
      temporary.write_bytes(self.to_bytes())

  def to_bytes(self) -> bytes:
    """The content of that file."""
    content = io.BytesIO()
    np.savez(content, words=np.array(list(self.rows)), vectors=self.vectors)
    return content.getvalue()


class WordFeatures:
  """Words of a text encoder instead of a vocabulary, for data without GloVe files: called as `WordVectors`.

  A word's vector is the encoder's output for it alone, scaled to length sqrt(D); no word is unknown. encoder: a
  `text.encoder.TextEncoder`.
  """

  def __init__(self, encoder):
    self._encoder, self._vectors = encoder, {}
    self.fingerprint = encoder.fingerprint
    self.dim = self._vector("person").size

  def _vector(self, word):
    if word not in self._vectors:
      vector = self._encoder.sentence([word])[0]
      self._vectors[word] = (vector * np.sqrt(vector.size)).astype(np.float32)
    return self._vectors[word]

  def __call__(self, sentences, max_words=MAX_WORDS):
    """As `WordVectors`; begin, end and filling are zeros."""
    padded, lengths = _padded(sentences, max_words)
    words = np.zeros((len(padded), max_words + 2, self.dim), np.float32)
    for row, tokens, length in zip(words, padded, lengths):
      for place in range(1, length - 1):
        row[place] = self._vector(tokens[place][0])
    return words, _classes(padded, lambda word: True), lengths


def _padded(sentences, max_words):
  padded = [assemble(sentence, max_words) for sentence in sentences]
  return padded, np.array([min(len(_tokens(sentence)), max_words) + 2 for sentence in sentences])


def _classes(padded, known):
  kinds = np.array([[CLASSES.index(_kind(word, pos) if known(word) else "OTHER") for word, pos in tokens]
                    for tokens in padded])
  return np.eye(len(CLASSES), dtype=np.float32)[kinds]


def _kind(word, pos):
  special = next((name for name, words in SPECIAL.items() if word in words), None)
  return special or (pos if pos in CLASSES else "OTHER")


def assemble(sentence, max_words=MAX_WORDS):
  """(word, POS) of a sentence cut to max_words, sos before and eos behind, filled with unk to max_words + 2."""
  tokens = [("sos", "OTHER"), *_tokens(sentence)[:max_words], ("eos", "OTHER")]
  return tokens + [("unk", "OTHER")] * (max_words + 2 - len(tokens))


def _tokens(sentence):
  pairs = [token.rpartition("/") for token in (sentence.split() if isinstance(sentence, str) else sentence)]
  bad = next((pos for word, slash, pos in pairs if not word or not slash), None)
  if bad is not None:
    raise ValueError(f"got the token {bad!r}, expected lemma/POS; motion_jax.text.tagger.tag makes such tokens")
  return [(word, pos) for word, _, pos in pairs]


def load_words(path) -> WordVectors:
  """A vocabulary from the .npz file that `convert_glove` wrote, or from a glove folder, converted in memory."""
  path = pathlib.Path(path)
  if path.is_dir():
    return load_words(path / CONVERTED) if (path / CONVERTED).is_file() else _read_glove(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no vocabulary {path}; give a folder that holds {', '.join(GLOVE_FILES)}")
  try:
    file = load_npz(path, ("vectors",), ("words",), required=("words", "vectors"))
    return WordVectors(file["words"].tolist(), file["vectors"])
  except (ValueError, TypeError) as error:
    raise ValueError(f"{path} is no vocabulary ({error}); make it with "
                     "motion_jax.evaluators.words.convert_glove") from error


def convert_glove(folder, out=None):
  """Reads our_vab_* of a folder and writes them as one safe .npz file, our_vab.npz beside them or `out` -> its path."""
  out = pathlib.Path(out) if out else pathlib.Path(folder) / CONVERTED
  _read_glove(pathlib.Path(folder)).save(out)
  return out


def _read_glove(folder):
  missing = [name for name in GLOVE_FILES if not (folder / name).is_file()]
  if missing:
    raise FileNotFoundError(f"{folder} lacks {', '.join(missing)}; expected the benchmark's glove folder, or the file "
                            f"{CONVERTED} made of it")
  vectors = load_npy(folder / GLOVE_FILES[0])
  words, rows = (_unpickle(folder / name) for name in GLOVE_FILES[1:])
  if not isinstance(words, list) or not isinstance(rows, dict) or not all(
      isinstance(word, str) and isinstance(rows.get(word), int) and 0 <= rows[word] < len(vectors) for word in words):
    raise ValueError(f"{folder}: {GLOVE_FILES[1]} must be a list of words and {GLOVE_FILES[2]} a row number of "
                     f"{GLOVE_FILES[0]} for each; these files do not belong together")
  return WordVectors(words, vectors[[rows[word] for word in words]])


class _PlainUnpickler(pickle.Unpickler):
  """Reads lists, dicts, words and numbers, for which a pickle needs no class; refuses anything that names a class."""

  def find_class(self, module, name):
    raise pickle.UnpicklingError(f"it asks for {module}.{name}")


def _unpickle(path):
  try:
    with open(path, "rb") as file:
      return _PlainUnpickler(file).load()
  except Exception as error:  # a damaged pickle fails in as many ways as there are opcodes
    raise ValueError(f"{path} is no plain list or table of words ({error}); fetch it again from where the benchmark "
                     "keeps it") from error
