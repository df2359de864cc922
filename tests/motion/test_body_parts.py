"""Which columns a body part has."""
import pytest

from motion_jax.motion.body_parts import PARTS, part_columns, whole_body
from motion_jax.motion.representations import LAYOUTS


def test_full_features_are_the_papers_split():
  assert [name for name, _ in part_columns("full")] == list(PARTS)
  parts = dict(part_columns("full"))
  assert parts["root"] == (0, 1, 2, 3, 193, 194, 195)
  assert parts["right_leg"][:12] == (7, 8, 9, 73, 74, 75, 76, 77, 78, 199, 200, 201)  # joint 2
  assert parts["right_leg"][-2:] == (261, 262) and parts["left_leg"][-2:] == (259, 260)
  spine3 = (28, 29, 30)
  assert all(set(spine3) <= set(parts[name]) for name in ("backbone", "right_arm", "left_arm"))


@pytest.mark.parametrize("layout, sizes", [
    ("full", [7, 50, 50, 60, 60, 60]),  # 287 = 263 + 2 x 12: joint 9 is in three parts
    ("essential", [4, 12, 12, 15, 15, 15]), ("coordinates", [3, 12, 12, 15, 15, 15])])
def test_parts_have_their_columns(layout, sizes):
  assert [len(columns) for _, columns in part_columns(layout)] == sizes


@pytest.mark.parametrize("name", sorted(LAYOUTS))
def test_every_column_belongs_somewhere(name):
  columns = {i for _, part in part_columns(name) for i in part}
  assert columns == set(range(LAYOUTS[name].dim))
  assert whole_body(name)[0][1] == tuple(range(LAYOUTS[name].dim))
