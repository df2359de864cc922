"""Requests over HTTP: what they give, and what cannot be made is told in one sentence."""
import base64
import io
import json
import re
import threading
import time

import numpy as np
import pytest

from motion_jax import export
from motion_jax.data.clip import Caption
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.export.html import resting_body
from motion_jax.models.results import captions_with
from motion_jax.motion.looping import in_place
from motion_jax.motion.skeleton import bone_lengths
from motion_jax.rigs.rig import all_rigs
from motion_jax.utils import progress
from motion_jax_studio import step_names
from motion_jax_studio.server import serialization
from tests.studio.server.characters import CHARACTERS, character
from tests.studio.server.conftest import refusal


@pytest.fixture(scope="module")
def walk():
  """A person walking, as JSON: the tiny model's bodies are none."""
  clip = synthetic_clips(seed=0, num=1)[0]
  return clip, serialization.to_json(clip)


def joints_of(motion):
  return np.frombuffer(base64.b64decode(motion["joints"]), "<f4").reshape(motion["shape"])


def test_models_and_status(client, library):
  models = {model["name"]: model for model in client.get("/v1/models").json()["models"]}
  assert models["tiny"]["state"] == "ready" and models["tiny"]["done"] == models["tiny"]["of"]
  assert "stream" in models["tiny"]["abilities"] and "edit" in models["editor"]["abilities"]
  assert models["tiny"]["id"] == library.model("tiny", "stream").id and models["tiny"]["sampling"]["lag"]["usual"]
  status = client.get("/v1/status").json()
  assert status["streams"] == 0 and status["models"] == {"tiny": "ready", "editor": "ready"}


@pytest.mark.parametrize("path, body, stays", [
    ("generate", {"prompt": "a person walks, then waves", "seconds": 2}, ["sample", "constrain"]),
    ("multi-prompt", {"segments": [{"prompt": "a person walks, then waves", "seconds": 2}]}, ["sample"])])
def test_steps_are_in_replies_and_left_out_by_name(client, path, body, stays):
  body = body | {"model": "tiny", "sampling": {"num_steps": 4}}
  names = lambda reply: [row["step"] for row in (reply.get("motion") or reply["motions"][0])["meta"]["steps"]]
  every = client.post(f"/v1/{path}", json=body).json()
  assert names(every)[:3] == ["plan", "sample", "cleanup"]
  out = [name for name in (step_names.GENERATE if path == "generate" else step_names.EXTEND) if name not in stays]
  assert names(client.post(f"/v1/{path}", json=body | {"without": out}).json()) == stays[:1]
  message = refusal(client.post(f"/v1/{path}", json=body | {"without": ["corect"]}))
  assert "'corect'" in message and "plan" in message


def test_generate_is_the_pipeline(client, library):
  reply = client.post("/v1/generate", json={"prompt": "a person walks", "seconds": 2, "seed": 3, "num_samples": 2,
                                            "sampling": {"num_steps": 4}, "model": "tiny"}).json()
  made = library.pipeline("tiny", "generate")(["a person walks"] * 2, seconds=2, seeds=[3, 4], num_steps=4)
  assert [motion["shape"] for motion in reply["motions"]] == [[40, 22, 3]] * 2
  assert all((joints_of(motion) == one.joints).all() for motion, one in zip(reply["motions"], made))
  assert reply["motions"][1]["meta"]["seed"] == 4 and reply["motions"][0]["captions"][0]["text"] == "a person walks"


@pytest.mark.parametrize("body, words", [
    ({}, "prompt is missing"), ({"prompt": "walks", "num_samples": 1000}, "got num_samples 1000"),
    ({"prompt": "walks", "model": "/etc"}, "this studio has"), ({"prompt": "\ud800"}, "valid JSON|UTF-8"),
    ({"segments": []}, "got no segments"),
    ({"segments": [{"prompt": "walks", "seconds": 60.1}] * 2}, "a motion of 120 s, expected at most 120")])
