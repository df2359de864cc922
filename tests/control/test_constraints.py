"""Constraints: what is refused and how, what they are as arrays, and as JSON."""
import json

import numpy as np
import pytest

from motion_jax.control import files, paths
from motion_jax.control import signal as signals
from motion_jax.control.compiling import angle_of, compile
from motion_jax.control.constraints import (
  EffectorTarget,
  EndPose,
  InPlace,
  KeepParts,
  Keyframe,
  Loop,
  RootPath,
  StartPose,
)
from motion_jax.motion import inverse
from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, SMPL
from motion_jax.utils.errors import InputError


def pose(heading=0.0, x=0.0, z=0.0):
  """A body (22, 3) that stands with its arms down, a little bent."""
  joints = np.zeros((22, 3))
  for chain in HUMANML3D.chains:
    for parent, joint in zip(chain[:-1], chain[1:]):
      joints[joint] = joints[parent] + HUMANML3D.offsets[joint]
  joints[..., 1] -= joints[[7, 8, 10, 11], 1].min()
  return signals.rotate_about_y(joints, heading) + [x, 0, z]


FLAT = pose() * [0, 1, 1]  # without width, so that it faces nowhere
WALK = np.stack([pose(z=0.05 * t) for t in range(61)])
EVERY = [
    RootPath([[0, 0], [2, 0], [2, 3]]), RootPath([[0, 0.9, 0], [1, 0.9, 1]], [0, 2], heading=[0, 1.5], between=False),
    RootPath(speed=1.5, heading=[0, 1], times=[0, 2]), Keyframe(pose(), 1.0), Keyframe(pose(1, 2, 3), 2.0, "world"),
    StartPose(pose()), EndPose(pose(), "world"),
    EffectorTarget("left_hand", [0.5, 1], [[0.3, 1, 0.2], [0, 1, 1]]),
    EffectorTarget("head", 1.5, [0, 1.2, 0.3], "root"), Loop(), InPlace(),
    KeepParts(WALK, ("legs", "head"), 20, [[1, 2]])]


def test_json_gives_the_same_constraints_back(tmp_path):
  path = files.save(EVERY, tmp_path / "asked.json")
  back = files.load(path)
  assert [type(one) for one in back] == [type(one) for one in EVERY]
  assert json.dumps(files.to_json(back)) == json.dumps(files.to_json(EVERY))
  assert json.loads(path.read_text())["version"] == 1


WRONG = [
    (lambda: EffectorTarget("left_hnad", [1], [[0, 1, 0]]), "did you mean left_hand?"),
    (lambda: EffectorTarget("left_hand", [1], [[0, np.nan, 0]]), "finite"),
    (lambda: EffectorTarget("left_hand", [1, 2], [[0, 1, 0]]), "one for each"),
    (lambda: EffectorTarget("head", [2, 1], [[0, 1, 0]] * 2), "do not rise"),
    (lambda: RootPath([[0, 0], [1, 1e9]]), "below 10000"),
    (lambda: RootPath(), "both a speed and a heading"),
    (lambda: RootPath([[0, 0], [1, 1]], [0]), "give one each"),
    (lambda: RootPath([[0, 0, 0, 0]]), "expected (..., 2) or (..., 3)"),
    (lambda: RootPath([[0, 0], [1]]), "not as many in every row"),
    (lambda: Keyframe(pose()[:21], 1.0), "21 joints"),
    (lambda: Keyframe(pose(), 1.0, "here"), "anywhere, world"),
    *((lambda make=make: make(FLAT), "faces nowhere") for make in (StartPose, EndPose, lambda x: Keyframe(x, 1.0))),
    (lambda: KeepParts(np.stack([pose(), FLAT]), ("legs",)), "in frame 1, so that the body faces nowhere"),
    (lambda: KeepParts(WALK, ("legs", "tail")), "legs, torso"),
    (lambda: KeepParts(WALK, ()), "none of the parts")]


