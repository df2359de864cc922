"""Long motions of SnapMoGen: real recordings say what is made, and are what it is held against, in centimetres."""
import dataclasses
import types

import numpy as np
import pytest

from motion_jax.data.clip import Caption
from motion_jax.data.datasets.snapmogen import GAP, Span, longest_sequence, recordings, write_folder
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.evaluation import protocols
from motion_jax.evaluation.harness import Harness
from motion_jax.evaluation.request import Request, Resolved
from motion_jax.evaluation.run import read_for
from motion_jax.evaluation.tasks.long_horizon import LongHorizon
from motion_jax.evaluators.evaluator import fresh_evaluator
from motion_jax.metrics import long_horizon as long_horizon_lib
from motion_jax.metrics import physics
from motion_jax.models.cmdm import multi_prompt
from motion_jax.models.cmdm.options import WAYS
from motion_jax.motion.representations import get_layout, to_joints
from motion_jax.motion.skeleton import SNAPMOGEN

ROWS, PIECES = 64, 6  # of a recording


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
  """Two recordings of six motions in a row, one of five, one of six that overlap."""
  clips = synthetic_clips(1, 4, num_frames=268, skeleton=SNAPMOGEN)  # 401 rows at 30 a second
  spans = {i: [(ROWS * k, ROWS * (k + 1)) for k in range(PIECES - (i == 2))] for i in range(3)}
  spans[3] = [(50 * k, 50 * k + ROWS) for k in range(PIECES)]
  made = [clip.replace(split="test", captions=tuple(
      Caption(f"motion {k} of {clip.id}", start / 30, end / 30) for k, (start, end) in enumerate(spans[i])))
      for i, clip in enumerate(clips)]
  return write_folder(made, tmp_path_factory.mktemp("data") / "SnapMoGen")


@pytest.fixture(scope="module")
def task(folder):
  protocol = dataclasses.replace(protocols.get_protocol("snapmogen-long"), pool=4, diversity_draws=6, few_draws=4,
                                 transition_frames=20)
  evaluator = fresh_evaluator("snapmogen", "snapmogen_148")
  test_set = read_for(Resolved(Request(), (folder,), protocol, None, True), evaluator)
  return LongHorizon(Harness(protocol, evaluator, None, test_set, seed=0))


def test_motions_in_a_row_are_the_longest_chain_without_overlap():
  spans = [Span("a", *ends) for ends in ((0, 90), (90, 200), (100, 130), (200 + GAP, 300), (301 + GAP, 400), (0, 90),
                                         (260, 500))]
  assert [span[1:] for span in longest_sequence(spans)] == [(0, 90), (90, 200), (230, 300)]
  assert [span[1:] for span in longest_sequence(spans, gap=GAP + 1)] == [(0, 90), (90, 200), (230, 300), (331, 400)]
  assert [span[1:] for span in longest_sequence(spans, gap=0)] == [(0, 90), (90, 200)] and longest_sequence([]) == []


@pytest.mark.slow
def test_only_recordings_of_more_than_five_motions_are_taken(folder):
  found = recordings(folder)
  assert [[item.id for item in pieces] for pieces in found] == [
      [f"00000{i}#{ROWS * k}#{ROWS * (k + 1)}" for k in range(PIECES)] for i in range(2)]
  whole = np.load(folder / "renamed_feats" / "000001.npy")
  np.testing.assert_array_equal(np.concatenate([item.features for item in found[1]]), whole[:ROWS * PIECES])
  assert len(recordings(folder, more_than=4)) == 3 and recordings(folder, shortest=ROWS + 1) == []
  assert [len(pieces) for pieces in recordings(folder, more_than=2)] == [6, 6, 5]  # of the fourth no two


class Recorder:
  """A model that makes what was recorded, or `changed` of it."""
  fps, ways = 30.0, WAYS
  stats = types.SimpleNamespace(layout=get_layout("snapmogen"))
  config, more_choices = types.SimpleNamespace(data=types.SimpleNamespace(mode="benchmark")), ()

  def __init__(self, folder, changed=lambda x: x):
    self.made = [changed(np.concatenate([item.features for item in pieces])) for pieces in recordings(folder)]
    self.asked = []

  def can(self, ability):
    return ability == "multi_prompt"

  def segment_frames(self, frames, way):
    return multi_prompt.segment_frames(frames, way, 12, 4)

  def multi_prompts(self, sequences, seeds, guidance_scale, way):
    self.asked += sequences
    return [types.SimpleNamespace(features=made) for made in self.made[:len(sequences)]]


def candidate_of(model):
  sample = lambda make, store, name, jobs, what, batch: make(jobs)
  return types.SimpleNamespace(model=model, options={}, sample=sample, store=lambda harness, kind: None, name="it",
                               guidance_scale=None)


@pytest.mark.slow
def test_what_was_recorded_has_the_real_row(folder, task):
  real = task.real(0).rows["real"]
  model = Recorder(folder)
  made = task.score(candidate_of(model), 0).rows[""]
  assert set(real) == set(made) == set(task.METRICS)
  for name in task.METRICS:
    assert made[name] == pytest.approx(real[name], rel=1e-4, abs=1e-4), name
  assert real["fid"] == pytest.approx(0, abs=1e-7) and real["transition_fid"] == pytest.approx(0, abs=1e-7)
  asked = [[caption for caption, _ in prompts] for prompts in model.asked]
  assert asked == [[f"motion {k} of 00000{i}" for k in range(PIECES)] for i in range(2)]
  assert [seconds for _, seconds in model.asked[0]] == pytest.approx([ROWS / 30] * PIECES)
  assert len(task._chosen) == 2 and "Of 2 recordings, where the protocol wants 128" in task.notes[0]
  other = task.score(candidate_of(Recorder(folder, lambda x: x[::-1])), 0).rows[""]
  assert other["fid"] > 1e-6 and other["transition_fid"] > 1e-6  # of an evaluator that has learned nothing


@pytest.mark.slow
def test_jerk_is_in_centimetres_from_the_level_that_the_paper_has(folder, task):
  row = task.real(0).rows["real"]
  jerks = []
  for pieces in recordings(folder):
    joints = np.float64(to_joints(np.concatenate([item.features for item in pieces]), "snapmogen"))  # centimetres
    cut = physics.cut_transitions(joints, ROWS * np.arange(1, PIECES), 20)
    jerks += [physics.jerk(long_horizon_lib.placed(one, SNAPMOGEN)) for one in cut]
  curve = np.mean(jerks, 0)
  assert row["peak_jerk"] == pytest.approx(curve.max(), rel=1e-5)
  assert row["auj"] == pytest.approx(np.abs(curve - physics.REAL_JERK["humanml3d"]).sum(), rel=1e-5)
