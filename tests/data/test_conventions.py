"""What capture files leave open is found as Blender shows it: unit, upward axis, collars, a pose before the motion."""
import warnings

import numpy as np
import pytest

from motion_jax.data.build import build
from motion_jax.data.mocap.bvh import bvh_clip, read_bvh
from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import to_pose
from motion_jax.motion.retarget import leg_scale
from motion_jax.motion.skeleton import body_axes
from tests.data.bvh_files import write_figure


def notes_of(read, *args, **options):
  """(what it returns, its warnings)."""
  with warnings.catch_warnings(record=True) as found:
    warnings.simplefilter("always")
    result = read(*args, **options)
  return result, [str(one.message) for one in found]


def degrees_apart(a, b):
  return np.degrees(np.arccos((rot.unit(a) * rot.unit(b)).sum(-1).clip(-1, 1)))


LEFT = np.array([[1.0, 0, 0]])
IN_ONE_POINT = {"LeftShoulder": (0, 0, 0), "RightShoulder": (0, 0, 0), "LeftArm": (17, 16, 0), "RightArm": (-17, 16, 0)}
def test_placed_collars_turn_with_the_file_s_own_chest(tmp_path):
  """Shoulders that a file turns by themselves do not turn the chest, and the bones to the collars keep their length."""
  frames = 40
  shrug = np.stack([20 * np.sin(np.arange(frames) / 5), 15 * np.cos(np.arange(frames) / 4), np.zeros(frames)], -1)
  lean = np.stack([np.zeros(frames), 30 * np.sin(np.arange(frames) / 6), 20 * np.sin(np.arange(frames) / 9)], -1)
  path = write_figure(tmp_path / "a.bvh", IN_ONE_POINT, {"LeftShoulder": shrug, "Spine1": lean}, frames)
  joints = bvh_clip(path).joints.astype(float)
  file = read_bvh(path)
  chest = file.turned[:, file.names.index("Spine2")]
  ours = to_pose(joints).turned[:, 9]
  apart = rot.multiply(rot.conjugate(chest), ours)
  assert degrees_apart(rot.rotate(apart, LEFT), rot.rotate(apart, LEFT)[:1]).max() < 4
  assert np.linalg.norm(joints[:, 13] - joints[:, 9], axis=-1).std() < 1e-6


def outward(degrees):
  """Offsets of legs that point so far outward at rest, and the turns that bring them straight down."""
  angle = np.radians(degrees)
  down = lambda length, sign: (sign * length * np.sin(angle), -length * np.cos(angle), 0)
  offsets = {f"{side}{name}": down(length, sign) for side, sign in (("Left", 1), ("Right", -1))
             for name, length in (("Leg", 42), ("Foot", 41))}
  return offsets, {"LeftUpLeg": (-degrees, 0, 0), "RightUpLeg": (degrees, 0, 0)}


@pytest.mark.parametrize("degrees, arms", [(0, 0), (20, 40)], ids=["T-pose", "A-pose"])
def test_a_set_pose_before_the_motion_is_left_out(tmp_path, degrees, arms):
  """Also where the legs of the rest pose point outward, so that the set pose itself turns them."""
  offsets, straight = outward(degrees)
  frames, fps = 60, 60
  swing = np.zeros((frames, 3))
  swing[1:, 2] = 15 * np.sin(np.arange(frames - 1) / 20)
  turns = {}
  for side, sign in (("Left", 1), ("Right", -1)):
    turns[side + "UpLeg"] = straight[side + "UpLeg"] + sign * swing
    turns[side + "Arm"] = np.concatenate([[(-sign * arms, 0, 0)], np.tile([-75.0 * sign, 0, 0], (frames - 1, 1))])
  path = write_figure(tmp_path / "a.bvh", offsets, turns, frames, fps=fps, swings=False)
  clip, notes = notes_of(bvh_clip, path, fps=fps)
  assert clip.num_frames == frames - 1 and any("frame 0 is a pose set before the motion" in note for note in notes)
  assert np.abs(np.diff(clip.joints, axis=0)).max() * fps < 3, "metres a second"
  assert bvh_clip(path, fps=fps, skip_pose=False).num_frames == frames


def test_what_is_captured_is_not_left_out(tmp_path):
  """A T-pose that is held, or from which an arm comes down at an even speed, and a walk, start with motion; a first
  frame that is straight on one side alone, or the same on both but bent, is no pose that a program sets, however far
  the next one is."""
  held = np.zeros((60, 3))
  held[10:, 0] = np.linspace(0, 70, 50)
  still = {"LeftArm": -held, "RightArm": held}
  even = {"LeftArm": np.arange(60)[:, None] * np.array([[-6.0, 0, 0]])}
  for turns in ({}, still, even):
    path = write_figure(tmp_path / "a.bvh", turns=turns, frames=60, swings=turns is not even)
    assert bvh_clip(path, fps=20.0).num_frames == 60
  then = {"LeftArm": (-75, 0, 0), "RightArm": (75, 0, 0), "LeftForeArm": (0, 0, 0), "RightForeArm": (0, 0, 0)}
  aside = then | {"LeftArm": (30, 0, 0)}
  bent = {"LeftArm": (-40, 0, 0), "RightArm": (40, 0, 0), "LeftForeArm": (0, -60, 0), "RightForeArm": (0, 60, 0)}
  for first in (aside, bent):
    turns = {name: np.array([first[name], *[then[name]] * 29], float) for name in then}
    path = write_figure(tmp_path / "a.bvh", turns=turns, frames=30, swings=False)
    assert bvh_clip(path, fps=20.0).num_frames == 30


