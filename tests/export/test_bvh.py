"""BVH files, read by a small parser of this test's own and by the library's reader."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from motion_jax import export
from motion_jax.data.clip import Clip
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.data.mocap.bvh import bvh_clip
from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import with_lengths
from motion_jax.motion.skeleton import HUMANML3D, KIT, bone_lengths


def walk(num_frames=60, turns=0.0):
  joints = synthetic_joints("walk", num_frames, np.random.default_rng(0))
  angle = np.linspace(0, 2 * np.pi * turns, num_frames)
  return Clip(joints=rot.rotate(rot.about_axis(angle, "y")[:, None], joints).astype(np.float32), id="walk")


def parse(path):
  """Joint positions (T, J, 3) by name order of the file, the raw channel rows, channel lists, and the frame time."""
  names, parents, offsets, channels, stack, in_end = [], [], [], [], [], False
  lines = iter(path.read_text().splitlines())
  for line in lines:
    words = line.split()
    if words[0] in ("ROOT", "JOINT"):
      names.append(words[1])
      parents.append(stack[-1] if stack else -1)
    elif words[0] == "End":
      in_end = True
    elif words[0] == "{":
      stack.append(-2 if in_end else len(names) - 1)
    elif words[0] == "}":
      in_end = in_end and stack.pop() != -2 or (False if in_end else stack.pop() is None)
    elif words[0] == "OFFSET" and not in_end:
      offsets.append([float(word) for word in words[1:]])
    elif words[0] == "CHANNELS":
      assert int(words[1]) == len(words) - 2
      channels.append(words[2:])
    elif words[0] == "MOTION":
      break
  num_frames, frame_time = int(next(lines).split()[1]), float(next(lines).split()[2])
  rows = np.array([[float(word) for word in line.split()] for line in lines])
  assert rows.shape == (num_frames, sum(map(len, channels))) and not stack
  world, position, column = {}, {}, 0
  for j, (parent, own) in enumerate(zip(parents, channels)):
    values = rows[:, column:column + len(own)]
    column += len(own)
    places = [c for c in own if c.endswith("position")]
    local = values[:, :3] if places else np.tile(offsets[j], (num_frames, 1))
    axes = "".join(c[0] for c in own if c.endswith("rotation"))
    turn = Rotation.from_euler(axes, values[:, len(places):], degrees=True)  # capitals: about the moving axes
    world[j] = turn if parent < 0 else world[parent] * turn
    position[j] = local if parent < 0 else position[parent] + world[parent].apply(local)
  order = [names.index(name) for name in HUMANML3D.joints]
  return np.stack([position[j] for j in order], axis=1), rows, channels, frame_time


def bent(seed, num_frames=60):
  """A walk with a pelvis and a chest that bend in themselves by a centimetre, as generated ones do; bones keep."""
  clip, rng = walk(num_frames), np.random.default_rng(seed)
  joints = clip.joints + 0.02 * np.sin(np.linspace(0, 6, num_frames))[:, None, None] * rng.normal(size=(22, 3))
  return clip.replace(joints=with_lengths(joints, HUMANML3D).astype(np.float32))


def head_of(path):
  return path.read_text().split("MOTION")[0]


@pytest.mark.parametrize("unit, scale", [("centimetres", 0.01), ("metres", 1.0)])
def test_another_parser_finds_the_joints(tmp_path, unit, scale):
  clip = bent(0)
  joints, rows, channels, frame_time = parse(export.bvh(clip, tmp_path / "a.bvh", unit=unit, exact=True))
  assert np.abs(joints * scale - clip.joints).max() < 1e-4  # metres
  assert frame_time == pytest.approx(1 / 20) and len(rows) == clip.num_frames


@pytest.mark.parametrize("exact, far", [(False, 0.01), (True, 5e-4)])
def test_our_reader_finds_the_joints(tmp_path, exact, far):
  clip = bent(0)
  path, = export.save(clip, tmp_path / "a.bvh", exact=exact)
  back = export.load(path)
  assert back.fps == 20 and back.num_frames == clip.num_frames
  off = np.linalg.norm(back.joints - clip.joints, axis=-1)
  assert off.mean() < far and off[:, [7, 8, 10, 11]].max() < min(far, 0.003), "metres; feet stay where they stand"
  slower = export.load(path, fps=10)  # a rate that is said is the frames' rate: none is dropped
  assert slower.fps == 10 and slower.num_frames == clip.num_frames


def test_a_skeleton_that_is_written_is_read(tmp_path):
  """KIT's 21 joints come back as KIT's, in millimetres; as 22 joints where a data set wants these."""
  clip = walk().on_skeleton(KIT)
  path, = export.save(clip, tmp_path / "kit.bvh", exact=True)
  back = export.load(path)
  assert back.skeleton is KIT and back.fps == clip.fps
  assert np.abs(back.joints - clip.joints).max() < 0.1
  joints = bvh_clip(path, fps=clip.fps).joints
  assert joints.shape[1] == 22
  at = HUMANML3D.joints.index("left_wrist")
  np.testing.assert_allclose(joints[:, at], clip.joints[:, KIT.joints.index("left_wrist")] / 1000, atol=1e-4)


def test_motions_of_one_body_share_one_skeleton(tmp_path):
  one, other = (export.bvh(bent(seed), tmp_path / f"{seed}.bvh") for seed in (0, 1))
  head = head_of(one)
  assert head == head_of(other), "offsets, channels and orders of axes are the model's, not the clip's"
  assert head.count("CHANNELS 6") == 1 and head.count("CHANNELS 3") == 21 and head.count("End Site") == 5
  exact = head_of(export.bvh(bent(0), tmp_path / "exact.bvh", exact=True))
  offsets = lambda text: [line for line in text.splitlines() if "OFFSET" in line]
  assert offsets(exact) == offsets(head) and exact.count("CHANNELS 6") > 4


def test_another_person_keeps_its_own_bones(tmp_path):
  clip = bent(0)
  tall = clip.replace(joints=clip.joints * np.float32(1.1))
  joints, *_ = parse(export.bvh(tall, tmp_path / "a.bvh"))
  assert np.abs(bone_lengths(joints, HUMANML3D) * 0.01 - 1.1 * HUMANML3D.bone_lengths).max() < 1e-3


def test_what_rotations_cost_is_known(tmp_path):
  clip = bent(0)
  mean, worst, joint = export.rig_error(clip)
  joints, *_ = parse(export.bvh(clip, tmp_path / "a.bvh"))
  off = 1000 * np.linalg.norm(joints * 0.01 - clip.joints, axis=-1)
  assert mean == pytest.approx(off.mean(), abs=0.01) and worst == pytest.approx(off.max(), abs=0.01)
  assert joint == HUMANML3D.joints[off.max(0).argmax()].replace("_", " ")


def test_angles_follow_several_whole_turns(tmp_path):
  joints, rows, channels, _ = parse(export.bvh(walk(120, turns=3), tmp_path / "a.bvh"))
  names = [name for own in channels for name in own]
  steps = np.abs(np.diff(rows, axis=0))[:, ["rotation" in name for name in names]]
  assert steps.max() < 60, "no angle jumps"
  assert channels[0][3] == "Yrotation"
  assert rows[-1, 3] - rows[0, 3] == pytest.approx(3 * 360, abs=30), "the heading counts the turns"
