"""A trained teacher as a guide for a tokenizer: its feature of every frame, in its own layout and statistics.

Source: docs/papers/cmdm.md#teacher-features.
"""
import pathlib
from collections.abc import Mapping
from typing import Any

import numpy as np

from motion_jax.models.tmr.space import Teacher
from motion_jax.motion.representations import Representation, get_layout
from motion_jax.motion.stats import Stats
from motion_jax.nets.tmr import TMR
from motion_jax.shapes import Array, Float, Net


def check_readable(layout: Representation | str, own_layout: Representation | str) -> None:
  """Raises ValueError if windows in `layout` lack features that a teacher of own_layout reads."""
  ours, theirs = get_layout(layout), get_layout(own_layout)
  if not ours.narrows_to(theirs):
    raise ValueError(f"a teacher of layout {theirs.name!r} cannot read windows of layout {ours.name!r}, only those of "
                     "its own layout, one that it is a part of or, if it is coordinates, one with the same joints; "
                     "train it on such data")


def as_seen(x: Float[Array, "b t f"], view: Mapping[str, Array], layout: Representation | str,
            own_layout: Representation | str) -> Float[Array, "b t g"]:
  """Converts windows (B, T, F) of a tokenizer to the layout and statistics of its teacher (B, T, G).

  view: "mean" and "std" of x, "own_mean" and "own_std" of the teacher. A window is a clip of its own: its joints start
  at the origin, facing +z.
  """
  seen: Any = x * view["std"] + view["mean"]
  seen = get_layout(layout).narrow_to(seen, get_layout(own_layout))
  return (seen - view["own_mean"]) / view["own_std"]


def motion_side(teacher: Teacher, params: Any) -> Any:
  """The teacher's parameters that frame features need: for a TMR neither its text encoder nor its decoder."""
  motion = params["motion"]
  return {"motion_encoder": motion["motion_encoder"]} if isinstance(teacher, TMR) else motion


def frame_features(teacher: Net, params: Any, x: Float[Array, "b t f"]) -> Float[Array, "b t e"]:
  """The frozen teacher's feature of every frame (B, T, E) of windows without padding."""
  return teacher.apply({"params": params}, x, method="frames")


def view_of(stats: Stats, own_stats: Stats, folder: str | pathlib.Path) -> dict[str, np.ndarray] | None:
  """The statistics of both, with which `as_seen` converts windows; None if they are the same.

  Raises ValueError if the teacher of that folder reads other features, or, in the same layout, was trained on quite
  other data: means off by half a std, or stds, averaged over blocks, by a quarter.
  """
  layout = stats.layout
  check_readable(layout.name, own_stats.layout.name)
  if own_stats.layout == layout:
    away = (np.abs(own_stats.mean - stats.mean) / stats.std).max()
    if away <= 0.01 and np.allclose(own_stats.std, stats.std, rtol=0.01):
      return None
    grouped, own_grouped = _by_block(stats), _by_block(own_stats)
    if away > 0.5 or not np.allclose(own_grouped, grouped, rtol=0.25, atol=1e-5):
      raise ValueError(f"the teacher in {folder} was trained on features of other statistics than the data given here; "
                       "train it on the same data")
  return {"mean": stats.mean, "std": stats.std, "own_mean": own_stats.mean, "own_std": own_stats.std}


def _by_block(stats):
  """The std of each column (F,), averaged over its block."""
  std = np.where(stats.std == 1, 0.0, stats.std)  # 1 stands for a column that never moves (`compute_stats`)
  for block in stats.layout.blocks.values():
    std[block] = np.mean(std[block], dtype=np.float64)
  return std


def plain_stats(layout: Representation | str) -> Stats:
  """Mean 0 and std 1, for a teacher with random weights."""
  layout = get_layout(layout)
  return Stats(np.zeros(layout.dim, np.float32), np.ones(layout.dim, np.float32), layout)
