"""Reconstruction, editing, long motions and timelines: small runs of each from data to rows."""
import dataclasses
import json
import shutil
import types

import numpy as np
import pytest

from motion_jax.control import paths
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.evaluation import protocols, request, samples
from motion_jax.evaluation import test_set as test_set_lib
from motion_jax.evaluation.candidates import Candidate
from motion_jax.evaluation.harness import Harness
from motion_jax.evaluation.request import Request
from motion_jax.evaluation.tasks import control, long_horizon
from motion_jax.evaluation.tasks.editing import editor
from motion_jax.evaluators.evaluator import fresh_evaluator
from motion_jax.metrics import long_horizon as long_horizon_lib
from motion_jax.models.cdamd.options import CdamdSampling
from motion_jax.models.cmdm import multi_prompt
from motion_jax.motion.representations import get_layout, to_joints
from motion_jax.motion.skeleton import HUMANML3D
from tests.conftest import load_config
from tests.evaluation.small import judged, small, two_captions


@pytest.mark.slow
def test_reconstruction(tiny_run, archive, evaluator, tmp_path):
  result = judged([tiny_run], [archive], small("reconstruction"), evaluator, tmp_path, controls=True)
  row = {name: one["mean"] for name, one in result.rows[tiny_run.name].items()}
  assert {"mpjpe", "mpjpe_heading", "released_mpjpe", "fid"} <= set(result.metrics) and row["mpjpe"] > 0
  # By the released code: metres, of sums over frames divided by the pool.
  assert 40 < row["released_mpjpe"] * 4 / (row["mpjpe"] / 1000) < 50
  errors = [one for one in result.controls["expected"] if one["metric"].endswith("mpjpe")]
  assert len(errors) == 2 and all(one["ok"] and one["real"] == 0 and one["noticed"] == 0.01 for one in errors)
  # The mean length of a draw in three dimensions, against a root with noise of its own, which is one of 22 joints.
  assert errors[0]["values"][0] == pytest.approx(10 * (2 * 8 / np.pi) ** 0.5 * 21 / 22, rel=0.02)


@pytest.mark.slow
def test_editing(tiny_generator, archive, evaluator, tmp_path):
  """The edits of four tasks, with what was kept pasted back: then nothing but the new frames differs."""
  folder = shutil.copytree(tiny_generator, tmp_path / "generator")
  result = judged([folder], [archive], small("editing", paste=True), evaluator, tmp_path / "out")
  assert result.row_order == ["real", *(f"{task}: generator" for task in (
      "inpainting", "outpainting", "prefix", "suffix"))]
  store = next((folder / "eval" / "samples").glob("*/prefix_r000_b000.npz"))
  with np.load(store) as file:
    edited, count = file["features"][:file["start"][1]], int(file["frames"][0])
  test_set = test_set_lib.read_test_set([archive], small("editing", layouts=()).on("archive"), [evaluator])
  half = count // 2 // 4 * 4
  kept = [np.abs(x[s:s + half] - edited[:half]).max() for x in test_set.of(evaluator) for s in range(len(x) - half + 1)]
  assert min(kept) < 1e-4 and min(np.abs(x[:count] - edited[:count]).max() for x in test_set.of(evaluator)) > 1e-3


def test_a_model_edits_with_the_mask_that_it_samples_with():
  """MARDM's is not CDAMD's."""
  edits = lambda clips, prompts, task, **given: types.SimpleNamespace(decoded=masks.append(given["mask"]) or [])
  masks, config = [], load_config("cdamd_generator", "mardm")
  model = types.SimpleNamespace(config=config, options=CdamdSampling, edits=edits)
  for options in ({}, {"mask": "bcm"}):
    candidate = Candidate("mardm", model, "", None, options=options)
    editor(candidate, protocols.get_protocol("editing"), [], "prefix")(samples.Jobs([], [], [], []))
  assert masks == ["bidirectional", "bcm"]


@pytest.mark.slow
def test_long_motions(tiny_run, archive, evaluator, tmp_path):
  protocol = small("long-horizon", sequences=2, segments=3, transition_frames=20, real_jerk=None)
  result = judged([tiny_run], [archive], protocol, evaluator, tmp_path, sampling=dict(num_steps=2), controls=True)
  spliced = {one["metric"]: one["ok"] for one in result.controls["expected"] if one["control"] == "spliced"}
  assert spliced == dict.fromkeys(("transition_fid", "transition_kid", "transition_distance", "peak_jerk", "auj"), True)
  for name in ("real", tiny_run.name):
    assert set(long_horizon.LongHorizon.METRICS) <= set(result.rows[name])
  assert result.rows["real"]["fid"]["mean"] == pytest.approx(0, abs=1e-6)
  assert any("of 4 transitions" in note and "transition KID" in note for note in result.notes)
  assert len(result.curves[f"jerk across transitions, {tiny_run.name}"]["y"]) == 17


def test_prompt_sequences_of_a_file(archive, evaluator, tmp_path):
  """FlowMDM's list: its captions and lengths, in the order of its ids, cut to whole units."""
  path = tmp_path / "sequences.json"
  path.write_text(json.dumps([dict(id="10", lengths=[70, 64, 33], text=["c", "d", "e"]),
                              dict(id="2", lengths=[101, 80], text=["a person walks", "b"], scenario="long")]))
  resolved = request.resolve(Request([], [str(path), archive]))
  folders, protocol = resolved.folders, resolved.protocol
  assert protocol.name == "long-horizon" and protocol.note == "" and folders == (archive,) and resolved.whole
  harness = Harness(dataclasses.replace(protocol, pool=4, min_frames=24), evaluator, None, test_set_lib.read_test_set(
      folders, dataclasses.replace(protocol, min_frames=24), [evaluator]), seed=0)
  task = long_horizon.LongHorizon(harness)
  first, second = task.sequences()
  assert first.captions == ["a person walks", "b"] and first.frames.tolist() == [100, 80]
  assert second.captions == ["c", "d", "e"] and second.frames.tolist() == [68, 64, 32]
  assert len(task._file_hash) == 68
  with pytest.raises(ValueError, match="is a file, protocol 'archives-66' takes data folders alone"):
    request.resolve(Request([], [str(path), archive], "archives-66"))


