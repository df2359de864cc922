"""Motions that another program made are read from its files; see test_run.py for how they are judged."""
import dataclasses
import json
import re
import types

import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.evaluation import external, run
from motion_jax.evaluation.harness import Harness
from motion_jax.evaluation.request import Request, resolve
from motion_jax.evaluation.result import HALVES
from motion_jax.evaluation.tasks import control
from motion_jax.evaluation.tasks.editing import kept_spans
from motion_jax.evaluators.evaluator import fresh_evaluator
from motion_jax.motion.representations import get_layout, to_features, to_joints
from tests.evaluation.small import judged, small, two_captions


def read_back(folder, evaluator, x, count, **options):
  """(features of a motion that another program wrote, its `ExternalMotions`)."""
  (folder / "r000").mkdir(parents=True)
  np.save(folder / "r000" / "00000.npy", x)
  candidate = external.load_external(folder.name, folder, evaluator, **options)
  return candidate.sample(None, None, "r000", types.SimpleNamespace(frames=[count]), "")[0], candidate


def test_joints_may_lie_anywhere(tmp_path, evaluator):
  layout, joints = get_layout("coordinates"), synthetic_clips(num=2, num_frames=20)[1].joints
  turned = joints[..., [2, 1, 0]] * [1, 1, -1] + [3, 0, -2]
  read = [read_back(tmp_path / name, evaluator, x, 12)[0]
          for name, x in (("a", joints), ("b", turned), ("c", turned.reshape(20, 66)))]
  assert read[0].shape == (16, 66) and max(np.abs(read[0] - other).max() for other in read[1:]) < 1e-5
  root = to_joints(read[0], layout)[0, 0]
  assert np.abs(root[[0, 2]]).max() < 1e-6 and root[1] == pytest.approx(joints[0, 0, 1])


@pytest.mark.parametrize("mode, size, floor, words", [
    ("benchmark", 0.9, 0.3, r"4\.\d cm a bone \(\w+\) and 30\.\d"),
    ("corrected", 0.9, 0, r"4\.\d cm a bone \(\w+\) and 0\.0"),
    ("corrected", 1, 0.3, r"0\.0 cm a bone \(\w+\) and 30\.\d")])
def test_other_bones_and_floors_are_retargeted_as_those_of_real_motions(tmp_path, evaluator, mode, size, floor, words):
  """A body of another size or floor, with zeros after its end."""
  evaluator = dataclasses.replace(evaluator, mode=mode)
  joints = size * synthetic_clips(num=2, num_frames=60)[1].joints.astype(np.float64) + [2, floor, 1]
  real = to_features(joints - [0, floor, 0], "coordinates", mode)
  padded = np.concatenate([joints[:48], np.zeros((10, 22, 3))]).astype(np.float32)
  made, candidate = read_back(tmp_path / "theirs", evaluator, padded, 48, tail=0)
  assert made.shape == (48, 66) and np.abs(made - real[:48]).max() < 0.02
  sunken = joints - np.where(np.arange(60) < 48, 0, 0.5)[:, None, None] * [0, 1, 0]
  for name, x, rows in (("zeros", padded, 48), ("sunken", sunken, 52)):  # what a decoder makes after the end
    after, _ = read_back(tmp_path / name, evaluator, x, 48)
    assert after.shape == (rows, 66) and np.abs(after[:48] - made).max() < 1e-6
  assert re.search(rf"theirs: joints differ .* by up to {words} cm at the floor; retargeted", candidate.note)
  assert candidate.about["retargeted"] is True
  left, candidate = read_back(tmp_path / "left", evaluator, joints, 48, as_given=True)
  np.testing.assert_allclose(np.ptp(left[:48, 1::3]), np.ptp(joints[:48, :, 1]), atol=1e-4)  # at its own size
  assert "left as given" in candidate.note and candidate.about["sampling"] == {"as_given": True}
  fitting, candidate = read_back(tmp_path / "fits", evaluator, joints, 48, moved=False)
  np.testing.assert_allclose(fitting, joints[:52].reshape(52, 66), atol=1e-6)
  assert "left as given" in candidate.note
  exported, candidate = read_back(tmp_path / "exported", evaluator, real, 48)
  assert not candidate.note and not candidate.retargeted


