"""Scores are the references' on recorded features, and what closed forms say they are."""
import re

import numpy as np
import pytest

from motion_jax.control.paths import CURVES
from motion_jax.metrics import accumulate, physics, scores
from motion_jax.metrics.control_scores import control_scores
from tests import fixtures
from tests.golden import check, golden

# The files' own words: counts and draws exact, the rest 1e-5, recorded in float32. Both recorded Frechet distances of
# features in a subspace ("flat") are 1e-6 beside the one that follows from the singular values of the features; ours is
# that to 1e-12.
RECORDED = {"top_k": (0, 0), "": (1e-5, 1e-10)}
DRAWS = [f"{name}/{place}" for name in ("diversity", "mm") for place in ("first", "second")]
README = {"fid_few": (1e-3, 1e-3), "fid": (1e-6, 1e-6), "": (1e-5, 1e-10)}


@golden("scores", leave_out=DRAWS, bounds=RECORDED)
def run_scores(fixture, dtype):
  batches = list(zip(fixture["in/text"], fixture["in/motion"]))
  made = {"top_k": np.stack([scores.hits(scores.distances(t, m)) for t, m in batches]),
          "top_k_cosine": np.stack([scores.hits(scores.cosine_distances(t, m)) for t, m in batches]),
          "matching": np.array([len(t) * scores.matching_score(t, m) for t, m in batches]),
          "distances": scores.distances(*batches[0])}
  for name, real in fixture.under("in/fid/real/").items():
    value = scores.fid(real, fixture[f"in/fid/gen/{name}"])
    made |= {f"fid/value/{name}": value, f"fid/exact/{name}": value}
  for name, score in (("diversity", scores.diversity), ("mm", scores.multimodality)):
    draws = fixture[f"out/{name}/first"], fixture[f"out/{name}/second"]
    made[f"{name}/value"] = score(fixture[f"in/{name}/features"], *draws)
  real, generated = fixture.under("in/joints/real/"), fixture.under("in/joints/made/")
  errors = [scores.joint_errors(real[name], generated[name]) for name in sorted(real, key=int)]
  made |= {f"mpjpe/frames/{i}": error for i, error in enumerate(errors)}
  made |= {"mpjpe/true": scores.mpjpe(errors), "mpjpe/code": scores.released_mpjpe(errors, len(errors))}
  joints = fixture["in/skate/motions"].transpose(0, 3, 1, 2)
  made |= {"skate/ratio": physics.skating_ratio(joints),
           "skate/speed": physics.foot_speed(joints).swapaxes(1, 2)}
  return made


@golden("metrics", bounds=README)
def run_metrics(fixture, dtype):
  text, real, fake = (fixture[f"in/{name}"] for name in ("text", "real", "fake"))
  few = int(re.search(r"\d+", fixture.meta["arrays"]["out/fid_few"]["what"])[0])  # "first 10 samples: .."
  made = {"fid": scores.fid(real, fake), "fid_self": scores.fid(real, real),
          "fid_few": scores.fid(real[:few], fake[:few]),
          "diversity": scores.diversity(real, fixture["in/diversity_first"], fixture["in/diversity_second"]),
          "multimodality": scores.multimodality(fixture["in/repeats"], fixture["in/multi_first"],
                                                fixture["in/multi_second"]),
          "mpjpe": scores.joint_errors(fixture["in/joints_a"], fixture["in/joints_b"])}
  for name, motion in (("real", real), ("fake", fake)):
    made |= {f"{name}/r_precision": scores.r_precision(text, motion), f"{name}/matching":
             scores.matching_score(text, motion)}
  return made


@pytest.mark.parametrize("name", ["cmdm/scores", "cdamd/metrics"])
def test_golden(name):
  assert not check(fixtures.path(f"{name}.npz")).failures


def draw(seed, *shape):
  return np.random.default_rng(seed).normal(size=shape)


def test_frechet_distance_of_gaussians_is_its_closed_form():
  """Covariances with common axes: |m1 - m2|^2 + sum of (root1 - root2)^2, whatever their rank."""
  axes = np.linalg.qr(draw(0, 6, 6))[0]
  mean1, mean2 = draw(1, 6), draw(2, 6)
  for spread1, spread2 in (([4, 3, 2, 1, 0.5, 0.1], [1, 2, 3, 4, 5, 6]), ([2, 1, 0, 0, 0, 0], [0, 0, 3, 1, 0, 0]),
                           ([1e-9, 1, 1, 1, 1, 1e5], [1, 1e-9, 1, 1, 1e5, 1])):
    one, two = (axes * np.square(spread) @ axes.T for spread in (spread1, spread2))
    expected = np.square(mean1 - mean2).sum() + np.square(np.subtract(spread1, spread2)).sum()
    assert scores.frechet_distance(mean1, one, mean2, two) == pytest.approx(expected, rel=1e-10)
  few = draw(3, 10, 24)  # fewer samples than numbers
  assert scores.fid(few, few) == pytest.approx(0, abs=1e-9)


def test_kernel_distance_is_unbiased_and_sees_a_shift():
  """Of 12 rows in 128 dimensions, where a Frechet distance of equal distributions is far from 0."""
  rng = np.random.default_rng(0)
  draw = lambda shift=0.0: rng.normal(size=(12, 128)) + shift
  same, moved = ([scores.kernel_distance(draw(), draw(shift)) for _ in range(40)] for shift in (0.0, 0.5))
  assert abs(np.mean(same)) < 3 * np.std(same) / np.sqrt(40) and np.mean(moved) > 5 * np.std(same)
  assert scores.fid(scores.moments(draw()), draw()) > 50
  one = np.eye(2)  # kernels: (1 / 2 + 1)^3 of a row with itself, 1 of the two
  assert scores.kernel_distance(one, one) == pytest.approx(1 + 1 - 2 * (1.5**3 + 1) / 2)


