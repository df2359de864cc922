"""Which vector each score is taken of."""
import dataclasses

import numpy as np
import pytest

from motion_jax.evaluation import items, protocols, run, sanity
from motion_jax.evaluation.evaluator import fresh_evaluator
from motion_jax.evaluation.judge import Judge
from motion_jax.metrics import scores
from motion_jax.motion.features import get_layout
from tests.evaluation.test_run import make_clips, write_archive


@pytest.fixture(scope="module")
def judge(tmp_path_factory):
  """SnapMoGen's rules and kind of evaluator, on other clips."""
  folder = write_archive(tmp_path_factory.mktemp("data") / "synthetic", make_clips())
  protocol = dataclasses.replace(protocols.get_protocol("snapmogen"), pool=4, few_draws=4, diversity_draws=6,
                                 min_frames=24, formats=("archive",), layouts=(),
                                 multimodality_motions=3, multimodality_pairs=2)
  evaluator = fresh_evaluator("snapmogen", "coordinates")
  found = items.read_items([folder], protocol, [evaluator])
  return Judge(protocol, evaluator, None, found, seed=1)


def test_fid_is_of_what_stands_before_the_last_layer(judge):
  reading, evaluator = judge.read(0), judge.evaluator
  motions = [x[::-1] for x in reading.drawn.cut(judge.items.of(evaluator))]
  made, seen = (np.concatenate([embed(evaluator.stats.normalize(x)[None], np.array([len(x)])) for x in motions])
                for embed in (evaluator.embed_motion, evaluator.embed_for_fid))
  row = judge.scores(0, motions, evaluator.layout)
  np.testing.assert_allclose(row["fid"], scores.fid(reading.real_seen, seen), rtol=1e-3)
  np.testing.assert_allclose(row["diversity"], scores.diversity(seen, *reading.draws.made), rtol=1e-3)
  assert abs(row["fid"] - scores.fid(reading.real, made)) > 1e-3 * row["fid"]
  # The rest is of the space that sentences share, and the score by CLIP's name is the evaluator's own cosine.
  np.testing.assert_allclose(row["matching"], scores.matching_score(reading.text, made), rtol=1e-3)
  np.testing.assert_allclose(row["clip_score"], scores.clip_score(reading.text, made), rtol=1e-3)


def test_real_motions_and_noise_are_read_alike(judge):
  found = sanity.look(judge)
  assert found["real"]["fid"] < 0.5 * found["fid_noise"]
  assert found["real"]["clip_score"] != found["shuffled"]["clip_score"]


def test_multimodality_is_of_the_same_vector(judge):
  drawn, evaluator = judge.read(0).drawn, judge.evaluator
  motions = drawn.cut(judge.items.of(evaluator))[:2]
  generations = [[x, x[::-1], x + 0.1] for x in motions]
  flat = [x for xs in generations for x in xs]
  seen = np.concatenate([evaluator.embed_for_fid(evaluator.stats.normalize(x)[None], np.array([len(x)]))
                         for x in flat]).reshape(2, 3, -1)
  apart = np.linalg.norm(seen[:, :, None] - seen[:, None], axis=-1)
  assert 0 < judge.multimodality(0, generations, evaluator.layout) <= apart.max() * 1.001


def test_pieces_may_be_longer_than_clips(judge):
  """Those of long motions end on the model's own grid."""
  short = Judge(dataclasses.replace(judge.protocol, max_frames=40), judge.evaluator, None, judge.items, seed=1)
  motions = judge.items.of(judge.evaluator)[:2]
  frames = np.array([48, 30])
  made = short.embed(judge.evaluator, [x[:m] for x, m in zip(motions, frames)], frames)
  np.testing.assert_allclose(made, judge.embed(judge.evaluator, [x[:m] for x, m in zip(motions, frames)], frames),
                             rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("padding", ["zeros", "decoded"])
def test_what_is_behind_a_motion_does_not_reach_into_it(judge, padding):
  """Headings are smoothed over seconds: features of a motion are made of its own frames alone."""
  evaluator, layout = fresh_evaluator("t2m", "full"), get_layout("coordinates")
  some = Judge(dataclasses.replace(judge.protocol, made_padding=padding), judge.evaluator, None, judge.items, seed=1)
  motion = judge.items.of(judge.evaluator)[0]
  count = len(motion) - 4
  wild = np.concatenate([motion[:count], np.random.default_rng(0).normal(size=(4, 66)).astype(np.float32)])
  made, other = some.carried(evaluator, [motion, wild], layout, [count, count])
  np.testing.assert_array_equal(made[:count], other[:count])
  assert len(made) == len(other) == count + 4 * (padding == "decoded")


def test_the_real_row_of_a_cosine_is_of_the_clips_that_are_ranked(judge):
  cut = Judge(dataclasses.replace(judge.protocol, max_frames=24), judge.evaluator, None, judge.items, seed=1)
  reading = cut.read(0)
  other = scores.clip_score(reading.text, reading.again)
  assert cut.real_scores(0)["clip_score"] == pytest.approx(scores.clip_score(reading.text, reading.real)) != other


def test_numbers_stand_beside_the_papers_of_their_own_representation():
  kit = protocols.get_protocol("kit")
  assert run._paper(kit, fresh_evaluator("t2m", "coordinates_kit"))["table"] == "2"
  assert run._paper(kit, fresh_evaluator("t2m", "full_kit")) is None