@pytest.mark.parametrize("turn, height", [((0, 0, -90), 15), ((0, 0, 90), 40), ((-90, 0, 0), 15)],
                         ids=["on the back, head to -z", "on the face, head to +z", "head to +x"])
def test_a_lying_body_stays_lying(tmp_path, turn, height):
  """The rest pose says that y is up, whatever the motion looks like; a note says how it could be read."""
  clip, notes = notes_of(bvh_clip, write_figure(tmp_path / "a.bvh", turns={"Hips": turn}, root=(0, height, 0)))
  rise = np.median(clip.joints[:, 15] - clip.joints[:, 7], axis=0)
  assert abs(rise[1]) < 0.2 and np.linalg.norm(rise) > 1.2
  assert any("is read with y up" in note for note in notes)


@pytest.mark.parametrize("axes, signs", [((2, 0, 1), (1, 1, 1)), ((1, 2, 0), (1, 1, 1)), ((0, 1, 2), (1, -1, -1)),
                                         ((0, 2, 1), (1, 1, -1)), ((0, 2, 1), (1, -1, 1))],
                         ids=["z", "x", "-y", "-z", "z mirrored twice"])
@pytest.mark.parametrize("turn", [(0, 0, 0), (0, 0, -90)], ids=["stands", "lies"])
def test_the_rest_pose_says_which_axis_is_up_and_its_sign(tmp_path, axes, signs, turn):
  """A body that stands, and one that lies, in files with any axis up: what is up in ours is up."""
  expected = bvh_clip(write_figure(tmp_path / "y.bvh", turns={"Hips": turn}), up="y").joints
  joints = bvh_clip(write_figure(tmp_path / "a.bvh", turns={"Hips": turn}, axes=axes, signs=signs)).joints
  np.testing.assert_allclose(joints[..., 1], expected[..., 1], atol=1e-5)
  facing = lambda x: np.abs(np.linalg.det(body_axes(x.astype(float))[0]) - 1).max()
  assert facing(joints) < 1e-6, "turned, not mirrored"


def test_a_body_on_its_feet_in_the_world_overrules_its_rest_pose(tmp_path):
  """z is up in the world, y at rest: the root turns it by 90 degrees, and its feet are on z = 0."""
  path = write_figure(tmp_path / "a.bvh", turns={"Hips": (0, 0, 90)}, root=(80, 30, 95))
  clip, notes = notes_of(bvh_clip, path)
  assert np.median(clip.joints[:, 15, 1] - clip.joints[:, 7, 1]) > 1.3
  assert any("z is up" in note for note in notes)


@pytest.mark.parametrize("scale, unit, words", [
    (1.0, 0.01, "centimetres"), (0.01, 1.0, "metres"), (1 / 2.54, 0.0254, "inches"),
    (0.7, 0.01, "legs of 0.58 m"), (0.25, 0.0396, "no usual unit"), (4e-4, 24.7, "no usual unit")])
def test_the_unit_is_reported(tmp_path, scale, unit, words):
  """A usual unit where the legs are a person's, else an adult's size; a note says which."""
  clip, notes = notes_of(bvh_clip, write_figure(tmp_path / "a.bvh", scale=scale))
  assert clip.meta["unit"] == pytest.approx(unit, rel=1e-2)
  assert sum("--unit (unit=) corrects it" in note for note in notes) == 1 and any(words in note for note in notes)
  if "no usual" in words:
    assert leg_scale(clip.joints.astype(float)) == pytest.approx(1, abs=0.01)
  assert not notes_of(bvh_clip, tmp_path / "a.bvh", unit=unit)[1]


def test_more_frames_than_the_header_says_are_read(tmp_path):
  """As Blender does, with a note."""
  path = write_figure(tmp_path / "a.bvh", frames=30)
  text = path.read_text()
  path.write_text(text.replace("Frames: 30", "Frames: 10"))
  file, notes = notes_of(read_bvh, path)
  assert file.num_frames == 30 and ["10 frames, 30 lines follow; 30 frames" in note for note in notes] == [True]
  path.write_text(text)
  assert not notes_of(read_bvh, path)[1]


def test_notes_about_many_files_are_one_line(tmp_path):
  (tmp_path / "in").mkdir()
  for name in "abc":
    write_figure(tmp_path / "in" / f"{name}.bvh", frames=50)
  (tmp_path / "in" / "captions.csv").write_text("file,caption\n" + "".join(f"{n}.bvh,a person walks\n" for n in "abc"))
  _, notes = notes_of(build, tmp_path / "in", tmp_path / "out", mirror=False, progress=False)
  units = [note for note in notes if "centimetres" in note]
  assert len(units) == 1 and "a.bvh and 2 more: by its bones" in units[0]
