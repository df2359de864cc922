"""MMCP: what its SDK's own client asks and reads, and what is refused by which code."""
import base64

import numpy as np
import pytest
from motionmcp import client as sdk

from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import Pose, pose_to_joints


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
  reply = client.post("/mmcp/generate", json=request_body)
  assert reply.status_code == 200 and reply.headers["content-type"] == "model/gltf+json"
  document, model = reply.json(), library.model("tiny", "multi_prompt")
  about = document["extensions"]["MMCP_motion"]
  assert about["model"] == model.id and about["fps"] == 20 and len(about["samples"]) == 2
  assert all(sample["num_frames"] == 60 and len(sample["foot_contacts"]["left_foot"]) == 60
             for sample in about["samples"])
  found, skeleton = tracks(document, 1), model.stats.layout.skeleton
  made = model.multi_prompt([("a person walks", 2), ("a person waves", 1)], seed=6, num_steps=4)
  assert np.abs(found["translation", 0] - made.joints[:, 0]).max() < 1e-5
  turns = np.stack([found["rotation", i][:, [3, 0, 1, 2]] for i in range(22)], 1).astype(float)
  offsets = np.array([joint["rest_translation"] for joint in request_body["skeleton"]["joints"]])
  pose = Pose(offsets, np.zeros((60, 22, 3)), found["translation", 0].astype(float), turns, turns)
  posed = pose_to_joints(pose, skeleton)
  arm = lambda joints: rot.unit(joints[:, 20] - joints[:, 18])  # its direction: the request's bones have their lengths
  assert np.abs(arm(posed) - arm(made.joints.astype(float))).max() < 1e-3


def test_rate_loop_and_guidance(client, request_body):
  body = request_body | {"timing": {"fps": 30}, "segments": request_body["segments"][:1],
                         "options": {"loop": True, "guidance": {"type": "nocfg"}, "diffusion_steps": 4}}
  found = tracks(client.post("/mmcp/generate", json=body).json(), 0)
  turn = found["rotation", 5]
  assert len(turn) == 40 and abs(turn[0] @ turn[-1]) > 0.99


@pytest.mark.parametrize("change, status, code", [
    ({"protocol_version": "2.0"}, 400, "version_unsupported"), ({"protocol_version": 1}, 422, "schema_validation"),
    ({"model": "nobody"}, 400, "unknown_model"), ({"model": None}, 400, "unknown_model"),
    ({"skeleton": None}, 422, "schema_validation"), ({"skeleton": {"joints": []}}, 400, "retargeting_unsupported"),
    ({"constraints": [{"type": "root_path"}]}, 400, "unsupported_constraint"), ({"extra": 1}, 422, "schema_validation"),
    ({"segments": []}, 422, "schema_validation"), ({"segments": [{"type": "pose"}]}, 400, "unsupported_segment"),
    ({"segments": [{"type": "text", "prompt": "a", "duration_frames": 0}]}, 422, "schema_validation"),
    ({"segments": [{"type": "text", "prompt": "x" * 10_000, "duration_frames": 9}]}, 422, "schema_validation"),
    ({"options": {"loop": True}}, 400, "invalid_options"), ({"options": {"num_samples": 99}}, 422, "schema_validation"),
    ({"options": {"guidance": {"type": "separated", "weight": [1, 2]}}}, 400, "invalid_options"),
    ({"timing": {"fps": 0}}, 422, "schema_validation")])
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
  with pytest.raises(sdk.MmcpError) as refused:
    sdk.get_capabilities(f"{server}/mmcp", use_cache=False, access_token="wrong")
  assert refused.value.code == "auth_required"
