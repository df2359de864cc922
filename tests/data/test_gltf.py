"""glTF files that ask for much with few bytes are refused, or read in linear time."""
import pytest

from motion_jax.data.mocap.gltf import Document
from motion_jax.utils.errors import InputError
from tests.export.characters import write_glb


def document(nodes, **more):
  return {"asset": {"version": "2.0"}, "nodes": nodes} | more


def test_nodes_below_one_another_are_ordered_or_refused(tmp_path):
  count = 30_000  # a chain; a search from each node would take minutes
  chain = [{"children": [i + 1]} for i in range(count - 1)] + [{}]
  write_glb(tmp_path / "chain.glb", document(chain), b"")
  assert Document(tmp_path / "chain.glb").order == list(range(count))
  write_glb(tmp_path / "loop.glb", document([{}, {"children": [2]}, {"children": [1]}]), b"")
  with pytest.raises(InputError, match="node 1 hangs on itself"):
    Document(tmp_path / "loop.glb")


def test_values_without_a_buffer_are_bounded_by_the_file(tmp_path):
  accessors = [{"componentType": 5126, "type": "MAT4", "count": count} for count in (20, 1 << 28, -1)]
  write_glb(tmp_path / "a.glb", document([{}], accessors=accessors), b"")
  read = Document(tmp_path / "a.glb")
  assert read.array(0).shape == (20, 16) and not read.array(0).any()
  for number in (1, 2):
    with pytest.raises(InputError, match=f"accessor {number} states"):
      read.array(number)
