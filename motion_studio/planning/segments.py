"""A prompt of several actions as prompts in a row, for motion that is sampled in one run: streams, timelines, what goes
on behind a motion.

`composed` puts together what `generate` makes, from joints: layers of actions at once, poses that are held. A run in
blocks cannot do that, so here actions at once share one prompt, and a held pose is more time for the prompt before it.
"""
from typing import TYPE_CHECKING

from motion_studio.language.sentences import Segment, Sentence
from motion_studio.planning import sequencing as composed

if TYPE_CHECKING:
  from motion_jax.models.base import TextToMotionModel


def prompts_in_a_row(model: "TextToMotionModel", prompt: str, num_frames: int | None = None, least: int = 1
                     ) -> list[tuple[str, int | None]]:
  """[(prompt, frames)] of the actions of a prompt, one after the other; the prompt itself where it is one action.

  num_frames: of all of them together; None: each as long as similar training clips, but for a single action, whose
  frames are None then. least: frames below which no action gets; a prompt whose actions would have less stays whole.
  """
  sentence = model.understand(prompt) if model.can("understand") else None
  if sentence is not None and len(sentence.segments) > 1 and (
      num_frames is None or num_frames >= least * len(sentence.segments)):
    counts = composed.lengths_of(model, [prompt], [sentence], num_frames, None)[0]
    return [*_merged(sentence, [max(count, least) for count in counts] if num_frames is None else counts)]
  if sentence is None or len(sentence.segments) > 1 or sentence.segments[0].also or sentence.is_plain:
    return [(prompt, num_frames)]
  first = sentence.segments[0]
  # "takes two bows" is "bows twice".
  return [(first.prompt, round(first.seconds * model.fps) if num_frames is None and first.seconds else num_frames)]


def _merged(sentence: Sentence, counts: list[int]) -> list[tuple[str, int]]:
  """The prompt of each segment, where one that holds a pose goes on with the prompt before it."""
  found: list[tuple[str, int]] = []
  for segment, count in zip(sentence.segments, counts):
    said = _prompt_of(segment, found[-1][0] if found else "")
    if found and found[-1][0] == said:
      found[-1] = said, found[-1][1] + count
    else:
      found.append((said, count))
  return found


def _prompt_of(segment: Segment, before: str) -> str:
  if not segment.holds or not before:
    return segment.prompt
  return " and ".join([before, *(action.words for action in segment.also)])
