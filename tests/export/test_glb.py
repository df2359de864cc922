"""GLB files, read back by pygltflib: structure, and the skinned body against the clip."""
import numpy as np
import pytest
from pygltflib import GLTF2
from scipy.spatial.transform import Rotation

from motion_jax import export
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.export.body import make_figure
from motion_jax.motion.skeleton import HUMANML3D, KIT

_TYPES = {5126: np.float32, 5123: np.uint16, 5121: np.uint8}
_SIZES = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


@pytest.fixture(scope="module")
def clip():
  joints = synthetic_joints("wave_left", 40, np.random.default_rng(0))
  return Clip(joints=joints.astype(np.float32), captions=(Caption("a person waves"),), license="procedural motion")


@pytest.fixture(scope="module")
def gltf(clip, tmp_path_factory):
  return GLTF2().load(str(export.glb(clip, tmp_path_factory.mktemp("glb") / "a.glb", exact=True)))


def read(gltf, number):
  accessor = gltf.accessors[number]
  view = gltf.bufferViews[accessor.bufferView]
  size = _SIZES[accessor.type]
  array = np.frombuffer(gltf.binary_blob(), _TYPES[accessor.componentType], accessor.count * size, view.byteOffset)
  return array.reshape(accessor.count, size)


def world_matrices(gltf, num_frames):
  """(T, J, 4, 4) of the joints' nodes, by playing the animation."""
  animation, root, joints = gltf.animations[0], 0, range(len(gltf.nodes))
  if gltf.skins:
    root, joints = gltf.skins[0].skeleton, gltf.skins[0].joints
  local = {}
  for number, node in enumerate(gltf.nodes):
    local[number] = np.tile(np.eye(4), (num_frames, 1, 1))
    local[number][:, :3, 3] = node.translation or 0
  for channel in animation.channels:
    values = read(gltf, animation.samplers[channel.sampler].output)
    if channel.target.path == "rotation":
      local[channel.target.node][:, :3, :3] = Rotation.from_quat(values).as_matrix()
    else:
      local[channel.target.node][:, :3, 3] = values
  world = {}

  def walk(number, above):
    world[number] = above @ local[number]
    for child in gltf.nodes[number].children or []:
      walk(child, world[number])

  walk(root, np.eye(4))
  return np.stack([world[number] for number in joints], axis=1)


def test_nodes_are_where_the_joints_are(gltf, clip):
  assert all(gltf.bufferViews[accessor.bufferView].byteOffset % 4 == 0 for accessor in gltf.accessors)
  world = world_matrices(gltf, clip.num_frames)
  assert [gltf.nodes[j].name for j in gltf.skins[0].joints] == list(HUMANML3D.joints)
  assert np.abs(world[..., :3, 3] - clip.joints).max() < 6e-4  # metres; a smaller bend of the pelvis is left out
  assert gltf.asset.extras == {"fps": 20.0, "caption": "a person waves", "license": "procedural motion"}
  for sampler in gltf.animations[0].samplers:
    values = read(gltf, sampler.output)
    assert values.shape[1] == 3 or (values[1:] * values[:-1]).sum(1).min() > 0, "players interpolate: no sign flips"


def skinned(gltf, num_frames):
  """Vertices (T, V, 3) of each primitive of the mesh, by playing the animation."""
  inverse = read(gltf, gltf.skins[0].inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
  skin = world_matrices(gltf, num_frames) @ inverse
  for primitive in gltf.meshes[0].primitives:
    points, weights = read(gltf, primitive.attributes.POSITION), read(gltf, primitive.attributes.WEIGHTS_0) / 255
    np.testing.assert_allclose(weights.sum(1), 1, atol=1e-6)
    mixed = np.einsum("vk,tvkij->tvij", weights, skin[:, read(gltf, primitive.attributes.JOINTS_0)])
    yield np.einsum("tvij,vj->tvi", mixed, np.c_[points, np.ones(len(points))])[..., :3]


@pytest.mark.parametrize("action, height", [("stand", 0.045), ("walk", 0.0)])
def test_soles_stand_on_the_ground(tmp_path, action, height):
  """However high the toe joints stand: HumanML3D puts the lowest joint on y = 0, in captures it is 4 to 5 cm high."""
  joints = synthetic_joints(action, 24, np.random.default_rng(0)).astype(np.float32)
  joints[..., 1] += height - joints[..., 1].min()
  clip = Clip(joints=joints)
  lowest = np.min([points[..., 1].min(1) for points in skinned(GLTF2().load(str(export.glb(
      clip, tmp_path / "a.glb"))), 24)], axis=0)
  assert -0.012 < lowest.min() and abs(np.median(lowest)) < 0.01
  assert make_figure(clip).floor == 0, "pictures and the page draw the ground where the file has it"


def test_a_recording_with_a_ground_of_its_own_stands_on_it():
  joints = synthetic_joints("stand", 10, np.random.default_rng(0)).astype(np.float32)
  joints -= joints[:, :1]  # the pelvis is the origin
  figure = make_figure(Clip(joints=joints))
  assert figure.floor == pytest.approx(joints[..., 1].min(), abs=0.05)


def test_the_other_skeleton_and_one_frame(tmp_path):
  offsets = KIT.offsets * [-1, 1, 1]
  joints = np.zeros((1, 21, 3))
  for chain in KIT.chains:
    for parent, joint in zip(chain[:-1], chain[1:]):
      joints[:, joint] = joints[:, parent] + offsets[joint]
  clip = Clip(joints=joints.astype(np.float32), fps=12.5, skeleton=KIT)
  gltf = GLTF2().load(str(export.glb(clip, tmp_path / "kit.glb", exact=True)))
  world = world_matrices(gltf, 1)
  np.testing.assert_allclose(world[..., :3, 3], joints * 0.001, atol=1e-4)
