"""Joint-name tables: each is found by its own names, and a user's own mapping may average."""
import numpy as np
import pytest

from motion_jax.motion.joint_maps import TABLES, best_table, map_joints
from motion_jax.motion.skeleton import HUMANML3D


def _names(table):
  needs = lambda entry: getattr(entry, "needs", [entry] if isinstance(entry, str) else entry)
  return sorted({name for entry in TABLES[table].values() for name in needs(entry)})


@pytest.mark.parametrize("table", TABLES)
def test_table_is_complete_and_found_by_its_names(table):
  assert set(TABLES[table]) == set(HUMANML3D.joints)
  names = _names(table)
  assert best_table(names + ["other"]) == table
  positions = np.random.default_rng(0).normal(size=(4, len(names), 3))
  turned = np.tile([1.0, 0, 0, 0], (4, len(names), 1))
  joints, label = map_joints(names, positions, None, turned)
  assert joints.shape == (4, 22, 3) and label == table and np.isfinite(joints).all()


def test_left_is_not_right():
  for table in TABLES.values():
    for joint, entry in table.items():
      if joint.startswith("left") and isinstance(entry, str):
        assert table["right" + joint[4:]] != entry


def test_own_mapping_averages_and_ignores_case():
  mapping = {joint: joint.upper() for joint in HUMANML3D.joints} | {"head": ["Nose", "mixamorig:Neck"]}
  names = [*HUMANML3D.joints, "nose"]
  positions = np.random.default_rng(0).normal(size=(3, 23, 3))
  joints, label = map_joints(names, positions, mapping)
  assert label == "own"
  np.testing.assert_allclose(joints[:, 15], (positions[:, 12] + positions[:, 22]) / 2)
  np.testing.assert_array_equal(joints[:, :15], positions[:, :15])


def test_errors_list_what_is_missing_and_what_is_there():
  names = [name for name in _names("bandai") if name != "Toes_L"]
  with pytest.raises(ValueError, match="mapping 'bandai' needs the joints Toes_L; the file has Chest, Foot_L"):
    map_joints(names, np.zeros((2, len(names), 3)))
  with pytest.raises(ValueError, match="has no tail"):
    map_joints(HUMANML3D.joints, np.zeros((2, 22, 3)), TABLES["humanml3d"] | {"tail": "head"})
  names = _names("cmu_asf")
  with pytest.raises(ValueError, match="needs the rotation of joint"):
    map_joints(names, np.zeros((2, len(names), 3)))
