"""glTF files: numbers come from the bytes that the file names and from no others, animations are followed by their way
of interpolation, damaged files are refused in one sentence."""
import struct

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation, Slerp

from motion_jax.data.mocap.gltf import Document, take_apart
from motion_jax.data.mocap.gltf_motion import read_gltf
from motion_jax.utils.errors import InputError
from tests.export.characters import write_glb

FLOAT, SHORT, BYTE = (5126, "<f4"), (5122, "<i2"), (5121, "u1")
DRAW = np.random.default_rng(0)
TIMES = np.array([0.0, 0.25, 0.5, 1.0])
STEPS, LINEAR, SPLINE = DRAW.normal(size=(4, 3)), DRAW.normal(size=(4, 3)), DRAW.normal(size=(12, 3))
TURNS = Rotation.from_euler("xyz", DRAW.normal(size=(4, 3)))  # quaternions x, y, z, w, as in the file
REST = Rotation.from_euler("xyz", [0.3, -0.5, 0.2])


class Body:
  """A glTF file under construction: `json`, and its one buffer."""

  def __init__(self):
    self.data = bytearray()
    self.json = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": []}

  def add(self, values, shape, kind=FLOAT, **about):
    """An accessor with a view of its own."""
    content = np.asarray(values, kind[1]).tobytes()
    self.json["bufferViews"].append({"buffer": 0, "byteOffset": len(self.data), "byteLength": len(content)})
    self.json["accessors"].append({"bufferView": len(self.json["bufferViews"]) - 1, "componentType": kind[0],
                                   "count": len(values), "type": shape} | about)
    self.data += content + b"\0" * (-len(content) % 4)
    return len(self.json["accessors"]) - 1

  def write(self, path, change=None):
    self.json["buffers"] = [{"byteLength": len(self.data)}]
    if change:
      change(self.json)
    write_glb(path, self.json, bytes(self.data))
    return path


def numbers():
  """Accessors: plain floats; every second triple of them, from the second on; shares of a byte and of a signed short;
  a sparse one."""
  body = Body()
  body.add(np.arange(12).reshape(4, 3), "VEC3")
  body.json["accessors"].append(body.json["accessors"][0] | {"byteOffset": 12, "count": 2, "bufferView": 1})
  body.json["bufferViews"].append(body.json["bufferViews"][0] | {"byteStride": 24})
  body.add([0, 51, 255], "SCALAR", BYTE, normalized=True)
  body.add([-32768, -32767, 16384], "SCALAR", SHORT, normalized=True)
  indices, values = body.add([1, 3], "SCALAR", BYTE), body.add([[7, 8, 9], [4, 5, 6]], "VEC3")
  view = lambda accessor: {"bufferView": body.json["accessors"][accessor]["bufferView"]}
  body.json["accessors"].append({"componentType": 5126, "type": "VEC3", "count": 4, "sparse": {
      "count": 2, "indices": view(indices) | {"componentType": 5121}, "values": view(values)}})
  return body


def test_numbers_are_those_of_the_bytes(tmp_path):
  document = Document(numbers().write(tmp_path / "a.glb"))
  triples = np.arange(12.0).reshape(4, 3)
  expected = {0: triples, 1: triples[[1, 3]], 2: [[0], [0.2], [1]], 3: [[-1], [-1], [16384 / 32767]],
              6: [[0, 0, 0], [7, 8, 9], [0, 0, 0], [4, 5, 6]]}
  for number, values in expected.items():
    np.testing.assert_allclose(document.array(number), values, err_msg=str(number))
  assert document.array(4).dtype == np.uint8  # indices stay whole numbers


OUTSIDE = "ends outside its buffer"


