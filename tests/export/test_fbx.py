"""FBX is written by Blender: how it is called (what it writes is in docs/formats.md); and it is read by ufbx."""
import warnings

import numpy as np
import pytest

from motion_jax import export
from motion_jax.export.rig import on_rig
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.rigs.rig import get_rig
from motion_jax.utils.errors import InputError
from tests.export.test_bvh import walk
from tests.export.test_rigs import places_of

# Called as Blender's Python is: -I SCRIPT MOTION.glb MOTION.fbx FPS.
PROGRAMS = {"python-that-copies": 'cp "$3" "$4"', "blender-that-copies": 'shift 7; cp "$1" "$2"',
            "python-that-fails": "echo no codec >&2; exit 3"}


@pytest.fixture
def blender(tmp_path, monkeypatch):
  def use(name):
    program = tmp_path / name
    if name in PROGRAMS:
      program.write_text(f"#!/bin/sh\n{PROGRAMS[name]}\n")
      program.chmod(0o755)
    monkeypatch.setenv("MOTION_JAX_BLENDER", str(program))
  return use


@pytest.mark.parametrize("name", ["python-that-copies", "blender-that-copies"])
def test_blender_converts_the_glb_of_the_rig(name, blender, tmp_path):
  blender(name)
  export.save(walk(4), tmp_path / "walk.fbx", rig="mixamo")
  assert b"mixamorig:LeftUpLeg" in (tmp_path / "walk.fbx").read_bytes()


@pytest.mark.parametrize("name, sentence", [("python-that-fails", "wrote no .fbx: no codec"), ("none", "no program")])
def test_a_blender_that_fails_is_one_sentence_and_no_file(name, sentence, blender, tmp_path):
  blender(name)
  with pytest.raises(InputError, match=sentence):
    export.save(walk(4), tmp_path / "walk.fbx")
  assert not (tmp_path / "walk.fbx").exists()


def test_without_blender_the_sentence_says_how_to_get_it(monkeypatch, tmp_path):
  monkeypatch.delenv("MOTION_JAX_BLENDER", raising=False)
  monkeypatch.setenv("PATH", str(tmp_path))
  with pytest.raises(InputError, match=r"\[fbx\]"):
    export.check_output(tmp_path / "walk.fbx")


