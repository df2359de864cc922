"""Which vector each score is taken of."""
import dataclasses

import numpy as np
import pytest

from motion_jax.evaluation import items, protocols, sanity
from motion_jax.evaluation.evaluator import fresh_evaluator
from motion_jax.evaluation.judge import Judge
from motion_jax.metrics import scores
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
