"""A character on the studio's page: shown, kept by the browser, moved with the motion; viewer.test.mjs has the rest."""
import time

import numpy as np
import pytest

from motion_jax.export.html import resting_body
from motion_jax.motion.skeleton import HUMANML3D
from tests.studio.server.browser import needs_a_browser
from tests.studio.server.characters import CHARACTERS, REFUSED, character, moving

pytestmark = [pytest.mark.slow, needs_a_browser]


def _off(page, frame):
  """The largest distance between the character's bones and the motion's joints, metres."""
  joints = np.array(page.get(f"joints({frame}, {frame + 1})")).reshape(22, 3)
  return max(np.linalg.norm(np.array(place) - joints[HUMANML3D.joints.index(joint)])
             for joint, place in page.get("places()").items())


def test_a_character_moves_with_the_motion_and_is_kept_by_the_browser(page, tmp_path):
  rest = np.array(resting_body()["rest"])
  page.find("#mode-timeline").click()
  np.save(tmp_path / "kick.npy", moving(rest).joints)
  page.find("#motion-file").send_keys(str(tmp_path / "kick.npy"))
  page.wait("stale === false && window.__studio.frames === 30")
  names = list(CHARACTERS)[:5]
  for name in names:
    (tmp_path / name).write_bytes(character(tmp_path, rest, **CHARACTERS[name]))
    page.find("#character-file").send_keys(str(tmp_path / name))
    page.wait(f"characters.shown === '{name}'", 15)
  page.driver.execute_script("window.__studio.seek(0.35)")
  page.wait("frame === 7 && window.__studio.figures === 1")
  end = time.monotonic() + 20
  while (off := _off(page, 7)) > 0.01:  # until the page has drawn the frame
    assert time.monotonic() < end, off
    time.sleep(0.1)
  made, words = REFUSED["skin.glb"]
  (tmp_path / "skin.glb").write_bytes(character(tmp_path, rest, **made))
  page.find("#character-file").send_keys(str(tmp_path / "skin.glb"))
  page.wait(f"errors.some((one) => one.startsWith('skin.glb') && one.includes('{words}'))", 15)
  assert page.get("characters") == {"kept": names[1:], "shown": names[-1]}  # the browser keeps the last four
  page.driver.refresh()
  page.wait(f"ready && window.__studio.characters.shown === '{names[-1]}'")
  page.driver.execute_script("const list = document.getElementById('character'); list.value = ''; list.onchange()")
  page.wait("characters.shown === ''")
