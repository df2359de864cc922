"""The base class of motion representations: named blocks of features per frame, computed from joints and back."""
import dataclasses
import functools
from collections.abc import Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.motion.rotations import A
from motion_jax.motion.skeleton import Skeleton
from motion_jax.shapes import Array, Float, Num
from motion_jax.utils.lazy import is_jax, jnp

MODES = ("benchmark", "corrected")
# Signs of the numbers of a row under a mirror, which negates x (x points to the left).
VECTOR = (-1, 1, 1)                  # x, y, z
GROUND = (-1, 1)                     # x, z
ROTATION = (1, -1, -1, -1, 1, 1)     # the first two columns, or rows, of a rotation's matrix


class Block(NamedTuple):
  """Columns of one quantity: one row of numbers for the whole body, or a row for each of `joints`.

  signs: of each number of a row, -1 if a mirror changes its sign, else 1.
  """
  signs: tuple[int, ...]
  joints: tuple[int, ...] = ()

  @property
  def size(self) -> int:
    return len(self.signs) * max(len(self.joints), 1)


@dataclasses.dataclass(frozen=True, eq=False)
class Representation:
  """A feature layout (..., T, F): the meaning of each column, and the conversion from joints (..., T, J, 3) and back.

  `layout["positions"]` is the slice of columns of a block. A subclass writes `extract`, `recover` and `root_path`, and
  `rotations_to_joints` if it has rotations; they return numpy for numpy arrays and jax for jax arrays, also inside jit.
  Users call `from_joints` and `to_joints`, which check their input.
  """
  name: str
  skeleton: Skeleton
  parts: dict[str, Block]  # in the order of the columns

  # Columns of a root loss: turn, step and height in most layouts (docs/papers/cmdm.md#data-sets).
  root: ClassVar[slice] = slice(0, 4)
  are_joints: ClassVar[bool] = False         # the features are the joints, in the world
  joints_suffice: ClassVar[bool] = False     # `of_joints` computes the features from joints alone, frame by frame
  std_by_block: ClassVar[bool] = True        # statistics have one std per block, as is usual in the field
  has_fixed_bones: ClassVar[bool] = False    # all motions have the skeleton's bone lengths

  @functools.cached_property
  def blocks(self) -> dict[str, slice]:
    ends = np.cumsum([block.size for block in self.parts.values()]).tolist()
    return {name: slice(end - block.size, end) for (name, block), end in zip(self.parts.items(), ends)}

  @functools.cached_property
  def dim(self) -> int:
    return sum(block.size for block in self.parts.values())

  @property
  def fps(self) -> float:
    return self.skeleton.fps

  def __getitem__(self, name: str) -> slice:
    if name not in self.blocks:
      raise KeyError(f"layout {self.name!r} has no block {name!r}; it has {', '.join(self.blocks)}")
    return self.blocks[name]

  def columns(self, name: str, joint: int | None = None) -> tuple[int, ...]:
    """The columns of a block, or of one joint in it; () for a joint without a row."""
    block, start = self.parts[name], self[name].start
    if joint is None:
      return tuple(range(start, start + block.size))
    size = len(block.signs)
    first = start + size * block.joints.index(joint) if joint in block.joints else None
    return () if first is None else tuple(range(first, first + size))

  def check(self, features: Num[A, "*lead f"]) -> None:
    if features.shape[-1] != self.dim:
      raise ValueError(f"got {features.shape[-1]} features per frame, layout {self.name!r} has {self.dim}; "
                       "joints become features with motion_jax.motion.representations.to_features(joints)")

  # --- joints and features ---------------------------------------------------------------------------------------

  def from_joints(self, joints: Num[A, "*lead t j 3"], mode: str = "benchmark") -> Float[A, "*lead _ f"]:
    """Joints (T, J, 3) in the skeleton's unit to features (T - 1 or T, F), float32; T - 1 if rows need the next frame.

    jax arrays (..., T, J, 3) give jax arrays (..., T - 1 or T, F) of the same dtype, differentiable and inside jit as
    well; their values are not checked, and a bone of no length takes the direction of the rest pose.

    Raises ValueError for a wrong shape and, for numpy arrays, if values are not finite or the body has no facing
    direction: bones of no length, hips and shoulders in one point or on a vertical line.
    """
    joints = check_joints(joints, self.skeleton, mode)
    if is_jax(joints):
      traced: Any = self.extract(joints, mode)
      return traced[..., :self.dim]
    with np.errstate(invalid="ignore", divide="ignore"):
      features = self.extract(joints, mode).astype(np.float32)
    if not np.isfinite(features).all():
      raise ValueError(f"no features in row {np.argwhere(~np.isfinite(features))[0, 0]}: a bone has no length, or hips "
                       "and shoulders do not tell where the body faces; check the joint mapping or cut these frames "
                       "away")
    return features[:, :self.dim]

  def from_joints_in_place(self, joints: Num[A, "*lead t j 3"], mode: str = "benchmark") -> Float[A, "*lead t f"]:
    """Features (..., T, F), one row per frame, of joints (..., T, J, 3) that begin at the origin, facing +z.

    A frame that repeats the last step is appended first. Bone lengths and position stay if the representation allows
    it. numpy gives float32.
    """
    return self.from_joints(one_ahead(joints), mode)[..., :joints.shape[-3], :]

  def to_joints(self, features: Num[A, "*lead t f"]) -> Num[A, "*lead t j 3"]:
    """Features (..., T, F) to joints (..., T, J, 3); numpy gives float32, jax arrays keep their dtype."""
    features = rot.namespace(features).asarray(features)
    self.check(features)
    return self.recover(features)

  def rotations_to_joints(self, features: Num[A, "*lead t f"], offsets: Num[Array, "j 3"] | None = None,
                          mode: str = "benchmark") -> Float[A, "*lead t j 3"]:
    """Features (..., T, F) to joints (..., T, J, 3) from the rotation columns, by forward kinematics.

    offsets (J, 3): by default the skeleton's; mode: that of the features.
    """
    raise ValueError(f"layout {self.name!r} holds no rotations; its joints come from to_joints")

  def root_path(self, features: Num[A, "*lead t f"]) -> tuple[Float[A, "*lead t 4"], Float[A, "*lead t 3"]]:
    """Heading quaternions (..., T, 4), which turn the body to +z, and root positions (..., T, 3).

    numpy input is summed in float64, jax input in its own dtype.
    """
    raise NotImplementedError(f"{type(self).__name__} does not tell its root's path")

  def extract(self, joints: Float[A, "*lead t j 3"], mode: str) -> Float[A, "*lead _ f"]:
    """Joints (..., T, J, 3) to features (..., T - 1 or T, F); columns beyond `dim` are cut off. numpy arrays are
    finite, float64 and without leading axes."""
    raise NotImplementedError(f"{type(self).__name__} makes no features of joints")

  def of_joints(self, joints: Num[A, "*lead t j 3"]) -> Num[A, "*lead t f"]:
    """Features (..., T, F) of joints, one row per frame, without changing bone lengths or position."""
    raise NotImplementedError(f"{type(self).__name__} does not follow from joints alone, frame by frame")

  def recover(self, features: Num[A, "*lead t f"]) -> Num[A, "*lead t j 3"]:
    """Features (..., T, F) of the right size to joints."""
    raise NotImplementedError(f"{type(self).__name__} makes no joints of features")

  # --- the same motion, seen otherwise ---------------------------------------------------------------------------

  def contacts(self, features: Num[A, "*lead f"]) -> Num[A, "*lead 4"] | None:
    """Foot contacts (..., T, 4): left ankle and toes, right ankle and toes; None if the layout has none."""
    return features[..., self.blocks["contacts"]] if "contacts" in self.blocks else None

  def mirror(self, features: Num[A, "*lead f"]) -> Num[A, "*lead f"]:
    """Features of the mirrored motion: left and right exchanged, turns reversed."""
    order, signs = self._mirrored
    return features[..., order] * signs.astype(features.dtype)

  @functools.cached_property
  def _mirrored(self) -> tuple[np.ndarray, np.ndarray]:
    """For each column the source column and the sign of its mirrored value."""
    order: list[int] = []
    signs: list[int] = []
    for name, block in self.parts.items():
      size = len(block.signs)
      rows = [block.joints.index(self.skeleton.mirror[joint]) for joint in block.joints] or [0]
      order += [self.blocks[name].start + row * size + i for row in rows for i in range(size)]
      signs += block.signs * len(rows)
    return np.array(order), np.array(signs)

  def columns_of(self, other: "Representation") -> slice | None:
    """The columns that hold all of another representation; None if it is no part of this one."""
    same = type(other) is type(self) and other.skeleton is self.skeleton
    first = list(self.parts.items())[:len(other.parts)]
    return slice(0, other.dim) if same and first == list(other.parts.items()) else None

  def narrows_to(self, other: "Representation") -> bool:
    """Whether `narrow_to` supports the other one: a part of this one, or computed from joints of the same skeleton."""
    return self.columns_of(other) is not None or other.joints_suffice and other.skeleton is self.skeleton

  def narrow_to(self, features: Num[A, "*lead t f"], other: "Representation",
                joints: Num[A, "*lead t j 3"] | None = None) -> Num[A, "*lead t g"]:
    """Features (..., T, F) as another representation with no more information: some columns, or computed from joints.

    joints (..., T, J, 3): those of these features, if known. Raises ValueError if the other representation needs
    information that these features lack.
    """
    if other is self:
      return features
    if not self.narrows_to(other):
      raise ValueError(f"layout {self.name!r} does not hold what layout {other.name!r} needs; make features of the "
                       "joints with motion_jax.motion.representations.to_features(joints, layout)")
    columns = self.columns_of(other)
    if columns is not None:
      return features[..., columns]
    return other.of_joints(self.to_joints(features) if joints is None else joints)

  def convert(self, features: Num[np.ndarray, "t f"], other: "Representation", mode: str = "benchmark"
              ) -> Num[np.ndarray, "t g"]:
    """Features (T, F) of motion that begins at the origin, as (T, G) of another representation of the same skeleton:
    by `narrow_to` if possible, else from joints. Raises ValueError if the skeletons differ."""
    if other.skeleton is not self.skeleton:
      raise ValueError(f"layout {self.name!r} moves skeleton {self.skeleton.name!r}, layout {other.name!r} moves "
                       f"{other.skeleton.name!r}; choose two of one skeleton, in an evaluation another --evaluator")
    if self.narrows_to(other):
      return self.narrow_to(features, other)
    return other.from_joints_in_place(self.to_joints(features), mode)


