"""Mean and standard deviation of a feature layout; networks see (features - mean) / std."""
import dataclasses
import hashlib
import os
import pathlib
from collections.abc import Sequence

import numpy as np

from motion_jax.motion.representations import Representation, get_layout, layout_for
from motion_jax.motion.rotations import A
from motion_jax.shapes import Array, Float, Num
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import load_npy

ABSOLUTE = ("Mean_abs.npy", "Std_abs.npy")  # where the field's tools keep statistics of coordinates


@dataclasses.dataclass(frozen=True, eq=False)
class Stats:
  """mean and std, float32 (F,), of features in a layout."""
  mean: np.ndarray
  std: np.ndarray
  layout: Representation

  def __post_init__(self) -> None:
    for name in ("mean", "std"):
      value = getattr(self, name)
      if np.shape(value) != (self.layout.dim,):
        raise InputError(f"got a {name} of shape {np.shape(value)}, layout {self.layout.name!r} needs "
                         f"({self.layout.dim},); these statistics belong to another representation")
      if not np.isfinite(value).all():
        raise InputError(f"the {name} holds NaN or infinity; compute the statistics again without the bad clips")
    if not (self.std > 0).all():
      raise InputError(f"the std is not positive in column {int(np.argmin(self.std))}; a constant column needs std 1")

  def normalize(self, features: Num[A, "*lead f"]) -> Float[A, "*lead f"]:
    return (features - self.mean) / self.std

  def denormalize(self, features: Num[A, "*lead f"]) -> Float[A, "*lead f"]:
    return features * self.std + self.mean

  @property
  def fingerprint(self) -> str:
    """Short hash that identifies the statistics of a training run."""
    return hashlib.sha256(self.mean.tobytes() + self.std.tobytes()).hexdigest()[:12]


def compute_stats(features: Sequence[Num[Array, "_ f"]] | Num[Array, "n f"], layout: Representation | str,
                  per_axis: bool = False, per_column: bool = False) -> Stats:
  """Statistics over all frames of a list of (T, F) arrays, or of one (N, F) array.

  Full and essential features: the std is averaged inside each block (docs/papers/cmdm.md#statistics), or with
  per_column kept for each column, as in TMR (docs/papers/cmdm.md#tmr). Coordinates: per column, or with per_axis one
  mean and std for x, y and z over all joints (docs/papers/cdamd.md#representations).
  """
  layout = get_layout(layout)
  frames = np.concatenate(features, dtype=np.float64) if isinstance(features, list | tuple) else (
      np.asarray(features, np.float64))
  layout.check(frames)
  if per_axis and layout.are_joints:
    axes = frames.reshape(-1, 3)
    copies = layout.dim // 3
    mean, std = np.tile(axes.mean(0), copies), np.tile(axes.std(0), copies)
  else:
    mean, std = frames.mean(0), frames.std(0)
    if layout.std_by_block and not per_column:
      for block in layout.blocks.values():
        std[block] = std[block].mean()
  # A constant column keeps its values; a single column may vary by the rounding of float32.
  std = np.where(std < (1e-5 if per_column else 1e-8), 1.0, std)
  return Stats(mean.astype(np.float32), std.astype(np.float32), layout)


class RunningStats:
  """Streaming mean and std of features, clip by clip; sums are float64, shifted by the first clip's mean."""

  def __init__(self, layout: Representation) -> None:
    self.layout, self.num, self.shift = layout, 0, None

  def add(self, features: Num[np.ndarray, "t f"]) -> None:
    features = features.astype(np.float64)
    if self.shift is None:
      self.shift = features.mean(0)
      self.sum, self.squares = np.zeros(self.layout.dim), np.zeros(self.layout.dim)
    self.num += len(features)
    self.sum += (features - self.shift).sum(0)
    self.squares += ((features - self.shift) ** 2).sum(0)

  def stats(self) -> Stats:
    if self.shift is None:
      raise ValueError("got no clip to take statistics of, expected one or more; add(features) takes them")
    mean = self.sum / self.num
    std = np.sqrt(np.maximum(self.squares / self.num - mean**2, 0))
    for block in self.layout.blocks.values():
      std[block] = std[block].mean()
    std = np.where(std < 1e-8, 1.0, std)
    return Stats((mean + self.shift).astype(np.float32), std.astype(np.float32), self.layout)


def biased_std(std: Num[Array, " f"], bias: float = 5.0) -> Float[np.ndarray, " f"]:
  """The std (F,) of features, divided by `bias` in the columns of turn, root velocity, root height and contacts.

  MoMask's and T2M-GPT's loaders apply it twice to one array: their networks and the evaluator use std / 25 in these
  eight columns (docs/papers/momask.md#statistics). float32.
  """
  std = np.array(std, np.float32)
  layout = layout_for(len(std))
  for name in {"turn", "root_velocity", "root_height", "contacts"} & layout.blocks.keys():
    std[layout.blocks[name]] /= np.float32(bias)
  return std


def save_stats(stats: Stats, folder: str | os.PathLike) -> None:
  """Writes Mean.npy and Std.npy, the usual names in the field."""
  for name, values in (("Mean", stats.mean), ("Std", stats.std)):
    with atomic_path(pathlib.Path(folder) / f"{name}.npy") as path:  # a write cut short leaves the old file as it was
      np.save(path, values)


def load_stats(folder: str | os.PathLike, layout: Representation | str | None = None,
               names: tuple[str, str] = ("Mean.npy", "Std.npy")) -> Stats:
  """Reads Mean.npy and Std.npy. layout: by default the one of their length; of coordinates they may also hold three
  numbers, one per axis."""
  folder = pathlib.Path(folder)
  values = []
  for name in names:
    if not (folder / name).is_file():
      raise FileNotFoundError(f"{folder} has no {name}; expected the statistics that the data or the run was made with")
    values.append(load_npy(folder / name).astype(np.float32).ravel())
  layout = get_layout(layout) if layout else layout_for(values[0].shape[-1])
  if layout.are_joints:
    values = [np.tile(value, layout.dim // 3) if value.shape == (3,) else value for value in values]
  mean, std = values
  return Stats(mean, std, layout)
