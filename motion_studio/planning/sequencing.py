"""Sentences of several actions become one motion: in a row by the method's own means, at once part by part of the body.

An action takes as long as clips of it in training, or its share of the length that is given. Actions at once are
sampled as two motions of one length, and arms, head or torso of the one are put on the other (`motion.layering`).
"""
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import jax
import numpy as np

from motion_jax.analysis.event_words import TIMES
from motion_jax.models.base import each
from motion_jax.models.results import Motions, captions_in_a_row, features_of, gathered
from motion_jax.motion.layering import put_on
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils import progress
from motion_jax.utils.errors import InputError
from motion_jax.utils.numerals import as_float, demand_numbers
from motion_studio.checks import attempts
from motion_studio.checks import requirements as looking
from motion_studio.checks.reports import with_reports
from motion_studio.language.actions import LOW, cycle_of, held_pose, is_counted_one_by_one
from motion_studio.language.sentences import Action, Segment, Sentence, rest_of, understand, who_is_done
from motion_studio.planning.finishing_touches import finished
from motion_studio.planning.independent import made_apart
from motion_studio.planning.resting import held_frame, with_rest

if TYPE_CHECKING:
  from motion_jax.models.base import Frames, TextToMotionModel

_LONGEST = 3600    # seconds
_REST = 2.0        # seconds of standing still
_LEFT = 1.0        # seconds beyond what an action takes in which a body can stand still
_AROUND = 1.5      # seconds in which a hand comes up and goes down again, around what is counted
_APART = 2         # tries before actions in a row are made apart
_TRIES_OF_EACH = 3  # of each action that is made apart; the one that shows it best is taken
_BRISK = 0.8       # of its usual length that an action takes which is done several times
# Seconds that it takes then at the most: clips of one squat among other exercises are seven seconds long. Of 24 motions
# of so many kicks or squats 17 came out right with 3 s, 11 without a limit, 10 with 2.2 s.
_ROUND = 3.0
_SHORT_ROUND = 2.4  # and at the least: by its own lengths `cdamd-small` had 1.4 s for a kick and 1.9 for a squat
# Seconds at the least in which a body gets down to a pose that is kept: of 16 seats of `cdamd-small`, which by its own
# lengths takes 0.9 to 1.6 s, trunks lean by 44 degrees in the median then, by 36 with 2.2 s, by 24 with 2.8.
_DOWN = 2.8
_IN, _OUT = 8, 12  # frames in which a part comes to another motion's and goes back


def usual_frames(model: "TextToMotionModel", sentence: Sentence) -> list[int]:
  """How long each segment of a sentence is, in frames: as it says itself, or as long as clips of its longest action;
  what is done several times takes as much longer."""
  return [round(segment.seconds * model.fps) if segment.seconds else
          max([_down_frames(model, segment, then), *(_action_frames(model, action) for action in segment.made)])
          if segment.made else round(_REST * model.fps)
          for segment, then in zip(sentence.segments, (*sentence.segments[1:], None))]


def _down_frames(model, segment, then):
  return round(_DOWN * model.fps) if segment.action.verb in LOW and then is not None and then.holds else 0


def _action_frames(model, action):
  if action.times > 1 and is_counted_one_by_one(action.verb):
    once = np.clip(_BRISK * model.natural_frames(action.prompt), _SHORT_ROUND * model.fps, _ROUND * model.fps)
    return round(once) * action.times
  if action.times > 1:
    said = model.nearest_captions(action.counted)
    if said and TIMES.get(action.times, "no number") in said[0][0]:  # clips show it so often
      return model.natural_frames(action.counted)
    cycle = cycle_of(action.verb)
    if cycle is not None:
      return round((cycle * action.times + _AROUND) * model.fps)
  return model.natural_frames(action.prompt) * action.times


def with_endings(model: "TextToMotionModel", prompts: Sequence[str], sentences: Sequence[Sentence | None],
                 num_frames: "Frames", seconds: "Frames") -> list[Sentence | None]:
  """The sentences, each with standing still at its end where that is due: where all its actions are over when they are
  done, and a second or more is left of the length that is asked for. None, a prompt that is taken as it is, stays."""
  said, scale = (num_frames, 1.0) if seconds is None else (seconds, model.fps)
  if said is None or callable(said) or num_frames is not None and seconds is not None:
    return list(sentences)
  totals = [as_float(value) * scale for value in each(said, prompts)]
  return [sentence and _with_ending(model, sentence, total) for sentence, total in zip(sentences, totals)]


