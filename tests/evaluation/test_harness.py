"""Which vector each score is taken of."""
import dataclasses
import re

import numpy as np
import pytest

from motion_jax.evaluation import protocols
from motion_jax.evaluation import test_set as test_set_lib
from motion_jax.evaluation.checks import controls, sanity
from motion_jax.evaluation.harness import Harness
from motion_jax.evaluators.evaluator import fresh_evaluator
from motion_jax.metrics import scores
from motion_jax.motion.representations import get_layout


@pytest.fixture(scope="module")
def harness(archive):
  """SnapMoGen's rules and kind of evaluator, on other clips."""
  protocol = dataclasses.replace(protocols.get_protocol("snapmogen"), pool=4, few_draws=4, diversity_draws=6,
                                 min_frames=24, formats=("archive",), layouts=(),
                                 multimodality_motions=3, multimodality_pairs=2)
  evaluator = fresh_evaluator("snapmogen", "coordinates")
  found = test_set_lib.read_test_set([archive], protocol, [evaluator])
  return Harness(protocol, evaluator, None, found, seed=1)


@pytest.mark.slow
def test_fid_is_of_what_stands_before_the_last_layer(harness):
  embedded, evaluator = harness.embedded(0), harness.evaluator
  motions = [x[::-1] for x in embedded.drawn.cut(harness.test_set.of(evaluator))]
  made, seen = (np.concatenate([embed(evaluator.stats.normalize(x)[None], np.array([len(x)])) for x in motions])
                for embed in (evaluator.embed_motion, evaluator.embed_for_fid))
  row = harness.scores(0, motions, evaluator.layout)
  np.testing.assert_allclose(row["fid"], scores.fid(embedded.real_for_fid, seen), rtol=1e-3)
  np.testing.assert_allclose(row["diversity"], scores.diversity(seen, *embedded.diversity_pairs.generated), rtol=1e-3)
  assert abs(row["fid"] - scores.fid(embedded.real, made)) > 1e-3 * row["fid"]
  # The rest is of the space that sentences share, and the score by CLIP's name is the evaluator's own cosine.
  np.testing.assert_allclose(row["matching"], scores.matching_score(embedded.text, made), rtol=1e-3)
  np.testing.assert_allclose(row["clip_score"], scores.clip_score(embedded.text, made), rtol=1e-3)


