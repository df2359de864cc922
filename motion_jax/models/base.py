"""What the models of all methods have in common: prompts, lengths, seeds, sampling options, and their origin."""
import functools
import hashlib
import operator
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.control.files import constraints_of
from motion_jax.control.signal import ControlSignal
from motion_jax.latents import SAMPLED
from motion_jax.models import arguments
from motion_jax.models.options import SamplingOptions
from motion_jax.models.results import Motions
from motion_jax.models.shared.captions import TrainingCaptions
from motion_jax.motion.cleanup import SMOOTHING
from motion_jax.motion.stats import Stats
from motion_jax.runs import Run
from motion_jax.text.captions import SUBJECTS
from motion_jax.text.encoder import TextEncoder
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import SEEDS, as_float, checked, format_value, require_numbers, shortened
from motion_jax.utils.text_files import is_text

_SECONDS = 6.0  # of a motion whose length is not given
_LONGEST_PROMPT = 5000  # characters: ten times the longest caption of the data sets

Prompts = str | Iterable[str]  # one prompt, or several
Frames = float | Sequence[float] | np.ndarray | Callable[[str], float] | None  # of all motions, of each, of a prompt


# Abilities of models, each a method of that name.
ABILITIES = {
    "generate": "motion from prompts, one pass of the network",
    "sample_segments": "one motion of several segments, each with its own prompt",
    "stream": "motion without end, block after block",
    "multi_prompt": "several prompts in sequence, one motion",
    "extend": "continues an existing motion",
    "edit": "new frames in an existing motion",
    "reconstruct": "a motion through the tokenizer and back",
    "round_trip": "padded motions through the tokenizer and back",
    "graphs": "its networks as graphs that run without JAX",
}


_SEVERAL = {"edits": "edit", "multi_prompts": "multi_prompt"}  # methods of the same ability
# Arguments of every method's `generate`, beside the choices of sampling.
_ARGUMENTS = ("seed", "seeds", "seconds", "num_frames", "cleanup", "control")


class Able:
  """Something that says what it can do: `can("edit")`. Models, and what is evaluated in place of one."""
  abilities: tuple[str, ...] = ()  # of ABILITIES
  more_choices: tuple[str, ...] = ()  # of sampling, beside those of `options`
  ways: tuple[str, ...] = ()  # of several prompts in one motion, the usual first, where `multi_prompts` has a choice

  def can(self, ability: str) -> bool:
    """Whether it has this ability, one of `ABILITIES`. Raises ValueError for a word that is none."""
    if ability not in ABILITIES:
      raise InputError(f"got the ability {ability!r}, expected one of {', '.join(ABILITIES)}")
    return ability in self.abilities


def cannot(name: str, ability: str) -> str:
  """The error text for a model that lacks an ability of `ABILITIES`: which shipped models have it."""
  from motion_jax import runs
  from motion_jax.models import registry
  able = runs.shipped_names(registry.model_stages(ability))
  return f"{name} has no {ability!r} ({ABILITIES[ability]}); " + (
      f"{', '.join(able)} {'has' if len(able) == 1 else 'have'}: load such a model (--model)" if able else
      "no model that ships has")


