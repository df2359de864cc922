"""Frozen text encoders: captions to features of words or sentences, with a cache."""
import concurrent.futures
import contextlib
import copy
import functools
import hashlib
import itertools
import json
import os
import pathlib
import re
import warnings

import jax
import jax.numpy as jnp
import numpy as np
from tokenizers import Tokenizer, models, normalizers, pre_tokenizers, processors

from motion_jax.text import bert, folder, hub
from motion_jax.text.morphology import possible_bases
from motion_jax.text.padding import pad, padded_length
from motion_jax.text.vocabulary import FUNCTION_WORDS, unknown_words
from motion_jax.utils import cache, text_files
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import shortened

SHIPPED = pathlib.Path(__file__).parents[1] / "pretrained"
LEVELS = ("words", "sentence")
KNOWN_WORDS = "known_words.txt"
CARRIED = "text_encoder"  # folder of the encoder inside a run (`training.checkpoint.ENCODER`)
FAMILIAR = 0.65  # least cosine to the nearest known word of an unseen word that counts as known
# Least cosine of the features of synonyms: walks and saunters 0.74, throws and tosses 0.76, quick and hastily 0.83; not
# grab and catches with 0.65, bounces and backflip with 0.38.
SYNONYM = 0.67
_GROUP = 8  # captions that are encoded together in training
_MOST, _MOST_IN_TRAINING = 50_000, 200_000  # captions in the cache: about 6 kB each of the shipped encoder


@functools.cache
def _threads():
  """Threads that encode groups of captions in parallel."""
  return concurrent.futures.ThreadPoolExecutor(min(8, os.cpu_count() or 1), "captions")


def _run(model, params, ids, text_mask):
  # Full precision: a caption has the same features on every device.
  with jax.default_matmul_precision("highest"):
    return model.apply({"params": params}, ids, text_mask)


_hidden = cache.Program("hidden", _run, 1)