def write_fbx(path, scale=1.0, z_up=False, takes=("Take 001",), empty=(), stated=True):
  """Writes a text FBX of a figure that raises its left arm in 5 frames: Maya's joints, which do not inherit scale.

  scale: of the hips and of the left thigh, by which places of what hangs on them are divided. z_up: as 3ds Max writes.
  takes: names of animations; those in `empty` have no curves. stated: their beginning and end.
  """
  moved = on_rig(walk(2), "lafan")
  names, parents, offsets = moved.rig.names, moved.rig.parents, 100 * moved.offsets
  scales = [scale if name in ("Hips", "LeftUpLeg") else 1.0 for name in names]
  objects, links = [], []
  for j, (name, parent) in enumerate(zip(names, parents)):
    at = offsets[j] / scales[parent] if parent >= 0 else (0, 0, 93) if z_up else (0, 93, 0)
    rows = [f'P: "InheritType", "enum", "", "",{0 if scale == 1 else 2}',
            'P: "Lcl Translation", "Lcl Translation", "", "A",' + ",".join(f"{x:.6f}" for x in at),
            'P: "Lcl Scaling", "Lcl Scaling", "", "A"' + f",{scales[j]}" * 3]
    rows += ['P: "Lcl Rotation", "Lcl Rotation", "", "A",90,0,0'] * (z_up and parent < 0)
    objects += [f'Model: {1000 + j}, "Model::{name}", "LimbNode" {{', "Properties70: {", *rows, "}", "}",
                f'NodeAttribute: {1500 + j}, "NodeAttribute::", "LimbNode" {{', 'TypeFlags: "Skeleton"', "}"]
    links += [f"{1000 + j},{1000 + parent if parent >= 0 else 0}", f"{1500 + j},{1000 + j}"]
  times = [round(k * 46186158000 / 20) for k in range(5)]
  for number, take in enumerate(takes):
    base = 5000 + 10 * number
    objects += [f'AnimationStack: {base}, "AnimStack::{take}", "" {{', "Properties70: {",
                *(f'P: "{key}", "KTime", "Time", "",{time}' for key, time in (
                    ("LocalStart", 0), ("LocalStop", times[-1])) if stated), "}", "}",
                f'AnimationLayer: {base + 1}, "AnimLayer::BaseLayer", "" {{', "}"]
    links.append(f"{base + 1},{base}")
    if take in empty:
      continue
    list_of = lambda key, values: [f"{key}: *{len(values)} {{", "a: " + ",".join(map(str, values)), "}"]
    objects += [f'AnimationCurveNode: {base + 2}, "AnimCurveNode::R", "" {{', "Properties70: {",
                'P: "d|Z", "Number", "", "A",0', "}", "}", f'AnimationCurve: {base + 3}, "AnimCurve::", "" {{',
                "Default: 0", "KeyVer: 4008", *list_of("KeyTime", times), *list_of("KeyValueFloat", range(12, 72, 12)),
                *list_of("KeyAttrFlags", [260]), *list_of("KeyAttrDataFloat", [0] * 4),
                *list_of("KeyAttrRefCount", [5]), "}"]
    links += [f"{base + 2},{base + 1}", f'{base + 2},{1000 + names.index("LeftArm")}, "Lcl Rotation"',
              f'{base + 3},{base + 2}, "d|Z"']
  up, front, sign = (2, 1, -1) if z_up else (1, 2, 1)
  settings = [f'P: "{key}", "int", "Integer", "",{value}' for key, value in (
      ("UpAxis", up), ("UpAxisSign", 1), ("FrontAxis", front), ("FrontAxisSign", sign), ("CoordAxis", 0),
      ("CoordAxisSign", 1), ("TimeMode", 14), ("CustomFrameRate", 20), ("UnitScaleFactor", 1))]
  lines = ["; FBX 7.4.0 project file", "FBXHeaderExtension: {", "FBXVersion: 7400", "}", "GlobalSettings: {",
           "Properties70: {", *settings, "}", "}", "Objects: {", *objects, "}", "Connections: {",
           *(f'C: "{"OP" if chr(34) in link else "OO"}",{link}' for link in links), "}"]
  path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("options, name", [
    ({}, "a.fbx"), ({"scale": 1.25}, "a.fbx"), ({"scale": 0.01}, "a.fbx"), ({"z_up": True}, "a.fbx"),
    ({"stated": False}, "a.fbx"), ({"takes": ("rest", "Take 001"), "empty": ("rest",)}, "a.fbx"),
    ({"takes": ("a", "b", "c"), "empty": "a"}, "a.fbx#c"), ({"takes": ("rest",), "empty": ("rest",)}, "a.fbx")])
def test_a_figure_of_fbx_is_as_large_and_upright_as_its_nodes(options, name, tmp_path):
  """Scales that joints do not inherit, the file's axes, and takes in which nothing moves."""
  pytest.importorskip("ufbx", reason="the extra `fbx-read` brings ufbx")
  write_fbx(tmp_path / "a.fbx", **options)
  with warnings.catch_warnings(action="error"):
    joints = export.load(tmp_path / name).joints
  rest = places_of(on_rig(walk(2), "lafan")._replace(turned=np.tile([1.0, 0, 0, 0], (1, 22, 1)), root=np.zeros((1, 3))))
  lafan = get_rig("lafan")
  expected = rest[0, [lafan.joints[joint] for joint in HUMANML3D.joints]] + [0, 0.93, 0]
  others = [j for j, joint in enumerate(HUMANML3D.joints) if joint not in ("left_elbow", "left_wrist")]
  np.testing.assert_allclose(joints[0, others], expected[others], atol=1e-4)
  raised = np.ptp(joints[:, HUMANML3D.joints.index("left_wrist"), 1])
  assert len(joints) == 5 and (raised > 0.3) == (options.get("takes") != ("rest",))
