"""What every conversion needs: one network's tensors out of a file, and a folder that appears whole or not at all."""
import hashlib
import math
import pathlib
import re
from typing import Any, NamedTuple

import jax
import ml_collections
import numpy as np

from motion_jax.convert.state import from_torch, load_checkpoint, select
from motion_jax.motion.representations import layout_for
from motion_jax.motion.stats import ABSOLUTE, load_stats, save_stats
from motion_jax.nets.post_norm import sinusoids
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint
from motion_jax.training.setup import text_identity
from motion_jax.utils.atomic import atomic_folder
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import npy_shape, shards

# What a checkpoint holds for going on with its training only, as the field's training scripts name it.
TRAINING_ONLY = re.compile(r"(opt|optim|optimizer|scheduler|lr_scheduler|scaler)(_.*)?$")


class NetworkState(NamedTuple):
  """Tensors of one network out of a checkpoint, {reference's name: array}."""
  state: dict
  source: dict           # file, part, sha256
  left: tuple[str, ...]  # entries that were left aside on purpose

  def shape(self, name, what, dims):
    """Shape of a tensor that every `what` has; an error says what the file holds instead."""
    if name not in self.state or self.state[name].ndim != dims:
      got = f"of shape {self.state[name].shape}" if name in self.state else "missing"
      raise ValueError(f"{self.source['file']} is no {what}: {name} is {got}; it holds "
                       f"{', '.join(sorted(self.state)[:4])}, ...: this is {whose(self.state)}")
    return self.state[name].shape

  def count(self, pattern):
    """How many different numbers stand at the group of a pattern of names."""
    return len({match[1] for name in self.state if (match := re.match(pattern, name))})


class Network(NamedTuple):
  """A converted network: its module, the module's fields, and its parameters as the run folder keeps them."""
  what: str
  module: Any
  fields: dict
  params: Any
  part: NetworkState
  note: str = ""

  @property
  def num_params(self):
    """Numbers out of the file; sums and counts of codebooks are ours."""
    books = self.params.get("codebooks", {"codes": ()})["codes"]
    return sum(np.size(a) for a in jax.tree.leaves((self.params.get("params", self.params), books)))

  def __str__(self):
    tell = lambda fields: ", ".join(f"{name} {f'({tell(value)})' if isinstance(value, dict) else value}"
                                    for name, value in fields.items())
    source = self.part.source["file"] + (f" ({self.part.source['part']})" if self.part.source["part"] else "")
    left = f"\n  left aside: {', '.join(self.part.left)}" if self.part.left else ""
    note = f"\n  {self.note}" if self.note else ""
    return f"{self.what}: {self.num_params:,} parameters from {source}\n  {tell(self.fields)}{left}{note}"


# What begins, or stands behind a dot or a slash, in the names of one network alone, and whose that is.
_WHOSE = {"input_process.": "MDM's denoiser", "vae.global_motion_token": "MLD",
          "denoiser.pose_embd.": "MLD without a VAE", "vqvae.": "T2M-GPT's VQ-VAE", "trans_base.": "T2M-GPT's GPT",
          "vq_model/": "MoMask's RVQ-VAE", "t2m_transformer/": "MoMask's masked transformer",
          "res_transformer/": "MoMask's residual transformer", "tae.": "MotionStreamer's causal autoencoder",
          "transformer.wte.": "MotionStreamer's generator"}


def whose(names) -> str:
  """Which network of a method these names of tensors belong to, for errors."""
  starts = {mark: re.compile(rf"(^|[./]){re.escape(mark)}") for mark in _WHOSE}
  return next((_WHOSE[mark] for mark in starts if any(map(starts[mark].search, names))), "another kind of checkpoint")


# --- reading -----------------------------------------------------------------------------------------------------


def read_part(path, wanted=(), others=(), choices=()):
  """One network's tensors out of a checkpoint -> NetworkState.

  wanted: the entries that hold it ("ae"; three for an evaluator, whose names then keep theirs, "text_encoder/..."),
  none for a bare state dict; a file whose names are not nested is a bare one. choices: names for the one entry that is
  wanted, of which the first counts that is there. others: entries of its kind to leave aside. Entries that only
  training needs are left aside too; any other is an error.
  """
  state, plain = load_checkpoint(path)
  if not state:
    raise ValueError(f"{path} holds no tensor" + (f", only {', '.join(sorted(plain))}" if plain else ""))
  nested = any("/" in name for name in state)
  left = set(plain)
  tops = {name.split("/")[0] for name in state}
  if nested and choices:
    wanted = tuple(name for name in choices if name in tops)[:1] or tuple(choices[:1])
  if nested and wanted:
    left |= {top for top in tops if top in others or TRAINING_ONLY.match(top)} - set(wanted)
    absent, unknown = set(wanted) - tops, sorted(tops - left - set(wanted))
    if absent or unknown:
      raise ValueError(f"{path} holds {', '.join(sorted(tops | plain))}; expected {', '.join(wanted)} and nothing else "
                       f"but what training needs; this is {whose(state)}")
    state = {name: array for name, array in state.items() if name.split("/")[0] in wanted}
    if len(wanted) == 1:
      state = select(state, f"{wanted[0]}/")
  state, counters = _unwrapped(state)
  left |= counters
  broken = [name for name, array in state.items() if not np.isfinite(array).all()]
  if broken:
    raise ValueError(f"{path}: {broken[0]} holds NaN or infinity; fetch the file again")
  digest = hashlib.sha256()
  for shard in shards(path):
    with open(shard, "rb") as file:
      while block := file.read(1 << 24):
        digest.update(block)
  part = ", ".join(wanted) if nested else ""
  source = dict(file=pathlib.Path(path).name, part=part, sha256=digest.hexdigest())
  return NetworkState(state, source, tuple(sorted(left)))