def test_what_cannot_be_generated_gets_one_sentence(client, body, words):
  path = "multi-prompt" if "segments" in body else "generate"
  assert re.search(words, refusal(client.post(f"/v1/{path}", content=json.dumps(body))))


@pytest.mark.parametrize("model, choices", [
    ("tiny", {"lagg": 2, "num_steps": "x", "guidance_scale": True, "lag": 1.5, "control_steps": "2", "refinements": 101,
              "solver": 5}),
    ("editor", {"guidance_scale": "2", "temperature": "x", "shared_noise": "", "num_iterations": "2",
                "unmasked_only": 2})])
def test_sampling_choices_of_a_wrong_kind_are_a_422(client, model, choices):
  for name, value in choices.items():
    body = {"prompt": "a person walks", "seconds": 1, "model": model, "sampling": {name: value}}
    assert name in refusal(client.post("/v1/generate", json=body), 422)
  wrong = {"model": model, "sampling": dict([next(iter(choices.items()))])}
  if model == "tiny":
    assert refusal(client.post("/v1/multi-prompt", json=wrong | {"segments": [{"prompt": "walks"}]}), 422)
  else:
    motion = serialization.to_json(synthetic_clips(seed=0, num=1)[0])
    assert refusal(client.post("/v1/edit", json=wrong | {"prompt": "a", "motion": motion, "change": [[0, 8]]}), 422)


def test_no_json_is_told(client):
  for content, why in ((b"", "line 1 column 1"), (b"{", "line 1 column 2"), (b"\xff", ""),
                       (b'{"prompt": NaN}', "NaN is no number"), (b"[" * 100_000, "")):
    answer = refusal(client.post("/v1/generate", content=content))
    assert answer.startswith("got no valid JSON (") and why in answer and len(answer) < 120


def test_a_story_is_sampled_again_from_where_it_changed(client):
  """A block of several actions is made action by action."""
  ask = lambda *rows: client.post("/v1/multi-prompt", json={"segments": [{"prompt": p, "seconds": s} for p, s in rows],
                                                     "model": "tiny", "seed": 8}).json()
  first = ask(("a person walks, then waves", 4.8), ("a person waves", 1.2))
  second = ask(("a person walks, then waves", 4.8), ("a person jumps", 1.2))
  assert first["motion"]["shape"] == second["motion"]["shape"] == [120, 22, 3]
  assert 0 < second["reused_frames"] <= 96 and 86 <= second["same_frames"] < 120
  same = second["same_frames"]
  assert (joints_of(first["motion"])[:same] == joints_of(second["motion"])[:same]).all()
  assert [(caption["text"], caption["start"]) for caption in second["motion"]["captions"]][::2] == [
      ("a person walks", 0.0), ("a person jumps", 4.8)]


def test_notes_are_of_prompts_and_of_what_no_attempt_shows(client, library, monkeypatch):
  motion = library.pipeline("tiny", "generate")("a person walks", seconds=2, seed=0, max_attempts=1, num_steps=2)
  missed = motion.replace(meta=motion.meta | dict(attempts=[{}] * 4, unmet=["no kick seen"]))
  edit = {"model": "editor", "motion": serialization.to_json(motion), "change": [[8, 24]]}
  for name, body in (("generate", {"model": "tiny"}), ("edit", edit)):
    with monkeypatch.context() as patch:
      patch.setattr("motion_jax_studio.server.requests.make_edit",
                    lambda *_: missed.replace(meta=missed.meta | dict(made=[])))
      patch.setattr(type(library.pipeline("tiny", "generate")), "__call__", lambda *_, **__: [missed])
      notes = client.post(f"/v1/{name}", json=body | {"prompt": "two people dance"}).json()["notes"]
    assert "only one body is made" in notes[0] and notes[-1].startswith("4 attempts, no kick seen")


def test_a_motion_goes_on(client, walk):
  clip, sent = walk
  body = {"segments": [{"prompt": "a person waves", "seconds": 2}], "past": sent}
  made = client.post("/v1/multi-prompt", json=body).json()
  assert made["motion"]["shape"][0] == len(clip.joints) + 40
  assert (joints_of(made["motion"])[:len(clip.joints)] == clip.joints.astype(np.float32)).all()


