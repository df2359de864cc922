"""Sanity checks before sampling: evaluators must separate real motions from noise, right captions from wrong ones."""
import math

from motion_jax.evaluation.harness import NOISE
from motion_jax.evaluation.report import tables
from motion_jax.evaluation.result import Sanity
from motion_jax.metrics import scores

MARGIN = 1.5     # real R-precision over that of shuffled captions
SMALL = 0.25     # share of the FID of noise that two halves of the real motions may be apart
BY_CHANCE = 0.05  # share of random orders of captions that may fit as well as the right one
NEAR = 0.1       # share by which R-precision and matching of real motions may be off the printed ones


def check(harness, replication=0) -> Sanity:
  """Scores of real motions, of shuffled captions and of noise in one replication, and what is wrong with them.

  -> {"real", "shuffled": scores, "fid_noise", "fid_halves", "failures": [sentences], "warnings": [sentences]}.
  """
  real, shuffled = harness.real_scores(replication), harness.shuffled_scores(replication)
  embedded, evaluator = harness.embedded(replication), harness.evaluator
  rng, size = harness.rng(replication, NOISE), evaluator.layout.dim
  frames = embedded.drawn.frames
  noise = harness.embed_for_fid([evaluator.stats.denormalize(rng.normal(size=(m, size))) for m in frames], frames)
  fid_halves = harness.halves(replication).get("fid", math.nan)
  fid_noise = scores.fid(embedded.real if embedded.real_for_fid is None else embedded.real_for_fid, noise)
  top = f"top{harness.protocol.top_k}"
  chance = harness.protocol.top_k / harness.protocol.pool
  failures = [f"the real motions' {name} is not finite: look for NaN in the evaluator's weights or statistics"
              for name, value in real.items() if not math.isfinite(value)]
  few = harness.count // 2 <= evaluator.dim  # halves of so few differ by luck alone
  if few and (share := harness.share_of_nearer_shuffles(replication)) > BY_CHANCE:
    failures.append(f"real motions are no nearer to their own captions than to others' ({100 * share:.0f} % of random "
                    "orders are as near): the evaluator does not know these captions; train one on your data "
                    "(docs/your-own-data.md) and name it by --evaluator")
  if not few and not real[top] > MARGIN * max(shuffled[top], chance):
    failures.append(f"real motions find their captions in {100 * real[top]:.1f} % ({top}), shuffled ones in "
                    f"{100 * shuffled[top]:.1f} %, chance is {100 * chance:.1f} %: check that the evaluator was "
                    "trained on this representation and these captions, and that its text input (vocabulary, tokens) "
                    "is the one it was trained with")
  if not few and not real["matching"] < shuffled["matching"]:
    failures.append(f"real motions are {real['matching']:.3g} from their captions and {shuffled['matching']:.3g} from "
                    "others': check that captions belong to their motions")
  if not max(real["fid"], 0.0 if few else fid_halves) < SMALL * fid_noise:
    failures.append(f"FID of real against real motions is {real['fid']:.3g}, of two halves of them {fid_halves:.3g}, "
                    f"of real against noise {fid_noise:.3g}: check that the statistics are the evaluator's own")
  if "clip_score" in real and not real["clip_score"] > shuffled["clip_score"]:
    failures.append(f"CLIP score of real motions is {real['clip_score']:.3f}, of shuffled captions "
                    f"{shuffled['clip_score']:.3f}: check the CLIP evaluator's weights and word pieces")
  return dict(real=real, shuffled=shuffled, fid_noise=fid_noise, fid_halves=fid_halves, failures=failures,
              warnings=_unlike_the_paper(harness, real) + _few(harness))


def _unlike_the_paper(harness, real):
  """Real motions are the same for everyone: other numbers than the printed ones mean another evaluator or split."""
  protocol, lines = harness.protocol, []
  if protocol.paper is None or protocol.paper_layout not in (None, harness.evaluator.layout.name):
    return lines
  if tables.REAL in tables.paper_table(*protocol.paper[:2]).rows:
    printed = tables.paper_row(*protocol.paper[:2], tables.REAL)
    for metric in ("top1", "top3", "matching"):
      if metric in printed and abs(real[metric] - printed[metric]["mean"]) > NEAR * printed[metric]["mean"]:
        lines.append(f"{tables.label(metric)} of real motions is {real[metric]:.3f}, the paper prints "
                     f"{printed[metric]['mean']:.3f}: another evaluator, split or preparation of the data than the "
                     "paper's, so that rows of ours and of the paper do not compare")
  return lines


def _few(harness):
  count, dim = harness.count, harness.evaluator.dim
  return [] if count > dim else [
      f"{count} motions are few for an evaluator of {dim} numbers: FID is far above that of many motions and compares "
      "rows of this table alone"]


def require(findings, force=False):
  """Raises ValueError if `check` found a failure, unless forced."""
  if findings["failures"] and not force:
    raise ValueError("the evaluation does not look right on real data, so nothing was sampled:\n- "
                     + "\n- ".join(findings["failures"])
                     + "\n--force continues and records this in the provenance")
