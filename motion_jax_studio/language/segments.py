"""The parts of a plan: actions, and segments of actions that happen at the same time."""
from typing import NamedTuple

from motion_jax.analysis.event_words import TIMES
from motion_jax_studio.language import lexicon
from motion_jax_studio.language.hand_places import HandPlace, hand_place_of
from motion_jax_studio.language.leaning import Lean, lean_of
from motion_jax_studio.language.lexicon import HOLD, PAUSE
from motion_jax_studio.language.path_shapes import PathShape, course_of, shapes_of
from motion_jax_studio.language.words import said, says


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
  goes_back: bool = False  # a walk to where the walk before it began

  @property
  def said(self) -> str:
    """Its words, normalized for phrase tables (`words.said`)."""
    return said(self.words)

  @property
  def is_in_place(self) -> bool:
    """Whether it is done on one spot: "jogs in place"."""
    return says(self.said, lexicon.IN_PLACE)

  @property
  def shapes(self) -> tuple[PathShape, ...]:
    """Shape and pace of its path."""
    return shapes_of(self.verb, self.words)

  @property
  def course(self) -> str | None:
    """The side that a walk leads to, "" for a walk elsewhere, None for other actions."""
    return course_of(self.verb, self.part, self.words)

  @property
  def is_backward(self) -> bool:
    """Whether it goes backward."""
    return says(self.said, "backward, backwards")

  @property
  def leads_back(self) -> bool:
    """Whether it goes back: "walks back to the door", but not "walks back and forth"."""
    words = [word for word in self.said.split() if not word.endswith("ly")]
    return words[1:2] == ["back"] and words[2:4] != ["and", "forth"]

  @property
  def is_turn_to_a_side(self) -> bool:
    """Whether it is a turn to the left or right and no more: "turns sharply to the left on his way"."""
    words = [word for word in self.said.removesuffix("on way ").split() if word != "to" and not word.endswith("ly")]
    return words in ([turn, side] for turn in ("turn", "turns") for side in ("left", "right"))

  @property
  def hands(self) -> HandPlace | None:
    """Its hand pose or gesture; None if its words name none."""
    return hand_place_of(self.verb, self.part, self.sides, self.times, self.words)

  @property
  def lean(self) -> Lean | None:
    """Its lean of the trunk; None if its words name none."""
    return lean_of(self.verb, self.words)

  @property
  def prompt_with_count(self) -> str:
    """The prompt with its repetitions, in the words of captions that count: "a person jumps three times"."""
    return f"{self.prompt} {TIMES.get(self.times, f'{self.times} times')}".rstrip()

  @property
  def is_done_once(self) -> bool:
    """Whether the action ends by itself and leaves the body standing, as a bow does and a walk does not."""
    return self.is_pose or self.verb in lexicon.DONE_ONCE

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


def pause(who: str, seconds: float | None) -> Segment:
  """A segment of standing still for a number of seconds; None: for the time that is left."""
  return Segment(Action(f"{who} {PAUSE}", PAUSE, "legs", verb="stand", subject=who), seconds=seconds)
