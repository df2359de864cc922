"""Constraints in requests, projects and streams: what is asked is met, what cannot be is told in one sentence."""
import json
from types import SimpleNamespace

import numpy as np
import pytest

from motion_jax.control.constraints import EffectorTarget, Keyframe, Loop, RootPath
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.utils.errors import InputError
from motion_jax_studio.server import stream_constraints, streams
from motion_jax_studio.server.limits import Limits
from tests.studio.server.conftest import refusal
from tests.studio.server.test_project import PROJECT
from tests.studio.server.test_requests import joints_of
from tests.studio.server.test_streams import URL, Page

PATH = {"type": "root_path", "points": [[1, 0], [1.4, 0.6], [1.2, 1.4]]}
BLOCKS = [{"prompt": "a person walks", "seconds": 1.8}, {"prompt": "a person waves", "seconds": 1.2}]


def asked(*rows):
  return {"version": 1, "constraints": list(rows)}


@pytest.mark.slow
def test_a_story_goes_along_its_path_and_is_in_its_pose(client):
  body = {"segments": BLOCKS, "sampling": {"num_steps": 4}, "seed": 1, "control": asked(PATH)}
  along = joints_of(client.post("/v1/multi-prompt", json=body).json()["motion"])
  pose, head = along[38], along[20, 15] - along[20, 0] * [1, 0, 1] + [0, 0.02, 0]
  body["control"] = asked(PATH, {"type": "keyframe", "time": 2.0, "joints": pose.tolist()},
                          {"type": "effector", "joint": "head", "times": [1.0], "positions": [
                              (along[20, 0] * [1, 0, 1] + head).tolist()]})
  reply = client.post("/v1/multi-prompt", json=body)
  assert reply.status_code == 200, reply.text
  found = reply.json()
  joints, told = joints_of(found["motion"]), found["constraints"]
  assert joints.shape == (60, 22, 3) and [caption["end"] for caption in found["motion"]["captions"]] == [1.8, 3.0]
  assert np.abs(joints[0, 0, [0, 2]] - [1, 0]).max() < 2e-3 and np.abs(joints[-1, 0, [0, 2]] - [1.2, 1.4]).max() < 2e-3
  assert told["off"]["mean"] <= told["off"]["worst"] < 5, told["off"]
  assert [row["frame"] for row in told["poses"]] == [40] and [row[0] for row in told["targets"]] == [20]
  assert np.abs(joints[40] - told["poses"][0]["joints"]).max() < 6e-3
  again = client.post("/v1/multi-prompt", json=body).json()
  assert (joints_of(again["motion"]) == joints).all()
  assert "control together with past" in refusal(client.post("/v1/multi-prompt", json=body | {
      "past": found["motion"]}))


def test_a_request_for_motions_takes_control_and_an_exported_page_shows_it(client):
  body = {"prompt": "a person walks", "num_samples": 2, "sampling": {"num_steps": 4},
          "control": asked({**PATH, "times": [0, 0.6, 1.2]})}
  found = client.post("/v1/generate", json=body).json()
  assert [one["shape"][0] for one in found["motions"]] == [25, 25] and len(found["constraints"]) == 2
  for one in found["motions"]:
    assert np.abs(joints_of(one)[-1, 0, [0, 2]] - [1.2, 1.4]).max() < 2e-3
  body = {"motion": one, "format": "html", "trim": [[4, 20]], "control": asked(PATH)}
  page = client.post("/v1/export", json=body).text
  assert '"points": [[1.0, 0.0], [1.4, 0.6]' in page and '"off": {"mean"' in page


@pytest.mark.parametrize("control, told", [
    (asked({**PATH, "points": [[0, 1e999]]}), "inf"),
    (asked({**PATH, "points": [[0.0, 0.001 * i] for i in range(4801)]}), "got 4,801 points"),
    (asked(*[{"type": "loop"}] * 257), "got 257 constraints"),
    (asked({"type": "keyframe", "time": 1, "file": "/etc/passwd"}), "names a file"),
    (asked({"type": "effector", "joint": "head", "times": [9], "positions": [[0, 1, 0]]}), "got effector at 9 s")])
