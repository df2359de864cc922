"""USD: what Pixar's own reader finds in a .usda is the motion, and so does `export.load`."""
import subprocess
import warnings

import numpy as np
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdSkel

from motion_jax import export
from motion_jax.data.mocap import child, native
from motion_jax.export.rig import on_rig
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError
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


def _on_stage(change):
  """A change of a stage as a change of a file."""
  def edit(path):
    stage = Usd.Stage.Open(str(path))
    change(stage)
    stage.GetRootLayer().Save()
    return path
  return edit


def _z_up_and_binary(path):
  """Centimetres with z up, the figure moved by what it hangs from, as Maya and Unreal write it."""
  stage = Usd.Stage.Open(str(path))
  UsdGeom.SetStageUpAxis(stage, "Z")
  UsdGeom.SetStageMetersPerUnit(stage, 0.01)
  root = UsdGeom.Xformable(stage.GetDefaultPrim())
  root.AddRotateXOp().Set(90.0)
  root.AddScaleOp().Set((100.0, 100.0, 100.0))
  stage.GetRootLayer().Export(str(path.with_suffix(".usdc")))
  return path.with_suffix(".usdc")


def _with_another_animation(stage):
  """A second SkelAnimation that nothing is bound to, as libraries of clips have it, and joints without names."""
  UsdSkel.Skeleton(stage.GetPrimAtPath("/Motion/Skeleton")).GetJointNamesAttr().Clear()
  layer = stage.GetRootLayer()
  Sdf.CopySpec(layer, layer.GetPrimAtPath("/Motion/Skeleton").nameChildren[0].path, layer, "/Motion/Skeleton/second")


def _without_a_root(stage):
  """A skeleton in a plain Xform, in a stage without a unit whose time codes are milliseconds."""
  stage.GetDefaultPrim().SetTypeName("Xform")
  stage.ClearMetadata("metersPerUnit")
  UsdGeom.Xformable(stage.GetDefaultPrim()).AddScaleOp().Set((100.0, 100.0, 100.0))
  layer, every = stage.GetRootLayer(), 1000 / 12.5
  layer.timeCodesPerSecond, layer.endTimeCode = 1000, 5 * every
  for spec in layer.GetPrimAtPath("/Motion/Skeleton").nameChildren[0].properties:
    for time in reversed(layer.ListTimeSamplesForPath(spec.path)):
      value = layer.QueryTimeSample(spec.path, time)
      layer.EraseTimeSample(spec.path, time)
      layer.SetTimeSample(spec.path, time * every, value)


def _with_other_files(stage):
  stage.GetRootLayer().subLayerPaths.append("./other.usda")


@pytest.mark.parametrize("rig, options, change, clip_name, note", [
    (None, {"exact": True}, lambda path: path, "", ""), ("ue5", {}, lambda path: path, "", ""),
    ("mixamo", {}, _z_up_and_binary, "", ""), ("mixamo", {}, _on_stage(_with_another_animation), "#second", ""),
    ("mixamo", {}, _on_stage(_without_a_root), "", ""),
    (None, {}, _on_stage(_with_other_files), "", "refers to ./other.usda, and only the file itself is read")])
def test_what_is_written_is_read_back(rig, options, change, clip_name, note, tmp_path):
  clip = walk(6, 0.2).replace(fps=12.5)
  path = change(export.save(clip, tmp_path / "walk.usda", rig=rig, **options)[0])
  with warnings.catch_warnings(record=True) as notes:
    warnings.simplefilter("always")
    read_back = export.load(f"{path}{clip_name}")
  assert [note in str(one.message) for one in notes] == [True] * bool(note), [str(one.message) for one in notes]
  moved = on_rig(clip, rig)
  index = [HUMANML3D.joints.index(joint) for joint in moved.rig.joints]
  joints = clip.joints[:, index] if options else places_of(moved)[:, list(moved.rig.joints.values())]
  assert read_back.fps == pytest.approx(12.5) and read_back.num_frames == 6
  np.testing.assert_allclose(read_back.joints[:, index], joints, atol=1e-4)


_XFORM = '#usda 1.0\ndef Xform "a" {}\n'
_SKELETON = '#usda 1.0\ndef SkelRoot "a" {\n  def Skeleton "s" {\n    uniform token[] joints = ["Hips"]\n  }\n}\n'
_REFERS = '#usda 1.0\ndef SkelRoot "a" (references = @/etc/passwd@) {}\n'
_UNLIKE = _SKELETON + 'def SkelAnimation "m" {\n  uniform token[] joints = ["Spine"]\n}\n'


@pytest.mark.parametrize("text, message", [
    ("nothing", "cannot be read as USD .*not a valid usda layer.*export a .glb"),
    (_XFORM, "holds no skeleton, expected a Skeleton and a SkelAnimation; export it with"),
    (_SKELETON, "holds a skeleton and no animation of it"),
    (_UNLIKE, "no skeleton has the joints of its animation 'm'"),
    (_REFERS, "no skeleton.*refers to /etc/passwd, and only the file itself is read: write it into one file")])
def test_what_is_no_skeletal_animation_is_one_sentence(text, message, tmp_path):
  (tmp_path / "a.usda").write_text(text)
  with pytest.raises(InputError, match=f"a.usda: .*{message}"):
    export.load(tmp_path / "a.usda")


def test_without_the_extra_a_reader_names_it(tmp_path, monkeypatch):
  monkeypatch.setattr(child, "run", lambda *given, **limits: subprocess.CompletedProcess(given, native.MISSING))
  for name, extra in (("a.usda", "usd"), ("a.fbx", "fbx-read"), ("a.c3d", "c3d")):
    (tmp_path / name).write_bytes(bytes([2, 0x50]) + bytes(510))
    with pytest.raises(InputError, match=rf"{name}: .*pip install .*\[{extra}\].* or export|or convert"):
      export.load(tmp_path / name)