class TextToMotionModel(Able):
  """A run folder whose parameters generate motion from prompts: the base class of every method, returned by `load`.

  `generate` is one pass of the network with the prompts as given. A method implements `sample`, and says by `abilities`
  what else it can do; `options` are its choices of sampling.
  """
  abilities: tuple[str, ...] = ("generate",)
  options: Any = SamplingOptions
  takes_control = False  # whether `sample` follows a control signal
  codec: Any = None  # of the latents, of a method that has latents
  max_seconds = 3600.0

  def __init__(self, run: Run, encoder: TextEncoder, text_dim: int, frames_per_latent: int, frozen_shapes: Any,
               shapes: Any) -> None:
    """text_dim: width of the text embeddings that the network takes; shapes: of the parameters in the folder."""
    self.folder, self.config, self.encoder, self.frames_per_latent = run.folder, run.config, encoder, frames_per_latent
    self.params_file = run.params_file
    if encoder.dim != text_dim:
      raise InputError(f"the text encoder gives {encoder.dim} numbers a {encoder.level.removesuffix('s')}, the model "
                       f"in {run.folder} was trained on {text_dim}; pass the encoder named {run.config.frozen.text!r} "
                       "as text")
    run.check_encoder(encoder)
    self.stats: Stats = run.stats
    # In one call, which compiles nothing: jnp.asarray is a small program for every shape.
    self.frozen = jax.device_put(run.frozen(frozen_shapes) if frozen_shapes else {})
    self.params = jax.device_put(run.params(shapes))

  if not TYPE_CHECKING:
    def __getattr__(self, name):
      """For names that do not exist: the error says which model has the ability of that name."""
      ability = _SEVERAL.get(name, name)
      if ability in ABILITIES and not self.can(ability):
        raise AttributeError(cannot(self.folder.name, ability))
      return object.__getattribute__(self, name)  # also raises again the error of a property

  def __repr__(self) -> str:
    return (f"{type(self).__name__}({self.folder.name!r}: {self.num_params / 1e6:.1f} M parameters, "
            f"{self.stats.layout.name} features, {self.fps:g} frames a second)")

  # --- identity -------------------------------------------------------------------------------------------------

  @property
  def fps(self) -> float:
    return self.stats.layout.skeleton.fps

  @property
  def smoothing(self) -> float:
    """How much the cleanup smooths its motions, in frames: config.cleanup.smoothing, of `motion.cleanup` by default."""
    return float(self.config.get("cleanup", {}).get("smoothing", SMOOTHING))

  @property
  def num_params(self) -> int:
    """Parameters of all networks that every sampled motion passes through, without the text encoder and a length
    estimator."""
    return sum(x.size for x in jax.tree.leaves((self.params, [self.frozen.get(name, {}) for name in SAMPLED])))

  @functools.cached_property
  def id(self) -> str:
    """Folder name and a hash of the weights, which files of its motions carry as their source."""
    digest = hashlib.sha256((self.folder / self.params_file).read_bytes()).hexdigest()[:12]
    return f"{self.folder.name}@{digest}"

  @property
  def license(self) -> str:
    """Text of its folder's LICENSE.txt; "" without one."""
    return self._text("LICENSE.txt")

  @property
  def limits(self) -> str:
    """Known limits, from its folder's LIMITS.txt; "" without one."""
    return self._text("LIMITS.txt")

  def _text(self, name):
    path = self.folder / name
    return path.read_text(encoding="utf-8", errors="replace").strip() if path.is_file() else ""

  @functools.cached_property
  def captions(self) -> TrainingCaptions:
    """Statistics of the captions that it was trained on; empty where its folder does not keep them."""
    subjects = SUBJECTS if self.config.data.get("vary_subject") else ()  # training had these, too
    return TrainingCaptions.of_folder(self.folder, self.encoder, self.fps, subjects)

  # --- lengths ---------------------------------------------------------------------------------------------------

  def estimated_frames(self, prompt: str) -> int | None:
    """The length that the method itself estimates for a prompt; None where it has no estimator."""
    return None

  def default_frames(self, prompt: str) -> int:
    """The length where none is given: the method's estimate, else six seconds."""
    estimate = self.estimated_frames(prompt)
    return round(min(_SECONDS, self.max_seconds) * self.fps) if estimate is None else estimate

  def frames_of(self, prompts: Sequence[str], num_frames: Frames, seconds: Frames) -> list[int]:
    """Lengths in frames, one per prompt: as given (one for all or one each), or `default_frames`."""
    if num_frames is not None and seconds is not None:
      raise InputError("got both num_frames and seconds; give one of them")
    if num_frames is None:
      num_frames = self.default_frames if seconds is None else [as_float(s) * self.fps for s in require_numbers(
          each(seconds, prompts), "seconds", "a number such as 6.0, or one per prompt")]
    counts = [num_frames(p) for p in prompts] if callable(num_frames) else each(num_frames, prompts)
    require_numbers(counts, "num_frames", "a number of frames such as 120, or one per prompt")
    for count in counts:
      if not self.frames_per_latent <= as_float(count) <= self.max_seconds * self.fps:
        raise InputError(f"got a length of {as_float(count):g} frames, expected {self.frames_per_latent} to "
                         f"{self.max_seconds * self.fps:,.0f}: {self.frames_per_latent / self.fps:g} to "
                         f"{self.max_seconds:,g} s at {self.fps:g} frames a second")
    return [int(round(count)) for count in counts]

  # --- sampling --------------------------------------------------------------------------------------------------

  @arguments.checked
  def generate(self, prompts: Prompts, num_frames: Frames = None, *, seconds: Frames = None,
               rng: jax.Array | None = None, seeds: Iterable[int] | None = None, seed: int | None = None,
               cleanup: bool = False, control: Any = None, **sampling: Any) -> Motions:
    """Motions of one prompt or several: one pass of the network, with the prompts as given.

    num_frames or seconds: one number, or one per prompt; by default `default_frames`. rng: a key, of which prompt i
    gets fold_in(rng, i), so that a motion does not depend on others in its batch; or seed (prompt i gets seed + i), or
    seeds, one per prompt. control: constraints that the network is guided by (`control`): a `ControlSignal` (B, T), a
    list of constraints for all motions, or a list of such lists; meeting them exactly is up to `control.project`.
    cleanup: pin standing feet and remove tremor (`motion.cleanup`); features stay as sampled. sampling: choices of this
    method's `options`, by default those of its config. Raises ValueError for an empty prompt, or a length that is not
    positive or more than an hour.

    Plans, prompt checks, several attempts and exact constraints are the application's: `motion_jax_studio.Pipeline`.
    """
    prompts = self.prompts_of(prompts)
    frames = self.frames_of(prompts, num_frames, seconds)
    keys, seeds = keys_of(rng, seeds, len(prompts), seed)
    if control is not None:
      from motion_jax.models.shared import guided
      constraints = constraints_of(control, len(prompts))
      return guided.sample(self, prompts, frames, keys, seeds, cleanup, sampling, constraints)
    return self.sample(prompts, frames, keys, seeds, cleanup, sampling)

  def sample(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
             cleanup: bool, sampling: dict[str, Any], signal: ControlSignal | None = None) -> Motions:
    """One pass of the network: motions of prompts, a key each. Every method implements it.

    signal (B, longest): constraints, in the frame where motions begin, that a method with `takes_control` follows.
    """
    raise NotImplementedError(f"{type(self).__name__} has no `sample` (docs/adding.md)")

  def sample_segments(self, lists: Sequence[Sequence[tuple[str, int]]], keys: jax.Array, seeds: Sequence[int | None],
                      cleanup: bool, sampling: dict[str, Any]) -> Motions:
    """Motions of lists of (prompt, frames), a key each. For methods that can make one motion of several prompts."""
    raise NotImplementedError(f"{type(self).__name__} has no `sample_segments`: it makes motions of one prompt each")

  def inpaint(self, features: Sequence[np.ndarray], new: Sequence[np.ndarray], prompts: Sequence[str], keys: jax.Array,
              sampling: dict[str, Any]) -> tuple[list[np.ndarray], dict[str, Any]]:
    """(features (T, F) of each motion with the frames of new (T,) sampled, record of the sampling). For methods that
    edit; `shared.pasting` puts the new frames into the clip they belong to."""
    raise NotImplementedError(f"{type(self).__name__} has no `inpaint`: it cannot edit")

  # --- arguments ---------------------------------------------------------------------------------------------------

  def prompts_of(self, prompts: Prompts) -> list[str]:
    """A list of prompts from one or several, checked. Raises TypeError for anything but text, InputError for an empty
    prompt, one that is no UTF-8 text, or one of more than 5,000 characters."""
    if not isinstance(prompts, str) and (isinstance(prompts, bytes | dict) or not isinstance(prompts, Iterable)):
      raise TypeError(f"got {format_value(prompts)} as prompts, expected a sentence such as \"a person waves\", or a "
                      "list of them")
    prompts = [prompts] if isinstance(prompts, str) else list(prompts)
    if not prompts:
      raise InputError("got no prompt; say what the person does, as in \"a person waves\"")
    for prompt in prompts:
      if not isinstance(prompt, str) or not prompt.strip():
        raise InputError(f"got the prompt {prompt!r}; say what the person does, as in \"a person waves\"")
      if not is_text(prompt):
        raise InputError(f"got the prompt {ascii(shortened(prompt))}, which holds bytes that are no UTF-8 text")
      if len(prompt) > _LONGEST_PROMPT:
        raise InputError(f"got a prompt of {len(prompt):,} characters, expected at most {_LONGEST_PROMPT:,}; "
                         "multi_prompt takes several sentences one after the other")
    return prompts

  def sampling(self, **choices: Any) -> Any:
    """All choices of sampling: those given, the others from the run's config.

    Raises TypeError for a choice that this method does not have, ValueError for a value that cannot be.
    """
    known = self.options.described()
    for name in choices:
      if name not in known:
        others = [*known, *(one for one in _ARGUMENTS if one != name)]
        raise TypeError(f"got the choice of sampling {name!r}, {self.folder.name} knows {', '.join(known)}"
                        + arguments.hint(name, others, ""))
    return self.options(**choices).resolved(self.config, **self.usual_sampling())

  def usual_sampling(self) -> dict[str, Any]:
    """Defaults that follow from the networks, for choices that neither caller nor config makes."""
    return {}