@pytest.mark.parametrize("x, words", [
    (np.zeros((11, 66)), "got 11 frames, expected 12"), (np.full((12, 66), np.nan), "holds NaN"),
    (np.zeros((12, 5)), r"got an array of shape \(12, 5\), expected \(frames, 66\) as in the first file, or joints"),
    (100 * synthetic_clips(num=2, num_frames=12)[1].joints, "bones are .* times as long .* in centimetres"),
])
def test_what_cannot_be_judged_is_refused(tmp_path, evaluator, x, words):
  with pytest.raises(FileNotFoundError, match="holds no motions: expected files such as r000/00000.npy"):
    external.load_external("a", tmp_path, evaluator)
  (tmp_path / "r000").mkdir()
  np.save(tmp_path / "r000" / "00000.npy", synthetic_clips(num=1, num_frames=12)[0].joints.reshape(12, 66))
  np.save(tmp_path / "r000" / "00001.npy", x)
  candidate = external.load_external("a", tmp_path, evaluator)
  with pytest.raises(ValueError, match=f"00001.npy.*{words}"):
    candidate.sample(None, None, "r000", types.SimpleNamespace(frames=[12, 12]), "")


# --- what each task wants, and what it makes of it -----------------------------------------------------------------


def prompts_of(folder, data, protocol, evaluator):
  """The lines of prompts.jsonl."""
  run.export_prompts(Request((), data, protocol, evaluator=evaluator), folder)
  return [json.loads(line) for line in (folder / "prompts.jsonl").read_text().splitlines()]


def save(folder, line, joints):
  (folder / line["file"]).parent.mkdir(exist_ok=True)
  np.save(folder / line["file"], joints)


def rows(folder, data, protocol, evaluator):
  """{row: {metric: number}} of the motions in a folder."""
  result = judged([], data, protocol, evaluator, folder / "out", motions=[("theirs", folder)])
  return {row: {metric: one["mean"] for metric, one in metrics.items()} for row, metrics in result.rows.items()}


@pytest.mark.parametrize("name, names", [
    ("reconstruction", ["theirs"]),
    ("editing", [f"{task}: theirs" for task in ("inpainting", "outpainting", "prefix", "suffix")])])
def test_real_motions_that_come_back_as_they_were_are_perfect(tmp_path, archive, evaluator, name, names):
  protocol = small(name)
  lines = prompts_of(tmp_path, [archive], protocol, evaluator)
  assert len(lines) == 8 * len(names) and all(line["motion"].startswith("real_r000/") for line in lines)
  page = (tmp_path / "README.md").read_text()
  assert f"--protocol {name} --motions NAME=THIS_FOLDER --evaluator fresh-t2m\n" in page and "`motion`" in page
  assert "pelvis, left_hip, right_hip" in page and "left_knee 0.394" in page and "of 1 replication(s)" in page
  for line in lines:
    joints = np.load(tmp_path / line["motion"])
    assert joints.shape == (line["frames"], 22, 3)
    save(tmp_path, line, joints)
  found = rows(tmp_path, [archive], protocol, evaluator)
  assert set(found) == {"real", HALVES, "shuffled", *names}
  for row in names:
    assert found[row]["fid"] == pytest.approx(0, abs=1e-4)
    assert found[row]["top1"] == pytest.approx(found["real"]["top1"])
  if name == "reconstruction":
    assert found["theirs"]["mpjpe"] < 1e-3 and found["theirs"]["mpjpe_heading"] < 1e-3