# What wraps a module, data-parallel, compiled or averaged, puts before every name alike, in any order and number.
_WRAPPER = re.compile(r"(?:(?:module|_orig_mod)\.)+")


def _unwrapped(state):
  """(state without what wrappers put before its names, the counter that an averaging one keeps)."""
  counters = {"n_averaged"} & state.keys()
  state = {name: array for name, array in state.items() if name not in counters}
  starts = {match[0] if (match := _WRAPPER.match(name)) else "" for name in state}
  if len(starts) == 1:
    state = {name[len(min(starts)):]: array for name, array in state.items()}
  return state, counters


def without_clip(part):
  """The part less a text encoder that lies in it; the encoder's own folder holds that."""
  clip = [name for name in part.state if name.startswith("clip_model.")]
  if not clip:
    return part
  return part._replace(state={name: array for name, array in part.state.items() if name not in clip},
                       left=(*part.left, f"clip_model ({len(clip)} tensors)"))


def check_sinusoids(part, name, width):
  """The table of fixed positions is a formula here; raises ValueError if the file's is another one."""
  if name in part.state:
    table = np.asarray(part.state[name]).reshape(-1, width)[:200]
    if np.abs(table - sinusoids(len(table), width)).max() > 1e-3:
      raise ValueError(f"{part.source['file']} has positions {name} other than sines and cosines of base 10000")


def network(what, part, module, fields, shapes, table, ignore=()):
  """A Network whose parameters are those of the part under the names of a table, every tensor accounted for."""
  params = from_torch(part.state, table, ignore)
  checkpoint.check_fits(params, shapes, f"{part.source['file']} does not fit a {what}")
  return Network(what, module, fields, params, part)


def heads_of(given, width, known, flag="--heads"):
  """The number of heads, which no tensor tells: as given, or the known one."""
  heads = known if given is None else given
  if heads is None:
    raise ValueError(f"the tensors do not tell the number of attention heads, and width {width} is none of the known "
                     f"sizes; give it with {flag}")
  if heads < 1 or width % heads:
    raise ValueError(f"got {heads} heads for width {width}, expected a number that divides it")
  return heads


def stats_of(folder, columns, means=("Mean.npy",)):
  """Mean and std with the given number of columns: the first pair of files in a folder that matches.

  means: names of the files with means; for coordinates Mean_abs.npy comes first (docs/papers/cdamd.md#representations).
  Raises FileNotFoundError or ValueError.
  """
  folder, layout = pathlib.Path(folder), layout_for(columns)
  pairs = [(mean, mean.replace("Mean", "Std").replace("mean", "std")) for mean in means]
  if layout.are_joints:
    pairs.insert(0, ABSOLUTE)
  for names in pairs:
    if all((folder / name).is_file() for name in names) and _fits(folder / names[0], layout):
      return load_stats(folder, layout, names)
  raise FileNotFoundError(f"{folder} has no statistics of {columns} numbers, those of layout {layout.name!r}; expected "
                          + ", or ".join(f"{mean} and {std}" for mean, std in pairs))


def _fits(path, layout):
  """Whether a file of means is of that layout; one that cannot be read is for `load_stats` to tell."""
  try:
    size = math.prod(npy_shape(path))
  except InputError:
    return True
  return size == layout.dim or size == 3 and layout.are_joints


def text_files(text, dim, what, usual, level="words"):
  """{file: content} by which a run knows the text encoder in the folder `text` (`encoder_of`), {} if that is None."""
  return {} if text is None else {checkpoint.TEXT: text_identity(encoder_of(text, dim, what, usual, level))}


def encoder_of(text, dim, what, usual, level="sentence"):
  """The text encoder in the folder `text`.

  Raises ValueError unless it gives the `dim` numbers that a `what` was trained on; usual: what it mostly was.
  """
  encoder = load_text_encoder(text, level=level)
  if encoder.dim != dim:
    raise ValueError(f"the text encoder {text} gives {encoder.dim} numbers a {level.removesuffix('s')}, the {what} was "
                     f"trained on {dim}; give --text-encoder the encoder that it was trained on ({usual})")
  return encoder


# --- writing -----------------------------------------------------------------------------------------------------


def write(out, config, networks, params, stats, frozen=None, files=None):
  """A run folder of converted networks, whole or not at all; its config names the files that they came from."""
  config |= dict(seed=0, converted={made.what: made.part.source for made in networks})
  with atomic_folder(out) as folder:
    checkpoint.save_config(folder, ml_collections.ConfigDict(config))
    save_stats(stats, folder)
    checkpoint.save_params(folder, params)
    if frozen:
      checkpoint.save_params(folder, frozen, name=checkpoint.FROZEN)
    for name, content in (files or {}).items():
      checkpoint.save_text(folder, name, content)


def check_free(out):
  """Raises ValueError if something lies where the folder `out` is to be written."""
  out = pathlib.Path(out)
  if out.is_file() or out.is_dir() and any(out.iterdir()):
    raise ValueError(f"{out} exists already; choose another --out, or remove it first")
