"""A character on the studio's page: its bones stand where the motion's joints do, and bad files get a sentence."""
import time

import numpy as np
import pytest

from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D
from tests.studio.server.browser import needs_a_browser
from tests.studio.server.characters import character, places

pytestmark = needs_a_browser
CHARACTERS = {  # what each is: names, rest pose, unit, axes
    "mixamo.glb": dict(rig="mixamo", unit=0.01, rolls=True), "unreal.glb": dict(rig="ue5", arms=0.8, rolls=True),
    "rigify.glb": dict(rig="rigify", scale=0.4, without=("left_collar", "right_collar")),
    "one.vrm": dict(vrm=1), "zero.vrm": dict(vrm=0, back=True),
    "short.glb": dict(rig="lafan", scale=3.0, without=("head", "neck"))}


def _motion():
  """Joints (T, 22, 3) of one body that kicks, raises its arms, turns and bows."""
  frames, skeleton = 30, HUMANML3D
  wave, joints = np.sin(np.linspace(0, 3, frames)), []
  for w in wave:
    turned = np.tile([1.0, 0, 0, 0], (22, 1))
    bends = {"pelvis": ("y", 0.9 * w), "spine1": ("x", 0.3 * w),
             "left_hip": ("x", -1.4 * w), "left_knee": ("x", 1.2 * w), "right_hip": ("x", -0.3 * w),
             "right_knee": ("x", 0.5 * w), "left_shoulder": ("z", 0.9 * w), "right_shoulder": ("z", 1.1 * w),
             "right_elbow": ("y", 1.3 * w), "neck": ("x", 0.2 * w)}
    for j, joint in enumerate(skeleton.joints):
      above = turned[skeleton.parents[j]] if j else np.array([1.0, 0, 0, 0])
      axis, angle = bends.get(joint, ("x", 0.0))
      turned[j] = rot.multiply(above, rot.about_axis(np.array(angle), axis))
    joints.append(places(turned))
  joints = np.array(joints) + np.linspace([0, 0, 0], [0.5, 0, 1], frames)[:, None]
  return joints - [0, joints[..., 1].min(), 0]


@pytest.fixture
def shown(page, tmp_path):
  """The page with a motion of the mannequin's proportions on the timeline."""
  page.find("#mode-timeline").click()
  np.save(tmp_path / "kick.npy", _motion().astype(np.float32))
  page.find("#motion-file").send_keys(str(tmp_path / "kick.npy"))
  page.wait("stale === false && window.__studio.frames === 30")
  return page


def _off(page, frame):
  """{joint: metres} between the bones of the character and the joints of the motion."""
  page.driver.execute_script("window.__studio.seek(arguments[0])", frame / 20)
  page.wait(f"frame === {frame} && window.__studio.figures === 1")
  joints = np.array(page.get(f"joints({frame}, {frame + 1})")).reshape(22, 3)
  return {joint: float(np.linalg.norm(np.array(place) - joints[HUMANML3D.joints.index(joint)]))
          for joint, place in page.get("places()").items()}


def test_every_character_stands_where_the_motion_does(shown, tmp_path):
  page = shown
  for name, about in CHARACTERS.items():
    (tmp_path / name).write_bytes(character(**about))
    page.find("#character-file").send_keys(str(tmp_path / name))
    page.wait(f"characters.shown === '{name}'", 15)
    for frame in (0, 7, 12):
      end = time.monotonic() + 10
      while max((off := _off(page, frame)).values()) > 0.001:  # until the page has drawn the frame
        assert time.monotonic() < end, (name, frame, off)
        time.sleep(0.1)
      assert set(off) >= {"pelvis", "left_ankle", "right_wrist"}
  kept = page.get("characters.kept")
  assert len(kept) == 4 and "mixamo.glb" not in kept  # the browser keeps the last ones
  page.driver.refresh()
  page.wait("ready && window.__studio.characters.shown === 'short.glb'")
  page.driver.execute_script("const list = document.getElementById('character'); list.value = ''; list.onchange()")
  page.wait("characters.shown === ''")
  assert not page.get("errors")


BAD = {
    "no skin": (character(skin=False), "has no skin"),
    "no legs": (character(without=("left_knee", "left_ankle", "left_foot")), "has no left leg"),
    "two": (character(twice=True), "has two humanoids"), "mirrored": (character(unit=-1), "is mirrored"),
    "cut": (character()[:3000], "is cut off"), "no file": (b"no glb at all, but long enough", "is no binary glTF"),
    "broken": (character().replace(b'"asset"', b'"asset", '), "not valid")}


def test_what_cannot_move_gets_one_sentence(shown, tmp_path):
  for what, (data, words) in BAD.items():
    (tmp_path / f"{what}.glb").write_bytes(data)
    shown.find("#character-file").send_keys(str(tmp_path / f"{what}.glb"))
    shown.wait(f"errors.some((one) => one.startsWith('{what}.glb') && one.includes('{words}'))", 15)
    assert shown.get("characters") == {"kept": [], "shown": ""}