def _with_ending(model, sentence, total):
  who = [who_is_done(one.prompt, at_ease=True) for part in sentence.segments for one in (part.action, *part.also)]
  if not all(who) or any(part.seconds for part in sentence.segments):
    return sentence
  left = total / model.fps - sum(usual_frames(model, sentence)) / model.fps
  if not _LEFT <= left <= _LONGEST:
    return sentence
  return sentence.with_segments((*sentence.segments, rest_of(who[-1], left)))


def rested(model: "TextToMotionModel", lists: Sequence[Sequence[tuple[str, int]]], keys: jax.Array,
           seeds: Sequence[int | None], cleanup: bool, sampling: dict[str, Any], **how: Any) -> Motions:
  """A motion of each list of (prompt, frames); an action that is over before its frames are ends in standing still.
  how: `way` and `ease` of `multi_prompts`."""
  sentences, lengths = [], []
  for row in lists:
    segments, counts = [], []
    for prompt, count in row:
      took, who = took_of(model, prompt), who_is_done(prompt, at_ease=True)
      left = (count - took) / model.fps if took else 0.0
      segments.append(Segment(Action(prompt, prompt)))
      counts.append(took if left >= _LEFT else count)
      if left >= _LEFT:
        segments.append(rest_of(who, left))
        counts.append(count - took)
    sentences.append(Sentence(" | ".join(prompt for prompt, _ in row), tuple(segments)))
    lengths.append(counts)
  return gathered(_composed(model, sentences, lengths, keys, seeds, cleanup, sampling, **how))


def took_of(model: "TextToMotionModel", prompt: str) -> int:
  """Frames that an action takes which is over when it is done, by clips of it in training; 0 of any other."""
  return model.natural_frames(prompt) if who_is_done(prompt) else 0


def shared(usual: Sequence[int], total: int, least: int) -> list[int]:
  """Whole numbers of at least `least` that sum to total, in proportion to the usual ones as far as that goes."""
  ends = np.round(np.cumsum(usual) / sum(usual) * total).astype(int)
  lengths = np.diff([0, *ends])
  for i in np.flatnonzero(lengths < least):  # the longest gives what is missing
    lengths[np.argmax(lengths)] -= least - lengths[i]
    lengths[i] = least
  return lengths.tolist()


def lengths_of(model: "TextToMotionModel", prompts: Sequence[str], sentences: Sequence[Sentence | None],
               num_frames: "Frames", seconds: "Frames") -> list[list[int]]:
  """Frames of the segments of each prompt; of a prompt that is taken as it is a single number."""
  if num_frames is not None and seconds is not None:
    model.frames_of(prompts, num_frames, seconds)  # says what is wrong
  name, said, scale = ("num_frames", num_frames, 1.0) if seconds is None else ("seconds", seconds, model.fps)
  said = [said(prompt) for prompt in prompts] if callable(said) else each(said, prompts)
  demand_numbers([value for value in said if value is not None], name, "a number, or one per prompt")
  return [model.frames_of([prompt], *((value, None) if seconds is None else (None, value)))
          if sentence is None or sentence.is_plain else
          _lengths(model, sentence, value if value is None else as_float(value) * scale)
          for prompt, sentence, value in zip(prompts, sentences, said)]


def _lengths(model, sentence, total):
  """Frames of each segment, of so many together, or of as many as are usual."""
  counts, least = usual_frames(model, sentence), model.frames_per_latent
  if total is not None:
    if not least * len(counts) <= total <= _LONGEST * model.fps:
      raise InputError(f"got a length of {total:g} frames for {len(counts)} actions in a row, expected "
                       f"{least * len(counts)} to {_LONGEST * model.fps:.0f}")
    counts = _within(counts, [segment.seconds is not None for segment in sentence.segments], round(total), least)
  if sum(counts) > _LONGEST * model.fps:
    raise InputError(f"got a sentence of {sum(counts) / model.fps:,.0f} s, expected at most {_LONGEST:,}")
  return model.frames_of([segment.action.prompt for segment in sentence.segments], counts, None)


