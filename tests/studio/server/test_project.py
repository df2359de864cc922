"""A project makes the same motion with the page and without it; one that is cut is told in a line."""
import json

import numpy as np
import pytest

from motion_jax import export
from motion_jax.utils.errors import InputError
from motion_studio import cli
from motion_studio.server import library as model_library
from motion_studio.server import project, serialization
from motion_studio.server.limits import Limits
from tests.studio.server.conftest import refusal
from tests.studio.server.test_requests import joints_of

PROJECT = {"format": "motion_jax project", "version": 1, "model": {"name": "tiny", "id": ""},
           "blocks": [{"prompt": "a person walks", "seconds": 2.4}, {"prompt": "a person waves", "seconds": 1.2}],
           "seeds": [4, 9], "chosen": 1, "sampling": {"num_steps": 4}}


def test_a_project_is_what_its_requests_make(client, library):
  found = client.post("/v1/project", json=PROJECT).json()
  assert found == PROJECT | {"cleanup": True, "past": None, "control": None, "edits": []}
  made = project.made(found, library, Limits())
  body = {"segments": found["blocks"], "sampling": found["sampling"], "seed": 9, "model": "tiny"}
  asked = client.post("/v1/multi-prompt", json=body)
  assert (joints_of(asked.json()["motion"]) == made.joints).all()
  other = project.made(found, library, Limits(), take=0)
  assert other.meta["seed"] == 4 and not (other.joints == made.joints).all()
  with pytest.raises(InputError, match="got the take 2"):
    project.made(found, library, Limits(), take=2)


def test_edits_are_done_in_their_order(library, monkeypatch):
  asked = []
  monkeypatch.setattr(project, "make_edit", lambda pipeline, clip, *rest: (
      asked.append((pipeline.model.id, *rest)), clip)[1])
  edit = {"prompt": "a person kicks", "change": [[8, 16]], "seed": 2, "model": {"name": "editor", "id": "old@1234"}}
  told = []
  found = project.checked(PROJECT | {"edits": [edit | {"take": 1}, edit | {"take": 0}, edit | {"take": 1, "seed": 3}]},
                          Limits())
  project.made(found, library, Limits(), notify=told.append)
  assert [row[4] for row in asked] == [2, 3] and asked[0][2] == [(8, 16)]
  assert "made with old@1234" in told[0]


def test_the_command_line_makes_it_too(tmp_path, monkeypatch, capsys, library, tiny_run):
  path, out = tmp_path / "story.json", tmp_path / "story.npz"
  path.write_text(json.dumps(PROJECT))
  monkeypatch.setattr(model_library, "_load", lambda name: library.model(name, "multi_prompt"))
  assert cli.main(["make", str(path), "--out", f"{out},{tmp_path / 'story.bvh'}"]) == 0
  made = export.load(out)
  assert (made.joints == project.made(project.checked(PROJECT, Limits()), library, Limits()).joints).all()
  assert "a person waves" in capsys.readouterr().out and (tmp_path / "story.bvh").is_file()


@pytest.mark.parametrize("text, told", [
    (json.dumps(PROJECT)[:150], "line 1: no valid JSON"), ("", "no valid JSON"), ("[]", "no project of motion_jax"),
    ('{"prompt": "a"}', "no project of motion_jax"), (json.dumps(PROJECT | {"version": 2}), "is of version 2"),
    (json.dumps(PROJECT | {"blocks": []}), "got no blocks"), (json.dumps(PROJECT | {"seeds": []}), "got no seeds"),
    (json.dumps(PROJECT | {"chosen": 5}), "got chosen 5"), (json.dumps(PROJECT | {"model": "tiny"}), "got a text"),
    (json.dumps(PROJECT | {"surprise": 1}), "'surprise'"), (json.dumps(PROJECT | {"past": {}}), "shape None"),
    (json.dumps(PROJECT | {"edits": [{}]}), "prompt is missing"),
    (json.dumps(PROJECT | {"blocks": [{"prompt": "x" * 10_000}]}), "10,000 characters")])
def test_what_is_no_project_is_told_in_one_line(tmp_path, capsys, client, text, told):
  path = tmp_path / "story.json"
  path.write_text(text)
  assert cli.main(["make", str(path), "--out", str(tmp_path / "a.npz")]) == 1
  said = capsys.readouterr().err
  assert told in said and len(said.splitlines()) == 1 and str(path) in said
  assert not (tmp_path / "a.npz").exists()
  assert refusal(client.post("/v1/project", content=text))


def test_a_missing_project_is_told(capsys):
  assert cli.main(["make", "nowhere.json"]) == 1
  assert "there is no file nowhere.json" in capsys.readouterr().err


def test_a_story_behind_a_past_is_kept_whole(library):
  from motion_jax.data.datasets.synthetic import synthetic_clips
  clip = synthetic_clips(seed=0, num=1)[0]
  found = project.checked(PROJECT | {"past": serialization.to_json(clip), "sampling": {}}, Limits())
  made = project.made(found, library, Limits())
  assert (made.joints[:clip.num_frames] == clip.joints.astype(np.float32)).all()
  assert made.num_frames == clip.num_frames + 72
