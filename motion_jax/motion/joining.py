"""New frames between old ones: moved so that they begin and end where the old ones do."""
import numpy as np

_FADE = 12  # frames over which a pose is drawn to its neighbour: 0.6 s at 20 frames a second


def join(made, given, kept, fade=_FADE):
  """Joints (T, J, 3): those given where kept (T,), elsewhere those made, brought to the borders without a jump.

  made and given (T, J, 3) show the same motion where kept, but for the error of the network that made the one. What is
  off at a border is taken out of the new frames: over the ground along the whole span (what follows a kept part starts
  from there, and between two kept parts the way is stretched to fit both), of the pose within `fade` frames. float32.
  """
  made, given, kept = np.asarray(made, np.float64), np.asarray(given, np.float64), np.asarray(kept, bool)
  if made.shape != given.shape or kept.shape != made.shape[:1]:
    raise ValueError(f"got joints of shapes {made.shape} and {given.shape} with {kept.shape} frames kept or not; "
                     "expected the same frames of all")
  off, result = given - made, np.where(kept[:, None, None], given, made)
  edges = np.flatnonzero(np.diff(np.concatenate([[True], kept, [True]]).astype(int)))
  for first, past in zip(edges[::2], edges[1::2]):
    sides = [off[first - 1]] if first > 0 else []
    sides += [off[past]] if past < len(kept) else []
    if not sides:
      continue
    count = past - first
    place = (np.arange(count) + 1)[:, None, None] / (count + 1)
    way = np.zeros((count, 1, 3))
    ways = [side[None, :1] * (1, 0, 1) for side in sides]
    way += ways[0] * (1 - place) + ways[-1] * place
    result[first:past] += way
    if first > 0:
      result[first:past] += _falling(count, fade) * (off[first - 1] - ways[0])
    if past < len(kept):
      result[first:past] += _falling(count, fade)[::-1] * (off[past] - ways[-1])
  return result.astype(np.float32)


def _falling(count, fade):
  """(count, 1, 1) from almost 1 to 0 within `fade` frames, or within count if these are fewer."""
  steps = np.arange(1, count + 1) / (min(fade, count) + 1)
  return (0.5 + 0.5 * np.cos(np.pi * np.minimum(steps, 1)))[:, None, None]
