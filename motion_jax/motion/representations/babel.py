"""BABEL's features as FlowMDM has them: 135 numbers a frame, 22 SMPL joints, 30 frames a second, metres.

  columns   block          row t of T, made of frames t - 1 and t
  0         root_height    z of SMPL's translation
  1:3       root_velocity  x and y of its step from the frame before; row 0: 0
  3:9       root_rotation  the root's rotation in the world, first two ROWS of its matrix
  9:135     rotations      21 x 6: SMPL's rotations relative to the parent, in the same way

z is up, as in AMASS. The heading is not taken out frame by frame: the whole clip is turned once, so that its first
frame faces -x (left is -y). There are no positions: joints come from the rotations and a body's bones. Established from
BarqueroGerman/FlowMDM, `data_loaders/amass/transforms/rots2rfeats/globvelandy.py` with canonicalize and offset on; the
means of its statistics file bear the axes out.

Modes: "benchmark" takes the heading as the reference does, from the third number of the rotation vector, which is the
yaw of an upright body only roughly (69 degrees for 90), so features depend on where a clip faced; "corrected" takes the
yaw of the body's front.
"""
import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.inverse import relative, world_rotations
from motion_jax.motion.representations.base import ROTATION, Block, Representation, join_rows
from motion_jax.motion.representations.motionstreamer import matrix_from_rows, smpl_joints, to_rows
from motion_jax.motion.rotations import A
from motion_jax.motion.skeleton import SMPL
from motion_jax.shapes import Array, Float, Num

# From the features' axes (z up, the first frame faces -x) to ours (y up, the first frame faces +z).
_TO_OURS = np.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]])


class Babel(Representation):

  def extract(self, joints: Float[A, "*lead t 22 3"], mode: str) -> Float[A, "*lead _ 135"]:
    """Features with the rotations of least twist that fit these joints; `from_rotations` takes SMPL's rotations."""
    return from_rotations(*from_ours(joints, world_rotations(joints, SMPL)), mode)

  def root_path(self, features: Num[A, "*lead t f"]) -> tuple[Float[A, "*lead t 4"], Float[A, "*lead t 3"]]:
    """Headings are constant, since features are not turned frame by frame; positions are y up."""
    xp = rot.namespace(features)
    if xp is np:
      features = features.astype(np.float64)
    path = xp.cumsum(features[..., self["root_velocity"]], axis=-2)
    path = path - path[..., :1, :]
    root = xp.stack([-path[..., 1], features[..., 0], -path[..., 0]], axis=-1)
    heading = xp.broadcast_to(xp.asarray([1.0, 0, 0, 0], root.dtype), root.shape[:-1] + (4,))
    return heading, root

  def recover(self, features: Num[A, "*lead t f"]) -> Float[A, "*lead t 22 3"]:
    return self.rotations_to_joints(features)

  def rotations_to_joints(self, features: Num[A, "*lead t f"], offsets: Num[Array, "22 3"] | None = None,
                          mode: str = "benchmark") -> Float[A, "*lead t 22 3"]:
    """Joints, y up, the first frame facing +z.

    offsets (22, 3): by default an adult's, `SMPL`. The pelvis is placed at the height of SMPL's translation, about 3 cm
    too low (the body model adds its rest position).
    """
    self.check(features)
    _, root = self.root_path(features)
    xp = rot.namespace(features)
    local = matrix_from_rows(features[..., 3:].reshape(features.shape[:-1] + (22, 6)))
    return smpl_joints(root, xp.asarray(_TO_OURS, root.dtype) @ local[..., 0, :, :], local, offsets)


def from_rotations(rotations: Float[A, "*lead t 22 4"], translation: Float[A, "*lead t 3"], mode: str = "benchmark"
                   ) -> Float[A, "*lead t 135"]:
  """Features (..., T, 135) of SMPL rotations relative to the parents, quaternions (..., T, 22, 4), and SMPL translation
  (..., T, 3), metres, z up as in AMASS files; numpy gives float64."""
  xp = rot.namespace(rotations, translation)
  root = rot.conjugate(rot.about_axis(_yaw(rotations[..., 0, 0, :], mode) + np.pi / 2, "z"))[..., None, :]
  step = rot.rotate(root, xp.diff(translation, axis=-2))[..., :2]
  step = xp.concatenate([xp.zeros_like(translation[..., :1, :2]), step], axis=-2)
  turned = xp.concatenate([rot.multiply(root, rotations[..., 0, :])[..., None, :], rotations[..., 1:, :]], axis=-2)
  return join_rows((translation[..., 2:], step, to_rows(turned)), translation[..., 2])


def _yaw(root, mode):
  """The heading of root rotations (..., 4): 0 where the body faces -y."""
  if mode == "corrected":
    ahead = rot.rotate(root, np.array([0.0, 0, 1]).astype(root.dtype))[..., None, :]
    return rot.arctan2(ahead[..., 0], -ahead[..., 1])[..., 0]
  return rot.to_vector(root)[..., 2]


def from_ours(joints: Float[A, "*lead t 22 3"], turned: Float[A, "*lead t 22 4"]
              ) -> tuple[Float[A, "*lead t 22 4"], Float[A, "*lead t 3"]]:
  """SMPL rotations (..., T, 22, 4) and translation (..., T, 3), z up, of joints (..., T, 22, 3) and world rotations,
  both y up."""
  upright = rot.namespace(joints, turned).asarray(rot.from_matrix(_TO_OURS.T), turned.dtype)
  return relative(rot.multiply(upright, turned), SMPL), rot.rotate(upright, joints[..., 0, :])


# Here left is -y: a mirror negates y of the world and, in the body's frame before its rotation, x.
BABEL = Babel("babel", SMPL, {
    "root_height": Block((1,)), "root_velocity": Block((1, -1)), "root_rotation": Block((-1, 1, 1, 1, -1, -1)),
    "rotations": Block(ROTATION, tuple(range(1, 22)))})
