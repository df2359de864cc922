"""The parts of the studio's page that need no browser: what undo goes through, clocks, scales, curves. Run by node."""
import pathlib
import shutil
import subprocess

import pytest

from motion_studio.server.app import ASSETS

NODE = shutil.which("node")


@pytest.mark.skipif(NODE is None, reason="there is no node, which runs the page's scripts without a browser")
def test_the_parts_do_what_they_say(tmp_path):
  for path in [*ASSETS.glob("*.js"), *pathlib.Path(__file__).with_name("page").glob("*.mjs")]:
    shutil.copy(path, tmp_path)
  (tmp_path / "package.json").write_text('{"type": "module"}')
  done = subprocess.run([NODE, "--test", "parts.test.mjs"], cwd=tmp_path, capture_output=True, text=True, timeout=120)
  assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]