def test_a_task_of_editing_may_be_left_out_but_not_all(tmp_path, archive, evaluator):
  protocol = small("editing")
  lines = prompts_of(tmp_path, [archive], protocol, evaluator)
  with pytest.raises(FileNotFoundError, match="holds no motions: expected files"):
    rows(tmp_path, [archive], protocol, evaluator)
  for line in lines:
    if line["task"] == "prefix":
      assert line["keep"] == kept_spans("prefix", line["frames"])
      save(tmp_path, line, np.load(tmp_path / line["motion"]))
  assert set(rows(tmp_path, [archive], protocol, evaluator)) == {"real", HALVES, "shuffled", "prefix: theirs"}


@pytest.mark.parametrize("task, spans", [("inpainting", [[0, 12], [36, 48]]), ("suffix", [[24, 48]])])
def test_frames_to_keep_are_those_that_our_own_edits_keep(task, spans):
  assert kept_spans(task, 48) == spans


def test_control_of_other_programs(tmp_path, archive, evaluator, monkeypatch):
  """Real motions are where they are wanted; a joint and paths that were not made are left out."""
  monkeypatch.setattr(control, "DENSITIES", (1, 25))
  protocol = small("control")
  lines = prompts_of(tmp_path, [archive], protocol, evaluator)
  assert {line.get("control", {}).get("joint") for line in lines} == {None, *control.JOINTS}
  reader = external.joint_reader(evaluator)
  resolved = resolve(Request((), [archive], protocol))
  test_set = run.read_for(resolved, evaluator, readers=[reader])
  task = control.Control(Harness(resolved.protocol, evaluator, None, test_set, protocol.seed))
  real = task._real_joints(reader, 0)
  for line in lines:
    folder, place = line["file"].split("/")
    if folder == "r000" or folder.startswith("head_"):
      joints = real[int(place[:5])]
      if "control" in line:
        wanted = np.array(line["control"]["positions"])
        np.testing.assert_allclose(joints[line["control"]["frames"], 15], wanted, atol=1e-5)
      save(tmp_path, line, joints)
  found = rows(tmp_path, [archive], protocol, evaluator)
  assert set(found) == {"real", "unconstrained: theirs", "head: theirs"}
  assert found["head: theirs"]["control_error"] < 1e-4 and found["head: theirs"]["fid"] < 0.05
  for line in lines:
    if line["file"].startswith("head_"):
      assert len(line["control"]["frames"]) == (1 if line["file"].startswith("head_1_") else line["frames"] // 4)
  path, = {json.dumps(line["control"]) for line in lines if line["file"].startswith("circle_")}
  assert json.loads(path)["positions"][5][1] is None


@pytest.mark.slow
@pytest.mark.parametrize("name, kind, changes, metrics", [
    ("long-horizon", "t2m", dict(sequences=2, segments=3, transition_frames=20, real_jerk=None), {"auj", "fid"}),
    ("mtt", "tmr", dict(released_slips=False, layouts=()), {"crop_top1", "tmr_m2t"})])
def test_motions_of_several_prompts_of_other_programs(tmp_path, archive, name, kind, changes, metrics):
  evaluator, protocol = fresh_evaluator(kind), small(name, **changes)
  first, second = two_captions()
  timelines = tmp_path / "timelines.txt"
  timelines.write_text(f"{first} # 0.0 # 3.0 # legs\n{second} # 2.0 # 7.0 # left arm\n")
  data = [timelines, archive] if name == "mtt" else [archive]
  lines = prompts_of(tmp_path, data, protocol, evaluator)
  for line in lines:
    assert line["frames"] == sum(segment["frames"] for segment in line["segments"])
    save(tmp_path, line, np.resize(synthetic_clips(num=1, num_frames=60)[0].joints, (line["frames"], 22, 3)))
  if name == "mtt":
    (line,) = lines
    assert line["timeline"][1] == {"text": second, "start": 2.0, "end": 7.0, "parts": ["left arm"]}
    assert line["frames"] == 140
  else:
    assert [len(line["segments"]) for line in lines] == [3, 3]
  assert metrics <= set(rows(tmp_path, data, protocol, evaluator)["theirs"])