@pytest.mark.slow
def test_an_edit_keeps_what_it_keeps_where_it_was(client, walk):
  clip, _ = walk
  turned = clip.replace(joints=clip.joints @ np.array([[0, 0, -1], [0, 1, 0], [1, 0, 0]]) + [5, 0, -3])
  sent = serialization.to_json(turned)
  reply = client.post("/v1/edit", json={"motion": sent, "prompt": "a person waves", "change": [[12, 24]]}).json()
  assert reply["made"] == [[12, 24]]
  before, after = joints_of(sent), joints_of(reply["motion"])
  kept = np.r_[0:12, 24:len(after)]
  assert (after[kept] == before[kept]).all() and not (after[12:24] == before[12:24]).all()
  said = [(one["text"], one["start"], one["end"]) for one in reply["motion"]["captions"]]
  assert ("a person waves", 0.6, 1.2) in said and said[0][0] == clip.captions[0].text and said[0][2] == 0.6
  lengths = bone_lengths(after.astype(np.float64), clip.skeleton)[:, 1:]
  assert np.abs(lengths / np.median(lengths[kept], axis=0) - 1).max() < 0.01
  for body, words in (({}, "both or neither"), ({"change": [[0, 10**6]]}, "beyond"),
                      ({"change": [[0, 8]], "model": "tiny"}, "has no 'edit'; editor has")):
    assert words in refusal(client.post("/v1/edit", json={"motion": sent, "prompt": "a"} | body))


def test_captions_give_way_to_an_edit_where_it_is():
  whole, piece = Caption("walks"), Caption("sits", 4.0, 6.0)
  assert captions_with((whole,), [(1.0, 2.0)], "kicks", 5.0) == (
      Caption("walks", 0.0, 1.0), Caption("kicks", 1.0, 2.0), Caption("walks", 2.0, 5.0))
  assert captions_with((piece,), [(3.0, 5.0)], "kicks", 6.0) == (Caption("kicks", 3.0, 5.0), Caption("sits", 5.0, 6.0))
  assert captions_with((), [(0.0, 1.0)], "kicks", 6.0) == (Caption("kicks", 0.0, 1.0),)


def test_a_request_says_how_far_it_is(client, studio, monkeypatch):
  """Read by another request while the first one runs."""
  seen, count = [], progress.count

  def read(*state):
    count(*state)
    seen.append(client.get("/v1/progress?work=mine").json())

  monkeypatch.setattr(progress, "count", read)
  body = {"segments": [{"prompt": "a person walks", "seconds": 2.4}], "model": "tiny"}
  assert client.post("/v1/multi-prompt", json=body, headers={"x-work": "mine"}).status_code == 200
  assert len(seen) >= 4 and seen[-1]["doing"] == "generating the motion" and seen[-1]["done"] == seen[-1]["of"] == 48
  assert client.get("/v1/progress?work=mine").json()["doing"] == "" and not studio.works


def test_a_request_that_is_cancelled_ends_where_it_reports_its_progress(client, studio, monkeypatch):
  """And gives its place and its cached streams back."""
  count, states = progress.count, []

  def cancel(*state):
    states.append(state)
    assert client.post("/v1/cancel?work=mine").json() == {"cancelled": True}
    count(*state)

  body = {"segments": [{"prompt": "a person walks", "seconds": 2.4}], "model": "tiny", "seed": 77}
  monkeypatch.setattr(progress, "count", cancel)
  assert "cancelled" in refusal(client.post("/v1/multi-prompt", json=body, headers={"x-work": "mine"}), 409)
  assert len(states) == 1 and not studio.works
  monkeypatch.setattr(progress, "count", count)
  assert client.post("/v1/cancel?work=mine").json() == {"cancelled": False}
  assert client.post("/v1/multi-prompt", json=body, headers={"x-work": "mine"}).status_code == 200


