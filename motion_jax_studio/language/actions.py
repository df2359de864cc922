"""The parts of a plan: actions, and segments of actions that happen at the same time."""
import dataclasses
from typing import Any, NamedTuple, Self

from motion_jax.analysis.event_words import TIMES
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.lexicon import HOLD, PAUSE
from motion_jax_studio.language.slots import Slots, slots_of


@dataclasses.dataclass(frozen=True)
class Action:
  """One action: its sentence, its words without the subject, and the slots that these fill."""
  prompt: str      # "a person waves the right hand"
  words: str       # "waves the right hand"
  part: str = ""   # one of `parts.PARTS`
  sides: tuple[str, ...] = ()  # the arms that it names
  times: int = 1   # number of repetitions, where the sentence gives one
  verb: str = ""   # its base form
  reworded: bool = False  # differs from the text: "bows" for "takes a bow"
  counts_steps: bool = False  # a walk of a given number of steps
  subject: str = ""  # "a person"
  goes_back: bool = False  # a walk to where the walk before it began
  slots: Slots = dataclasses.field(init=False, repr=False, compare=False)

  def __post_init__(self) -> None:
    object.__setattr__(self, "slots", slots_of(self.verb, self.part, self.sides, self.times, self.words))

  @classmethod
  def of(cls, subject: str, words: str, part: str = "", **fields: Any) -> Self:
    """The action of a subject and words."""
    return cls(f"{subject} {words}", words, part, subject=subject, **fields)

  def replace(self, **changes: Any) -> Self:
    """The action with other values; other words without a prompt get one with its subject."""
    if "words" in changes and "prompt" not in changes:
      changes["prompt"] = f"{self.subject} {changes['words']}"
    return dataclasses.replace(self, **changes)

  @property
  def prompt_with_count(self) -> str:
    """The prompt with its repetitions, in the words of captions that count: "a person jumps three times"."""
    return f"{self.prompt} {TIMES.get(self.times, f'{self.times} times')}".rstrip()

  @property
  def is_done_once(self) -> bool:
    """Whether the action ends by itself and leaves the body standing, as a bow does and a walk does not."""
    return self.verb in lexicon.DONE_ONCE

  @property
  def leaves_at_ease(self) -> bool:
    """Whether the action ends by itself in a stance in which the body can stand on, as a raised hand does not."""
    return self.verb in lexicon.DONE_ONCE - lexicon.NOT_AT_EASE


class Segment(NamedTuple):
  """The actions of one span of time: one of the whole body, and simultaneous ones of body parts."""
  action: Action
  simultaneous: tuple[Action, ...] = ()
  seconds: float | None = None  # duration, where the sentence gives one

  @property
  def actions(self) -> tuple[Action, ...]:
    """All its actions, that of the whole body first."""
    return (self.action, *self.simultaneous)

  @property
  def words(self) -> str:
    """The words of all its actions: "walks forward + waves 3 times"."""
    return " + ".join(action.words + (f" {action.times} times" if action.times > 1 else "")
                      for action in self.actions)

  @property
  def prompt(self) -> str:
    """All its sampled actions in one sentence, for motion that cannot be layered: "a person walks and waves"."""
    first, *others = self.sampled or (self.action,)
    return " and ".join([first.prompt_with_count, *(action.words for action in others)])

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
    return self.simultaneous if self.is_pause else self.actions


def still(subject: str, words: str = PAUSE, **fields: Any) -> Action:
  """The action of standing still, or of holding the last pose of the action before it (words: HOLD)."""
  return Action.of(subject, words, "legs", verb="stand", **fields)


def pause(subject: str, seconds: float | None) -> Segment:
  """A segment of standing still for a number of seconds; None: for the time that is left."""
  return Segment(still(subject), seconds=seconds)
