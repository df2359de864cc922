"""Read a folder in Hugging Face layout: module, parameters, tokenizer and sentence feature of a text encoder."""
import hashlib
import re
from typing import Any, NamedTuple

import numpy as np
from tokenizers import AddedToken, Regex, Tokenizer, models, normalizers, pre_tokenizers, processors

from motion_jax.nets.network_sizes import check_sizes
from motion_jax.text import bert, clip, hugging_face, mpnet, t5
from motion_jax.utils.errors import InputError, reading
from motion_jax.utils.input_files import load_safetensors, read_json, shards
from motion_jax.utils.install import pip_install

CONFIG, WEIGHTS, TOKENIZER = "config.json", "model.safetensors", "tokenizer.json"
SHARDED = f"{WEIGHTS}.index.json"
CLIP_TOKENIZER = ("vocab.json", "merges.txt")
DENSE = "2_Dense"  # where Sentence-T5 keeps its projection
KINDS = {
    "bert": (bert.bert_fields, bert.Bert, bert.params_from_reference, r"cls\.|vocab_"),
    "distilbert": (bert.bert_fields, bert.Bert, bert.params_from_reference, r"cls\.|vocab_"),
    "clip": (clip.clip_fields, clip.ClipText, clip.params_from_reference, clip.IGNORED),
    "clip_text_model": (clip.clip_fields, clip.ClipText, clip.params_from_reference, clip.IGNORED),
    "mpnet": (mpnet.mpnet_fields, mpnet.MPNet, mpnet.params_from_reference, r"lm_head\."),
    "t5": (t5.t5_fields, t5.T5Encoder, t5.params_from_reference, t5.IGNORED),
}


class Sentence(NamedTuple):
  """Pooling of the word features of a sentence to one vector."""
  pooling: str = "mean"                 # or "last": CLIP's end token
  projection: np.ndarray | None = None  # (E, D)
  unit: bool = True                     # whether the vector is scaled to length 1

  def vectors(self, features):
    """Features of B sentences, each (S_i, D), to (B, E), not scaled."""
    rows = np.stack([words.mean(0) if self.pooling == "mean" else words[-1] for words in features])
    # Not @: its rounding depends on B.
    return rows if self.projection is None else np.einsum("bd,ed->be", rows, self.projection)


class EncoderParts(NamedTuple):
  """The parts of a text encoder. fingerprint: sha256 of weights and tokenizer; truncates: cut long captions."""
  model: Any
  params: Any
  tokenizer: Tokenizer
  fingerprint: str
  sentence: Sentence = Sentence()
  truncates: bool = False


def read(folder, name, level="words"):
  """The parts of the encoder in a folder, whose kind is in its config.json.

  level "sentence" also requires the weights of a sentence feature. Raises FileNotFoundError with the missing files,
  ValueError for files that cannot be read or do not belong together.
  """
  kind = _kind(folder, name)
  files = _check_files(folder, name, kind)
  to_fields, module, to_params, ignored = KINDS[kind]
  try:
    with reading("one of its files", "they are damaged or not of one model: fetch them again"):
      config = read_json(folder / CONFIG)
      fields = _fields(folder, to_fields, config)
      check_sizes(fields, CONFIG, advice="fetch it again")
      state = _weights(folder / files[1], ignored)
      if kind == "clip_text_model" and "text_projection.weight" not in state:
        fields["projection_dim"] = 0
      params = to_params(state, fields)
      sentence = _sentence(folder, state, fields, kind, level)
      tokenizer = _tokenizer(folder, kind, files)
  except InputError as error:
    raise InputError(f"text encoder {name!r} cannot be read from {folder}: {error}") from error
  pieces = max(tokenizer.get_vocab().values(), default=0) + 1
  if pieces > fields["vocab_size"]:
    raise InputError(f"text encoder {name!r}: the tokenizer has {pieces} word pieces, the weights "
                     f"have {fields['vocab_size']}; both must come from one model")
  tokenizer.no_padding()
  tokenizer.no_truncation()
  if kind not in ("bert", "distilbert", "mpnet"):
    end = fields.get("end_id") if kind != "t5" else config.get("eos_token_id", 1)
    ids = tokenizer.encode("a").ids
    if ids[-1] != (max(ids) if end is None else end):
      raise InputError(f"text encoder {name!r}: the tokenizer ends a sentence with piece {ids[-1]}, config.json says "
                       f"{end}; both must come from one model")
  digest = hashlib.sha256()
  for file in files[1:]:
    with open(folder / file, "rb") as stream:
      while block := stream.read(1 << 24):
        digest.update(block)
  return EncoderParts(module(**fields), params, tokenizer, digest.hexdigest(), sentence, kind.startswith("clip"))


def _fields(folder, to_fields, config):
  """The fields of a kind's module; defaults that config.json omits come from transformers, if installed."""
  try:
    return to_fields(config)
  except ValueError:
    whole = hugging_face.whole_config(folder, config)
    if whole.keys() == config.keys():
      raise
    return to_fields(whole)


def _kind(folder, name):
  if not (folder / CONFIG).is_file():
    return "bert"  # the error about missing files is that of the most common kind
  try:
    kind = read_json(folder / CONFIG, advice="fetch it again").get("model_type", "bert")
  except InputError as error:
    raise InputError(f"text encoder {name!r}: {error}") from error
  if not isinstance(kind, str) or kind not in KINDS:
    raise InputError(f"text encoder {name!r}: {folder / CONFIG} is of model_type {str(kind)[:60]!r}, expected one of "
                     f"{', '.join(KINDS)}")
  return kind