class TextEncoder:
  """A frozen encoder of captions.

  level: "words" (one feature per word piece) or "sentence" (one per caption). dim: width of a feature. max_words: the
  largest number of word pieces of a caption, special ones included. fingerprint: sha256 of weights, tokenizer and
  level, which checkpoints store.
  """

  def __init__(self, parts, name, known_words=(), max_words=None, level="words", folder=None):
    """folder: a folder of the user; None for encoders that ship, are downloaded or have no files."""
    self.model, self.params, self.tokenizer = parts.model, jax.device_put(parts.params), parts.tokenizer
    self.name, self.level, self.fingerprint, self.dim = name, level, parts.fingerprint, self.model.width
    self.max_words = min(max_words or self.model.max_positions, self.model.max_positions)
    self.known_words, self.folder = frozenset(known_words), folder
    self._sentence, self._truncates = parts.sentence, parts.truncates
    self._num_special = self.tokenizer.num_special_tokens_to_add(is_pair=False)
    self._cache, self._kept, self._in_groups = {}, lambda sentence: None, False
    if level == "sentence":
      self.fingerprint = hashlib.sha256(f"{parts.fingerprint} {level}".encode()).hexdigest()
      if self._sentence.projection is not None:
        self.dim = len(self._sentence.projection)

  def __call__(self, sentences, pad_to=None, at_least=None, rows=slice(None)):
    """Features of captions: text_emb (B, S, D) float32 and text_mask (B, S), True = a real word piece.

    S is the number of word pieces of the longest caption, or `pad_to`, or with `at_least` that number times a power of
    two (`padded_length`); 1 at level "sentence". The features of a caption depend neither on the others nor on S.
    rows: a slice of the captions to encode; S is still that of all of them.
    Raises ValueError for an empty caption and for one that is too long; CLIP truncates it as its authors do, and warns.
    """
    sentences = [sentences] if isinstance(sentences, str) else list(sentences)
    features = self._features(sentences[rows])
    if self.level == "sentence":
      vectors = self._sentence.vectors(features)
      return (_unit(vectors) if self._sentence.unit else vectors)[:, None], np.ones((len(features), 1), bool)
    longest = max(len(f) for f in (features if len(features) == len(sentences) else map(self._ids, sentences)))
    if pad_to is not None and pad_to < longest:
      raise InputError(f"got pad_to={pad_to}, the longest caption has {longest} word pieces")
    length = pad_to or (padded_length(longest, at_least, self.max_words) if at_least else longest)
    text_emb = np.zeros((len(features), length, self.dim), np.float32)
    for row, feature in zip(text_emb, features):
      row[:len(feature)] = feature
    return text_emb, np.arange(length) < np.array([len(f) for f in features])[:, None]

  def no_caption(self):
    """The sentence vector (1, E) of an empty caption: of its special word pieces, or zeros without any."""
    ids = self._encode("").ids
    if not ids:
      return np.zeros((1, len(self._sentence.projection)), np.float32)
    padded = min(-(-len(ids) // 8) * 8, self.model.max_positions)
    rows = np.asarray(_hidden(self.model, self.params, *pad([ids], padded)))[0, :len(ids)]
    vector = np.nan_to_num(self._sentence.vectors([rows]))
    return _unit(vector) if self._sentence.unit and vector.any() else vector

  def sentence(self, sentences):
    """One unit vector per caption, (B, E), at any level: captions of similar meaning are close."""
    return _unit(self._sentence.vectors(self._features(sentences)))

  def many_sentences(self, sentences):
    """`sentence` in batches, for many captions: faster, and equal up to rounding."""
    features = dict(self.in_batches(dict.fromkeys(sentences)))
    return _unit(self._sentence.vectors([features[sentence] for sentence in sentences]))

  def sentence_and_words(self, sentences, at_least=None, rows=slice(None)):
    """The feature of the sentence, then those of its words: text_emb (B, 1 + S, D), text_mask (B, 1 + S).

    For encoders of level "words" whose sentence and word features have the same width. at_least, rows: see `__call__`.
    """
    words, mask = self(sentences, at_least=at_least, rows=rows)
    vectors = self._sentence.vectors(self._features(sentences[rows]))
    vectors = _unit(vectors) if self._sentence.unit else vectors
    if self.level != "words" or vectors.shape[-1] != words.shape[-1]:
      raise InputError(f"the encoder {self.name!r} (level {self.level!r}) has {vectors.shape[-1]} features per "
                       f"caption and {self.dim} per word; sentence_and_words needs level 'words' and equal widths")
    return np.concatenate([vectors[:, None], words], axis=1), np.concatenate([mask[:, :1], mask], axis=1)

  def pieces(self, sentences, at_least):
    """Word pieces of captions, for networks with an embedding of their own: ids (B, S), text_mask (B, S).

    S is at_least times a power of two. Raises ValueError for a caption that is too long.
    """
    encodings = [self._ids(sentence) for sentence in sentences]
    return pad(encodings, padded_length(max(map(len, encodings)), at_least, self.max_words))

  def check(self, captions):
    """Raises ValueError, with the longest caption, if any caption is too long for this encoder."""
    captions = list(dict.fromkeys(captions))
    if long := self.too_long(captions):
      worst = max(long, key=long.__getitem__)
      raise InputError(f"{len(long)} of {len(captions)} captions are longer than the {self.max_words} word pieces that "
                       f"the text encoder {self.name!r} takes; the longest has {long[worst]}: "
                       f"{worst[:60]!r}... Shorten them, or take an encoder with more positions")

  def too_long(self, captions) -> dict[str, int]:
    """{caption: number of word pieces} of the captions that are too long for this encoder; {} if it truncates."""
    captions = list(dict.fromkeys(captions)) if not self._truncates else []
    counts = [len(encoding.ids) for i in range(0, len(captions), 4096)
              for encoding in self.tokenizer.encode_batch(captions[i:i + 4096])]
    return {caption: count for caption, count in zip(captions, counts) if count > self.max_words}

  def word(self, sentence, word):
    """The feature (D,) of a word in a sentence: the mean of its pieces. Raises InputError if the word is not in it."""
    match = re.search(rf"(?<!\w){re.escape(word.lower())}(?!\w)", sentence.lower())
    offsets = self._encode(sentence).offsets
    rows = [i for i, (a, b) in enumerate(offsets) if match and a < b and match.start() <= a and b <= match.end()]
    if not rows:
      raise InputError(f"got the word {word!r}, which is not in {sentence!r}")
    return self._features([sentence])[0][rows].mean(0)

  def shows(self, sentence, spans, length):
    """Which of `length` word pieces of a sentence lie in one of the spans of characters, (length,); special ones do."""
    shown = np.zeros(length, bool)
    for row, (a, b) in enumerate(self._encode(sentence).offsets[:length]):
      shown[row] = a == b or any(first <= a and b <= past for first, past in spans)
    return shown

  def out_of_vocabulary(self, sentence):
    """Words of a sentence that the encoder has not learned, in order.

    A word is known if a form of it occurs in the training sentences, or if its sentence vector is close to that of such
    a word. Encoders without a word list (those in Hugging Face layout) return [].
    """
    if not self.known_words:
      return []
    known = lambda word: possible_bases(word) & self._known_bases or self._near_a_known(word)
    return unknown_words(sentence, known) + self.unreadable(sentence)

  def synonym(self, word, others):
    """The best synonym of a word among others, by their features in equal sentences.

    "" if there is none, if the encoder has not learned the word, and for encoders without a word list.
    """
    if not others or not possible_bases(word.lower()) & self._known_bases:
      return ""
    key = cache.key_of("words", self.fingerprint, *others)
    theirs = cache.kept_array("words", key, lambda: self._in_plain_sentences(others))
    nearness = theirs @ self._in_plain_sentences([word])[0]
    return others[int(nearness.argmax())] if nearness.max() >= SYNONYM else ""

  def _in_plain_sentences(self, words):
    """Unit features (N, D) of words, each in the sentence "a person WORD."."""
    return _unit(np.stack([self.word(f"a person {word}.", word) for word in words]))

  def is_piece(self, word):
    """Whether a word is a single piece of the tokenizer, hence spelled correctly."""
    return len(self._encode(word).ids) == 1 + self._num_special and "[UNK]" not in self._encode(word).tokens

  def files(self):
    """Paths of the encoder's files, if it was read from a folder of the user."""
    return [self.folder / name for name in (*hub.FILES, KNOWN_WORDS) if (self.folder / name).is_file()
            ] if self.folder else []

  def unreadable(self, sentence):
    """Characters of a sentence, other than letters, that the tokenizer does not know: emoji and the like."""
    strange = [c for c in sentence if "[UNK]" in self._encode(c).tokens and not c.isalpha()]
    return list(dict.fromkeys(strange))

  @functools.cached_property
  def _known_bases(self):
    return frozenset().union(*(possible_bases(word) for word in self.known_words))

  @functools.cached_property
  def _known_vectors(self):
    words = sorted(word for word in self.known_words - FUNCTION_WORDS if len(word) > 2)
    encodings = [self._encode(word).ids for word in words]
    ids, text_mask = pad(encodings, max(map(len, encodings)))
    hidden = np.asarray(_hidden(self.model, self.params, ids, text_mask))  # in one batch: rounding does not matter here
    return _unit(self._sentence.vectors([words[mask] for words, mask in zip(hidden, text_mask)]))

  def nearness(self, word):
    """Cosine of a word's sentence vector to that of the nearest known word."""
    return float((self._known_vectors @ self.sentence([word])[0]).max())

  def _near_a_known(self, word):
    pieces = self._encode(word).tokens[1:-1]
    if "[UNK]" in pieces or not pieces or len(pieces) > self.max_words - 2:
      return False
    # A word of several small pieces (sw ##ive ##ls) has an arbitrary vector: require a known first piece (sneak ##ily).
    if len(pieces) > 1 and (len(pieces[0]) < 4 or not possible_bases(pieces[0]) & self._known_bases):
      return False
    return self.nearness(word) >= FAMILIAR

  def _encode(self, sentence):
    return self.tokenizer.encode(sentence)

  def _features(self, sentences):
    """Features (S_i, D) of captions without padding, as a list."""
    if isinstance(sentences, str):
      sentences = [sentences]
    sentences = list(sentences)
    if not sentences:
      raise InputError("got no caption, expected at least one, such as 'a person walks'")
    if self._in_groups:
      self._encode_new(sentences)
    return [self._feature(sentence) for sentence in sentences]

  def _feature(self, sentence):
    if not isinstance(sentence, str):
      raise InputError(f"got a caption of type {type(sentence).__name__}, expected a string")
    if sentence in self._cache:
      return self._cache[sentence]
    kept = self._kept(sentence)
    if kept is not None:
      return kept
    ids = self._ids(sentence)
    # One caption at a time, padded to multiples of 8: few compilations, and no caption depends on its batch.
    padded = min(-(-len(ids) // 8) * 8, self.model.max_positions)
    hidden = np.asarray(_hidden(self.model, self.params, *pad([ids], padded)))[0, :len(ids)]
    return self._remember(sentence, hidden)

  def _remember(self, sentence, hidden):
    hidden = hidden.copy()
    hidden.setflags(write=False)  # the cache returns this array itself
    if len(self._cache) >= (_MOST_IN_TRAINING if self._in_groups else _MOST):
      with contextlib.suppress(RuntimeError, KeyError):  # another thread may use the cache
        self._cache.pop(next(iter(self._cache)))
    self._cache[sentence] = hidden
    return hidden

  def for_training(self):
    """This encoder for the many captions of training: about ten times as fast, equal up to rounding (3e-6).

    New captions of a batch are encoded in groups of one size, on the host's processor, where they do not wait for the
    steps of an accelerator. A feature does not depend on other captions or on earlier calls.
    """
    other = copy.copy(self)
    other._cache, other._in_groups = {}, True
    with contextlib.suppress(RuntimeError):  # JAX may have been started without it
      other.params = jax.device_put(self.params, jax.local_devices(backend="cpu")[0])
    return other

  def _encode_new(self, sentences):
    new = [sentence for sentence in dict.fromkeys(sentences)
           if isinstance(sentence, str) and sentence not in self._cache and self._kept(sentence) is None]
    run = lambda padded, some: (some, np.asarray(_hidden.jitted(self.model, self.params, *pad(
        [ids for ids, _ in some] + [some[-1][0]] * (_GROUP - len(some)), padded))))
    for some, features in _threads().map(run, *zip(*self._groups(new, _GROUP))) if new else ():
      for (ids, sentence), rows in zip(some, features):
        self._remember(sentence, rows[:len(ids)])

  def recall(self, kept):
    """Uses stored features kept(sentence), (S, D), from now on; None means that they are computed."""
    self._kept = kept

  def in_batches(self, sentences, size=32):
    """Yields (sentence, features (S, D)) of many different captions, in the order of their lengths."""
    for padded, some in self._groups(sentences, size):
      filled = [ids for ids, _ in some] + [some[-1][0]] * (size - len(some))
      features = np.asarray(_hidden(self.model, self.params, *pad(filled, padded)))
      yield from ((sentence, rows[:len(ids)]) for (ids, sentence), rows in zip(some, features))

  def _groups(self, sentences, size):
    """Yields (padded length, up to `size` pairs of word pieces and sentence), by length."""
    encodings = sorted(((self._ids(sentence), sentence) for sentence in sentences), key=lambda item: len(item[0]))
    width = lambda item: min(-(-len(item[0]) // 8) * 8, self.model.max_positions)
    for padded, same in itertools.groupby(encodings, width):
      while some := list(itertools.islice(same, size)):
        yield padded, some

  def _ids(self, sentence):
    """The word pieces of a caption, special ones included."""
    ids = self._encode(sentence).ids
    if not sentence.strip() or len(ids) <= self._num_special:
      raise InputError(f"got the empty caption {sentence!r}; say what the person does, such as 'a person walks'")
    if len(ids) > self.max_words and self._truncates:
      warnings.warn(f"CLIP reads {self.max_words} word pieces of the {len(ids)} of {sentence[:60]!r}...", stacklevel=5)
      ids = ids[:self.max_words - 1] + ids[-1:]
    if len(ids) > self.max_words:
      raise InputError(f"got a caption of {len(ids)} word pieces, expected at most {self.max_words}; shorten it or "
                       f"split it into several: {sentence[:60]!r}...")
    return ids


def _unit(vectors):
  return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def load_text_encoder(name_or_folder="words", max_words=None, level="words"):
  """A frozen encoder by name or folder.

  - "words": the small encoder that ships. "random-init": a tiny one with fixed random weights, for tests.
  - A run folder or a shipped model, such as "cmdm-small": the encoder that the model was trained with.
  - A name of `hub.REVISIONS`, which is downloaded at a pinned revision (extra `hub`), or "owner/name@revision".
  - A folder in Hugging Face layout, with config.json, model.safetensors and
    - BERT, MiniLM, DistilBERT, MPNet: tokenizer.json. The sentence feature is the unit mean of its words.
    - CLIP, whole or its text half: tokenizer.json, or vocab.json and merges.txt. The sentence feature is the projected
      feature of the end token, not at unit length. Captions are truncated to 77 word pieces.
    - T5 1.0 and 1.1: tokenizer.json; for Sentence-T5 also 2_Dense/model.safetensors. The sentence feature is the
      mean of its words, projected by the latter, at unit length.

  level: "words" for one feature per word piece, "sentence" for one per caption. max_words: limits word pieces further.
  Raises FileNotFoundError or ValueError that say what is missing.
  """
  if max_words is not None and max_words < 3:
    raise InputError(f"got max_words={max_words}, expected at least 3: a word and the two special pieces")
  if level not in LEVELS:
    raise InputError(f"got the text level {shortened(repr(level))}, expected one of {', '.join(LEVELS)}")
  name = str(name_or_folder)
  if name == "random-init":
    return TextEncoder(_random_init(), name, max_words=max_words, level=level)
  carried = _carried(name_or_folder)
  place = SHIPPED / name if name in shipped_encoders() else carried or hub.find(name_or_folder)
  known = place / KNOWN_WORDS
  return TextEncoder(folder.read(place, name, level), name, max_words=max_words, level=level,
                     known_words=text_files.read_text(known).split() if known.is_file() else (),
                     folder=place if place in (carried, pathlib.Path(name_or_folder)) else None)


def _carried(run):
  """The encoder's folder inside a run folder or a shipped model, or None."""
  places = [pathlib.Path(run) / CARRIED, SHIPPED / run / CARRIED]
  config = SHIPPED / run / "config.json"
  if config.parent.parent == SHIPPED and config.is_file():  # a shipped model may share the encoder of another
    places.append(SHIPPED / json.loads(config.read_text()).get("frozen", {}).get("text", "") / CARRIED)
  return next((place for place in places if (place / "tokenizer.json").is_file()), None)


def shipped_encoders():
  """Names of the encoders that ship."""
  return sorted(path.parent.name for path in SHIPPED.glob("*/tokenizer.json"))


def _random_init(seed=0):
  """Random weights over letters and a few words: without files, equal on every machine."""
  pieces = ["[PAD]", "[UNK]", "[CLS]", "[SEP]", *".,!?'-", *"0123456789"]
  pieces += [p + c for c in "abcdefghijklmnopqrstuvwxyz" for p in ("", "##")] + [f"##{c}" for c in "0123456789"]
  pieces += "person someone walks runs jumps turns left right forward and then the waves sits".split()
  tokenizer = Tokenizer(models.WordPiece({piece: i for i, piece in enumerate(pieces)}, unk_token="[UNK]"))
  tokenizer.normalizer, tokenizer.pre_tokenizer = normalizers.BertNormalizer(), pre_tokenizers.BertPreTokenizer()
  tokenizer.post_processor = processors.TemplateProcessing(
      single="[CLS] $A [SEP]", special_tokens=[("[CLS]", 2), ("[SEP]", 3)])
  fields = dict(vocab_size=len(pieces), width=32, num_layers=1, num_heads=2, mlp_width=64, max_positions=64)
  rng = np.random.default_rng(seed)  # numpy's stream is the same on every jax version
  shapes = jax.eval_shape(lambda: bert.Bert(**fields).init(
      jax.random.key(0), jnp.zeros((1, 1), jnp.int32), jnp.ones((1, 1), bool)))["params"]
  params = jax.tree_util.tree_map_with_path(
      lambda path, leaf: np.ones(leaf.shape, np.float32) if path[-1].key == "scale"
      else rng.normal(0, 1.0 if path[-1].key == "embedding" else 0.2, leaf.shape).astype(np.float32), shapes)
  # Positions for long captions are drawn last, which keeps the features of short ones.
  more = rng.normal(0, 1.0, (512 - fields["max_positions"], fields["width"])).astype(np.float32)
  params["positions"]["embedding"] = np.concatenate([params["positions"]["embedding"], more])
  fields["max_positions"] = 512
  digest = hashlib.sha256(tokenizer.to_str().encode())
  for leaf in jax.tree.leaves(params):
    digest.update(leaf.tobytes())
  return folder.EncoderParts(bert.Bert(**fields), params, tokenizer, digest.hexdigest())
