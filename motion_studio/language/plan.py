"""The Plan of a sentence: segments one after the other, and the actions that happen at the same time in each."""
import dataclasses
import functools
from typing import NamedTuple

from motion_jax.analysis.event_words import TIMES
from motion_studio.language import actions
from motion_studio.language.lexicon import HOLD, PAUSE
from motion_studio.language.path_shapes import PathShape, min_duration, path_shapes_of
from motion_studio.language.requirements import Requirement, requirements_of


class Action(NamedTuple):
  """One action: its sentence, its words without the subject, and the body part that performs it."""
  prompt: str      # "a person waves the right hand"
  words: str       # "waves the right hand"
  part: str = ""   # one of `actions.PARTS`
  sides: tuple[str, ...] = ()  # the arms that it names
  times: int = 1   # number of repetitions, where the sentence gives one
  verb: str = ""   # its base form
  is_pose: bool = False   # a pose that is kept, such as "with the right hand raised"
  reworded: bool = False  # differs from the text: "bows" for "takes a bow"
  counts_steps: bool = False  # a walk of a given number of steps
  subject: str = ""  # "a person"

  @property
  def prompt_with_count(self) -> str:
    """The prompt with its repetitions, in the words of captions that count: "a person jumps three times"."""
    return f"{self.prompt} {TIMES.get(self.times, f'{self.times} times')}".rstrip()

  @property
  def is_done_once(self) -> bool:
    """Whether the action ends by itself and leaves the body standing, as a bow does and a walk does not."""
    return self.is_pose or actions.is_done_once(self.verb)

  @property
  def leaves_at_ease(self) -> bool:
    """Whether the action ends by itself in a relaxed stance, as a bow does and a raised hand does not."""
    return actions.leaves_at_ease(self.verb)


class Segment(NamedTuple):
  """The actions of one span of time: one of the whole body, and simultaneous ones of body parts."""
  action: Action
  simultaneous: tuple[Action, ...] = ()
  seconds: float | None = None  # duration, where the sentence gives one

  @property
  def words(self) -> str:
    """The words of all its actions: "walks forward + waves 3 times"."""
    return " + ".join(one.words + (f" {one.times} times" if one.times > 1 else "")
                      for one in (self.action, *self.simultaneous))

  @property
  def prompt(self) -> str:
    """All its sampled actions in one sentence, for motion that cannot be layered: "a person walks and waves"."""
    first, *others = self.sampled or (self.action,)
    return " and ".join([first.prompt_with_count, *(one.words for one in others)])

  @property
  def is_pause(self) -> bool:
    """Whether the body stands still or keeps a pose; above a kept pose arms and head may act."""
    return self.hold_pose or self.action.words == PAUSE and not self.simultaneous

  @property
  def hold_pose(self) -> bool:
    """Whether the pose in which the previous segment ends is kept: seated, an arm in the air."""
    return self.action.words == HOLD

  @property
  def sampled(self) -> tuple[Action, ...]:
    """The actions that a model samples: all but standing still and keeping a pose."""
    return self.simultaneous if self.is_pause else (self.action, *self.simultaneous)


@dataclasses.dataclass(frozen=True)
class Plan:
  """What a sentence asks for: made once by `parse`, and passed on to whatever needs the meaning of the sentence.

  Two readings are kept. `segments` is for generation: words that a model has learned as one action stay together.
  `actions` is for checks: all actions of the text, whatever any model has learned.
  """
  text: str
  segments: tuple[Segment, ...]
  actions: tuple[Action, ...] = ()
  single: Action | None = None  # the text read as one action by its first verb; None where that cannot be
  split: tuple[Segment, ...] = ()  # the segments where no action is kept together because a model has learned it

  @property
  def sampled(self) -> tuple[Action, ...]:
    """The actions that a model samples, in order; a pause only where it is all there is."""
    first, *others = self.segments
    return tuple(one for part in self.segments for one in part.sampled) if others else (
        first.action, *first.simultaneous)

  @property
  def prompts(self) -> list[str]:
    """The prompts that a model gets, one per sampled action, without duplicates."""
    return list(dict.fromkeys(one.prompt for one in self.sampled))

  @property
  def summary(self) -> str:
    """The segments for a reader: "walks forward + waves | stands still [2]", with durations in seconds."""
    return " | ".join(one.words + (f" [{one.seconds:g}]" if one.seconds else "") for one in self.segments)

  @property
  def is_plain(self) -> bool:
    """Whether it is one action and nothing else, so that a model gets the text as it was written."""
    first = self.segments[0]
    return len(self.segments) == 1 and not first.simultaneous and first.action.times == 1 and (
        first.seconds is None and not first.action.reworded)

  @functools.cached_property
  def requirements(self) -> list[Requirement]:
    """What a motion of this text has to show, as far as it can be measured on joints."""
    return requirements_of(self.actions, self.text)

  @functools.cached_property
  def path_shapes(self) -> list[PathShape]:
    """Shape and pace of the path that the text describes."""
    return path_shapes_of(self.actions)

  @property
  def min_duration(self) -> float:
    """Seconds that the path takes at least: time for a full circle; 0 for other paths."""
    return min_duration(self.actions, self.text)

  def with_segments(self, segments: tuple[Segment, ...]) -> "Plan":
    """The same plan with other segments; what the text asks for stays."""
    return dataclasses.replace(self, segments=tuple(segments))

  def fully_split(self) -> "Plan":
    """The plan in which no action is kept together because a model has learned it."""
    return self.with_segments(self.split or self.segments)


def pause(who: str, seconds: float | None) -> Segment:
  """Standing still for a number of seconds, or (None) as long as there is time."""
  return Segment(Action(f"{who} {PAUSE}", PAUSE, "legs", verb="stand", subject=who), seconds=seconds)
