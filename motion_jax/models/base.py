"""The base class of all methods: prompts, lengths, seeds and sampling options."""
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from motion_jax.models import arguments
from motion_jax.models.keys import each, keys_of
from motion_jax.models.loaded import LoadedRun
from motion_jax.models.options import SamplingOptions
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import as_float, format_value, require_numbers, shortened
from motion_jax.utils.text_files import is_text

if TYPE_CHECKING:
  from motion_jax.control.signal import ControlSignal
  from motion_jax.models.results import Motions

_SECONDS = 6.0  # of a motion whose length is not given
_LONGEST_PROMPT = 5000  # characters: ten times the longest caption of the data sets
_ARGUMENTS = ("seed", "seeds", "seconds", "num_frames", "cleanup", "control")  # of `generate`, not choices of sampling

Prompts = str | Iterable[str]  # one prompt, or several
Frames = float | Sequence[float] | np.ndarray | Callable[[str], float] | None  # for all, for each, by prompt


class TextToMotionModel(LoadedRun):
  """A run folder whose parameters generate motion from prompts: the base class of every method, returned by `load`.

  `generate` is one pass of the network with the prompts as given. A method implements `sample`, and lists in
  `abilities` what else it can do; `options` are its choices of sampling.
  """
  abilities: tuple[str, ...] = ("generate",)
  options: Any = SamplingOptions
  takes_control = False  # whether `sample` follows a control signal
  codec: Any = None  # of the latents, of a method that has latents
  max_seconds = 3600.0

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
               cleanup: bool = False, control: Any = None, **sampling: Any) -> "Motions":
    """Motions of one prompt or several: one pass of the network, with the prompts as given.

    num_frames or seconds: one number, or one per prompt; by default `default_frames`. rng: a key, which is folded with
    each prompt's number; or seed (prompt i gets seed + i), or seeds, one per prompt. control: constraints that guide
    the network: a `ControlSignal` (B, T), a list of constraints for all motions, or a list of such lists. cleanup: pin
    standing feet and remove tremor (`motion.cleanup`); features stay as sampled. sampling: choices of this method's
    `options`, by default those of its config. Plans, prompt checks, several attempts and exact constraints are the
    application's: `motion_jax_studio.Pipeline`.
    """
    prompts = self.prompts_of(prompts)
    frames = self.frames_of(prompts, num_frames, seconds)
    keys, seeds = keys_of(rng, seeds, len(prompts), seed)
    if control is not None:
      from motion_jax.models.shared import guided
      return guided.sample(self, prompts, frames, keys, seeds, cleanup, sampling, control)
    return self.sample(prompts, frames, keys, seeds, cleanup, sampling)

  def sample(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, seeds: Sequence[int | None],
             cleanup: bool, sampling: dict[str, Any], signal: "ControlSignal | None" = None) -> "Motions":
    """One pass of the network: motions of prompts, a key each. A method implements it, or `sampled_features`.

    signal (B, longest): constraints, in the frame where motions begin, that a method with `takes_control` follows.
    """
    from motion_jax.models.results import motions_of_prompts
    chosen = self.sampling(**sampling)
    features, frames = self.sampled_features(prompts, frames, keys, chosen)
    return motions_of_prompts(self, features, prompts, frames, seeds, self.record_of(chosen), cleanup)

  def sampled_features(self, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array, chosen: Any
                       ) -> tuple[Any, Sequence[int]]:
    """(normalized features (B, T, F), frames of each motion); chosen: the method's `options`."""
    raise NotImplementedError(f"{type(self).__name__} has no `sampled_features` (docs/adding.md)")

  def record_of(self, chosen: Any) -> dict[str, Any]:
    """What a motion's meta says of its sampling: the choices, and the model."""
    return chosen.about() | dict(model=self.id)

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
        others = [*known, *(argument for argument in _ARGUMENTS if argument != name)]
        raise TypeError(f"got the choice of sampling {name!r}, {self.folder.name} knows {', '.join(known)}"
                        + arguments.hint(name, others, ""))
    return self.options(**choices).resolved(self.config, **self.usual_sampling())

  def usual_sampling(self) -> dict[str, Any]:
    """Defaults that follow from the networks, for choices that neither caller nor config makes."""
    return {}


Model = TextToMotionModel  # its public name, `motion_jax.Model`
