"""What models that are ready to use have in common: prompts, lengths, seeds, and where a motion is from."""
import functools
import hashlib
import operator
import warnings
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.models import arguments
from motion_jax.models.options import SamplingOptions
from motion_jax.motion.stats import Stats
from motion_jax.runs import Run
from motion_jax.text.captions import SUBJECTS, of_a_person
from motion_jax.text.encoder import TextEncoder
from motion_jax.text.vocabulary import Vocabulary
from motion_jax.training import checkpoint
from motion_jax.utils import cache
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import SEEDS, as_float, checked, demand_numbers, shortened, told
from motion_jax.utils.text_files import is_text
from motion_studio.checks import prompt_notes
from motion_studio.checks.path_shapes import least_seconds
from motion_studio.language.repertoire import Repertoire
from motion_studio.language.sentences import Sentence, understand

_SHORTEST, _USUAL, _LONGEST = 3.0, 6.0, 9.8  # seconds of a motion whose length nobody says
_LONGEST_PROMPT = 5000  # characters: ten times the longest caption of the data sets

Prompts = str | Iterable[str]  # one prompt, or several
Frames = float | Sequence[float] | np.ndarray | Callable[[str], float] | None  # of all motions, of each, of a prompt


# What a model may be able to do, each a method of its name; `can` says whether a model is.
ABILITIES = {
    "generate": "motion from words",
    "understand": "a sentence of several actions is one motion in which they are done",
    "stream": "motion without end, block after block",
    "multi_prompt": "several prompts in a row, one motion",
    "extend": "a motion that exists goes on",
    "edit": "new frames in a motion that exists",
    "reconstruct": "a motion through the tokenizer and back",
    "round_trip": "padded motions through the tokenizer and back",
}


_SEVERAL = {"edits": "edit", "multi_prompts": "multi_prompt"}  # methods of the same ability
# Arguments of every method's `generate`, beside the choices of sampling.
_ARGUMENTS = ("seed", "seeds", "seconds", "num_frames", "cleanup", "literal", "control", "tries")


class Able:
  """Something that says what it can do: `can("edit")`. Models, and what is judged in the place of one."""
  abilities: tuple[str, ...] = ()  # of ABILITIES

  def can(self, ability: str) -> bool:
    """Whether it has this ability, one of `ABILITIES`. Raises ValueError for a word that is none."""
    if ability not in ABILITIES:
      raise InputError(f"got the ability {ability!r}, expected one of {', '.join(ABILITIES)}")
    return ability in self.abilities


def cannot(name: str, ability: str) -> str:
  """The sentence for a model that lacks an ability of `ABILITIES`: which of those that ship have it."""
  from motion_jax import runs
  from motion_jax.models import registry
  able = runs.shipped_names(registry.model_stages(ability))
  return f"{name} has no {ability!r} ({ABILITIES[ability]}); " + (
      f"{' and '.join(able)} {'has' if len(able) == 1 else 'have'}: load such a model (--model)" if able else
      "no model that ships has")


