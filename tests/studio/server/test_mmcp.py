"""MMCP: what its SDK's own client asks and reads, and what is refused by which code."""
import base64

import numpy as np
import pytest
from motionmcp import client as sdk

from motion_jax.control.compiling import compile
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.models.results import Motion
from motion_jax.motion import rotations as rot
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.pose import Pose, pose_to_joints
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.plugins import Registry
from motion_jax_studio.mmcp import constraints
from motion_jax_studio.pipeline import Pipeline
from motion_jax_studio.server import app


@pytest.fixture
def request_body(client):
  spec = client.get("/mmcp/capabilities").json()["models"][0]
  return {"protocol_version": "1.2", "model": spec["id"], "skeleton": spec["canonical_skeleton"],
          "segments": [{"type": "text", "prompt": "a person walks", "duration_frames": 40},
                       {"type": "text", "prompt": "a person waves", "duration_frames": 20}],
          "options": {"seed": 5, "num_samples": 2, "diffusion_steps": 4}}


def tracks(document, sample):
  """{(path, node): array} of an animation."""
  data = base64.b64decode(document["buffers"][0]["uri"].split(",")[1])
  animation, found = document["animations"][sample], {}
  for channel in animation["channels"]:
    accessor = document["accessors"][animation["samplers"][channel["sampler"]]["output"]]
    view, width = document["bufferViews"][accessor["bufferView"]], {"VEC3": 3, "VEC4": 4}[accessor["type"]]
    array = np.frombuffer(data, "<f4", accessor["count"] * width, view["byteOffset"]).reshape(-1, width)
    found[channel["target"]["path"], channel["target"]["node"]] = array
  return found


def test_a_reply_is_the_models_motion(client, library, request_body):
  request_body["options"]["without"] = ["cleanup"]
  reply = client.post("/mmcp/generate", json=request_body)
  assert reply.status_code == 200 and reply.headers["content-type"] == "model/gltf+json"
  document, model = reply.json(), library.model("tiny", "multi_prompt")
  about = document["extensions"]["MMCP_motion"]
  assert about["model"] == model.id and about["fps"] == 20 and len(about["samples"]) == 2
  assert all(sample["num_frames"] == 60 and len(sample["foot_contacts"]["left_foot"]) == 60
             for sample in about["samples"])
  found, skeleton = tracks(document, 1), model.stats.layout.skeleton
  pipeline = library.pipeline("tiny", "multi_prompt")
  rows = [("a person walks", 2), ("a person waves", 1)]
  made = pipeline.multi_prompt(rows, seed=6, num_steps=4, without="cleanup")
  assert np.abs(found["translation", 0] - made.joints[:, 0]).max() < 1e-5
  turns = np.stack([found["rotation", i][:, [3, 0, 1, 2]] for i in range(22)], 1).astype(float)
  offsets = np.array([joint["rest_translation"] for joint in request_body["skeleton"]["joints"]])
  pose = Pose(offsets, np.zeros((60, 22, 3)), found["translation", 0].astype(float), turns, turns)
  posed = pose_to_joints(pose, skeleton)
  arm = lambda joints: rot.unit(joints[:, 20] - joints[:, 18])  # its direction: the request's bones have their lengths
  assert np.abs(arm(posed) - arm(made.joints.astype(float))).max() < 1e-3


@pytest.mark.slow
def test_constraints_are_met_and_what_is_not_followed_is_told(client, request_body):
  turn = [0.0, float(np.sin(0.4)), 0.0, float(np.cos(0.4))]
  body = request_body | {"options": {"seed": 5, "diffusion_steps": 4}, "constraints": [
      {"type": "root_path", "frames": list(range(60)), "positions_xz": np.linspace([1, 0], [1.5, 1], 60).tolist()},
      {"type": "effector_target", "joint": "left_wrist", "frames": [30], "positions": [[1.5, 1.2, 0.6]],
       "rotations": [turn]},
      {"type": "pose_keyframe", "frame": 50, "joint_rotations": {"pelvis": turn, "left_shoulder": [0, 0, 0.4, 0.9]}}]}
  reply = client.post("/mmcp/generate", json=body)
  assert reply.status_code == 200, reply.text
  document = reply.json()
  assert len(document["extras"]["notes"]) == 2 and "rotations" in document["extras"]["notes"][0]
  root = tracks(document, 0)["translation", 0]
  assert np.abs(root[[0, 59]][:, [0, 2]] - [[1, 0], [1.5, 1]]).max() < 5e-3
  spec = client.get("/mmcp/capabilities").json()["models"][0]
  assert spec["supported_constraints"] == ["root_path", "effector_target", "pose_keyframe"]


def test_a_pose_of_mmcp_is_turned_as_replies_are():
  """Rotations that a reply has give its joints back."""
  from motion_jax.motion.pose import t_pose, to_pose
  pose = to_pose(np.asarray(synthetic_clips(seed=0, num=1)[0].joints)[:9].astype(float))
  turns = {name: pose.rotations[8, i, [1, 2, 3, 0]].tolist() for i, name in enumerate(HUMANML3D.joints)}
  rows = [{"type": "pose_keyframe", "frame": 8, "joint_rotations": turns, "root_position": pose.root[8].tolist()}]
  (keyframe,), notes = constraints.read(rows, 20, 20.0)
  same = pose_to_joints(pose._replace(offsets=t_pose(), shifts=0 * pose.shifts))[8]
  assert np.abs(keyframe.joints - same).max() < 1e-6 and (keyframe.place, keyframe.time) == ("world", 0.4) and not notes
  (anywhere,), _ = constraints.read([{name: value for name, value in rows[0].items() if name != "root_position"}],
                                         20, 20.0)
  assert anywhere.place == "anywhere" and anywhere.joints[:, 1].min() == 0, "it stands on the floor"


