"""The Plan of a sentence: segments one after the other, and the actions that happen at the same time in each."""
import dataclasses
import functools

from motion_jax_studio.language.actions import Action, Segment
from motion_jax_studio.language.path_shapes import PathShape, min_duration, path_shapes_of
from motion_jax_studio.language.requirements import Requirement, requirements_of


@dataclasses.dataclass(frozen=True)
class Plan:
  """The meaning of a sentence: parsed once by `parse`, then passed to all steps.

  It has two readings. `segments` is for generation: words that a model has learned as one action stay together.
  `actions` is for checks: all actions of the text, for any model.
  """
  text: str
  segments: tuple[Segment, ...]
  actions: tuple[Action, ...] = ()
  single: Action | None = None  # the text read as one action by its first verb; None where that cannot be
  split: tuple[Segment, ...] = ()  # segments with all actions split, also those that a model has learned as one

  @property
  def sampled(self) -> tuple[Action, ...]:
    """The actions that a model samples, in order; a pause only if the plan is nothing else."""
    first, *others = self.segments
    return tuple(action for part in self.segments for action in part.sampled) if others else (
        first.action, *first.simultaneous)

  @property
  def prompts(self) -> list[str]:
    """The prompts that a model gets, one per sampled action, without duplicates."""
    return list(dict.fromkeys(action.prompt for action in self.sampled))

  @property
  def read_segments(self) -> tuple[Segment, ...]:
    """The segments with parsed actions; those of a plain plan otherwise have the text as it was written."""
    first, *_ = self.segments
    return (first._replace(action=self.single),) if self.is_plain and self.single else self.segments

  @property
  def summary(self) -> str:
    """The segments for a reader: "walks forward + waves | stands still [2]", with durations in seconds."""
    seconds = lambda segment: f" [{segment.seconds:g}]" if segment.seconds else ""
    return " | ".join(segment.words + seconds(segment) for segment in self.segments)

  @property
  def is_plain(self) -> bool:
    """Whether it is one action and nothing else, so that a model gets the text as it was written."""
    first = self.segments[0]
    return len(self.segments) == 1 and not first.simultaneous and first.action.times == 1 and (
        first.seconds is None and not first.action.reworded)

  @functools.cached_property
  def requirements(self) -> list[Requirement]:
    """What a motion of this text must show, as far as it can be measured on joints."""
    return requirements_of(self.actions, self.text)

  @functools.cached_property
  def path_shapes(self) -> list[PathShape]:
    """Shape and pace of the path that the text describes."""
    return path_shapes_of(self.actions)

  @property
  def min_duration(self) -> float:
    """Least seconds for the path, such as a full circle; 0 for paths without a minimum."""
    return min_duration(self.actions)

  def with_segments(self, segments: tuple[Segment, ...]) -> "Plan":
    """The same plan with other segments; its requirements stay."""
    return dataclasses.replace(self, segments=tuple(segments))

  def fully_split(self) -> "Plan":
    """The plan with all actions split, also those that a model has learned as one."""
    return self.with_segments(self.split or self.segments)