def test_what_cannot_be_asked_is_told_in_one_sentence(client, control, told):
  body = json.dumps({"segments": BLOCKS, "control": control}).replace("Infinity", "1e999")
  assert told in refusal(client.post("/v1/multi-prompt", content=body))
  if told != "got effector at 9 s":
    assert told in refusal(client.post("/v1/project", content=json.dumps(PROJECT | {"control": control})
                                       .replace("Infinity", "1e999")))


@pytest.mark.parametrize("body, told", [
    ({"sampling": {"control": "/etc/passwd"}}, "got the choice of sampling 'control'"),
    ({"sampling": {"control_steps": 1e9}, "control": asked(PATH)}, "got control_steps 1000000000.0, expected"),
    ({"control": asked({**PATH, "times": [0, 300, 600]})}, "control: got what takes 600 s, expected at most"),
    ({"control": asked({**PATH, "points": [[0, 0], [9000, 0]], "speed": 1e-3})}, "control: got what takes 9")])
def test_a_request_asks_for_no_more_than_a_studio_makes(client, body, told):
  status = 422 if "sampling" in body else 400
  assert told in refusal(client.post("/v1/generate", json={"prompt": "a person walks"} | body), status)


@pytest.mark.slow
def test_a_stream_takes_constraints_of_what_lies_ahead(client):
  """That it follows them and what is committed stays is tests/control/test_guidance.py's."""
  with client.websocket_connect(URL) as socket:
    page = Page(socket)
    page.send(type="control", control=asked(PATH))
    assert "no stream yet" in page.until(type="error")["message"]
    page.send(type="start", prompt="a person walks", seed=4, speed=0, ahead=1)
    page.more(3)
    page.send(type="control", control=asked({"type": "loop"}))
    assert "got loop for a stream" in page.until(type="error")["message"]
    sent = page.blocks[-1]["committed"]
    page.send(type="control", control=asked({"type": "root_path", "points": [[1, 1], [2, 1]], "speed": 1.0}))
    held = page.until(type="constrained")
    assert held["from_frame"] >= sent and held["until_frame"] > held["from_frame"] + 20
    while page.blocks[-1]["committed"] < held["until_frame"]:
      page.more(1)
    page.send(type="control", control=None)
    assert page.until(type="constrained")["until_frame"] == 0


def test_a_path_of_a_stream_begins_where_the_body_is():
  limits, signal_of = Limits(), lambda *control, at=None, ends=None: stream_constraints.signal_of(
      control, at, 40, (1.0, 2.0), ends, 20.0, limits)
  path = RootPath([[1, 3], [2, 3]], speed=1.0)
  found = signal_of(path)
  given = np.asarray(found.given)[0, :, 0, 0]
  assert not given[:40].any() and given[40:].all()
  assert np.abs(found.positions[0, 40, 0, [0, 2]] - [1, 2]).max() < 1e-6
  assert np.abs(found.positions[0, -1, 0, [0, 2]] - [2, 3]).max() < 0.06
  placed = signal_of(path, at=5.0)  # as it is
  assert np.flatnonzero(np.asarray(placed.given)[0, :, 0, 0])[0] == 100
  assert np.abs(placed.positions[0, 100, 0, [0, 2]] - [1, 3]).max() < 1e-6
  assert signal_of() is None
  pose = synthetic_clips(0, 1)[0].joints[0]
  standing = signal_of(Keyframe(pose, 0.125, "world"), at=2.5)
  assert standing.given[0, 53].all(), "half a frame is rounded up, as elsewhere"
  with pytest.raises(InputError, match="got control from 1e[+]06 s on of a stream that is at 2.0 s"):
    signal_of(path, at=1e6)
  with pytest.raises(InputError, match="at most 120 s"):
    signal_of(EffectorTarget("head", [200.0], [[0, 1.5, 0]]))
  with pytest.raises(InputError, match="keyframe at 9 s"):
    signal_of(path, Keyframe(pose, 9.0), EffectorTarget("head", [10.0], [[0, 1.5, 0]]))
  for wrong, told in ((Loop(), "got loop"), (Keyframe(pose, 1.0), "anywhere"), (RootPath(speed=1, heading=0), "points"),
                      (EffectorTarget("head", [1.0], [[0, 1, 0]], "root"), "relative to the root")):
    with pytest.raises(InputError, match=told):
      stream_constraints.check([wrong])