def test_a_reply_names_the_feet_that_stand(client, request_body, monkeypatch):
  joints = synthetic_clips(seed=0, num=6, num_frames=60)[5].joints
  monkeypatch.setattr(Pipeline, "multi_prompt", lambda *_, **__: Motion(joints, 20.0, meta={}))
  reply = client.post("/mmcp/generate", json=request_body).json()
  contacts = reply["extensions"]["MMCP_motion"]["samples"][0]["foot_contacts"]
  expected = feet_stand(joints, 20.0, HUMANML3D, floor=0.0)
  assert list(contacts) == ["left_ankle", "left_foot", "right_ankle", "right_foot"]
  assert (np.array(list(contacts.values())).T == expected).all() and 0 < expected[:, 0].sum() != expected[:, 3].sum()


def test_paths_and_hands_at_frames_of_another_rate_pass_their_points():
  """Points that fall into one frame of the model are one; frames far apart stay targets of their own."""
  every, apart = [*range(30), 60], list(range(0, 120, 2))
  for kind, frames, fps, joint in (("root_path", every, 30.0, 0), ("root_path", apart, 60.0, 0),
                                   ("effector_target", every, 30.0, 20)):
    places = [[0.01 * frame, 1.2, 0.0] for frame in frames]
    row = {"type": kind, "frames": frames} | ({"joint": "left_wrist", "positions": places} if joint else {
        "positions_xz": [place[::2] for place in places], "heading_radians": [0.0] * len(frames)})
    signal = compile(constraints.read([row], 200, fps)[0], 45, 20.0)
    given = signal.given[0, :, joint, 0]
    assert given[:20].all() and (not joint or not given[20:40].any() and given[40] and not given[41:].any())
    expected = 0.01 * fps / 20 * np.flatnonzero(given)
    np.testing.assert_allclose(signal.positions[0, given, joint, 0], expected, atol=0.011)


def test_rate_loop_and_guidance(client, request_body):
  """Ten of 14 frames at 30 a second are 4.67 s, though none is whole frames of the model."""
  many = request_body | {"segments": [request_body["segments"][0] | {"duration_frames": 14}] * 10,
                         "timing": {"fps": 30}, "options": {"diffusion_steps": 4}}
  assert len(tracks(client.post("/mmcp/generate", json=many).json(), 0)["translation", 0]) == 140
  body = request_body | {"timing": {"fps": 30}, "segments": request_body["segments"][:1],
                         "options": {"loop": True, "guidance": {"type": "nocfg"}, "diffusion_steps": 4}}
  found = tracks(client.post("/mmcp/generate", json=body).json(), 0)
  turn = found["rotation", 5]
  assert len(turn) == 40 and abs(turn[0] @ turn[-1]) > 0.99


def test_a_studio_without_the_entry_point_has_no_mmcp(studio, protocols, monkeypatch):
  paths = lambda: {route.path for route in studio.app()._app.router.routes}
  assert set(protocols) == {"mmcp"} and "/mmcp" in paths()
  monkeypatch.setattr(app, "PROTOCOLS", Registry("nothing", {}))
  assert "/mmcp" not in paths() and "/v1/generate" in paths()


@pytest.mark.parametrize("change, status, code", [
    ({"protocol_version": "2.0"}, 400, "version_unsupported"), ({"protocol_version": 1}, 422, "schema_validation"),
    ({"model": None}, 400, "unknown_model"),
    ({"skeleton": {"joints": []}}, 400, "retargeting_unsupported"),
    ({"constraints": [{"type": "ground_height"}]}, 400, "unsupported_constraint"),
    ({"constraints": [{"type": "root_path", "frames": [60], "positions_xz": [[0, 0]]}]}, 400, "frame_out_of_range"),
    ({"constraints": [{"type": "effector_target", "joint": "tail", "frames": [1], "positions": [[0, 1, 0]]}]}, 400,
     "unknown_joint"),
    ({"constraints": [{"type": "pose_keyframe", "frame": 1, "joint_rotations": {"head": [0, 0, 0, 0]}}]}, 422,
     "schema_validation"),
    ({"constraints": [{"type": "root_path", "frames": [*range(50)], "positions_xz": [[0, 0]] * 50}] * 97}, 422,
     "schema_validation"),  # 4,850 points
    ({"extra": 1}, 422, "schema_validation"), ({"segments": [{"type": "pose"}]}, 400, "unsupported_segment"),
    ({"options": {"loop": True}}, 400, "invalid_options"), ({"options": {"without": "pose"}}, 400, "invalid_options"),
    ({"options": {"without": [1]}}, 400, "invalid_options"), ({"timing": {"fps": 0}}, 422, "schema_validation")])
def test_refusals_have_their_codes(client, request_body, change, status, code):
  reply = client.post("/mmcp/generate", json=request_body | change)
  error = reply.json()["error"]
  assert (reply.status_code, error["code"]) == (status, code) and "\n" not in error["message"]


def test_the_sdks_own_client_reads_it(address, request_body):
  server, token = address.split("/?token=")
  found = sdk.get_capabilities(f"{server}/mmcp", access_token=token)
  assert sdk.pick_model(found)["id"] == request_body["model"]
  document = sdk.generate(f"{server}/mmcp", request_body, access_token=token)
  samples = sdk.parse_gltf_samples(document)
  assert len(samples) == 2
  with pytest.raises(sdk.MmcpError) as refused:
    sdk.generate(f"{server}/mmcp", request_body | {"model": "nobody"}, access_token=token)
  assert refused.value.code == "unknown_model"