def test_each_segment_has_its_own_notes_and_the_nearest_caption(client, library):
  prompts = "a person walks", "a person floobles", "a person walks", "eine Person geht vorwärts und winkt"
  segments = [{"prompt": prompt, "seconds": 0.6} for prompt in prompts]
  reply = client.post("/v1/multi-prompt", json={"segments": segments, "model": "tiny"}).json()
  known, odd, again, german = reply["segments"]
  assert known == again == {"notes": [], "unknown": [], "nearest": ""}
  assert "floobles" in odd["notes"][0] and odd["notes"] == reply["notes"][:1] and odd["unknown"] == reply["unknown"]
  assert "English only" in german["notes"][0] and not german["unknown"] and not german["nearest"]
  assert odd["nearest"] in library.model("tiny", "generate").captions.texts


def test_suggestions_are_prompts_that_the_model_knows(client, library):
  found = client.get("/v1/suggestions?model=tiny&words=a person jumps").json()
  model = library.model("tiny", "generate")
  assert all(not model.captions.unknown_words(row["prompt"]) for row in found["rows"])
  assert found["captions"] == [text for text, _ in model.captions.nearest("a person jumps", 12)]
  assert "got the model 'nobody'" in refusal(client.get("/v1/suggestions?model=nobody"))


@pytest.mark.parametrize("kind", ["bvh", "npz", "glb", "png"])
def test_exports_are_files_that_open(client, walk, kind):
  clip, sent = walk
  reply = client.post("/v1/export", json={"motion": sent, "format": kind, "trim": [[2, 14]], "name": "../A wave!"})
  assert reply.status_code == 200 and f'filename="a-wave.{kind}"' in reply.headers["content-disposition"]
  if kind != "png":
    motion = client.post(f"/v1/import?name=x.{kind}", content=reply.content).json()["motion"]
    assert motion["shape"] == [12, 22, 3] and np.abs(joints_of(motion) - clip.joints[2:14]).max() < 0.02
  if kind in ("glb", "png"):
    assert reply.content.startswith({"glb": b"glTF", "png": b"\x89PNG"}[kind])


def test_all_writers_and_rigs_of_the_library_are_offered(client, walk, tmp_path):
  found = client.get("/v1/export-choices").json()
  offered = {row["name"]: row["options"] for row in found["formats"]}
  assert {"." + name for name in offered} >= set(export.WRITERS)
  assert [name for name in offered if "character" in offered[name]] == ["glb", "vrm"]
  assert {row["name"] for row in found["rigs"]} == set(all_rigs())
  assert offered["bvh"] == ["rig", "t_pose", "fps"] and offered["npz"] == ["fps"] and offered["html"] == []
  missing = {row["name"]: row["missing"] for row in found["formats"]}
  assert missing["bvh"] is None and (missing["fbx"] is None or "pip install" in missing["fbx"])
  clip, sent = walk
  body = {"motion": sent, "format": "bvh", "rig": "mixamo", "fps": 40, "t_pose": True}
  (tmp_path / "a.bvh").write_bytes(client.post("/v1/export", json=body).content)
  made = export.load(tmp_path / "a.bvh")
  assert b"mixamorig:LeftUpLeg" in (tmp_path / "a.bvh").read_bytes() and round(made.fps) == 40
  assert made.num_frames > 2 * clip.num_frames - 2


def test_a_motion_is_exported_on_the_character_that_the_page_shows(client, walk, tmp_path):
  """With its own mesh and bones, as `--character` writes it."""
  clip, sent = walk
  data = character(tmp_path, np.array(resting_body()["rest"]), **CHARACTERS["one.vrm"])
  body = {"motion": sent, "character": base64.b64encode(data).decode(), "name": "wave"}
  for kind in ("glb", "vrm"):
    reply = client.post("/v1/export", json=body | {"format": kind})
    assert reply.status_code == 200, reply.text
    (tmp_path / f"made.{kind}").write_bytes(reply.content)
    (tmp_path / "own.glb").write_bytes(data)
    export.save(serialization.from_json(sent, 1000), tmp_path / f"cli.{kind}", file=tmp_path / "own.glb")
    assert (tmp_path / f"made.{kind}").read_bytes() == (tmp_path / f"cli.{kind}").read_bytes()
  for change, words in (({"format": "bvh"}, "got character for the format bvh, expected one of glb, vrm"),
                        ({"format": "glb", "rig": "mixamo"}, "keeps its own bones"),
                        ({"format": "vrm", "character": None}, "vrm without a character"),
                        ({"format": "glb", "character": "no base64!"}, "in base64"),
                        ({"format": "glb", "character": base64.b64encode(data[:3000]).decode()}, "the character")):
    assert words in refusal(client.post("/v1/export", json=body | change)), change