def check_joints(joints: Num[A, "*shape"], skeleton: Skeleton, mode: str = "benchmark") -> Float[A, "*shape"]:
  """Joints (T, J, 3) as float64, jax arrays (..., T, J, 3) in their own dtype.

  Raises ValueError for another shape, fewer than 2 frames, or numpy arrays that are not finite.
  """
  check_mode(mode)
  of_jax = is_jax(joints)
  if of_jax:
    joints = joints if jnp.issubdtype(joints.dtype, jnp.floating) else joints.astype(float)
  else:
    joints = np.asarray(joints, np.float64)  # type: ignore[assignment]
  if (joints.ndim != 3 and not (of_jax and joints.ndim > 3) or joints.shape[-2:] != (skeleton.num_joints, 3)
      or joints.shape[-3] < 2):
    raise ValueError(f"got joints of shape {joints.shape}, expected (at least 2 frames, {skeleton.num_joints}, 3)")
  if not of_jax and not np.isfinite(joints).all():
    raise ValueError(f"joints hold NaN or infinity, first in frame {np.argwhere(~np.isfinite(joints))[0, 0]}")
  return joints


def check_mode(mode: str) -> None:
  if mode not in MODES:
    raise ValueError(f"got mode {mode!r}, expected one of {', '.join(MODES)}")


def one_ahead(joints: Num[A, "*lead t j 3"]) -> Float[A, "*lead t+1 j 3"]:
  """Joints (..., T, J, 3) with one more frame that repeats the last step; numpy gives float64."""
  xp = rot.namespace(joints)
  joints = xp.asarray(joints, np.float64 if xp is np else None)
  return xp.concatenate([joints, 2 * joints[..., -1:, :, :] - joints[..., -2:-1, :, :]], axis=-3)


def join_rows(blocks: Sequence[Any], like: Float[A, "*lead t"]) -> Float[A, "*lead t f"]:
  """Concatenates blocks of columns, each (..., T), (..., T, n) or (..., T, n, k), of the frames of `like` (..., T).

  jax arrays get the dtype of `like`, numpy arrays are float64.
  """
  xp = rot.namespace(*blocks)
  dtype = np.float64 if xp is np else like.dtype
  return xp.concatenate([xp.reshape(block, like.shape + (-1,)).astype(dtype) for block in blocks], axis=-1)