class TextToMotionModel(Able):
  """A run folder whose parameters make motion from words: the base of every method's model, and what `load` gives.

  A method's class says what else it `can` do, and names the `SamplingOptions` by which it is sampled.
  """
  abilities: tuple[str, ...] = ("generate",)
  options: Any = SamplingOptions
  control_choices: tuple[str, ...] = ()  # of `generate`, beside those of sampling, where constraints guide it
  codec: Any = None  # of the latents that it makes, where it makes latents
  max_seconds = 3600.0
  reports_to_terminal = True  # False where warnings about prompts would not be read

  def __init__(self, run: Run, encoder: TextEncoder, text_dim: int, frames_per_latent: int, frozen_shapes: Any,
               shapes: Any) -> None:
    """text_dim: numbers that the network takes of a word or sentence; shapes of what the folder must hold."""
    self.folder, self.config, self.encoder, self.frames_per_latent = run.folder, run.config, encoder, frames_per_latent
    self.params_file = run.params_file
    if encoder.dim != text_dim:
      raise InputError(f"the text encoder gives {encoder.dim} numbers a {encoder.level.removesuffix('s')}, the model "
                       f"in {run.folder} was trained on {text_dim}; pass the encoder named {run.config.frozen.text!r} "
                       "as text")
    run.check_encoder(encoder)
    self.stats: Stats = run.stats
    self.frozen = jax.tree.map(jnp.asarray, run.frozen(frozen_shapes) if frozen_shapes else {})
    self.params = jax.tree.map(jnp.asarray, run.params(shapes))

  if not TYPE_CHECKING:
    def __getattr__(self, name):
      """Only for names that there are not: says which model has the ability of that name."""
      ability = _SEVERAL.get(name, name)
      if ability in ABILITIES and not self.can(ability):
        raise AttributeError(cannot(self.folder.name, ability))
      return object.__getattribute__(self, name)  # raises, also what a property raised

  def __repr__(self) -> str:
    return (f"{type(self).__name__}({self.folder.name!r}: {self.num_params / 1e6:.1f} M parameters, "
            f"{self.stats.layout.name} features, {self.fps:g} frames a second)")

  # --- what it is ------------------------------------------------------------------------------------------------

  @property
  def fps(self) -> float:
    return self.stats.layout.skeleton.fps

  @property
  def num_params(self) -> int:
    return sum(x.size for x in jax.tree.leaves((self.params, self.codec.params if self.codec else {})))

  @functools.cached_property
  def id(self) -> str:
    """Folder name and a hash of the weights: what a file says about where its motion is from."""
    digest = hashlib.sha256((self.folder / self.params_file).read_bytes()).hexdigest()[:12]
    return f"{self.folder.name}@{digest}"

  @property
  def license(self) -> str:
    """What its folder's LICENSE.txt says; "" without one."""
    return self._told("LICENSE.txt")

  @property
  def limits(self) -> str:
    """What it cannot do, for whoever uses it: its folder's LIMITS.txt; "" without one."""
    return self._told("LIMITS.txt")

  def _told(self, name):
    path = self.folder / name
    return path.read_text(encoding="utf-8", errors="replace").strip() if path.is_file() else ""

  # --- lengths ---------------------------------------------------------------------------------------------------

  def natural_frames(self, prompt: str) -> int:
    """How long the clips of the nearest training captions are: an action generated much longer goes on by itself.

    Whether he, she or somebody does it makes no difference, though other captions may be nearer to the one. A circle
    has time to be gone round.
    """
    nearest = self.nearest_captions(of_a_person(prompt), 5)
    if not nearest:
      return round(_USUAL * self.fps)
    usual = np.clip(np.median([frames for _, frames in nearest]), _SHORTEST * self.fps, _LONGEST * self.fps)
    return int(max(usual, least_seconds(prompt) * self.fps))

  # --- what it learned from ----------------------------------------------------------------------------------------

  @functools.cached_property
  def _learned(self):
    """(Vocabulary, usual frames) of the captions that it learned from; None where its folder does not keep them."""
    table = checkpoint.load_lengths(self.folder)
    subjects = SUBJECTS if self.config.data.get("vary_subject") else ()  # training said these, too
    return table and (Vocabulary(table[0], subjects), table[1])

  @property
  def vocabulary(self) -> Vocabulary | None:
    """The captions that it learned from; None where its folder does not keep them."""
    return None if self._learned is None else self._learned[0]

  @functools.cached_property
  def repertoire(self) -> Repertoire | None:
    """What it can do, as phrases of one action each; None where its folder does not keep the captions."""
    return None if self.vocabulary is None else Repertoire(self.vocabulary.captions, self.encoder)

  def knows(self, prompt: str) -> bool:
    """Whether a training caption says this, of any subject."""
    return self.vocabulary is not None and self.vocabulary.holds(prompt)

  @functools.cached_property
  def _caption_vectors(self):
    captions = self._learned[0].captions
    key = cache.key_of("sentences", self.encoder.fingerprint, *captions)
    return cache.kept_array("sentences", key, lambda: self.encoder.many_sentences(captions))

  def nearest_captions(self, prompt: str, num: int = 1) -> list[tuple[str, int]]:
    """[(caption, usual frames)] of the training captions that mean nearly the same, the nearest first.

    As the text encoder sees it: of a large training set it is asked only about those that share words with the prompt.
    None where the folder does not keep the captions.
    """
    if self._learned is None:
      return []
    vocabulary, frames = self._learned
    rows = vocabulary.candidates(prompt)
    known = (self._caption_vectors if len(rows) == len(vocabulary.captions) else
             self.encoder.many_sentences([vocabulary.captions[row] for row in rows]))
    nearness = known @ self.encoder.sentence([prompt])[0]
    nearest = [rows[i] for i in np.argsort(-nearness, kind="stable")[:num]]
    return [(vocabulary.captions[row], frames[row]) for row in nearest]

  def frames_of(self, prompts: Sequence[str], num_frames: Frames, seconds: Frames) -> list[int]:
    """Lengths in frames, one per prompt: as given (one for all or one each), or those of similar training clips."""
    if num_frames is not None and seconds is not None:
      raise InputError("got both num_frames and seconds; give one of them")
    if num_frames is None:
      num_frames = self.natural_frames if seconds is None else [as_float(s) * self.fps for s in demand_numbers(
          each(seconds, prompts), "seconds", "a number such as 6.0, or one per prompt")]
    counts = [num_frames(p) for p in prompts] if callable(num_frames) else each(num_frames, prompts)
    demand_numbers(counts, "num_frames", "a number of frames such as 120, or one per prompt")
    for count in counts:
      if not self.frames_per_latent <= as_float(count) <= self.max_seconds * self.fps:
        raise InputError(f"got a length of {as_float(count):g} frames, expected {self.frames_per_latent} to "
                         f"{self.max_seconds * self.fps:.0f} ({self.max_seconds:g} s at {self.fps:g} frames a second)")
    return [int(round(count)) for count in counts]

  # --- arguments ---------------------------------------------------------------------------------------------------

  def sampling(self, **choices: Any) -> Any:
    """All choices of sampling: those given, the rest as the run's config has them.

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
    """Choices that follow from the networks where neither caller nor config makes them."""
    return {}

  def understand(self, prompt: str) -> Sentence:
    """The actions that a sentence asks for, one after the other and at once: `text.sentences`.

    What a caption of the training data says stays one action, whoever moves.
    """
    return understand(prompt, self.knows)

  def sample(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
             cleanup: bool, sampling: dict[str, Any]) -> Any:
    """`results.Motions` of prompts said to the network as they are, a key each. A method has its own."""
    raise NotImplementedError(f"{type(self).__name__} has no `sample` (docs/adding.md)")

  def sample_controlled(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array,
                        seeds: Sequence[int | None], cleanup: bool, sampling: dict[str, Any], signal: ControlSignal
                        ) -> Any:
    """As `sample`, led towards what signal (B, longest) asks, in the frame in which motions begin. A method that can be
    led has its own; here words alone make the motion, and `control.project` brings it there."""
    return self.sample(prompts, frames, keys, seeds, cleanup, sampling)

  def in_a_row(self, lists: Sequence[Sequence[tuple[str, int]]], keys: jax.Array, seeds: Sequence[int | None],
               cleanup: bool, sampling: dict[str, Any]) -> Any:
    """`results.Motions`, one of each list of (prompt, frames), a key each. A method has its own."""
    raise NotImplementedError(f"{type(self).__name__} has no `in_a_row`: it cannot do one action after another")

  def remake(self, features: Sequence[np.ndarray], new: Sequence[np.ndarray], prompts: Sequence[str], keys: jax.Array,
             sampling: dict[str, Any]) -> tuple[list[np.ndarray], dict[str, Any]]:
    """(features of each motion with its new frames remade, what a file says of the sampling); see `models.editing`. A
    method that edits has its own."""
    raise NotImplementedError(f"{type(self).__name__} has no `remake`: it cannot edit")

  def prompts_of(self, prompts: Prompts, literal: bool = True) -> list[str]:
    """A list of prompts from one or several, checked as `check_words` does. Raises TypeError for what is no text."""
    if not isinstance(prompts, str) and (isinstance(prompts, bytes | dict) or not isinstance(prompts, Iterable)):
      raise TypeError(f"got {told(prompts)} as prompts, expected a sentence such as \"a person waves\", or a "
                      "list of them")
    prompts = [prompts] if isinstance(prompts, str) else list(prompts)
    if not prompts:
      raise InputError("got no prompt; say what the person does, as in \"a person waves\"")
    self.check_words(prompts, literal)
    return prompts

  def check_words(self, prompts: Iterable[str], literal: bool = True) -> None:
    """Raises ValueError for an empty prompt; warns of words and actions that the model has not learned.

    The warning says what it will make instead, and what it can do (`notes_of`). literal: the prompts are given to the
    model as they are, not action by action as it understands them.
    """
    prompts = list(prompts)
    for prompt in prompts:
      if not isinstance(prompt, str) or not prompt.strip():
        raise InputError(f"got the prompt {prompt!r}; say what the person does, as in \"a person waves\"")
      if not is_text(prompt):
        raise InputError(f"got the prompt {ascii(shortened(prompt))}, which holds bytes that are no UTF-8 text")
      if len(prompt) > _LONGEST_PROMPT:
        raise InputError(f"got a prompt of {len(prompt):,} characters, expected at most {_LONGEST_PROMPT:,}; "
                         "multi_prompt takes several sentences one after the other")
    for note in self.notes_of(prompts, literal) if self.reports_to_terminal else []:
      warnings.warn(note, stacklevel=3)

  def notes_of(self, prompts: Iterable[str], literal: bool = False) -> list[str]:
    """Sentences for the person who wrote the prompts: words and actions that the model has not learned, what it makes
    instead and what it can do (`prompt_notes`)."""
    return prompt_notes.notes_of(self, prompts, literal)

  def unknown_words(self, prompt: str) -> list[str]:
    """Words that the model has not learned from, nor words that mean the same, and signs that its encoder cannot read;
    the encoder's own judgement where the folder does not keep the captions."""
    if self._learned is None:
      return self.encoder.out_of_vocabulary(prompt)
    vocabulary = self._learned[0]
    return [word for word in vocabulary.missing(prompt) if not self.encoder.synonym(word, vocabulary.words)
            ] + self.encoder.unreadable(prompt)


