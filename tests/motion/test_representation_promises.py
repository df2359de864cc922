"""What every representation promises, and a further one that is a class and an entry of the registry."""
import dataclasses
import functools

import jax
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion import rotations as rot
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.representations import LAYOUTS, get_layout, layout_for, to_features, to_joints
from motion_jax.motion.representations.base import VECTOR, Block, Representation
from motion_jax.motion.retarget import mirror
from motion_jax.motion.skeleton import HUMANML3D, facing
from motion_jax.motion.stats import compute_stats, load_stats, save_stats

WALK, CURVE, TURN = 1, 3, 5


@pytest.fixture(params=LAYOUTS)
def layout(request):
  return LAYOUTS[request.param]


@functools.cache
def _clips(skeleton):
  """Made once for a skeleton; read only."""
  clips = synthetic_clips(0, 6, skeleton=skeleton)
  for clip in clips:
    clip.joints.setflags(write=False)
  return clips


def _joints(layout, index=CURVE):
  return _clips(layout.skeleton)[index].joints


@functools.cache
def _features(layout, index=CURVE, mode="corrected"):
  """Made once for a layout; read only."""
  features = layout.from_joints(_joints(layout, index), mode)
  features.setflags(write=False)
  return features


@functools.cache
def _back(layout, index=CURVE, mode="corrected"):
  """Joints of these features."""
  joints = layout.to_joints(_features(layout, index, mode))
  joints.setflags(write=False)
  return joints


def _moved(joints, angle=2.9):
  return rot.rotate(rot.about_axis(np.array(angle), "y"), joints.astype(np.float64)) + [3.0, 0, -2.0]


def _metres(layout, difference):
  return np.abs(difference).max() * layout.skeleton.unit


# The benchmark's features break where a heading passes 180 degrees.
@pytest.mark.parametrize("mode, index", [("benchmark", CURVE), ("corrected", CURVE), ("corrected", TURN)])
def test_joints_become_features_and_joints_again(layout, mode, index):
  """The same body moves the same way from where its root begins, by positions and by rotations; a second time nothing
  changes: what the first one left out (the place of the start) is left out already."""
  made = _back(layout, index, mode)
  assert made.dtype == np.float32 and made.shape[1:] == (layout.skeleton.num_joints, 3)
  size = lambda joints: np.linalg.norm(joints[:, 1:] - joints[:1, :1], axis=-1)
  if mode == "corrected" or layout.skeleton.name not in ("humanml3d", "kit"):
    assert _metres(layout, size(made) - size(_joints(layout, index).astype(np.float64))[:len(made)]) < 1e-4
  if "rotations" in layout.blocks:
    assert _metres(layout, layout.rotations_to_joints(_features(layout, index, mode), mode=mode) - made) < 2e-3
  again = layout.to_joints(layout.from_joints(made, mode))
  rows = max(len(again) - 81, 1)  # the heading of the last second is smoothed with other frames
  assert _metres(layout, size(again)[:rows] - size(made)[:rows]) < 2e-3


@pytest.mark.parametrize("name", ["full", "steps", "snapmogen", "motionstreamer", "babel"])
def test_inside_jit_are_the_numbers_of_numpy(name):
  """Joints, the root's path and a mirror, of a batch."""
  layout = LAYOUTS[name]
  rows = _features(layout)[:28]
  inside = jax.jit(lambda x: (layout.to_joints(x), *layout.root_path(x), layout.mirror(x)))(np.stack([rows, rows]))
  for made, expected in zip(inside, (layout.to_joints(rows), *layout.root_path(rows), layout.mirror(rows))):
    assert np.abs(np.asarray(made)[1] - expected).max() < 1e-4 * max(1, np.abs(expected).max())


def test_a_mirror_changes_sides_and_two_change_nothing(layout):
  features = _features(layout, TURN)
  seen = layout.mirror(features)
  assert np.array_equal(layout.mirror(seen), features)
  expected = mirror(layout.to_joints(features), layout.skeleton)
  assert _metres(layout, layout.to_joints(seen) - expected) < 1e-3
  assert _metres(layout, layout.root_path(seen)[1] - layout.root_path(features)[1] * [-1, 1, 1]) < 1e-5
  assert np.abs(seen - features).max() > 0.1  # a motion that is not its own mirror image


def test_features_of_a_mirrored_body_are_the_mirrored_features(layout):
  """So every block, rotations and contacts too, has the right signs and sides."""
  clip = mirror(_joints(layout), layout.skeleton)
  one, other = _features(layout), layout.from_joints(clip, "corrected")
  if layout.has_fixed_bones:  # bones of left and right differ by millimetres: nothing may bring them to one length
    joints = _back(layout)
    one, other = (layout.from_joints_in_place(x, "corrected") for x in (joints, mirror(joints, layout.skeleton)))
    assert one.shape == (len(joints), layout.dim), "a row for every frame"
  same = np.isclose(layout.mirror(one), other, atol=2e-3 / min(layout.skeleton.unit * 100, 1))
  assert same.mean(0).min() > 0.98, sorted({name for name, block in layout.blocks.items() if not same[:, block].all()})