def test_what_is_none_is_refused():
  for make, words in WRONG:
    with pytest.raises(InputError) as caught:
      make()
    assert words in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize("constraints, words", [
    ([EffectorTarget("left_hand", [3.2], [[0, 1, 0]])], "the motion ends at 3 s (frame 60)"),
    ([Keyframe(pose(), 1.0), Keyframe(pose(), 1.01)], "two poses at 1.00 s (frame 20)"),
    ([EndPose(pose()), Keyframe(pose(), 3.0)], "two poses"),
    ([EffectorTarget("head", [1], [[0, 1, 0]]), EffectorTarget("head", [1], [[0, 1.5, 0]])], "two places of head"),
])
def test_what_cannot_be_together_is_refused(constraints, words):
  with pytest.raises(InputError, match=r"^[^\n]*$") as caught:
    compile(constraints, 61, 20.0, WALK)
  assert words in str(caught.value)


@pytest.mark.parametrize("data, words", [
    ([], "expected {"), ({"version": 2, "constraints": []}, "version 2"),
    ({"version": 1, "constraints": [{"type": "root_pth"}]}, "did you mean root_path?"),
    ({"version": 1, "constraints": [{"type": "loop", "speed": 1}]}, "expected no more"),
    ({"version": 1, "constraints": [{"type": "keyframe", "time": 1}]}, "joints is missing"),
    ({"version": 1, "constraints": [{"type": "keyframe", "time": 1, "file": "/etc/passwd"}]}, "give its joints here"),
    ({"version": 1, "constraints": [{"type": "effector", "joint": "head", "times": [1], "positions": [["a", 1, 2]]}]},
     "no numbers"),
    ({"version": 1, "constraints": [{"type": "loop"}] * 300}, "at most 256"),
])
def test_json_that_is_none_is_refused(data, words):
  with pytest.raises(InputError) as caught:
    files.from_json(data)
  assert words in str(caught.value)


def test_standard_curves_lead_to_their_sides():
  """The left of a body that faces +Z is +X."""
  for name, first, then in (("circle", 1, 1), ("figure of eight", 1, -1), ("corner", 0, 1)):
    path = paths.CURVES[name](20.0)
    at = lambda share, path=path: path[round(share * (len(path) - 1)), 0]
    assert np.sign(np.round(at(0.25), 1)) == first and np.sign(np.round(at(0.75), 1)) == then, name
    steps = np.linalg.norm(np.diff(path, axis=0), axis=-1)
    assert np.median(steps) * 20 == pytest.approx(paths.SPEED, rel=0.01) and not path[0].any(), name


def test_a_file_that_is_too_large_is_not_read(tmp_path):
  with open(tmp_path / "large.json", "wb") as file:
    file.truncate(files.MOST_BYTES + (1 << 20))
  with pytest.raises(InputError, match="holds 33 MiB, expected constraints of at most 32 MiB"):
    files.load(tmp_path / "large.json")


def test_paths_are_followed_at_one_speed_and_pass_their_points():
  signal = compile([RootPath([[0, 0], [0, 2], [2, 2]])], 61)
  way = signal.positions[0, :, 0][:, [0, 2]]
  assert signal.given[0, :, 0, [0, 2]].all() and not signal.given[0, :, 0, 1].any()
  steps = np.linalg.norm(np.diff(way, axis=0), axis=-1)
  assert np.ptp(steps) < 0.02 * steps.mean()
  assert np.linalg.norm(way - [0, 2], axis=-1).min() < 0.05 and np.abs(way[-1] - [2, 2]).max() < 1e-6
  timed = compile([RootPath([[0, 0], [0, 2], [2, 2]], [0, 1, 3])], 61).positions[0, :, 0][:, [0, 2]]
  np.testing.assert_allclose(timed[[0, 20, 60]], [[0, 0], [0, 2], [2, 2]], atol=1e-6)
  assert compile([RootPath([[0, 0], [0, 2]], [0, 2], between=False)], 61).given.sum() == 4
  assert compile([RootPath([[0, 0], [0, 1]], speed=1.0)], 61).given[0, :, 0, 0].sum() == 21  # there after a second
  assert abs(paths.length(np.array([[0.0, 0], [3, 0], [3, 0], [5, 0]])) - 5) < 1e-6


