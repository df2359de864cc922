"""Representations of motion: the features of a frame that a network sees, and the conversion back to joints.

  name                    numbers    joints         file
  full, essential         263, 67    22, HumanML3D  humanml3d
  full_kit, essential_kit 251, 64    21, KIT        humanml3d
  coordinates, ..._kit    66, 63     22, 21         coordinates
  steps, steps_kit        70, 67     22, 21         steps
  snapmogen, ..._148      296, 148   24, SnapMoGen  snapmogen
  motionstreamer          272        22, SMPL       motionstreamer
  babel                   135        22, SMPL       babel

The last three hold rotations that joints alone do not determine: features of joints have those of least twist
(`motion.inverse`); `from_rotations` in their files makes features of data with rotations.

To add a representation, write a subclass of `Representation` and an entry of `LAYOUTS`, or an entry point of the group
`motion_jax.representations` in another package. Use it by name: `get_layout("full").to_joints(features)`, or
`to_joints(features, "full")`.
"""
from motion_jax.motion.representations.babel import BABEL
from motion_jax.motion.representations.base import MODES, Block, Representation
from motion_jax.motion.representations.coordinates import COORDINATES, COORDINATES_KIT
from motion_jax.motion.representations.humanml3d import ESSENTIAL, ESSENTIAL_KIT, FULL, FULL_KIT, canonicalize, extract
from motion_jax.motion.representations.motionstreamer import MOTIONSTREAMER
from motion_jax.motion.representations.snapmogen import SNAPMOGEN_148, SNAPMOGEN_296
from motion_jax.motion.representations.steps import STEPS, STEPS_KIT
from motion_jax.motion.rotations import A
from motion_jax.shapes import Array, Float, Num
from motion_jax.utils.plugins import Registry

LAYOUTS: Registry[Representation] = Registry("motion_jax.representations", {layout.name: layout for layout in (
    FULL, ESSENTIAL, COORDINATES, FULL_KIT, ESSENTIAL_KIT, COORDINATES_KIT, STEPS, STEPS_KIT, SNAPMOGEN_296,
    SNAPMOGEN_148, MOTIONSTREAMER, BABEL)})
FeatureLayout = Representation


def get_layout(layout: Representation | str) -> Representation:
  """A representation from its name; a representation passes through."""
  if isinstance(layout, Representation):
    return layout
  if layout not in LAYOUTS:
    raise ValueError(f"got layout {layout!r}, expected one of {', '.join(LAYOUTS)}")
  return LAYOUTS[layout]


def layout_for(num_features: int) -> Representation:
  """The representation with this number of features per frame."""
  for layout in LAYOUTS.values():
    if layout.dim == num_features:
      return layout
  known = ", ".join(f"{layout.dim} ({layout.name})" for layout in LAYOUTS.values())
  raise ValueError(f"got {num_features} features per frame; known sizes are {known}")


def to_features(joints: Num[A, "*lead t j 3"], layout: Representation | str = "full", mode: str = "benchmark"
                ) -> Float[A, "*lead _ f"]:
  """Joints (T, J, 3) to features (T - 1, F), float32, of a layout: `Representation.from_joints`.

  "motionstreamer" and "babel" make T rows, not T - 1. jax arrays, also with leading axes, give jax arrays of the same
  dtype: differentiable, and inside jit and vmap as well.
  """
  return get_layout(layout).from_joints(joints, mode)


def to_joints(features: Num[A, "*lead t f"], layout: Representation | str = "full") -> Num[A, "*lead t j 3"]:
  """Features (..., T, F) of a layout to joints (..., T, J, 3): `Representation.to_joints`."""
  return get_layout(layout).to_joints(features)


def root_path(features: Num[A, "*lead t f"], layout: Representation | str = "full"
              ) -> tuple[Float[A, "*lead t 4"], Float[A, "*lead t 3"]]:
  """Heading quaternions (..., T, 4) and root positions (..., T, 3): `Representation.root_path`."""
  return get_layout(layout).root_path(features)


def rotations_to_joints(features: Num[A, "*lead t f"], layout: Representation | str = "full",
                        offsets: Num[Array, "j 3"] | None = None, mode: str = "benchmark") -> Float[A, "*lead t j 3"]:
  """Joints (..., T, J, 3) from the rotation columns: `Representation.rotations_to_joints`."""
  return get_layout(layout).rotations_to_joints(features, offsets, mode)


__all__ = ["LAYOUTS", "MODES", "Block", "FeatureLayout", "Representation", "canonicalize", "extract", "get_layout",
           "layout_for", "root_path", "rotations_to_joints", "to_features", "to_joints"]