@pytest.mark.parametrize("change, message", [
    (lambda d: d["accessors"][1].update(byteOffset=-12), OUTSIDE),
    (lambda d: d["accessors"][1].update(byteOffset=-4) or d["bufferViews"][1].update(byteOffset=8), OUTSIDE),
    (lambda d: d["bufferViews"][1].update(byteOffset=-4), OUTSIDE),
    (lambda d: d["accessors"][1].update(count=-1), "states -1 values"),
    (lambda d: d["accessors"][1].update(count=10 ** 9), "states 1,000,000,000 values"),
    (lambda d: d["bufferViews"][1].update(byteStride=8), OUTSIDE),
    (lambda d: d["bufferViews"][1].update(byteOffset=d["buffers"][0]["byteLength"] - 47), OUTSIDE),
    (lambda d: d["accessors"][1].update(componentType=5124), "not as the format says"),
    (lambda d: d["buffers"][0].update(byteLength=d["buffers"][0]["byteLength"] + 1), "of .* bytes; the file is cut"),
    (lambda d: d["buffers"][0].update(uri="../a.bin"), "expected a file beside it"),
    (lambda d: d["buffers"][0].update(uri="b.bin"), "needs the file 'b.bin'"),
    (lambda d: d["bufferViews"][1].update(extensions={"EXT_meshopt_compression": {}}), "compressed"),
    (lambda d: d["asset"].update(version="1.0"), "expected 2.0"),
    (lambda d: d.update(nodes=[{"children": [1]}]), "no node of its own"),
])
def test_bytes_before_and_behind_are_refused(tmp_path, change, message):
  """Also an offset that a view's own makes up for, and one byte too many."""
  path = numbers().write(tmp_path / "a.glb", change)
  with pytest.raises(InputError, match=message):
    Document(path).array(1)


@pytest.mark.parametrize("at, value, message", [
    (4, 1, "binary glTF version 1"), (8, 1 << 20, "of the 1,048,576 bytes"), (12, 1 << 20, "ends outside the file"),
    (16, 0, "no JSON chunk"), (0, 0, "begins like no glTF")])
def test_headers_that_lie_are_refused(tmp_path, at, value, message):
  path = numbers().write(tmp_path / "a.glb")
  content = bytearray(path.read_bytes())
  struct.pack_into("<I", content, at, value)
  path.write_bytes(content)
  with pytest.raises(InputError, match=message):
    Document(path)


def animated(fps=None):
  """Four bones in a chain, one for each way of interpolation; the last one turns."""
  body = Body()
  times = body.add(TIMES[:, None], "SCALAR")
  channels, samplers = [], []
  for node, (kind, values, way) in enumerate((
      ("translation", STEPS, "STEP"), ("translation", LINEAR, "LINEAR"), ("translation", SPLINE, "CUBICSPLINE"),
      ("rotation", TURNS.as_quat(), "LINEAR"))):
    channels.append({"sampler": node, "target": {"node": node, "path": kind}})
    samplers.append({"input": times, "output": body.add(values, f"VEC{values.shape[1]}"), "interpolation": way})
  body.json |= {"animations": [{"channels": channels, "samplers": samplers, "extras": {"fps": fps}}],
                "nodes": [{"name": f"bone{node}", "children": [node + 1]} for node in range(4)] + [
                    {"name": "end", "translation": [0, 2, 0]}]}
  body.json["nodes"][3]["rotation"] = REST.as_quat().tolist()
  body.json["skins"] = [{"joints": [0, 1, 2, 3, 4]}]
  return body


def test_animations_are_followed_by_their_way_of_interpolation(tmp_path):
  """At the rate that the file states, against scipy; rotations are those from the rest pose."""
  capture = read_gltf(animated(fps=20).write(tmp_path / "a.glb"))
  assert capture.fps == 20 and capture.num_frames == 21 and capture.parents == (-1, 0, 1, 2, 3)
  at = np.arange(21) / 20
  offsets = np.diff(capture.positions, axis=1, prepend=0)
  np.testing.assert_allclose(offsets[:, 0], STEPS[np.searchsorted(TIMES, at + 1e-6, "right") - 1], atol=1e-6)
  linear = np.stack([np.interp(at, TIMES, LINEAR[:, axis]) for axis in range(3)], -1)
  np.testing.assert_allclose(offsets[:, 1], linear, atol=1e-6)
  # Pieces by their own tangents: out of the first key, into the second.
  spline = np.concatenate([
      CubicHermiteSpline(TIMES[k:k + 2], SPLINE[[3 * k + 1, 3 * k + 4]], SPLINE[[3 * k + 2, 3 * k + 3]])(
          at[(at >= TIMES[k]) & ((at < TIMES[k + 1]) | (k == 2))]) for k in range(3)])
  np.testing.assert_allclose(offsets[:, 2], spline, atol=1e-6)
  turns = Slerp(TIMES, TURNS)(at)
  np.testing.assert_allclose(offsets[:, 4], turns.apply([0, 2, 0]), atol=1e-6)
  made = Rotation.from_quat(np.roll(capture.turned[:, 3], -1, axis=-1))
  np.testing.assert_allclose(made.as_matrix(), (turns * REST.inv()).as_matrix(), atol=1e-6)