Model = TextToMotionModel  # its public name, `motion_jax.Model`


def each(value: Any, prompts: Sequence[str]) -> list[Any]:
  """One value per prompt, of one for all or one for each."""
  several = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes)
  values = list(value) if several else [value] * len(prompts)
  if len(values) != len(prompts):
    raise InputError(f"got {len(values)} lengths for {len(prompts)} prompts; give one number or one per prompt")
  return values


def random_keys(seeds: Sequence[int]) -> jax.Array:
  """Keys (N,) of seeds as of `jax.random.key`; keys of the default kind are made without compiling anything."""
  config: Any = jax.config
  if config.jax_default_prng_impl != "threefry2x32" or config.jax_enable_x64:
    return jnp.stack([jax.random.key(seed) for seed in seeds])
  data: Any = np.array([[0, seed & 0xffffffff] for seed in seeds], np.uint32)
  return jax.random.wrap_key_data(data, impl="threefry2x32")


def select_keys(keys: jax.Array, rows: Sequence[int]) -> jax.Array:
  """Some of the keys (N,), without compiling anything."""
  chosen: Any = np.asarray(rows, int)
  if not jnp.issubdtype(keys.dtype, jax.dtypes.prng_key):
    return jax.device_put(np.asarray(keys)[chosen])
  data: Any = np.asarray(jax.random.key_data(keys))[chosen]
  return jax.random.wrap_key_data(data, impl=jax.random.key_impl(keys))


