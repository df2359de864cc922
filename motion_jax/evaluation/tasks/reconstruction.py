"""Reconstruction: the items of a pass through a tokenizer, judged like generated motions, and joint by joint."""
import numpy as np

from motion_jax.evaluation import samples
from motion_jax.evaluation.tasks.generation import METRICS as _GENERATION
from motion_jax.evaluation.tasks.generation import real_rows
from motion_jax.evaluation.tokenizers import load_tokenizer
from motion_jax.metrics import protocol as protocol_lib
from motion_jax.metrics import scores

# mpjpe in millimetres, of poses without heading; mpjpe_heading of the whole motion; released_mpjpe as the code prints.
METRICS = (*(name for name in _GENERATION if name != "multimodality"), "mpjpe", "mpjpe_heading", "released_mpjpe")
__all__ = ["METRICS", "damaged", "load", "real_rows", "rows"]
load = load_tokenizer


def rows(judge, subject, repeat):
  """{"": scores} of a tokenizer for a repeat."""
  protocol, layout, drawn = judge.protocol, subject.model.stats.layout, judge.read(repeat).drawn
  real = drawn.cut(judge.items.of(subject.reader))
  made = reconstructed(judge, subject, repeat, real)
  errors = {}
  for alone in (True, False):
    pairs = zip(real, made, drawn.frames)
    errors[alone] = [protocol_lib.reconstruction_errors(a[None], b[None], [m], alone, layout)[0] for a, b, m in pairs]
  mm = 1000 * layout.skeleton.unit
  return {"": judge.scores(repeat, made, layout) | {
      "mpjpe": mm * scores.mpjpe(errors[True]), "mpjpe_heading": mm * scores.mpjpe(errors[False]),
      "released_mpjpe": scores.released_mpjpe(errors[protocol.poses_alone], protocol.pool)}}


def damaged(judge, repeat, joints):
  """Controls of joint errors: real motions against themselves with noise on every joint, {"real", "noise 1 cm", ..}."""
  skeleton = judge.evaluator.layout.skeleton
  errors = {name: [scores.joint_errors(a, b) for a, b in zip(joints["real"], noisy)]
            for name, noisy in joints.items()}
  rows = {name: {"mpjpe": 1000 * skeleton.unit * scores.mpjpe(some),
                 "released_mpjpe": scores.released_mpjpe(some, judge.protocol.pool)} for name, some in errors.items()}
  return rows, {"noise": {"mpjpe": 1, "released_mpjpe": 1}}


def reconstructed(judge, subject, repeat, real):
  """Motions [(rows, F)] of a pass after the tokenizer, BATCH at a time."""
  stats, protocol, drawn = subject.model.stats, judge.protocol, judge.read(repeat).drawn
  made = []
  with samples.progress(len(real), f"{subject.name}, repeat {repeat + 1}", subject.show) as bar:
    for first in range(0, len(real), samples.BATCH):
      places = np.minimum(np.arange(first, first + samples.BATCH), len(real) - 1)
      x = padded([real[i] for i in places], stats, protocol.max_frames)
      seeds = [samples.seed_of(judge.seed, repeat, int(drawn.item[i])) for i in places]
      back = subject.model.round_trip(x, drawn.frames[places], seeds if protocol.sampled_latents else None)
      made += [stats.denormalize(row[:m + samples.TAIL]) for row, m in zip(back, drawn.frames[places])]
      bar.update(samples.BATCH)
  return made[:len(real)]


def padded(motions, stats, length):
  """Motions [(T_i, F)] normalized, zeros behind them: (B, length, F)."""
  x = np.zeros((len(motions), length, stats.layout.dim), np.float32)
  for row, motion in zip(x, motions):
    row[:len(motion)] = stats.normalize(motion)
  return x