def _check_files(folder, name, kind):
  """The files of an encoder: config.json, weights or the index of their shards, tokenizer. Raises FileNotFoundError
  that lists missing ones."""
  has = lambda file: (folder / file).is_file()
  tokenizer = [TOKENIZER]
  if kind.startswith("clip") and not has(TOKENIZER) and any(map(has, CLIP_TOKENIZER)):
    tokenizer = list(CLIP_TOKENIZER)
  if not has(TOKENIZER) and hugging_face.old_tokenizer(folder, kind):
    tokenizer = [hugging_face.old_tokenizer(folder, kind)]
  weights = [WEIGHTS]
  if not has(WEIGHTS) and has(SHARDED):
    weights = [SHARDED, *(path.name for path in shards(folder / SHARDED))]
  files = [CONFIG, *weights, *tokenizer]
  if kind == "t5" and (folder / DENSE).is_dir():
    files.append(f"{DENSE}/{WEIGHTS}")
  missing = [file for file in files if not has(file)]
  if not missing:
    return files
  advice = ["give 'words' (it ships with this package) or a folder that holds config.json, model.safetensors and "
            "tokenizer.json of a BERT, MiniLM, DistilBERT, MPNet, CLIP or T5 model, as Hugging Face lays it out"]
  for file in missing:
    pickled = file.replace(WEIGHTS, "pytorch_model.bin")
    if pickled != file and has(pickled):
      advice.append(f"pytorch_model.bin is not opened here; after {pip_install('convert')} convert it once: "
                    f"python -c \"from motion_jax.convert import load_state; from safetensors.numpy import save_file; "
                    f"save_file(load_state('{folder / pickled}'), '{folder / file}')\"")
  old = hugging_face.OLD_TOKENIZERS.get(kind)
  if TOKENIZER in missing and old and has(old):
    advice.append(f"{old} is not read here without transformers: {pip_install('convert')}, or save "
                  "tokenizer.json beside it (AutoTokenizer writes it with save_pretrained; that of "
                  "sentence-transformers/sentence-t5-base has T5's own vocabulary)")
  raise FileNotFoundError(f"text encoder {name!r}: {folder} lacks {', '.join(missing)}; {'; '.join(advice)}")


def _weights(path, ignored=None):
  """{name: array} of a safetensors file, without the parts of the network that do not encode text."""
  return load_safetensors(path, lambda name: not (ignored and re.match(ignored, name)), advice="fetch it again")


def _sentence(folder, state, fields, kind, level):
  """The sentence feature of an encoder: of CLIP the projected end token, of others the unit mean."""
  float32 = lambda array: None if array is None else np.asarray(array, np.float32)
  if kind.startswith("clip"):
    if level == "sentence" and not fields["projection_dim"]:
      raise InputError("it has no text_projection, so no sentence feature; give a CLIPModel or a "
                       "CLIPTextModelWithProjection, or use level 'words'")
    # Parity: CDAMD takes this feature as it is, not at unit length, and in half precision; ours is float32.
    return Sentence("last", float32(state.get("text_projection.weight")), unit=False)
  if kind == "t5" and (folder / DENSE).is_dir():
    return Sentence(projection=_dense(folder / DENSE, fields["width"]))
  return Sentence(projection=float32(state.get("sentence_projection.weight")))


def _dense(folder, width):
  """The matrix (E, D) of Sentence-T5's last layer, which has neither bias nor activation."""
  config = read_json(folder / CONFIG) if (folder / CONFIG).is_file() else {}
  activation = config.get("activation_function", "Identity").split(".")[-1]
  state = _weights(folder / WEIGHTS)
  if set(state) != {"linear.weight"} or activation != "Identity":
    raise InputError(f"{folder} holds {', '.join(sorted(state))} with activation {activation!r}, expected "
                     "linear.weight alone and the identity")
  if state["linear.weight"].ndim != 2 or state["linear.weight"].shape[1] != width:
    raise InputError(f"linear.weight of {folder} has shape {state['linear.weight'].shape}, expected (any, {width})")
  return np.asarray(state["linear.weight"], np.float32)


def _tokenizer(folder, kind, files):
  file = folder / TOKENIZER
  if hugging_face.OLD_TOKENIZERS.get(kind) in files:
    return hugging_face.tokenizer(folder)
  try:
    if file.is_file():
      return Tokenizer.from_file(str(file))
    return clip_tokenizer(*(folder / name for name in CLIP_TOKENIZER))
  except Exception as error:  # the tokenizers library raises bare Exception
    if type(error) is not Exception:
      raise
    raise InputError(f"{file if file.is_file() else folder} is not a tokenizer: {error}") from error


def clip_tokenizer(vocab, merges, start="<|startoftext|>", end="<|endoftext|>"):
  """CLIP's tokenizer from its two files: lower case, split into words, byte-pair merges, an end-of-word mark."""
  tokenizer = Tokenizer(models.BPE.from_file(str(vocab), str(merges), unk_token=end, end_of_word_suffix="</w>"))
  ids = {token: tokenizer.token_to_id(token) for token in (start, end)}
  if None in ids.values():
    raise InputError(f"{vocab} lacks {start} or {end}; expected the vocabulary of CLIP")
  tokenizer.add_special_tokens([AddedToken(token, special=True) for token in ids])
  tokenizer.normalizer = normalizers.Sequence(
      [normalizers.NFC(), normalizers.Replace(Regex(r"\s+"), " "), normalizers.Lowercase()])
  words = Regex(r"'s|'t|'re|'ve|'m|'ll|'d|\p{L}+|\p{N}|[^\s\p{L}\p{N}]+")
  tokenizer.pre_tokenizer = pre_tokenizers.Sequence(
      [pre_tokenizers.Split(words, "removed", invert=True), pre_tokenizers.ByteLevel(add_prefix_space=False)])
  tokenizer.post_processor = processors.TemplateProcessing(single=f"{start} $A {end}", special_tokens=list(ids.items()))
  return tokenizer