def test_variants_of_an_export(client, walk):
  clip, sent = walk
  ask = lambda **fields: np.load(io.BytesIO(client.post("/v1/export", json={"motion": sent, "format": "npy", **fields}
                                                        ).content))
  assert (ask() == clip.joints.astype(np.float32)).all()
  still = ask(in_place=True)
  assert np.abs(still - in_place(clip.joints)).max() == 0 and np.ptp(still[:, 0, [0, 2]], axis=0).max() < 1e-6
  assert not np.allclose(ask(loop=True), clip.joints)
  for made in ([[0, 5], [8, 12]], [[5]]):  # new frames of an edit are drawn in another colour
    edited = sent | {"meta": {"made": made}}
    drawn = client.post("/v1/export", json={"motion": edited, "format": "html", "trim": [[2, 10]]})
    assert drawn.status_code == 200 and (b'"tints"' in drawn.content) == (made == [[0, 5], [8, 12]])


@pytest.mark.parametrize("change, told", [
    ({"format": "exe"}, "expected one of amass.npz"),
    ({"rig": "vrm"}, "got rig for the format npy, expected one of bvh"),
    ({"format": "bvh", "rig": "nothing"}, "got rig 'nothing'"), ({"trim": [[0, 10**6]]}, "expected one span"),
    ({"motion": {"shape": [1, 22, 3], "fps": 20, "joints": "AA=="}}, "bytes of joints"),
    ({"motion": {"shape": [36_001, 22, 3], "fps": 20, "joints": ""}}, "expected [frames, 22, 3] of 1 to 36,000"),
    ({"motion": {"shape": [2, 22, 3], "fps": 20, "joints": "*"}}, "no base64"),
    ({"motion": {"skeleton": "../x"}}, "got the skeleton"),
    ({"motion": {"shape": [1, 22, 3], "fps": 20, "joints": base64.b64encode(b"\xff" * 264).decode()}}, "NaN|finite"),
    ({"motion": {"shape": [1, 22, 3], "fps": 20, "joints": base64.b64encode(bytes(264)).decode()}}, "bones")])
def test_what_cannot_be_exported_is_told(client, walk, change, told):
  body = {"motion": walk[1], "format": "npy"} | change
  assert re.search(told.replace("[", r"\["), refusal(client.post("/v1/export", json=body)))


@pytest.mark.parametrize("name, data, told", [
    ("walk.bvh", b"HIERARCHY nothing", "the file"), ("walk.amc", b"", "ends in '.amc'"),
    ("../../etc/passwd", b"", "ends in ''")])
def test_what_is_no_motion_is_not_read(client, name, data, told):
  message = refusal(client.post("/v1/import", params={"name": name}, content=data))
  assert told in message and "/tmp" not in message


def test_too_many_at_once_are_told_to_wait(client, studio, walk):
  """Two run, four wait, the seventh is refused."""
  body, replies = {"motion": walk[1], "format": "npy"}, []
  with studio.handler.place(), studio.handler.place():
    waiting = [threading.Thread(target=lambda: replies.append(client.post("/v1/export", json=body).status_code))
               for _ in range(4)]
    for thread in waiting:
      thread.start()
    while studio.handler._admitted._value:
      time.sleep(0.01)
    assert "6 requests run or wait already" in refusal(client.post("/v1/export", json=body), 429)
    assert not replies
  for thread in waiting:
    thread.join(20)
  assert replies == [200] * 4