def _within(counts, said, total, least):
  """Counts that sum to total: of those that are `said` as they are where that leaves enough for the others."""
  free = [count for count, is_said in zip(counts, said) if not is_said]
  left = total - sum(counts) + sum(free)
  if not free or left < least * len(free):
    return shared(counts, total, least)
  others = iter(shared(free, left, least))
  return [count if is_said else next(others) for count, is_said in zip(counts, said)]


def told(sentence: Sentence, frames: Sequence[int], fps: float) -> str:
  """What was understood, for a person: "walks forward (3.2 s) | waves the right hand (2.6 s)"."""
  return " | ".join(f"{segment.words} ({count / fps:.1f} s)" for segment, count in zip(sentence.segments, frames))


def generate(model: "TextToMotionModel", prompts: Sequence[str], num_frames: "Frames", seconds: "Frames",
             keys: jax.Array, seeds: Sequence[int | None], cleanup: bool, literal: bool, sampling: dict[str, Any],
             tries: int = 1) -> Motions:
  """Motions of prompts, each understood by itself; those of one action go to `model.sample` as they are.

  tries: a motion that violates a requirement of its prompt (`models.looking`) is resampled, with the key
  fold_in(key, 2^20 + attempt), until none is violated or there are this many attempts: the best is kept, of equals the
  first; what it still violates say a warning and its meta["unmet"]. From the third attempt on actions in a row, and one
  that is done several times, are made apart, each three times, and the best joined (`models.apart`).
  """
  made = _generated(model, prompts, num_frames, seconds, keys, seeds, cleanup, literal, sampling)
  if literal or tries == 1 or model.stats.layout.skeleton is not HUMANML3D:
    return made
  required = [looking.requirements_of(prompt) for prompt in prompts]

  def scored(motions, rows):
    motions = [finished(model, motion, required[i]) for i, motion in zip(rows, motions)]
    return [(looking.violation_score(motion.joints, required[i], model.fps), motion)
            for i, motion in zip(rows, motions)]

  best = scored(made, range(len(prompts)))

  def make_anew(rows, number, scale):
    some = lambda said: said if said is None or callable(said) else [each(said, prompts)[i] for i in rows]
    folded = jax.numpy.stack([jax.random.fold_in(keys[i], attempts.FIRST_RESAMPLED + number) for i in rows])
    said = [attempts.said_again(prompts[i], required[i], number) for i in rows]
    with progress.part(f"attempt {number + 1} of {tries}, as the last motion does not show all of the prompt"):
      anew = _generated(model, said, some(num_frames), some(seconds), folded, [seeds[i] for i in rows], cleanup,
                        literal, attempts.reweighed(model, sampling, scale), apart=number >= _APART)
    for i, (missed, motion) in zip(rows, scored(anew, rows)):
      if missed < best[i][0]:
        best[i] = missed, motion.replace(meta=motion.meta | dict(tries=number + 1))

  for number in range(1, tries):
    rows = [i for i, (missed, _) in enumerate(best) if missed]
    if not rows:
      break
    # Overdone and nothing else: whose words do not show at all are to be said louder first.
    over = [i for i in rows if best[i][0] <= looking.excess_speed(best[i][1].joints, required[i], model.fps)]
    for some, scale in (([i for i in rows if i not in over], attempts.LOUDER), (over, attempts.SOFTER)):
      if some:
        make_anew(some, number, scale)
  found = with_reports(model, prompts, [motion for _, motion in best], required, tries)
  if all(motion is one for motion, one in zip(found, made)):
    return made
  return gathered([motion.replace(id=f"motion_{i}") for i, motion in enumerate(found)])