def test_speed_and_heading_make_a_path():
  signal = compile([RootPath(speed=2.0, heading=np.pi / 2)], 41)
  np.testing.assert_allclose(signal.positions[0, -1, 0], [4, 0, 0], atol=1e-5)  # towards +X
  np.testing.assert_allclose(signal.heading[0], np.pi / 2, atol=1e-6)


def test_a_pose_that_may_be_anywhere_is_laid_where_the_body_is_and_on_paths():
  placed = compile([Keyframe(pose(2.0, 9, 9), 1.0)], 61, 20.0, WALK)
  np.testing.assert_allclose(placed.positions[0, 20], WALK[20], atol=1e-5)
  assert compile([Keyframe(pose(), 1.0)], 61).is_empty and not compile([StartPose(pose())], 61).is_empty
  on_path = compile([RootPath([[0, 0], [4, 0]]), Keyframe(pose(), 1.5)], 61)
  np.testing.assert_allclose(on_path.positions[0, 30], pose(np.pi / 2, 2, 0), atol=1e-3)


def test_targets_seen_from_the_body_turn_with_it():
  body = np.stack([pose(np.pi / 2, 1, 2)] * 61)
  signal = compile([EffectorTarget("right_hand", [1], [[0.1, 1.2, 0.5]], "root")], 61, 20.0, body)
  np.testing.assert_allclose(signal.positions[0, 20, 21], [1.5, 1.2, 1.9], atol=1e-5)  # ahead is +X, left is -Z
  assert abs(angle_of(body)[0] - np.pi / 2) < 1e-6


def test_a_motion_begins_where_its_path_does_and_faces_along_it():
  signal = compile([RootPath([[3, 1], [5, 1]])], 61)
  place = signals.placement(signal)
  np.testing.assert_allclose(place, (3, 1, np.pi / 2), atol=1e-6)
  inside = signals.to_model_frame(signal, place)
  np.testing.assert_allclose(inside.positions[0, -1, 0], [0, 0, 2], atol=1e-5)
  np.testing.assert_allclose(signals.to_world_frame(inside.positions[0], place)[-1, 0], [5, 0, 1], atol=1e-5)
  assert signals.placement(compile([], 5)) == signals.Placement()


def test_kimodos_file_is_read():
  points, angles, body = [[0, 0], [0, 1], [1, 2]], np.array([0, 0.5, 1]), pose(0.7, 1, 2)
  on_smpl = with_lengths(body[None], SMPL)
  path = {"type": "root2d", "frame_indices": [0, 30, 60], "smooth_root_2d": points,
          "global_root_heading": np.stack([np.cos(angles), np.sin(angles)], -1).tolist()}
  whole = {"type": "fullbody", "frame_indices": [30], "root_positions": on_smpl[:, 0].tolist(), "local_joints_rot":
           rot.to_vector(inverse.relative(inverse.world_rotations(on_smpl, SMPL), SMPL)).tolist()}
  back = files.from_kimodo([path, whole])
  np.testing.assert_allclose(back[0].points, points)
  np.testing.assert_allclose(back[0].heading, angles)
  assert back[1].time == 1.0
  assert np.linalg.norm(back[1].joints - body, axis=-1).max() < 0.15  # SMPL's hips lie lower
  hand = {"type": "left-hand", "frame_indices": [30], "local_joints_rot": np.zeros((1, 22, 3)).tolist(),
          "root_positions": [[0, 1, 0]]}
  assert files.from_kimodo([hand])[0].joint == "left_hand"
  for broken in ([{"type": "root3d"}], [{"type": "root2d"}], [dict(hand, local_joints_rot=[[[0, 0, 0]] * 77])]):
    with pytest.raises(InputError):
      files.from_kimodo(broken)
