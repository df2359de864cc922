"""By what trained stages are chosen: numbers of held-out motions by an evaluator."""
import numpy as np

from motion_jax.metrics import scores

# Frames of a clip; those that an evaluator is not told of (docs/papers/cmdm.md#protocol); clips at a time.
LENGTH, LOST, CHUNK = 192, 1, 64


def reconstruction_fid(evaluator, features, stats):
  """fid(reconstruct) of held-out clips, normalized features [(T, F)], against themselves: reconstruct(x (1, LENGTH, F),
  i) gives clip i back.

  evaluator: a folder or a name that ships. Clips are cut to LENGTH frames and to whole groups of four, padded with
  zeros (docs/papers/cmdm.md#reconstruction). Raises ValueError where the evaluator judges another body.
  """
  from motion_jax.evaluators.evaluator import load_evaluator
  network = load_evaluator(evaluator)
  clips = [clip[:min(len(clip), LENGTH) // 4 * 4] for clip in features]
  clips = [clip for clip in clips if len(clip) >= network.frames_per_token + LOST]
  if len(clips) < 2:
    raise ValueError(f"got {len(clips)} held-out clips to compare with {network.name!r}, a Gaussian needs 2 or more")

  def embed(motions):
    read = [stats.layout.convert(stats.denormalize(x), network.layout, network.mode) for x in motions]
    read = [network.stats.normalize(x) for x in read]
    frames = np.array([len(x) for x in read])
    rows = np.zeros((len(read), LENGTH, network.layout.dim), np.float32)
    for row, x in zip(rows, read):
      row[:len(x)] = x
    return np.concatenate([network.embed_for_fid(rows[i:i + CHUNK], frames[i:i + CHUNK] - LOST)
                           for i in range(0, len(rows), CHUNK)])

  real = scores.moments(embed(clips))

  def fid(reconstruct):
    made = []
    for i, clip in enumerate(clips):
      x = np.zeros((1, LENGTH, clip.shape[1]), np.float32)
      x[0, :len(clip)] = clip
      made.append(np.asarray(reconstruct(x, i))[0, :len(clip)])
    return float(scores.fid(real, embed(made)))

  return fid
