"""What models that are ready to use have in common: prompts, lengths, seeds, and where a motion is from."""
import functools
import hashlib
import pathlib
import warnings
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax import checkpoint
from motion_jax.motion.stats import Stats, load_stats
from motion_jax.text.encoder import TextEncoder


class Prompted:
  """A run folder whose parameters make motion from words; the base of `model.Model` and `cdamd_model.CdamdModel`."""
  max_seconds = 3600.0

  def __init__(self, folder, config, encoder: TextEncoder, text_dim, unit, frozen_shapes, shapes, raw=False):
    """text_dim: numbers that the network takes of a word or sentence; unit: frames of a latent; shapes of what the
    folder must hold; raw: its last weights, not their average."""
    self.folder, self.config, self.encoder, self.unit = pathlib.Path(folder), config, encoder, unit
    self.params_file = checkpoint.RAW if raw else checkpoint.PARAMS
    if encoder.dim != text_dim:
      raise ValueError(f"the text encoder gives {encoder.dim} numbers a {encoder.level.removesuffix('s')}, the model "
                       f"in {folder} was trained on {text_dim}; pass the encoder named {config.frozen.text!r} as text")
    if checkpoint.load_fingerprint(folder) not in (None, encoder.fingerprint):
      raise ValueError(f"{folder} was trained on another version of the text encoder {config.frozen.text!r}; pass the "
                       "folder with the old one as text, or train the model again")
    self.stats: Stats = load_stats(folder, config.data.layout)
    frozen = checkpoint.load_params(folder, name=checkpoint.FROZEN)
    frozen = {name: frozen[name] for name in frozen_shapes if name in frozen}  # less what only training needs
    checkpoint.check_fits(frozen, frozen_shapes, f"{self.folder / checkpoint.FROZEN} does not fit its config")
    self.frozen = jax.tree.map(jnp.asarray, frozen)
    self.params = jax.tree.map(jnp.asarray, checkpoint.load_params(folder, shapes, self.params_file))
    self._lengths = None

  # --- what it is ------------------------------------------------------------------------------------------------

  @property
  def fps(self) -> float:
    return self.stats.layout.skeleton.fps

  @property
  def num_params(self) -> int:
    return sum(x.size for x in jax.tree.leaves((self.params, self.frozen["tokenizer"])))

  @functools.cached_property
  def id(self) -> str:
    """Folder name and a hash of the weights: what a file says about where its motion is from."""
    digest = hashlib.sha256((self.folder / self.params_file).read_bytes()).hexdigest()[:12]
    return f"{self.folder.name}@{digest}"

  @property
  def license(self) -> str:
    path = self.folder / "LICENSE.txt"
    return path.read_text().strip() if path.is_file() else ""

  # --- lengths ---------------------------------------------------------------------------------------------------

  def natural_frames(self, prompt) -> int:
    """How long the clips of the nearest training captions are: an action generated much longer goes on by itself."""
    if self._lengths is None:
      table = checkpoint.load_lengths(self.folder)
      if table is None:
        return 120
      self._lengths = self.encoder.sentence(table[0]), table[1]
    known, frames = self._lengths
    nearness = known @ self.encoder.sentence([prompt])[0]
    nearest = np.argsort(-nearness, kind="stable")[:5]
    return int(np.clip(np.median(frames[nearest]), 60, 196))

  def frames_of(self, prompts, num_frames, seconds):
    """Lengths in frames, one per prompt: as given (one for all or one each), or those of similar training clips."""
    if num_frames is not None and seconds is not None:
      raise ValueError("got both num_frames and seconds; give one of them")
    if num_frames is None:
      num_frames = self.natural_frames if seconds is None else [float(s) * self.fps for s in each(seconds, prompts)]
    counts = [num_frames(p) for p in prompts] if callable(num_frames) else each(num_frames, prompts)
    for count in counts:
      if not np.isfinite(count) or not self.unit <= count <= self.max_seconds * self.fps:
        raise ValueError(f"got a length of {count:g} frames, expected {self.unit} to {self.max_seconds * self.fps:.0f} "
                         f"({self.max_seconds:g} s at {self.fps:g} frames a second)")
    return [int(round(count)) for count in counts]

  # --- arguments ---------------------------------------------------------------------------------------------------

  def scale_of(self, guidance_scale):
    """The guidance scale, the config's if None is given."""
    scale = self.config.sampler.guidance_scale if guidance_scale is None else float(guidance_scale)
    if not np.isfinite(scale):
      raise ValueError(f"got guidance_scale {scale}, expected a finite number such as 3")
    return scale

  def check_words(self, prompts):
    """Raises ValueError for an empty prompt; warns of words that the model does not know."""
    for prompt in prompts:
      if not isinstance(prompt, str) or not prompt.strip():
        raise ValueError(f"got the prompt {prompt!r}; say what the person does, as in \"a person waves\"")
      strange = self.encoder.unfamiliar(prompt)
      if strange:
        warnings.warn(f"the model does not know {', '.join(repr(w) for w in strange)} in {prompt!r}; it may be ignored "
                      "or misunderstood", stacklevel=3)


def plain_fields(config):
  """A config section as fields of a module: lists become tuples, which can be hashed."""
  return {k: tuple(v) if isinstance(v, list | tuple) else v for k, v in config.to_dict().items()}


def each(value, prompts):
  values = list(value) if isinstance(value, Sequence | np.ndarray) else [value] * len(prompts)
  if len(values) != len(prompts):
    raise ValueError(f"got {len(values)} lengths for {len(prompts)} prompts; give one number or one per prompt")
  return values


def keys_of(rng, seeds, count):
  """(keys (count,), seeds or Nones): of seeds, or of a key that is folded with each motion's place."""
  if seeds is not None:
    if len(seeds) != count:
      raise ValueError(f"got {len(seeds)} seeds for {count} motions")
    return jnp.stack([jax.random.key(int(seed)) for seed in seeds]), [int(seed) for seed in seeds]
  rng = jax.random.key(0) if rng is None else rng
  return jax.vmap(lambda i: jax.random.fold_in(rng, i))(jnp.arange(count)), [None] * count
