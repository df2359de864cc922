"""Items of a test set as the benchmarks' loaders cut them, to compare ours with."""
import numpy as np


def cut_item(features, double, start, stats, max_frames, start_again=0, unit_length=4):
  """A clip as the benchmarks' loaders hand it on: cut, normalized, zero-padded -> ((max_frames, F), frames kept).

  features (T, F). double: the coin fell on "double" (one time in three), a unit less is kept than the clip holds.
  start, start_again: first frame of the cut, and of a second one where more than max_frames are left.
  """
  count = (len(features) // unit_length - bool(double)) * unit_length
  if count < unit_length or not 0 <= start <= len(features) - count:
    raise ValueError(f"got a clip of {len(features)} frames to be cut to {count} from frame {start}; it does not reach")
  kept = features[start:start + count]
  if count > max_frames:
    kept = kept[start_again:start_again + max_frames]
  out = np.zeros((max_frames, features.shape[1]), np.float32)
  out[:len(kept)] = (kept - stats.mean) / stats.std
  return out, len(kept)
