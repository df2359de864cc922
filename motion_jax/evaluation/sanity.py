"""Before anything is sampled: do the evaluators tell real motions from noise, and right captions from wrong ones?"""
import math

from motion_jax.evaluation.judge import NOISE
from motion_jax.metrics import scores

MARGIN = 1.5     # real R-precision over that of shuffled captions
SMALL = 0.25     # share of the FID of noise that real motions may have among themselves


def look(judge, repeat=0) -> dict:
  """What the evaluators say of real motions, of wrong captions and of noise in one pass, and what is wrong with it.

  -> {"real", "shuffled": scores, "fid_noise", "failures": [sentences]}.
  """
  real, shuffled = judge.real_scores(repeat), judge.shuffled_scores(repeat)
  reading, evaluator = judge.read(repeat), judge.evaluator
  x = judge.rng(repeat, NOISE).normal(size=(judge.count, judge.protocol.max_frames, evaluator.layout.dim))
  noise = judge.embed_for_fid([evaluator.stats.denormalize(row[:m]) for row, m in zip(x, reading.drawn.frames)],
                              reading.drawn.frames)
  fid_noise = scores.fid(reading.real if reading.real_seen is None else reading.real_seen, noise)
  top = f"top{judge.protocol.top_k}"
  chance = judge.protocol.top_k / judge.protocol.pool
  failures = [f"the real motions' {name} is not finite: look for NaN in the evaluator's weights or statistics"
              for name, value in real.items() if not math.isfinite(value)]
  if not real[top] > MARGIN * max(shuffled[top], chance):
    failures.append(f"real motions find their captions in {100 * real[top]:.1f} % ({top}), shuffled ones in "
                    f"{100 * shuffled[top]:.1f} %, chance is {100 * chance:.1f} %: check that the evaluator was "
                    "trained on this representation and these captions, and that its text input (vocabulary, tokens) "
                    "is the one it was trained with")
  if not real["matching"] < shuffled["matching"]:
    failures.append(f"real motions are {real['matching']:.3g} from their captions and {shuffled['matching']:.3g} from "
                    "others': check that captions belong to their motions")
  if not real["fid"] < SMALL * fid_noise:
    failures.append(f"FID of real against real motions is {real['fid']:.3g}, of real against noise {fid_noise:.3g}: "
                    "check that the statistics are the evaluator's own, and that there are enough samples")
  if "clip_score" in real and not real["clip_score"] > shuffled["clip_score"]:
    failures.append(f"CLIP score of real motions is {real['clip_score']:.3f}, of shuffled captions "
                    f"{shuffled['clip_score']:.3f}: check the CLIP evaluator's weights and word pieces")
  return dict(real=real, shuffled=shuffled, fid_noise=fid_noise, failures=failures)


def demand(found, force=False):
  """Raises ValueError where `look` found something wrong, unless it is forced."""
  if found["failures"] and not force:
    raise ValueError("the evaluation does not look right on real data, so nothing was sampled:\n- "
                     + "\n- ".join(found["failures"]) + "\n--force goes on all the same and keeps this in the record")
