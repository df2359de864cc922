"""A project makes the same motion with the page and without it; one that is cut is told in a line."""
import json

import numpy as np
import pytest

from motion_jax import export
from motion_jax.utils.errors import InputError
from motion_jax_studio import cli
from motion_jax_studio.server import library as model_library
from motion_jax_studio.server import project, serialization
from motion_jax_studio.server.limits import Limits
from tests.studio.server.conftest import refusal
from tests.studio.server.test_requests import joints_of

PROJECT = {"format": "motion_jax project", "version": 1, "model": {"name": "tiny", "id": ""},
           "blocks": [{"prompt": "a person walks", "seconds": 2.4}, {"prompt": "a person waves", "seconds": 1.2}],
           "seeds": [4, 9], "chosen": 1, "sampling": {"num_steps": 4}}


def test_a_project_is_what_its_requests_make(client, library):
  found = client.post("/v1/project", json=PROJECT).json()
  assert found == PROJECT | {"cleanup": True, "past": None, "control": None, "edits": [], "without": []}
  made = project.generate(found, library, Limits())
  body = {"segments": found["blocks"], "sampling": found["sampling"], "seed": 9, "model": "tiny"}
  asked = client.post("/v1/multi-prompt", json=body)
  assert (joints_of(asked.json()["motion"]) == made.joints).all()
  other = project.generate(found, library, Limits(), take=0)
  assert other.meta["seed"] == 4 and not (other.joints == made.joints).all()
  with pytest.raises(InputError, match="got the take 2"):
    project.generate(found, library, Limits(), take=2)


def test_edits_are_done_in_their_order(library, monkeypatch):
  asked = []
  monkeypatch.setattr(project, "make_edit", lambda pipeline, clip, *rest: (
      asked.append((pipeline.model.id, *rest)), clip)[1])
  edit = {"prompt": "a person kicks", "change": [[8, 16]], "seed": 2, "model": {"name": "editor", "id": "old@1234"}}
  notes = []
  edits = [edit | {"take": 1}, edit | {"take": 0}, edit | {"take": 1, "seed": 3}]
  project.generate(project.validate(PROJECT | {"edits": edits}, Limits()), library, Limits(), notify=notes.append)
  assert [row[4] for row in asked] == [2, 3] and asked[0][2] == [(8, 16)]
  assert "made with old@1234" in notes[0]


@pytest.mark.slow
def test_keys_of_an_edit_are_met_by_its_motion(client, library):
  """By the request of the page and by the saved project; the other frames are equal."""
  motion = project.generate(project.validate(PROJECT, Limits()), library, Limits())
  aim = (motion.joints[20, 20] + [0.02, 0.05, 0.03]).round(4).tolist()
  key = {"type": "effector", "joint": "left_wrist", "times": [1.0], "positions": [aim]}
  keys = {"version": 1, "constraints": [key]}
  edit = {"prompt": "a person kicks", "change": [[12, 30]], "seed": 2, "control": keys}
  edits = [edit | {"take": 1, "model": {"name": "editor"}}]
  saved = client.post("/v1/project", json=PROJECT | {"edits": edits}).json()
  assert saved["edits"][0]["control"] == keys
  made = project.generate(saved, library, Limits()).joints
  reply = client.post("/v1/edit", json=edit | {"motion": serialization.to_json(motion), "model": "editor"}).json()
  assert (joints_of(reply["motion"]) == made).all() and reply["constraints"]["off"]["worst"] < 1
  kept = [*range(12), *range(30, len(made))]
  assert (made[kept] == motion.joints[kept]).all() and np.abs(made[20, 20] - aim).max() < 1e-3
  late = edit | {"change": [[25, 40]], "motion": serialization.to_json(motion), "model": "editor"}
  assert "a key of left wrist at 1.00 s (frame 20), which is not among" in refusal(client.post("/v1/edit", json=late))


def test_steps_of_a_project_are_left_out_of_its_blocks_and_edits(library, monkeypatch):
  given = []
  monkeypatch.setattr(project, "make_edit", lambda pipeline, clip, *rest: (given.append(rest[-2]), clip)[1])
  edit = {"prompt": "a person kicks", "change": [[8, 16]], "take": 1, "model": {"name": "editor", "id": ""}}
  checked = project.validate(PROJECT | {"without": ["plan", "check"], "edits": [edit]}, Limits())
  assert checked["without"] == ["plan", "check"]
  motion = project.generate(checked, library, Limits())
  assert [row["step"] for row in motion.meta["steps"]] == ["sample", "cleanup"] and given == [{"plan", "check"}]
  with pytest.raises(InputError, match="'pose' in without, expected one of check, cleanup"):
    project.validate(PROJECT | {"without": ["pose"]}, Limits())


@pytest.mark.slow
def test_the_command_line_makes_it_too(tmp_path, monkeypatch, capsys, client, library):
  """Along its path, as the page does."""
  control = {"version": 1, "constraints": [{"type": "root_path", "points": [[1, 0], [1.4, 0.6], [1.2, 1.4]]}]}
  checked = client.post("/v1/project", json=PROJECT | {"control": control}).json()
  assert checked["control"]["constraints"] == control["constraints"]
  path, outputs = tmp_path / "story.json", [tmp_path / f"story.{kind}" for kind in ("npz", "html")]
  path.write_text(json.dumps(checked))
  monkeypatch.setattr(model_library, "_load", lambda name: library.model(name, "multi_prompt"))
  assert cli.main(["make", str(path), "--out", ",".join(map(str, outputs))]) == 0
  motion = project.generate(checked, library, Limits())
  assert (export.load(outputs[0]).joints == motion.joints).all() and motion.meta["control"] == ["root_path"]
  assert np.abs(motion.joints[-1, 0, [0, 2]] - [1.2, 1.4]).max() < 2e-3
  assert "a person waves" in capsys.readouterr().out
  assert '"points": [[1.0, 0.0], [1.4, 0.6]' in outputs[1].read_text()


@pytest.mark.parametrize("text, told", [
    (json.dumps(PROJECT)[:150], "line 1: no valid JSON"), ("[]", "no project of motion_jax"),
    (json.dumps(PROJECT | {"version": 2}), "is of version 2"),
    (json.dumps(PROJECT | {"chosen": 2}), "got chosen 2"), (json.dumps(PROJECT | {"past": {}}), "shape None"),
    (json.dumps(PROJECT | {"edits": [{}]}), "prompt is missing")])
def test_what_is_no_project_is_told_in_one_line(tmp_path, capsys, client, text, told):
  path = tmp_path / "story.json"
  path.write_text(text)
  assert cli.main(["make", str(path), "--out", str(tmp_path / "a.npz")]) == 1
  said = capsys.readouterr().err
  assert told in said and len(said.splitlines()) == 1 and str(path) in said
  assert not (tmp_path / "a.npz").exists()
  assert refusal(client.post("/v1/project", content=text))
  with pytest.raises(InputError, match="larger than a project can be"):
    project.read(path, Limits(body_bytes=len(text) - 1))
