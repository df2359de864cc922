"""Poses beside a stream's joints: those of the library, in bounded delay, in the messages of docs/protocol.md."""
import re
import subprocess
import sys

import numpy as np
import pytest

from motion_jax.export.rig_stream import RigStream
from motion_jax.utils.errors import InputError
from motion_jax_studio.client import Client
from motion_jax_studio.server.poses import Poses
from tests.conftest import ROOT

START = {"seed": 3, "speed": 0, "frames": 60}


@pytest.mark.slow
def test_a_client_gets_the_poses_of_the_joints(address, library):
  """Of a rig; the example below follows those of a robot."""
  with Client(address).stream("a person walks", pose="rig:unity", **START) as live:
    found, late = [], []
    for rows in live.poses():
      found.append(rows)
      late.append(live.last["committed"] / live.last["fps"] - sum(map(len, found)) / 50)
  about = live.about
  assert about["fps"] == 50 and about["quaternion_order"] == "wxyz" and len(about["axes"].split(",")) == 3
  assert max(late) <= about["delay"] + 1e-6
  pipeline = library.pipeline("tiny", "stream")
  lag = next(message for message in live.messages if message["type"] == "started")["sampling"]["lag"]
  stream, expected = RigStream("unity", pipeline.model.fps), []
  for joints in pipeline.stream("a person walks", seed=3, num_frames=60, lag=lag):
    expected.append(stream.push(joints))
  expected = np.concatenate([*expected, stream.finish()])
  assert expected.shape[1] == 3 + 4 * 22
  np.testing.assert_array_equal(np.concatenate(found), expected.astype(np.float32))


@pytest.mark.parametrize("pose, message", [
    ("g1", "expected robot:g1 or rig:NAME"), ("robot:atlas", "got robot 'atlas', expected g1"),
    ("rig:mixammo", "got rig 'mixammo'"), ("rig:", "expected robot:g1")])
def test_an_unknown_pose_is_one_sentence(address, pose, message):
  with pytest.raises(ValueError, match=message), Client(address).stream("a person walks", pose=pose, **START) as live:
    list(live.poses())


def test_poses_are_of_22_joints():
  from motion_jax.motion.skeleton import KIT
  with pytest.raises(InputError, match="skeleton kit, expected a model of HumanML3D"):
    Poses("rig:unity", KIT, 20.0)


@pytest.mark.slow
def test_the_example_follows_a_stream(address):
  run = subprocess.run([sys.executable, str(ROOT / "examples" / "robot_live.py"), address, "1"], text=True,
                       capture_output=True, stdin=subprocess.DEVNULL)
  assert run.returncode == 0, run.stderr
  assert "pelvis at [" in run.stdout and re.search(r"largest step of a joint 0\.\d+ rad a tick", run.stdout)