def _generated(model, prompts, num_frames, seconds, keys, seeds, cleanup, literal, sampling, apart=False):
  sentences = [None if literal else model.understand(prompt) for prompt in prompts]
  if apart:
    sentences = [sentence and _counted_out(sentence) for sentence in sentences]
  sentences = with_endings(model, prompts, sentences, num_frames, seconds)
  rows = [i for i, sentence in enumerate(sentences) if sentence is None or sentence.is_plain]
  if len(rows) == len(prompts):
    frames = model.frames_of(prompts, num_frames, seconds)
    return model.sample(prompts, frames, keys, seeds, cleanup, sampling)
  lengths = lengths_of(model, prompts, sentences, num_frames, seconds)
  found: dict[int, Any] = {}
  if rows:
    made = model.sample([prompts[i] for i in rows], [lengths[i][0] for i in rows], keys[np.array(rows)],
                        [seeds[i] for i in rows], cleanup, sampling)
    found |= zip(rows, made)
  rows = [i for i in range(len(prompts)) if i not in found]
  several = [sentence for i in rows if (sentence := sentences[i]) is not None]
  made = _composed(model, several, [lengths[i] for i in rows], keys[np.array(rows)], [seeds[i] for i in rows], cleanup,
                   sampling, make=partial(made_apart, tries=_TRIES_OF_EACH) if apart else None)
  found |= zip(rows, made)
  return gathered([found[i].replace(id=f"motion_{i}") for i in range(len(prompts))])


def _counted_out(sentence):
  """The sentence, parted where a caption of the training data says it and counts: those words did not do it."""
  counts = sentence.is_plain and any(one.counted for one in looking.requirements_of(sentence.text))
  return understand(sentence.text) if counts else sentence


def _composed(model: "TextToMotionModel", sentences: list[Sentence], lengths: list[list[int]], keys: jax.Array,
              seeds: Sequence[int | None], cleanup: bool, sampling: dict[str, Any], make: Any = None, **how: Any
              ) -> list[Any]:
  """A Motion for each sentence. make: what puts actions in a row, by default the model's own way."""
  moving = [[(segment, count) for segment, count in zip(sentence.segments, frames) if not segment.rests]
            or [(sentence.segments[0], frames[0])] for sentence, frames in zip(sentences, lengths)]
  rounds = [[_rounds(model, segment.action, count, apart=make is not None) for segment, count in row]
            for row in moving]
  in_a_row = partial(make, model) if make else model.in_a_row
  bases = in_a_row([sum(row, []) for row in rounds], keys, seeds, cleanup, sampling, **how)
  spans = [_spans(model, base, [len(one) for one in row]) for base, row in zip(bases, rounds)]
  layers = [(row, place, action) for row, sentence in enumerate(sentences)
            for place, segment in enumerate(sentence.segments) for action in segment.also]
  arms: dict[tuple[int, int], list[Any]] = {}
  if layers:
    folded = jax.numpy.stack([jax.random.fold_in(keys[row], 1 + i) for i, (row, _, _) in _numbered(layers)])
    counts = [_layer_frames(sentences[row].segments, place, spans[row], lengths[row]) for row, place, _ in layers]
    counts = [max(count, model.frames_per_latent) for count in counts]
    others = model.sample([action.counted for _, _, action in layers], counts, folded, [None] * len(layers), cleanup,
                          sampling)
    for (row, place, action), other in zip(layers, others):
      arms.setdefault((row, place), []).append((action, other.joints))
  skeleton = model.stats.layout.skeleton
  bodies = [_put_together(base.joints, sentence.segments, span, frames,
                          [arms.get((row, place), []) for place in range(len(sentence.segments))], skeleton)
            for row, (base, sentence, span, frames) in enumerate(zip(bases, sentences, spans, lengths))]
  return [_finished(model, base, sentence, *body) for base, sentence, body in zip(bases, sentences, bodies)]


def _numbered(layers):
  """Each layer with its number within its sentence, so that draws do not depend on batch-mates."""
  seen: dict[int, int] = {}
  for layer in layers:
    seen[layer[0]] = seen.get(layer[0], -1) + 1
    yield seen[layer[0]], layer


def _rounds(model, action, count, apart):
  """[(prompt, frames)] of an action: one, or one for each time that it is done. apart: they are made apart."""
  one_by_one = is_counted_one_by_one(action.verb) or apart and looking.is_counted(action.prompt)
  if action.times == 1 or not one_by_one or count < action.times * model.frames_per_latent:
    return [(action.counted, count)]
  return [(action.prompt, part) for part in shared([1] * action.times, count, model.frames_per_latent)]


def _spans(model, base, sizes):
  """[(first frame, past)] of segments of so many rounds each, by the captions of the motion."""
  if sum(sizes) == 1:
    return [(0, base.num_frames)]
  ends = np.cumsum(sizes)
  frame = lambda seconds: min(round(seconds * model.fps), base.num_frames)
  return [(frame(base.captions[end - size].start), frame(base.captions[end - 1].end)) for end, size in zip(ends, sizes)]


