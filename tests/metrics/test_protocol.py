"""The evaluation loops are the references', from normalized features to a row of numbers."""
import dataclasses

import numpy as np
import pytest

from motion_jax.evaluation.protocols import PROTOCOLS
from motion_jax.metrics import protocol as P
from motion_jax.metrics import scores
from tests import fixtures
from tests.golden import check, golden

# The file's words: 1e-4 relative, recorded from float32 embeddings; ranks exact.
RECORDED = {f"{loop}/top": (1e-12, 1e-12) for loop in ("ae", "dit")} | {"": (1e-5, 1e-10)}


@golden("protocol", leave_out=[f"{loop}/draws" for loop in ("ae", "dit", "mm")], bounds=RECORDED)
def run_protocol(fixture, dtype):
  c, mean, std = fixture.config, fixture["in/mean"], fixture["in/std"]
  protocol = P.Protocol(pool=c["batch"], multimodality_motions=c["generations"])
  arrays = {name: fixture[f"in/{name}"].astype(np.float64) for name in ("gt", "rec", "gen")}

  def embed(x, frames, weights="w_motion"):
    """The recorder's linear evaluators, which have a mean and a deviation of their own."""
    x = (x * std + mean - fixture["in/eval_mean"]) / fixture["in/eval_std"]
    return np.stack([row[:m].mean(0) for row, m in zip(x, frames)]) @ fixture[f"in/{weights}"]

  batches = {"ae": [], "dit": []}
  for text, frames, gt, rec, gen in zip(fixture["in/text"], fixture["in/lengths"], *arrays.values()):
    seen = P.evaluator_frames(frames, protocol)
    words, real = text @ fixture["in/w_text"], embed(gt, seen)
    meters = lambda x: x * std + mean
    errors = P.reconstruction_errors(meters(gt), meters(rec), frames)
    batches["ae"].append(P.Batch(words, real, embed(rec, seen), errors=errors))
    batches["dit"].append(P.Batch(words, real, embed(gen, seen), text @ fixture["in/w_clip_text"],
                                  embed(gen, seen, "w_clip")))
  made, rows = {}, {}
  for loop, score in (("ae", P.reconstruction_scores), ("dit", P.generation_scores)):
    drawn = [fixture[f"out/{loop}/draws/{i}"] for i in range(4)]
    rows[loop] = score(batches[loop], protocol, P.DiversityPairs((drawn[0], drawn[1]), (drawn[2], drawn[3])))
    made |= {f"{loop}/{name}": rows[loop][name] for name in ("fid", "diversity", "top1", "top2", "top3", "matching")}
  made |= {"ae/mpjpe": rows["ae"]["released_mpjpe"], "dit/clip": rows["dit"]["clip_score"]}

  count = protocol.multimodality_batches
  generations = []
  for frames, gen in zip(fixture["in/lengths"][:count], arrays["gen"][:count]):
    seen = P.evaluator_frames(frames, protocol)
    generations.append(np.stack([embed(gen + offset, seen) for offset in fixture["in/offsets"]], axis=1))
  made["mm/multimodality"] = scores.multimodality(np.concatenate(generations),
                                                  *(fixture[f"out/mm/draws/{i}"] for i in (4, 5)))
  return made


def test_golden():
  assert not check(fixtures.path("cmdm/protocol.npz")).failures


SMALL = P.Protocol(pool=8, diversity_draws=40, few_draws=10)


def batches(count=4, errors=True):
  rng = np.random.default_rng(0)
  made = []
  for _ in range(count):
    text = rng.normal(size=(SMALL.pool, 6))
    real = text + 0.1 * rng.normal(size=text.shape)
    made.append(P.Batch(text, real, real, text, real, [np.full(10, 0.25)] * SMALL.pool if errors else None))
  return made


def test_a_copy_of_the_data_scores_as_the_data():
  row = P.reconstruction_scores(batches(), SMALL, P.draw_diversity_pairs(np.random.default_rng(1), 32, SMALL))
  assert row["fid"] == pytest.approx(0, abs=1e-10) and row["top1"] == 1
  for name in ("top1", "top2", "top3", "matching"):
    assert row[name] == row[f"real_{name}"]
  assert row["mpjpe"] == 0.25 and row["released_mpjpe"] == pytest.approx(0.25 * 10 / 8)
  assert row["clip_score"] > 0.98


def test_r_precision_is_by_distance_or_by_angle_as_the_protocol_says():
  """Motions in their texts' directions, all but one far out: by angle each is its text's nearest, by distance the near
  one is everybody's."""
  text = np.eye(SMALL.pool)
  motion = text * np.array([0.1] + [10] * (SMALL.pool - 1))[:, None]
  draws = P.draw_diversity_pairs(np.random.default_rng(1), 32, SMALL)
  for prefix, batch in (("", P.Batch(text, text, motion)), ("real_", P.Batch(text, motion, text))):
    by_angle = P.generation_scores([batch] * 4, dataclasses.replace(SMALL, cosine=True), draws)
    by_distance = P.generation_scores([batch] * 4, SMALL, draws)
    assert by_angle[f"{prefix}top1"] == 1 and by_distance[f"{prefix}top1"] == 1 / SMALL.pool
  # Of all benchmarks only SnapMoGen's rank by angle (docs/papers/cmdm.md#snapmogen).
  assert [name for name, protocol in PROTOCOLS.items() if protocol.cosine] == ["snapmogen", "snapmogen-long"]


def test_errors_of_poses_alone_and_of_whole_motions():
  """A wrong turn in frame 0 changes every later frame of the whole motion, and no pose by itself."""
  real = np.zeros((1, 12, 67))
  real[..., 4:] = np.random.default_rng(0).normal(size=63)
  made = real.copy()
  made[:, 0, 0] = 0.3
  assert np.abs(P.reconstruction_errors(real, made, [12])[0]).max() == 0
  whole = P.reconstruction_errors(real, made, [9], alone=False)[0]
  assert whole.shape == (9,) and whole[0] == 0 and whole[1:].min() > 0.1


def test_bad_input_is_told():
  draws = P.draw_diversity_pairs(np.random.default_rng(1), 32, SMALL)
  with pytest.raises(ValueError, match="one of 8 rows, the protocol needs batches of 32"):
    P.generation_scores(batches(), P.Protocol(), draws)
  with pytest.raises(ValueError, match="no joint errors"):
    P.reconstruction_scores(batches(errors=False), SMALL, draws)
