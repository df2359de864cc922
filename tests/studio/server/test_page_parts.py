"""The page's parts that need no browser: undo, clocks, scales, curves, characters, turns of limbs. Run by node."""
import base64
import json
import pathlib
import shutil
import subprocess

import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.export.html import VIEWER, resting_body
from motion_jax.motion.pose import to_pose
from motion_jax_studio.server.app import ASSETS
from tests.studio.server import characters

NODE = shutil.which("node")
pytestmark = pytest.mark.skipif(NODE is None, reason="there is no node, which runs scripts without a browser")


def run(script, folder, needs):
  for path in [*needs, pathlib.Path(__file__).with_name("page") / script]:
    shutil.copy(path, folder)
  (folder / "package.json").write_text('{"type": "module"}')
  done = subprocess.run([NODE, "--test", script], cwd=folder, capture_output=True, text=True, timeout=120)
  assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]


@pytest.mark.parametrize("script", ["parts.test.mjs", "notes.test.mjs", "posing.test.mjs", "keys.test.mjs",
                                    "clips.test.mjs"])
def test_the_parts_do_what_they_say(script, tmp_path):
  run(script, tmp_path, ASSETS.glob("*.js"))


@pytest.fixture(scope="module")
def expected(tmp_path_factory):
  """What Python says of limbs, and the bytes of characters and of files that are none."""
  body, clip = resting_body(), np.asarray(synthetic_clips(seed=0, num=1)[0].joints)[:40]
  rest, folder = np.array(body["rest"]), tmp_path_factory.mktemp("characters")
  write = lambda about: characters.character(folder, rest, **about)
  whole = {name: write(about) for name, about in characters.CHARACTERS.items()}
  whole["meshopt.glb"] = characters.with_meshopt(whole["mixamo.glb"])
  refused = {name: (made(whole["unity.glb"]) if callable(made) else write(made), words)
             for name, (made, words) in characters.REFUSED.items()}
  text = lambda data: base64.b64encode(data).decode()
  return {"body": body, "clip": clip.tolist(), "turned": to_pose(clip).turned.tolist(),
          "motion": characters.moving(rest).joints[[7, 12, 20]].tolist(),
          "characters": {name: text(data) for name, data in whole.items()},
          "refused": {name: (text(data), words) for name, (data, words) in refused.items()}}


def test_the_viewer_turns_limbs_and_characters_as_a_motion_does(expected, tmp_path):
  (tmp_path / "expected.json").write_text(json.dumps(expected))
  run("viewer.test.mjs", tmp_path, [VIEWER])