def _layer_frames(segments, place, spans, lengths):
  """Frames of what is put on the segment at a place: as many as it has in the motion; spans are of those that move."""
  if segments[place].rests:
    return lengths[place]
  first, past = spans[sum(not segment.rests for segment in segments[:place])]
  return past - first


def _layered(joints, other, span, action, skeleton, upright=False):
  """Joints with an action's part in one segment, which comes and goes where there is something before and behind."""
  first, past = span
  if action.held:
    hands = [chain[-1] for side, chain in zip(("right", "left"), skeleton.chains[3:]) if side in action.sides
             or not action.sides]
    other = np.repeat(other[[int(np.argmax(other[:, hands, 1].mean(1)))]], past - first, axis=0)
  other = np.concatenate([other, np.repeat(other[-1:], max(past - first - len(other), 0), axis=0)])[:past - first]
  k, weight = np.arange(past - first), np.ones(past - first)
  if first > 0:
    weight = np.minimum(weight, (k + 1) / (_IN + 1))
  if past < len(joints):
    weight = np.minimum(weight, (len(k) - k) / (_OUT + 1))
  weight = weight * weight * (3 - 2 * weight)
  body = joints.copy()
  body[first:past] = put_on(joints[first:past], other, action.part, action.sides, weight, skeleton, upright)
  return body


def _put_together(joints, segments, spans, lengths, arms, skeleton):
  """(joints, [(first frame, past)] of all segments): layers put on, and time for those that rest; from joints and spans
  of those that move. arms: for each segment [(action, joints)] of what is put on it."""
  moves = iter(spans)
  for segment, own in zip(segments, arms):
    span = None if segment.rests and len(segments) > 1 else next(moves)
    for action, other in own if span else ():
      joints = _layered(joints, other, span, action, skeleton)
  return _with_rests(joints, segments, spans, lengths, arms, skeleton)


def _with_rests(joints, segments, spans, lengths, arms, skeleton):
  if not any(segment.rests for segment in segments) or len(segments) == 1:
    return joints, spans
  found: list[tuple[int, int]] = []
  spans, added, end, before = list(spans), 0, 0, None
  for place, (segment, count, own) in enumerate(zip(segments, lengths, arms)):
    if segment.rests:
      at, pose = end, None
      if before is not None and segment.holds:
        at, pose = _held_at(joints, found[-1], before, skeleton)
      # Who does no more than rest from here on does not get up; arms that are held up for so many seconds come down
      # then, as they do in what was made.
      done = place == len(segments) - 1 or pose == "low" and all(one.rests for one in segments[place:])
      ends = done and not (pose == "arms" and segment.seconds)
      joints, first, past = with_rest(joints, at, count, skeleton, ends, exact=pose is not None)
      if found:
        found[-1] = (found[-1][0], first)
      found.append((first if found else 0, past))
      for action, other in own:
        joints = _layered(joints, other, found[-1], action, skeleton, upright=True)
      added, end = added + count, past
    else:
      _, past = spans.pop(0)
      found.append((end, past + added))
      end = past + added
    before = segment
  return joints, found


def _held_at(joints, span, before, skeleton):
  """(frame, pose) at which somebody holds still behind a segment; the pose is None where any will do."""
  first, past = span
  if before.holds and not before.also:
    return past - 1, "as it is"
  action = before.also[-1] if before.holds else before.action
  pose = held_pose(action.verb, action.part)
  if pose is None:
    return past, None
  # What is held takes a frame at least, or its caption would have no time.
  return held_frame(joints, min(first + 1, past - 1), past, pose, action.sides, skeleton), pose


def _finished(model, base, sentence, joints, spans):
  """The motion with its sentence, what was understood of it, and features of what it shows."""
  captions = captions_in_a_row([segment.prompt for segment in sentence.segments], [past for _, past in spans],
                               model.fps)
  meta = base.meta | dict(prompt=sentence.text, understood=told(sentence, [b - a for a, b in spans], model.fps))
  if joints is base.joints:
    return base.replace(captions=captions, meta=meta)
  return base.replace(joints=joints, features=features_of(model, joints), captions=captions, meta=meta)
