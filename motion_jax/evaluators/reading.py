"""Motion of one representation as an evaluator of another reads it."""
import numpy as np

from motion_jax.motion.representations import extract, to_features, to_joints


def carry(features, layout, evaluator):
  """Features (T, F) of a model's layout, in physical units, as an evaluator reads them (T, F').

  The same layout stays as it is, a part of it is cut out, everything else goes by the joints. Raises ValueError where
  the two move different bodies.
  """
  other = evaluator.layout
  if other is layout:
    return features
  if other.skeleton is not layout.skeleton:
    raise ValueError(f"the model moves skeleton {layout.skeleton.name!r}, evaluator {evaluator.name!r} judges "
                     f"{other.skeleton.name!r}; choose another --evaluator")
  if {layout.kind, other.kind} == {"full", "essential"} and other.dim < layout.dim or (
      layout.kind == other.kind == "snapmogen" and other.dim < layout.dim):
    return features[:, :other.dim]
  return from_joints(to_joints(features, layout), evaluator)


def from_joints(joints, evaluator):
  """Joints (T, J, 3) that begin at the origin, facing +z, as an evaluator reads them (T, F): bones and place stay."""
  layout = evaluator.layout
  if layout.kind == "coordinates":
    return np.reshape(joints, (len(joints), -1)).astype(np.float32)
  joints = np.asarray(joints, np.float64)
  ahead = np.concatenate([joints, 2 * joints[-1:] - joints[-2:-1]])  # a row looks one frame ahead
  if layout.kind in ("full", "essential"):
    return extract(ahead, layout.skeleton, evaluator.mode)[:, :layout.dim].astype(np.float32)
  return to_features(ahead, layout, evaluator.mode)[:len(joints)]