def test_what_is_narrowed_is_a_cut(layout):
  features = _features(layout)
  for other in LAYOUTS.values():
    columns = layout.columns_of(other)
    if columns is not None:
      assert np.array_equal(layout.narrow_to(features, other), features[:, columns])
      assert np.array_equal(_features(other), features[:, columns])
      assert other.blocks == {name: layout.blocks[name] for name in other.blocks}
    elif layout.narrows_to(other):
      made = layout.narrow_to(features, other)
      places = layout.to_joints(features) - (layout.to_joints(features)[:1, :1] * [1, 0, 1] if "root" in other.parts
                                             else 0)
      np.testing.assert_allclose(other.to_joints(made), places, atol=1e-6 / layout.skeleton.unit)
      assert np.array_equal(layout.narrow_to(features, other, layout.to_joints(features)), made)
    else:
      with pytest.raises(ValueError, match=f"layout '{layout.name}' does not hold what layout '{other.name}' needs"):
        layout.narrow_to(features, other)
  assert layout.narrow_to(features, layout) is features


def test_the_path_of_the_root_is_that_of_joint_0_and_the_heading_turns_the_body_ahead(layout):
  joints, (heading, path) = _back(layout).astype(np.float64), layout.root_path(_features(layout))
  assert np.abs(np.linalg.norm(heading, axis=-1) - 1).max() < 1e-6 and _metres(layout, path - joints[:, 0]) < 1e-4
  if layout.name == "babel":  # nothing is turned frame by frame
    assert (heading == [1, 0, 0, 0]).all()
  else:
    assert facing(rot.rotate(heading[:, None], joints), layout.skeleton)[:, 2].min() > 0.9


def test_contacts_are_those_of_the_feet(layout):
  features = layout.from_joints(_joints(layout, 0))  # somebody stands
  contacts = layout.contacts(features)
  assert (contacts is None) == ("contacts" not in layout.blocks or "steps" in layout.name)  # there they are not asked
  if contacts is not None:
    assert contacts.shape == (len(features), 4) and contacts.all()
    feet = layout.skeleton.left_feet + layout.skeleton.right_feet
    assert tuple(layout.columns("contacts", foot)[0] for foot in feet) == layout.columns("contacts")


def test_walking_north_is_walking_east(layout):
  """And begins over the origin, faced ahead, with those representations that keep no place."""
  joints = _joints(layout, CURVE)
  other = layout.from_joints(_moved(joints), "corrected")
  assert np.abs(_features(layout) - other).max() < 1e-4 / min(layout.skeleton.unit * 100, 1)
  begins = layout.to_joints(other[:20])
  assert _metres(layout, begins[0, 0, [0, 2]]) < 1e-5
  assert facing(begins.astype(np.float64), layout.skeleton)[0, 2] > 0.95


def test_blocks_cover_all_columns_once(layout):
  assert [i for name in layout.parts for i in layout.columns(name)] == list(range(layout.dim))
  assert layout.fps == layout.skeleton.fps and get_layout(layout) is layout
  assert layout_for(layout.dim) is (layout if layout.name != "steps_kit" else get_layout("essential"))  # the first


@dataclasses.dataclass(frozen=True, eq=False)
class FromRoot(Representation):
  """Where the root is, and every other joint as seen from it: nothing is turned, nothing is scaled."""

  def extract(self, joints, mode):
    return np.concatenate([joints[:, 0], (joints[:, 1:] - joints[:, :1]).reshape(len(joints), -1)], axis=1)

  def root_path(self, features):
    xp = rot.namespace(features)
    root = features[..., self["place"]]
    return xp.broadcast_to(xp.asarray([1.0, 0, 0, 0], root.dtype), root.shape[:-1] + (4,)), root

  def recover(self, features):
    xp = rot.namespace(features)
    _, root = self.root_path(features)
    body = features[..., self["body"]].reshape(features.shape[:-1] + (21, 3))
    return xp.concatenate([root[..., None, :], body + root[..., None, :]], axis=-2)


def test_a_further_representation_is_a_class_and_an_entry(monkeypatch, tmp_path):
  """Joints, a mirror, the coordinates of the same body, and statistics: nothing else knows of it."""
  tiny = FromRoot("from_root", HUMANML3D, {"place": Block(VECTOR), "body": Block(VECTOR, tuple(range(1, 22)))})
  monkeypatch.setitem(LAYOUTS, tiny.name, tiny)
  clip = synthetic_clips(0, 6)[CURVE]
  features = to_features(clip.joints, "from_root")
  assert features.shape == (clip.num_frames, 66)
  np.testing.assert_allclose(to_joints(features, "from_root"), clip.joints, atol=1e-5)
  np.testing.assert_allclose(tiny.to_joints(tiny.mirror(features)), mirror(clip.joints), atol=1e-5)
  assert np.array_equal(tiny.narrow_to(features, get_layout("coordinates")),
                        to_joints(features, "from_root").reshape(-1, 66))
  assert tiny.convert(features, get_layout("full"), "corrected").shape == (clip.num_frames, 263)

  save_stats(compute_stats([features], "from_root"), tmp_path)
  stats = load_stats(tmp_path, "from_root")
  assert stats.layout is tiny and len(np.unique(stats.std)) == 2  # one per block


def test_steps_begin_over_the_origin_and_go_as_the_joints_do():
  steps = get_layout("steps")
  joints = _joints(steps, CURVE) + np.array([3, 0, -2], np.float32)
  rows = steps.of_joints(joints)
  np.testing.assert_allclose(rows[1:, [0, 2]], np.diff(joints[:, 0], axis=0)[:, [0, 2]], atol=1e-6)
  np.testing.assert_allclose(rows[0, [0, 2]], rows[1, [0, 2]])
  np.testing.assert_array_equal(rows[:, 66:], feet_stand(joints, floor=0.0))
  np.testing.assert_allclose(steps.to_joints(rows), joints - joints[:1, :1] * [1, 0, 1], atol=2e-6)
  assert steps.to_joints(steps.of_joints(joints[:1])).shape == (1, 22, 3)
