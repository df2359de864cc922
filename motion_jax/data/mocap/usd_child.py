"""Reads skeletal animation of a USD file with usd-core, in a process of its own: damaged files can crash that library.

  python -m motion_jax.data.mocap.usd_child FILE OUT.npz MOST [CLIP]

Only FILE itself is opened: sublayers, references, payloads and value clips in other files are removed first, and
OUT.npz lists them as `outside`. `animations` has the names of the SkelAnimations. Of the chosen one OUT.npz has the
joints' names and parents, and their world matrices at rest (N, 4, 4) and in each frame (T, N, 4, 4), which act on
columns, in the stage's unit and axes. These are missing if CLIP matches none or several, or if T * N exceeds MOST.
"""
import re
import sys

import numpy as np

try:
  from pxr import Sdf, Tf, Usd, UsdGeom, UsdSkel
except ImportError:
  if __name__ == "__main__":
    sys.exit(3)
  raise

_SLOWEST = 10.0   # keys a second; below it, frames follow the stage's framesPerSecond
_FASTEST = 240.0  # frames a second


def main(path, out, most, wanted=None):
  """Writes what the file holds. Raises what usd-core raises, and ValueError for an animation without a skeleton."""
  layer = Sdf.Layer.OpenAsAnonymous(path)
  outside = _remove_arcs(layer)
  stage = Usd.Stage.Open(layer)
  prims = list(Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()))
  animations = [prim for prim in prims if prim.IsA(UsdSkel.Animation) and UsdSkel.Animation(prim).GetJointsAttr().Get()]
  skeletons = [UsdSkel.Skeleton(prim) for prim in prims if prim.IsA(UsdSkel.Skeleton)]
  names = [prim.GetName() for prim in animations]
  matches = [i for i, name in enumerate(names) if wanted in (None, name, str(i + 1))]
  arrays = {"animations": np.array(names, str), "outside": np.array(outside, str), "skeletons": len(skeletons)}
  if len(matches) == 1 and skeletons:
    arrays |= _motion(stage, _query(stage, animations[matches[0]], skeletons), int(most))
  np.savez(out, **arrays)


def _remove_arcs(layer) -> list[str]:
  """Removes what a layer composes from other files; returns their names."""
  outside = list(layer.GetCompositionAssetDependencies())
  for name in outside:
    layer.UpdateCompositionAssetDependency(name, "")

  def remove_clips(path):
    prim = layer.GetPrimAtPath(path) if path.IsPrimPath() or path.IsPrimVariantSelectionPath() else None
    if prim is not None and prim.HasInfo("clips"):
      outside.append("value clips")
      prim.ClearInfo("clips")

  layer.Traverse("/", remove_clips)
  return outside


def _query(stage, animation, skeletons):
  """The SkeletonQuery of an animation: of the largest skeleton it is bound to, else of the one with most of its joints.

  In that case, and for a skeleton that is in no SkelRoot, the stage in memory is changed.
  """
  for skeleton in skeletons:
    line = [skeleton.GetPrim()]
    while (above := line[-1].GetParent()) and not above.IsPseudoRoot():
      line.append(above)
    if len(line) > 1 and not any(prim.IsA(UsdSkel.Root) for prim in line):
      line[-1].SetTypeName("SkelRoot")
  joints = {*UsdSkel.Animation(animation).GetJointsAttr().Get()}
  shared = lambda skeleton: len(joints & {*(skeleton.GetJointsAttr().Get() or ())})
  skeletons = sorted(skeletons, key=shared, reverse=True)
  if not shared(skeletons[0]):
    raise ValueError(f"no skeleton has the joints of its animation {animation.GetName()!r}")
  for candidates in (skeletons, skeletons[:1]):
    cache = UsdSkel.Cache()
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
      if prim.IsA(UsdSkel.Root):
        cache.Populate(UsdSkel.Root(prim), Usd.TraverseInstanceProxies())
    for skeleton in candidates:
      query = cache.GetSkelQuery(skeleton)
      if query and query.GetAnimQuery() and query.GetAnimQuery().GetPrim() == animation:
        return query
    binding = UsdSkel.BindingAPI.Apply(skeletons[0].GetPrim())
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
  raise ValueError(f"its animation {animation.GetName()!r} cannot be bound to its skeleton {skeletons[0].GetPath()}")


