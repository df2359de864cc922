"""The scores of timelines: which frames are looked at, and what perfect and random motions get."""
import dataclasses

import numpy as np
import pytest

from motion_jax.data.timelines import Interval
from motion_jax.metrics import scores
from motion_jax.metrics import timeline_scores as ts
from motion_jax.motion import rotations
from tests.metrics.test_physics import still

FIXED = dataclasses.replace(ts.CORRECTED, crop_seconds=1.0)
TIMELINE = [Interval("walk", 0.0, 8.64), Interval("sit", 8.64, 14.76), Interval("wave", 0.47, 4.91)]
TEXTS = ["walk", "sit", "wave", "jump"]


def _mean(motions):
  return np.stack([np.mean(motion, axis=0) for motion in motions])


def test_frames_borders_and_crops():
  assert ts.frames_of(TIMELINE).tolist() == [[0, 172], [172, 295], [9, 98]]
  # All starts and ends are 0, 9, 98, 172, 295; the motion's end is no border.
  assert ts.borders_of(TIMELINE, 295, ts.CORRECTED) == [9, 98, 172]
  assert ts.borders_of(TIMELINE, 294) == [9, 98]  # the released code loses one more
  starts = ts.crop_starts(294)
  np.testing.assert_array_equal(starts, ts.crop_starts(200))  # 263 columns decide, not the length
  assert starts.tolist() == [47, 117, 67, 103, 9]  # numpy's legacy generator with seed 0: randint(0, 163, 5)
  assert ts.crop_starts(2000, ts.CORRECTED).max() > 163


def test_perfect_motions_score_as_real_ones():
  latents = np.eye(4)
  motion = np.zeros((295, 4))
  motion[:172], motion[172:] = latents[0], latents[1]
  timeline = TIMELINE[:2]
  joints = [still(295)]
  row = ts.score([timeline], [motion], joints, _mean, TEXTS, latents, latents, FIXED)
  assert row["crop_top1"] == row["crop_top3"] == 1 and row["transition_distance"] == pytest.approx(0, abs=1e-9)
  assert row["tmr_m2t"] == pytest.approx(1) and row["tmr_m2m"] == pytest.approx(1)
  # Swapped motions are still among the first three of four, and orthogonal: (0 + 1) / 2.
  row = ts.score([timeline], [motion], joints, _mean, TEXTS, latents[[1, 0, 2, 3]], latents, FIXED)
  assert row["crop_top1"] == 0 and row["tmr_m2t"] == pytest.approx(0.5) and row["tmr_m2m"] == pytest.approx(1)


def test_the_real_row_is_one_and_zero_by_definition():
  rng = np.random.default_rng(0)
  latents, texts = rng.normal(size=(4, 6)), rng.normal(size=(4, 6))
  joints = [still(n) for n in (40, 50, 60, 70)]
  joints[0][10:, 15] += [0, 0.44, 0]  # at a quarter of 40 frames; 12 borders in all
  row = ts.real_row(TEXTS, texts, latents, joints)
  assert row["tmr_m2m"] == pytest.approx(1) and row["fid"] == pytest.approx(0, abs=1e-9)
  assert row["transition_distance"] == pytest.approx(0.44 / 22 / 12)
  own = scores.cosines(latents, texts)
  assert row["tmr_m2t"] == pytest.approx((np.diagonal(own).mean() + 1) / 2)
  assert row["crop_top1"] == pytest.approx(np.mean(own.argmax(1) == np.arange(4)))


def test_fid_is_of_directions():
  rng = np.random.default_rng(2)
  latents = rng.normal(size=(4, 3))
  motion = rng.normal(size=(295, 3))
  joints = [still(295)]
  row = lambda scale: ts.score([TIMELINE], [motion * scale], joints, _mean, TEXTS, latents, latents, FIXED)
  assert row(7.0)["fid"] == pytest.approx(row(1.0)["fid"])
  starts = ts.crop_starts(295, FIXED)
  made = scores.units(_mean([motion[start:start + 20] for start in starts]))
  assert row(1.0)["fid"] == pytest.approx(scores.fid(scores.units(latents), made))


def test_released_steps_measure_x_and_the_path():
  joints = still(30)
  joints[..., 2] += 0.05 * np.arange(30)[:, None]  # a body that glides ahead by 5 cm a frame
  turned = rotations.rotate(rotations.about_axis(np.full(30, 0.7), "y")[:, None], joints)
  np.testing.assert_allclose(ts.released_steps(turned, [10, 20]), 0.05, atol=1e-5)  # features face ahead
  row, features = {}, np.ones((30, 263))
  for slipped in (True, False):
    protocol = dataclasses.replace(ts.CORRECTED, crop_seconds=1.0, slipped_axis=slipped)
    row[slipped] = ts.score([[Interval("walk", 0, 1), Interval("sit", 1, 1.5)]], [features], [joints], _mean, TEXTS,
                            np.eye(4, 263), np.eye(4, 263), protocol)["transition_distance"]
  assert row[True] == pytest.approx(0.05, abs=1e-5) and row[False] == pytest.approx(0, abs=1e-9)


def test_bad_input():
  motion, joints, latents = np.ones((295, 4)), still(295), np.eye(4)
  go = lambda timeline=TIMELINE, motion=motion, texts=TEXTS, latents=latents: ts.score(
      [timeline], [motion], [joints], _mean, texts, latents, latents, FIXED)
  with pytest.raises(ValueError, match="'run', which is not among the 4 texts"):
    go(timeline=[Interval("run", 0, 4)])
  with pytest.raises(ValueError, match="'sit' begins at frame 172, the motion has 100"):
    go(motion=motion[:100])