def _walked(course, points, pace=0.06, limit=2000):
  """Places of a body that always goes pace metres towards half a metre ahead of what rest says is left."""
  place, walked = np.array(points[0], float), []
  while (rest := course.rest(tuple(place))) is not None and len(walked) < limit:
    walked.append(place)
    goal = rest.points[min(2, len(rest.points) - 1)]
    place = place + (goal - place) * min(1.0, pace / max(np.linalg.norm(goal - place), 1e-9))
  return np.array(walked)


@pytest.mark.parametrize("points", [[[0, 0], [0, 3], [3, 3]], [[0, 0], [2, 2], [4, 0], [2, -2], [0, 0], [-2, 2]]])
def test_a_path_without_times_waits_for_a_slow_body_and_is_gone_along_to_its_end(points):
  """At a fifth of the path's speed; one crosses its own beginning, and none of it is left out."""
  course = stream_constraints.Course.from_constraints([RootPath(points, speed=1.2)], None, tuple(points[0]))
  walked = _walked(course, points, 0.012)
  assert np.linalg.norm(walked[-1] - points[-1]) < 0.15
  for corner in points:
    assert np.linalg.norm(walked - corner, axis=-1).min() < 0.3


def test_what_is_left_of_a_path_begins_at_the_body_and_never_goes_back():
  course = stream_constraints.Course.from_constraints([RootPath([[0, 0], [0, 4]])], None, (0.0, 0.0))
  assert np.allclose(course.rest((0.2, 1.0)).points[[0, 1, -1]], [[0.2, 1.0], [0, 1.4], [0, 4]], atol=0.03)
  assert course.rest((0.0, 0.2)).points[1, 1] > 1.3  # pushed back, it goes on from where it had been
  assert course.rest((0.0, 2.2)) is not None  # a step ahead
  assert course.rest((0.0, 3.3)) is not None and course.rest((0.0, 3.95)) is None


def test_only_a_path_alone_without_times_waits():
  path, pose = RootPath([[0, 0], [0, 4]]), Keyframe(synthetic_clips(0, 1)[0].joints[0], 1.0, "world")
  course = lambda control, at=None: stream_constraints.Course.from_constraints(control, at, (0.0, 0.0))
  assert course([path]) is not None
  for control in ([path, pose], [RootPath([[0, 0], [0, 4]], times=[0, 3])], [pose], [], None,
                  [RootPath([[0, 0], [0, 4]], heading=[0.0, 1.0])]):
    assert course(control) is None
  assert course([path], at=3.0) is None


def test_a_led_stream_is_held_to_what_is_left_of_its_path_before_each_block():
  held, run = [], object.__new__(streams._Run)
  run.stream = SimpleNamespace(decided=20, place=(0.0, 0.0), num_frames=40,
                               hold=lambda signal: held.append(signal) or 20)
  run.fps, run.constrained_until, run._course_at, live, limits = 20.0, 86, 20, run.stream, Limits()
  run._course = stream_constraints.Course.from_constraints([RootPath([[0, 0], [0, 4]])], None, live.place)
  run._update_constraints(limits)
  assert not held  # nothing has been decided since
  live.decided, live.place = 32, (0.1, 0.3)  # half as far as the path goes in that time
  run._update_constraints(limits)
  given = np.asarray(held[0].given)[0, :, 0, 0]
  assert not given[:32].any() and given[32:].all()
  np.testing.assert_allclose(held[0].positions[0, 32, 0, [0, 2]], [0.1, 0.3], atol=1e-6)
  assert run.constrained_until > 86 and abs(held[0].positions[0, -1, 0, 2] - 4) < 0.07  # later, and all the way
  for live.decided, z in ((56, 1.6), (80, 2.9), (104, 3.97), (116, 4.2)):
    live.place = 0.0, z
    run._update_constraints(limits)
  assert held[3:] == [None] and not run.constrained_until