@pytest.mark.parametrize("options, shown", [
    ({}, False), (dict(way="chain", cleanup=True), True), (dict(ease=True), True)])
def test_long_motions_may_be_judged_as_they_are_shown(options, shown):
  """What is cleaned up or eased are joints, of which the features that are judged are then computed: bones that drift
  and feet in the floor come out of them as they went in, but for where the body begins."""
  joints = synthetic_joints("walk", 40, np.random.default_rng(0)) * np.linspace(0.9, 1.1, 40)[:, None, None]
  joints, calls = long_horizon_lib.placed(joints - [0, 0.03, 0], HUMANML3D), []

  def multi_prompts(lists, **given):
    calls.append(given)
    return [types.SimpleNamespace(joints=joints.astype(np.float32), features=None) for _ in lists]

  model = types.SimpleNamespace(
      multi_prompts=multi_prompts, more_choices=(), stats=types.SimpleNamespace(layout=get_layout("full")),
      config=types.SimpleNamespace(data=types.SimpleNamespace(mode="corrected")))
  make = long_horizon.multi_prompt_generator(types.SimpleNamespace(model=model, guidance_scale=2.0), [["a"]], options)
  (made,) = make(types.SimpleNamespace(places=[0], seeds=[7]))
  assert calls == [dict(guidance_scale=2.0, seeds=[7]) | options]
  assert made is None if not shown else made.shape == (40, 263)
  if shown:
    found = to_joints(made, get_layout("full")).astype(float)
    np.testing.assert_allclose(long_horizon_lib.placed(found, HUMANML3D), joints, atol=1e-4)


@pytest.mark.parametrize("way, unit, latent, expected", [
    ("chain", 24, 8, [96, 64, 8]), ("chain", 12, 4, [100, 64, 4]), ("stream", 12, 4, None)])
def test_pieces_are_as_long_as_the_model_makes_them(way, unit, latent, expected):
  """Latents of 8 frames are whole, too: a model asked for 100 frames makes 96."""
  made = multi_prompt.segment_frames([100, 64, 6], way, unit, latent)
  assert made == expected if expected else sum(made) == 170


@pytest.mark.slow
def test_timelines(tiny_run, archive, tmp_path):
  evaluator = fresh_evaluator("tmr")
  first, second = two_captions()
  path = tmp_path / "timelines.txt"
  path.write_text(f"{first} # 0.0 # 3.0\n{second} # 3.0 # 7.0\n\n{second} # 0.0 # 4.0\n{first} # 4.0 # 8.0\n")
  protocol = small("mtt", released_slips=False, layouts=())
  result = judged([tiny_run], [path, archive], protocol, evaluator, tmp_path, sampling=dict(num_steps=2))
  assert {"crop_top1", "tmr_m2t", "transition_distance"} <= set(result.rows[tiny_run.name])
  assert request.guess_protocol([tiny_run], [path, archive]) == "mtt"
  path.write_text("somebody juggles # 0.0 # 3.0\n")
  with pytest.raises(ValueError, match="1 of 1 texts of the timelines are no caption of the data"):
    judged([tiny_run], [path, archive], protocol, evaluator, tmp_path)


@pytest.mark.slow
@pytest.mark.parametrize("more", [{}, pytest.param(dict(exact=True), marks=pytest.mark.exhaustive)], ids=["", "exact"])
def test_control(tiny_run, archive, evaluator, tmp_path, monkeypatch, more):
  """Rows of the joints that are asked for, of each curve, and of the same model asked for nothing, which is farther
  off; what features computed of exact joints change is in a row of its own. Two densities and one short curve: each
  length is compiled."""
  monkeypatch.setattr(control, "DENSITIES", (1, 100))
  monkeypatch.setattr(paths, "CURVES", {"circle": lambda fps: paths.circle(fps)[:48]})
  result = judged([tiny_run], [archive], small("control"), evaluator, tmp_path, limit=4,
                  sampling=dict(num_steps=2, joints="pelvis") | more)
  rows = {name: {key: one["mean"] for key, one in row.items()} for name, row in result.rows.items()}
  name = tiny_run.name
  assert {f"{part}: {name}" for part in ("unconstrained", "pelvis", *paths.CURVES)} <= set(rows)
  assert rows["real"]["control_error"] == 0 and rows[f"circle: {name}"]["top_speed"] > 0
  assert rows[f"pelvis: {name}"]["control_error"] < rows[f"unconstrained: {name}"]["control_error"]
  assert {"trajectory_20", "location_50", "control_error", "skating", "fid", "top3"} <= set(result.metrics)
  if more:
    assert all(rows[f"{part}: {name}"]["control_error"] < 1e-3 for part in ("pelvis", "circle"))
    assert rows[f"unconstrained, from joints: {name}"]["fid"] != rows[f"unconstrained: {name}"]["fid"]
  with pytest.raises(ValueError, match="got the joint 'nose', expected all, or some of pelvis"):
    judged([tiny_run], [archive], small("control"), evaluator, tmp_path / "b", limit=4,
           sampling=dict(num_steps=2, joints="nose"))