def test_pieces_may_be_longer_than_clips(harness):
  """Those of long motions end on the model's own grid."""
  protocol = dataclasses.replace(harness.protocol, max_frames=40)
  short = Harness(protocol, harness.evaluator, None, harness.test_set, seed=1)
  motions = harness.test_set.of(harness.evaluator)[:2]
  frames = np.array([48, 30])
  made = short.embed(harness.evaluator, [x[:m] for x, m in zip(motions, frames)], frames)
  np.testing.assert_allclose(made, harness.embed(harness.evaluator, [x[:m] for x, m in zip(motions, frames)], frames),
                             rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("padding", ["zeros", "decoded"])
def test_what_is_behind_a_motion_does_not_reach_into_it(harness, padding):
  """Headings are smoothed over seconds: features of a motion are made of its own frames alone."""
  evaluator, layout = fresh_evaluator("t2m", "full"), get_layout("coordinates")
  protocol = dataclasses.replace(harness.protocol, made_padding=padding)
  some = Harness(protocol, harness.evaluator, None, harness.test_set, seed=1)
  motion = harness.test_set.of(harness.evaluator)[0]
  count = len(motion) - 4
  wild = np.concatenate([motion[:count], np.random.default_rng(0).normal(size=(4, 66)).astype(np.float32)])
  made, other = some.converted(evaluator, [motion, wild], layout, [count, count])
  np.testing.assert_array_equal(made[:count], other[:count])
  assert len(made) == len(other) == count + 4 * (padding == "decoded")


GOOD = dict(top1=0.5, top2=0.7, top3=0.99, matching=1.0, fid=0.01, clip_score=0.8)


@pytest.mark.parametrize("real, halves, words", [
    ({}, 0.02, None),
    (dict(top3=0.8), 0.02, "real motions find their captions in 80.0 % (top3), shuffled ones in 60.0 %"),
    (dict(matching=2.5), 0.02, "real motions are 2.5 from their captions and 2 from others"),
    (dict(fid=90.0), 0.02, "FID of real against real motions is 90"),
    ({}, 1e9, "of two halves of them 1e+09"),
    (dict(clip_score=0.3), 0.02, "CLIP score of real motions is 0.300, of shuffled captions 0.400"),
    (dict(top1=float("nan")), 0.02, "the real motions' top1 is not finite"),
])
def test_each_sign_of_a_wrong_evaluator_is_reported(harness, monkeypatch, real, halves, words):
  harness.embedded(0)
  monkeypatch.setattr(harness, "count", 10_000)
  monkeypatch.setattr(harness, "protocol", dataclasses.replace(harness.protocol, pool=32))
  monkeypatch.setattr(harness, "real_scores", lambda replication: GOOD | real)
  monkeypatch.setattr(harness, "shuffled_scores", lambda replication: dict(top3=0.6, matching=2.0, clip_score=0.4))
  monkeypatch.setattr(harness, "halves", lambda replication: dict(fid=halves))
  monkeypatch.setattr(sanity.scores, "fid", lambda *given: 100.0)
  found = sanity.check(harness)["failures"]
  assert (not found) if words is None else (len(found) == 1 and words in found[0])


@pytest.mark.parametrize("share, words", [(0.01, None), (0.4, "40 % of random orders .* train one on your data")])
def test_few_clips_are_judged_where_the_evaluator_knows_their_captions(harness, monkeypatch, share, words):
  """Halves of a few clips differ by luck, and shuffled captions may fit by luck: neither says that something is off."""
  monkeypatch.setattr(harness, "real_scores", lambda replication: GOOD)
  monkeypatch.setattr(harness, "shuffled_scores", lambda replication: dict(top3=0.9, matching=0.9, clip_score=0.4))
  monkeypatch.setattr(harness, "halves", lambda replication: dict(fid=1e9))
  monkeypatch.setattr(sanity.scores, "fid", lambda *given: 100.0)
  monkeypatch.setattr(harness, "share_of_nearer_shuffles", lambda replication: share)
  found = sanity.check(harness)
  assert harness.count == 8 and "8 motions are few" in " ".join(found["warnings"])
  assert not found["failures"] if words is None else re.search(words, found["failures"][0])


def test_captions_that_belong_to_their_motions_are_nearer_than_shuffled_ones(harness, monkeypatch):
  embedded = harness.embedded(0)
  monkeypatch.setitem(harness._embedded, 0, dataclasses.replace(embedded, text=embedded.real))
  assert harness.share_of_nearer_shuffles(0) < 0.01
  monkeypatch.setitem(harness._embedded, 0, dataclasses.replace(embedded, text=np.ones_like(embedded.real)))
  assert harness.share_of_nearer_shuffles(0) > 0.3


def test_real_numbers_unlike_the_papers_are_reported(harness, monkeypatch):
  paper = dataclasses.replace(harness.protocol, paper=("cmdm", "2", "CMDM w/ FSS"))
  some = Harness(paper, harness.evaluator, None, harness.test_set, seed=1)
  printed = {name: one["mean"] for name, one in sanity.tables.paper_row("cmdm", "2", "GT").items()}
  assert not sanity._unlike_the_paper(some, GOOD | printed)
  assert "R@3 of real motions is 0.400, the paper prints 0.9" in sanity._unlike_the_paper(some, GOOD | printed | {
      "top3": 0.4})[0]


def test_shuffled_captions_are_all_those_of_their_pools(harness):
  """Any order, so that chance is what an evaluator that knows nothing has; none comes from another pool."""
  given_texts, embed = [], harness.batches
  harness.batches = lambda embedded, *given, **more: given_texts.append(given[3]) or embed(embedded, *given, **more)
  try:
    harness.shuffled_scores(0)
  finally:
    del harness.batches
  text, turned = harness.embedded(0).text, given_texts[0]
  for first in range(0, harness.count, 4):
    pool = slice(first, first + 4)
    assert sorted(map(tuple, text[pool])) == sorted(map(tuple, turned[pool]))
  assert (text != turned).any()


def test_halves_of_the_real_motions_share_none(harness, monkeypatch):
  seen = []
  monkeypatch.setattr("motion_jax.evaluation.harness.scores.fid", lambda a, b: seen.append((a, b)) or 1.0)
  assert harness.halves(0, draws=3)["fid"] == 1.0 and len(seen) == 3
  for a, b in seen:
    assert len(a) == len(b) == 4 and not set(map(tuple, a)) & set(map(tuple, b))


@pytest.mark.parametrize("values, ok, noticed, rest", [
    ([1.1, 2.0, 9.0], True, 0.03, {}), ([0.99, 1.0, 9.0], True, 0.1, {}), ([2.0, 3.0, 9.0], True, 0.01, {}),
    ([2.0, 1.5, 9.0], False, 0.01, {}), ([0.5, 2.0, 9.0], False, 0.03, {}), ([0.9, 0.8, 0.7], False, None, {}),
    # What real motions do from repeat to repeat is nothing: one clip of 320 more than before is no step back.
    ([0.9956, 0.9969, 1.1], False, 0.1, {}), ([0.9956, 0.9969, 1.1], True, 0.1, dict(spread=0.02)),
    ([1.01, 1.015, 1.1], True, 0.1, dict(spread=0.02))])
def test_a_control_says_from_which_level_on_it_is_noticed(values, ok, noticed, rest):
  assert controls._moves(1.0, values, 1, **rest) is ok
  assert controls._moves(-1.0, [-value for value in values], -1, **rest) is ok
  assert controls._noticed(1.0, values, 1, **rest) == noticed