Model = TextToMotionModel  # its public name, `motion_jax.Model`


def each(value: Any, prompts: Sequence[str]) -> list[Any]:
  """One value per prompt, of one for all or one for each."""
  several = isinstance(value, Sequence | np.ndarray) and not isinstance(value, str | bytes)
  values = list(value) if several else [value] * len(prompts)
  if len(values) != len(prompts):
    raise InputError(f"got {len(values)} lengths for {len(prompts)} prompts; give one number or one per prompt")
  return values


def keys_of(rng: jax.Array | None, seeds: Iterable[int] | None, count: int, seed: int | None = None
            ) -> tuple[jax.Array, list[Any]]:
  """(keys (count,), seeds or Nones): of seeds, of the seeds seed, seed + 1, ..., or of a key that is folded with each
  motion's place."""
  if sum(choice is not None for choice in (rng, seeds, seed)) > 1:
    raise InputError("got more than one of rng, seeds and seed; give one of them")
  if seed is not None:
    try:
      seeds = [operator.index(seed) + i for i in range(count)]
    except TypeError:
      raise TypeError(f"got the seed {told(seed)}, expected an integer") from None
  if seeds is not None:
    if isinstance(seeds, str | bytes) or not isinstance(seeds, Iterable):
      raise TypeError(f"got {told(seeds)} as seeds, expected one integer per motion, as in seeds=[5]")
    seeds = list(seeds)
    for seed in seeds:
      try:
        operator.index(seed)
      except TypeError:
        raise TypeError(f"got the seed {told(seed)}, expected an integer") from None
    if len(seeds) != count:
      raise InputError(f"got {len(seeds)} seeds for {count} motions")
    seeds = [checked(seed, -SEEDS[1], SEEDS[1], "seed") for seed in seeds]
    return jnp.stack([jax.random.key(seed) for seed in seeds]), seeds
  rng = jax.random.key(0) if rng is None else rng
  is_array = isinstance(rng, jax.Array | np.ndarray)
  if not (is_array and (jnp.issubdtype(rng.dtype, jax.dtypes.prng_key) and rng.shape == ()
                        or rng.dtype == np.uint32 and rng.ndim == 1)):
    raise TypeError(f"got {told(rng)} as rng, expected a key such as jax.random.key(5)")
  return jax.vmap(lambda i: jax.random.fold_in(rng, i))(jnp.arange(count)), [None] * count