def _motion(stage, query, most):
  """The arrays of one animation."""
  first, step, num_frames, rate = _frames(stage, query)
  topology, num_joints = query.GetTopology(), len(query.GetJointOrder())
  arrays = {"frames": num_frames, "rate": rate, "joints": num_joints, "up": str(UsdGeom.GetStageUpAxis(stage)),
            "unit": UsdGeom.GetStageMetersPerUnit(stage) if UsdGeom.StageHasAuthoredMetersPerUnit(stage) else 0.0}
  if num_frames * num_joints > most:
    return arrays
  skeleton = query.GetSkeleton()
  names = list(skeleton.GetJointNamesAttr().Get() or ())
  if len(names) != num_joints:
    names = [path.rsplit("/", 1)[-1] for path in query.GetJointOrder()]
  columns = lambda matrices: np.array(matrices, np.float64).reshape(-1, 4, 4).transpose(0, 2, 1)
  codes = [Usd.TimeCode.Default()] if first is None else [first + step * frame for frame in range(num_frames)]
  matrices = np.empty((num_frames, num_joints, 4, 4))
  for frame, code in enumerate(codes):
    matrices[frame] = columns(query.ComputeJointWorldTransforms(UsdGeom.XformCache(code)))
  place = columns([UsdGeom.XformCache(codes[0]).GetLocalToWorldTransform(skeleton.GetPrim())])
  if query.HasRestPose():
    rest = place @ columns(query.ComputeJointSkelTransforms(codes[0], atRest=True))
  elif query.HasBindPose():
    rest = place @ columns(skeleton.GetBindTransformsAttr().Get())
  else:
    rest = matrices[0]
  return arrays | {"names": np.array(names, str), "parents": np.array(topology.GetParentIndices(), int), "rest": rest,
                   "matrices": matrices}


def _frames(stage, query):
  """(time code of the first frame, time codes from one to the next, number of frames, frames a second).

  A frame per key, in the range that the stage states. The first time code is None if nothing has keys.
  """
  keys = {*query.GetAnimQuery().GetJointTransformTimeSamples()}
  prim = query.GetSkeleton().GetPrim()
  while prim:  # what a skeleton is placed in may move it
    if xform := UsdGeom.Xformable(prim):
      keys.update(xform.GetTimeSamples())
    prim = prim.GetParent()
  per_second = stage.GetTimeCodesPerSecond()
  if not keys:
    return None, 0.0, 1, per_second
  first, last = min(keys), max(keys)
  if stage.HasAuthoredTimeCodeRange() and stage.GetStartTimeCode() <= last and stage.GetEndTimeCode() >= first:
    first, last = max(first, stage.GetStartTimeCode()), min(last, stage.GetEndTimeCode())
  gaps = np.diff(sorted(key for key in keys if first <= key <= last))
  rate = per_second / np.median(gaps) if len(gaps) else 0.0
  rate = min(round(float(rate if rate >= _SLOWEST else stage.GetFramesPerSecond()), 4), _FASTEST)
  step = per_second / rate
  return first, step, int((last - first) / step + 1e-3) + 1, rate


if __name__ == "__main__":
  try:
    main(*sys.argv[1:])
  except Tf.ErrorException as error:
    why = re.sub(r"pxrInternal\w+(::\w+)*::", "", error.args[0].commentary.replace(sys.argv[1], ""))
    sys.exit(" ".join(why.strip("<>@: \n").split()))
  except Exception as error:
    sys.exit(f"{type(error).__name__}: {error}")