def test_streaming_moments_are_those_of_the_whole():
  features = draw(0, 101, 7) + 1e3
  chunks = [scores.moments(chunk) for chunk in np.split(features, [1, 2, 40, 41, 90])]
  total = chunks[0]
  for chunk in chunks[1:]:
    total = scores.merge(total, chunk)
  whole = scores.moments(features)
  assert total.count == 101
  np.testing.assert_allclose(total.mean, whole.mean, rtol=1e-14)
  np.testing.assert_allclose(total.covariance, np.cov(features, rowvar=False), rtol=1e-9, atol=1e-12)
  assert scores.fid(total, draw(1, 50, 7)) == pytest.approx(scores.fid(features, draw(1, 50, 7)), rel=1e-12)


def test_r_precision_of_a_perfect_a_random_and_a_collapsed_model():
  text = draw(0, 3200, 16)
  assert scores.r_precision(text, text + 1e-3 * draw(1, 3200, 16)).tolist() == [1, 1, 1]
  expected = np.arange(1, 4) / 32
  deviation = np.sqrt(expected * (1 - expected) / 3200)
  assert (np.abs(scores.r_precision(text, draw(2, 3200, 16)) - expected) < 4 * deviation).all()
  np.testing.assert_allclose(scores.r_precision(text, np.ones((3200, 16))), expected, rtol=1e-12)
  assert scores.r_precision(text[:70], text[:70]).tolist() == [1, 1, 1]  # the last 6 are left out


def test_retrieval():
  similarity = np.eye(12)
  assert set(scores.retrieval(similarity).values()) == {1.0}
  found = scores.retrieval(np.roll(similarity, 1, axis=1) - 0.01 * np.arange(12))
  assert found["r1"] == 0 and found["median_rank"] == 7.5  # one is above, and those to the left
  assert found.keys() == {prefix + name for prefix in ("", "back_")
                          for name in ("r1", "r2", "r3", "r5", "r10", "median_rank")}
  flat = scores.retrieval(np.zeros((12, 12)))
  assert flat["r3"] == pytest.approx(3 / 12) and flat["median_rank"] == 6.5


def test_pairs_are_drawn_without_replacement():
  first, second = scores.draw_pairs(np.random.default_rng(0), 40, 30)
  assert len(set(first)) == len(set(second)) == 30
  with pytest.raises(ValueError, match="50 samples to draw 100"):
    scores.draw_pairs(np.random.default_rng(0), 50, 100)


@pytest.mark.parametrize("call, told", [
    (lambda: scores.r_precision(draw(0, 20, 4), draw(1, 20, 4)), "needs a pool of 32"),
    (lambda: scores.fid(draw(0, 1, 4), draw(1, 6, 4)), "covariance needs 2"),
    (lambda: scores.fid(draw(0, 9, 4), draw(1, 6, 5)), "two of the same evaluator"),
    (lambda: scores.moments(np.diag([1, 1, np.nan])), "row 2 .* NaN"),
    (lambda: scores.retrieval(draw(0, 3, 4)), r"expected \(N, N\)"),
    (lambda: scores.joint_errors(draw(0, 5, 22, 3), draw(0, 6, 22, 3)), "the same frames"),
    (lambda: scores.mpjpe([]), "got no joint errors"),
])
def test_bad_input_is_told(call, told, as_users_run):
  with pytest.raises(ValueError, match=told):
    call()


def test_embeddings_may_pass_in_chunks_and_each_is_as_likely_drawn():
  def passed(chunks, size=50, seed=1):
    rng, state = np.random.default_rng(seed), accumulate.start(size)
    for chunk in chunks:
      state = accumulate.add(state, chunk, rng)
    return state

  rows, other = np.random.default_rng(0).normal(2, 3, (400, 8)), np.random.default_rng(5).normal(size=(300, 8))
  whole, parts = passed([rows]), passed([rows[:7], rows[7:8], rows[8:300], rows[300:]])
  np.testing.assert_array_equal(whole.rows, parts.rows)
  assert scores.fid(parts.moments, scores.moments(other)) == pytest.approx(scores.fid(rows, other), rel=1e-9)
  line = np.arange(40.0)[:, None]
  drawn = np.stack([passed([line[:15], line[15:]], 10, seed).rows[..., 0] for seed in range(400)])
  assert all(len(set(side)) == 10 for draw in drawn for side in draw)
  # Each row is in a quarter of 800 sides: 200, with a standard deviation of 12.3.
  assert abs(np.bincount(drawn.astype(int).ravel(), minlength=40) - 200).max() < 5 * 12.3


def test_the_scores_of_known_distances():
  """Of four motions one is 0.3 m off at one of two points, another 0.6 m at its only one."""
  found = control_scores([np.array([0.0, 0.3]), np.array([0.6]), np.zeros(5), np.full(2, 0.1)])
  assert found == pytest.approx({"trajectory_20": 0.5, "trajectory_50": 0.25, "location_20": 0.2, "location_50": 0.1,
                                 "control_error": (0.15 + 0.6 + 0.1) / 4})
  with pytest.raises(ValueError, match="without a controlled frame"):
    control_scores([np.zeros(3), np.zeros(0)])


def test_curves_begin_ahead_and_a_circle_comes_back():
  """tests/control has their speed and their sides."""
  assert all(curve(20.0)[1, 1] > 0 for curve in CURVES.values())  # towards +Z
  places = CURVES["circle"](20.0)
  np.testing.assert_allclose(places[-1], 0, atol=0.1)
  assert np.ptp(places, axis=0) == pytest.approx([4, 4], abs=0.05)
