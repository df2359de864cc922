"""Assemble one body from sampled parts: layers on arms, head or torso, pauses, and held poses."""
from collections.abc import Sequence
from typing import Any

import numpy as np

from motion_jax.motion.layering import put_on
from motion_jax.motion.skeleton import Skeleton
from motion_jax.shapes import Float, Num
from motion_jax_studio.language import Action, Segment
from motion_jax_studio.language.parts import held_pose
from motion_jax_studio.planning.pauses import held_frame, insert_pause

_IN, _OUT = 8, 12  # frames in which a layer is blended in and out

Layers = Sequence[Sequence[tuple[Action, Any]]]  # for each segment, the layers on it: (action, joints (T, J, 3))
Spans = Sequence[tuple[int, int]]  # (first frame, frame past the last)


def assemble(joints: Num[np.ndarray, "t j 3"], segments: Sequence[Segment], spans: Spans, lengths: Sequence[int],
             layers: Layers, skeleton: Skeleton) -> tuple[Float[np.ndarray, "n j 3"], Spans]:
  """Apply layers and insert pauses; returns (joints, spans of all segments).

  joints, spans: of the segments that move, which are all but pauses; lengths: frames of all segments.
  """
  moves = iter(spans)
  for segment, segment_layers in zip(segments, layers):
    span = None if segment.is_pause and len(segments) > 1 else next(moves)
    for action, other in segment_layers if span else ():
      joints = _layered(joints, other, span, action, skeleton)
  if not any(segment.is_pause for segment in segments) or len(segments) == 1:
    return joints, spans
  return _with_pauses(joints, segments, spans, lengths, layers, skeleton)


def _layered(joints, other, span, action, skeleton, upright=False):
  """Layer an action's body part from the motion `other` on one segment; it is blended in and out within the segment."""
  first, past = span
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


def _with_pauses(joints, segments, spans, lengths, layers, skeleton):
  new_spans: list[tuple[int, int]] = []
  spans, added, end, before = list(spans), 0, 0, None
  for place, (segment, count, segment_layers) in enumerate(zip(segments, lengths, layers)):
    if segment.is_pause:
      at, pose = end, None
      if before is not None and segment.hold_pose:
        at, pose = _held_at(joints, new_spans[-1], before, skeleton)
      # A seated or lying body with only pauses ahead does not get up. Arms that are held up for a given time come down
      # afterwards, as they do in the sampled motion.
      done = place == len(segments) - 1 or pose == "low" and all(later.is_pause for later in segments[place:])
      ends = done and not (pose == "arms" and segment.seconds)
      # At least two thirds of the previous segment are played, even of a single step.
      earliest = new_spans[-1][0] + 2 * (at - new_spans[-1][0]) // 3 if new_spans else 0
      joints, first, past = insert_pause(joints, at, count, skeleton, ends, pose is not None, earliest)
      if new_spans:
        new_spans[-1] = (new_spans[-1][0], first)
      new_spans.append((first if new_spans else 0, past))
      for action, other in segment_layers:
        joints = _layered(joints, other, new_spans[-1], action, skeleton, upright=True)
      added, end = added + count, past
    else:
      _, past = spans.pop(0)
      new_spans.append((end, past + added))
      end = past + added
    before = segment
  return joints, new_spans


def _held_at(joints, span, before, skeleton):
  """(frame, pose) at which the body holds still after a segment; the pose is None if any pose will do."""
  first, past = span
  if before.hold_pose and not before.simultaneous:
    return past - 1, "as it is"
  action = before.simultaneous[-1] if before.hold_pose else before.action
  pose = held_pose(action.verb, action.part)
  if pose is None:
    return past, None
  # The segment keeps at least one frame, or its caption would have no time.
  return held_frame(joints, min(first + 1, past - 1), past, pose, action.sides, skeleton), pose