def test_without_a_stated_rate_it_is_that_of_the_keys(tmp_path):
  """And each key is at its own frame, though float32 puts some of them behind it."""
  body = animated()
  assert read_gltf(body.write(tmp_path / "a.glb")).fps == 24  # keys at quarters of a second lie on its frames, too
  body.json["accessors"].append(body.json["accessors"][0] | {
      "bufferView": body.json["accessors"][body.add(np.arange(4)[:, None] / 30, "SCALAR")]["bufferView"]})
  for sampler in body.json["animations"][0]["samplers"]:
    sampler["input"] = len(body.json["accessors"]) - 1
  capture = read_gltf(body.write(tmp_path / "b.glb"))
  assert capture.fps == 30 and capture.num_frames == 4
  np.testing.assert_allclose(capture.positions[:, 0], STEPS, atol=1e-6)


@pytest.mark.parametrize("change, message", [
    (lambda d: d["accessors"][0].update(count=3), "has 3 times"),
    (lambda d: d.update(animations=[]), "holds no animation"),
    (lambda d: d["animations"].append(d["animations"][0] | {"name": "Run"}), "2 'Run'.*/a.glb#1', or #NAME"),
    (lambda d: d["animations"][0]["channels"].clear(), "moves no node"),
    (lambda d: d["animations"][0]["channels"][0]["target"].update(node=9), "not as the format says"),
])
def test_animations_that_do_not_fit_are_refused(tmp_path, change, message):
  with pytest.raises(InputError, match=message):
    read_gltf(animated().write(tmp_path / "a.glb", change))


def test_a_matrix_is_taken_apart(tmp_path):
  """Into place, turn and scale, column by column; of a mirror the first scale is negative."""
  matrix = np.eye(4)
  matrix[:3, :3] = REST.as_matrix() * [-2, 3, 4]
  matrix[:3, 3] = [1, 2, 3]
  body = Body()
  body.json["nodes"] = [{"matrix": matrix.T.ravel().tolist()}]
  for moved, turned, scale in (take_apart(matrix[None]), Document(body.write(tmp_path / "a.glb")).rest()):
    np.testing.assert_allclose(moved, [[1, 2, 3]])
    np.testing.assert_allclose(scale, [[-2, 3, 4]])
    np.testing.assert_allclose(Rotation.from_quat(np.roll(turned[0], -1)).as_matrix(), REST.as_matrix(), atol=1e-12)


def test_nodes_below_one_another_are_ordered_or_refused(tmp_path):
  body, count = Body(), 30_000  # a chain; a search from each node would take minutes
  body.json["nodes"] = [{"children": [i + 1]} for i in range(count - 1)] + [{}]
  assert Document(body.write(tmp_path / "chain.glb")).order == list(range(count))
  body.json["nodes"] = [{}, {"children": [2]}, {"children": [1]}]
  with pytest.raises(InputError, match="node 1 hangs on itself"):
    Document(body.write(tmp_path / "loop.glb"))


def test_values_without_a_buffer_are_bounded_by_the_file(tmp_path):
  body = Body()
  body.json["accessors"] = [{"componentType": 5126, "type": "MAT4", "count": count} for count in (20, 1 << 28, -1)]
  read = Document(body.write(tmp_path / "a.glb"))
  assert read.array(0).shape == (20, 16) and not read.array(0).any()
  for number in (1, 2):
    with pytest.raises(InputError, match=f"accessor {number} states"):
      read.array(number)
