"""Validation by an evaluator: FID of held-out motions after a tokenizer, by which its weights are chosen."""
import jax
import numpy as np

from motion_jax.evaluators.evaluator import load_evaluator
from motion_jax.metrics import scores
from motion_jax.training.setup import held_out

# Frames of a clip; frames that are left out of its length (docs/papers/cmdm.md#protocol); clips at a time.
LENGTH, LOST, CHUNK = 192, 1, 64


def with_fid(setup, config):
  """The `TrainingSetup` of a tokenizer; its validation adds held_out_fid where config.frozen names an evaluator."""
  if not config.frozen.get("evaluator"):
    return setup
  fid = reconstruction_fid(config.frozen.evaluator, held_out(config, setup.stats).features, setup.stats)
  drawn = jax.jit(lambda params, x, rng: setup.stage.predict(params, {}, {"features": x}, rng)["drawn"])

  def evaluate(params):
    # Parity: of drawn latents, as the released evaluation has it; the same draws at every save.
    key = jax.random.key(config.seed)
    value = fid(lambda x, i: drawn(params, x, jax.random.fold_in(key, i)))
    return setup.evaluate(params) | {"held_out_fid": round(value, 5)}

  return setup._replace(evaluate=evaluate)


def reconstruction_fid(evaluator, features, stats):
  """fid(reconstruct) of held-out clips, normalized features [(T, F)], against themselves; reconstruct(x (1, LENGTH, F),
  i) reconstructs clip i.

  evaluator: a folder or a shipped name. Clips are cut to LENGTH frames and to whole groups of four, padded with zeros
  (docs/papers/cmdm.md#reconstruction). Raises ValueError if the evaluator is of another skeleton.
  """
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
    rebuilt = []
    for i, clip in enumerate(clips):
      x = np.zeros((1, LENGTH, clip.shape[1]), np.float32)
      x[0, :len(clip)] = clip
      rebuilt.append(np.asarray(reconstruct(x, i))[0, :len(clip)])
    return float(scores.fid(real, embed(rebuilt)))

  return fid
