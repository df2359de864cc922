"""USD: what Pixar's own reader finds in a .usda is the motion."""
import numpy as np
import pytest
from pxr import Usd, UsdGeom, UsdSkel

from motion_jax import export
from motion_jax.export.rig import on_rig
from tests.export.test_bvh import walk
from tests.export.test_rigs import places_of


def read(path):
  """(stage, skeleton, query of its joints) of a file."""
  stage = Usd.Stage.Open(str(path))
  cache = UsdSkel.Cache()
  cache.Populate(UsdSkel.Root(stage.GetDefaultPrim()), Usd.PrimDefaultPredicate)
  skeleton = UsdSkel.Skeleton(stage.GetPrimAtPath("/Motion/Skeleton"))
  return stage, skeleton, cache.GetSkelQuery(skeleton), cache


@pytest.mark.parametrize("rig", [None, "ue5"])
def test_the_joints_are_where_the_rig_has_them(rig, tmp_path):
  clip = walk(6, 0.2).replace(fps=32.0)
  export.save(clip, tmp_path / "walk.usda", rig=rig)
  stage, skeleton, query, _ = read(tmp_path / "walk.usda")
  assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (0, 5, clip.fps)
  assert UsdGeom.GetStageUpAxis(stage) == "Y" and UsdGeom.GetStageMetersPerUnit(stage) == 1
  moved = on_rig(clip, rig)
  assert list(skeleton.GetJointNamesAttr().Get()) == list(moved.rig.names)
  found = np.array([[matrix.ExtractTranslation() for matrix in query.ComputeJointSkelTransforms(t)] for t in range(6)])
  np.testing.assert_allclose(found, places_of(moved), atol=1e-5)


def test_the_mannequin_is_skinned_and_equal_on_every_rig(tmp_path):
  clip, found = walk(6, 0.2), []
  for rig in (None, "ue5"):
    export.save(clip, tmp_path / "walk.usda", rig=rig)
    stage, _, query, cache = read(tmp_path / "walk.usda")
    points = []
    for binding in cache.ComputeSkelBindings(UsdSkel.Root(stage.GetDefaultPrim()), Usd.PrimDefaultPredicate):
      for target in binding.GetSkinningTargets():
        skin = UsdGeom.Mesh(target.GetPrim()).GetPointsAttr().Get()
        assert target.ComputeSkinnedPoints(query.ComputeSkinningTransforms(4), skin, 4)
        points.append(np.array(skin))
    found.append(np.concatenate(points))
  np.testing.assert_allclose(found[1], found[0], atol=1e-5)
  assert abs(found[0][:, 1].min()) < 0.05 and 1.3 < found[0][:, 1].max() < 2
