"""Keyword arguments of a model's methods: an unknown name is an error with a suggestion."""
import functools
from collections.abc import Callable, Sequence
from typing import Any

from motion_jax.utils.lazy import LazyModule

difflib = LazyModule("difflib")

# {argument name of another program or method: ours}; the hint is the first of ours that the call accepts.
OTHERS = {
    "frames": ("num_frames",), "n_frames": ("num_frames",), "length": ("num_frames", "seconds"),
    "lengths": ("num_frames",), "motion_length": ("seconds",), "duration": ("seconds",), "durations": ("seconds",),
    "time": ("seconds",), "steps": ("num_steps",), "sampling_steps": ("num_steps",), "diffusion_steps": ("num_steps",),
    "iterations": ("num_iterations",), "guidance": ("guidance_scale",), "scale": ("guidance_scale",),
    "cfg": ("guidance_scale",), "cfg_scale": ("guidance_scale",), "cfg_weight": ("guidance_scale",),
    "guidance_param": ("guidance_scale",), "cond_scale": ("guidance_scale",),
    "text": ("prompt", "prompts"), "texts": ("prompts",),
    "caption": ("prompt", "prompts"), "captions": ("prompts",), "key": ("rng",), "random_seed": ("seed",),
    "num": ("seeds", "num_samples", "top_k"), "num_samples": ("seeds",),
    "num_repetitions": ("seeds", "num_samples"), "repeat_times": ("seeds", "num_samples"),
    "attempts": ("max_attempts",), "tries": ("max_attempts",),
    "literal": ("no_plan",), "ask": ("export_prompts",), "beside": ("compare_with",),
    "printed": ("paper_tables",), "past_text": ("past_prompt",), "text_prompt": ("prompt",), "raw": ("no_cleanup",),
    "rounds": ("num_iterations",), "run": ("model",), "repeats": ("replications",),
    "span": ("change",), "spans": ("change",), "edit": ("change",),
    "constraints": ("control",), "clean": ("cleanup",), "post_processing": ("cleanup",),
    "no_postprocess": ("no_cleanup",),
}


def checked(function: Callable) -> Callable:
  """Decorate a method of a model: TypeError, with a suggestion, for a keyword that is neither an argument of it nor a
  choice of sampling of the model."""
  code = function.__code__
  parameters = list(code.co_varnames[1:code.co_argcount + code.co_kwonlyargcount])

  @functools.wraps(function)
  def called(self: Any, *args: Any, **given: Any) -> Any:
    known = [*parameters, *self.options.described(), *self.more_choices]
    for name in given:
      if name not in known:
        raise TypeError(f"{function.__name__} has no argument {name!r}"
                        + hint(name, known, f"; it has {', '.join(known)}"))
    return function(self, *args, **given)

  return called


def hint(name: str, known: Sequence[str], otherwise: str) -> str:
  """A suggestion for an unknown name, "; did you mean X?", or `otherwise` where no known name is close."""
  others = [candidate for candidate in OTHERS.get(name.lower(), ()) if candidate in known] or (
      difflib.get_close_matches(name, known, 1, 0.75))
  return f"; did you mean {others[0]}?" if others else otherwise
