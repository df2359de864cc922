"""New frames between old ones: moved so that they begin and end where the old ones do."""
import numpy as np

_FADE = 12    # frames over which a pose is drawn to its neighbour: 0.6 s at 20 frames a second
_SWERVE = 0.15  # metres that a joint's step across a border may differ from the steps beside it


def join(made, given, kept, fade=_FADE):
  """Joints (T, J, 3): those given where kept (T,), elsewhere those made, brought to the borders without a jump.

  made and given (T, J, 3), metres. A new part should begin one step behind the kept frame before it, and end one
  before the next; what it is off there, by the network's error or because its words lead elsewhere, is taken out of it:
  over the ground along the whole part (behind a kept beginning it starts from its end, between two kept parts the way
  is stretched to fit both), of the pose within `fade` frames. float32.
  """
  made, given, kept = np.asarray(made, np.float64), np.asarray(given, np.float64), np.asarray(kept, bool)
  if made.shape != given.shape or kept.shape != made.shape[:1]:
    raise ValueError(f"got joints of shapes {made.shape} and {given.shape} with {kept.shape} frames kept or not; "
                     "expected the same frames of all")
  result = np.where(kept[:, None, None], given, made)
  edges = np.flatnonzero(np.diff(np.concatenate([[True], kept, [True]]).astype(int)))
  for first, past in zip(edges[::2], edges[1::2]):
    new = made[first:past]
    before = after = None
    if first > 0:
      known = slice(first - 2 if first > 1 and kept[first - 2] else first - 1, first)
      before = _off(new, given[known], made[first - 1])
    if past < len(kept):
      known = slice(past, past + 2 if past + 1 < len(kept) and kept[past + 1] else past + 1)
      after = _off(new[::-1], given[known][::-1], made[past])
    ways = [side[:1] * (1, 0, 1) for side in (before, after) if side is not None]
    if not ways:
      continue
    place = (np.arange(past - first) + 1)[:, None, None] / (past - first + 1)
    moved = new + ways[0] * (1 - place) + ways[-1] * place
    if before is not None:
      moved += _falling(len(new), fade) * (before - ways[0])
    if after is not None:
      moved += _falling(len(new), fade)[::-1] * (after - ways[-1])
    result[first:past] = moved
  return result.astype(np.float32)


def _off(new, known, beside):
  """How far (J, 3) the first frame of new (N, J, 3) is from where it should be, a step behind the last of known.

  beside (J, 3): what was made in the place of that last frame. The step from there counts as far as it is like the
  steps on both sides.
  """
  steps = [frames[1] - frames[0] for frames in (new[:2], known[-2:]) if len(frames) == 2]
  step = new[0] - beside
  if steps:
    swerve = step - np.mean(steps, axis=0)
    size = np.linalg.norm(swerve, axis=-1, keepdims=True)
    step = np.mean(steps, axis=0) + swerve * np.minimum(1, _SWERVE / np.maximum(size, 1e-9))
  return known[-1] + step - new[0]


def _falling(count, fade):
  """(count, 1, 1) from almost 1 to 0 within `fade` frames, or within count if these are fewer."""
  steps = np.arange(1, count + 1) / (min(fade, count) + 1)
  return (0.5 + 0.5 * np.cos(np.pi * np.minimum(steps, 1)))[:, None, None]