def keys_of(rng: jax.Array | None, seeds: Iterable[int] | None, count: int, seed: int | None = None
            ) -> tuple[jax.Array, list[Any]]:
  """(keys (count,), seeds or Nones): from seeds, from seed, seed + 1, ..., or from a key folded with each motion's
  place."""
  if sum(choice is not None for choice in (rng, seeds, seed)) > 1:
    raise InputError("got more than one of rng, seeds and seed; give one of them")
  if seed is not None:
    try:
      seeds = [operator.index(seed) + i for i in range(count)]
    except TypeError:
      raise TypeError(f"got the seed {format_value(seed)}, expected an integer") from None
  if seeds is not None:
    if isinstance(seeds, str | bytes) or not isinstance(seeds, Iterable):
      raise TypeError(f"got {format_value(seeds)} as seeds, expected one integer per motion, as in seeds=[5]")
    seeds = list(seeds)
    for seed in seeds:
      try:
        operator.index(seed)
      except TypeError:
        raise TypeError(f"got the seed {format_value(seed)}, expected an integer") from None
    if len(seeds) != count:
      raise InputError(f"got {len(seeds)} seeds for {count} motions")
    seeds = [checked(seed, -SEEDS[1], SEEDS[1], "seed") for seed in seeds]
    return random_keys(seeds), seeds
  rng = jax.random.key(0) if rng is None else rng
  is_array = isinstance(rng, jax.Array | np.ndarray)
  if not (is_array and (jnp.issubdtype(rng.dtype, jax.dtypes.prng_key) and rng.shape == ()
                        or rng.dtype == np.uint32 and rng.ndim == 1)):
    raise TypeError(f"got {format_value(rng)} as rng, expected a key such as jax.random.key(5)")
  return jax.vmap(lambda i: jax.random.fold_in(rng, i))(jnp.arange(count)), [None] * count
