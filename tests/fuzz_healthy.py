"""Healthy inputs of every kind, which the fuzzer damages: files as bytes, made once in each process."""
import collections
import contextlib
import dataclasses
import functools
import json
import pathlib
import shutil
import tempfile

import numpy as np
from safetensors import numpy as safetensors

from motion_jax import export, robots
from motion_jax.control import files as control_files
from motion_jax.data.datasets import babel, humanml3d, snapmogen
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.models import cmdm
from motion_jax.motion.representations import to_features
from motion_jax.motion.skeleton import SMPL, SNAPMOGEN
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.runs import PRETRAINED
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint
from motion_jax.training.setup import untrained
from motion_jax.utils.config_files import module_fields
from motion_jax_studio.server import serialization
from tests import fixtures
from tests.conftest import load_config
from tests.control.test_constraints import EVERY, pose
from tests.convert.test_torch_files import tensor, write
from tests.data.test_build import write_archive
from tests.export.characters import rig_joints, with_vrm, write_character
from tests.robots.test_robots import humanoid, mapping


@functools.cache
def healthy(name) -> dict[str, bytes]:
  """The files of a healthy input by their path."""
  with tempfile.TemporaryDirectory() as folder:
    folder = pathlib.Path(folder)
    _MAKERS[name](folder)
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*"))
            if path.is_file()}


def _clips(num=5, frames=48, skeleton=None):
  clips = synthetic_clips(0, num, num_frames=frames)
  return [clip.on_skeleton(skeleton) for clip in clips] if skeleton else clips


def _motion(folder):
  clip = _clips(1, 20)[0]
  features = to_features(clip.joints, "full", "corrected")
  for name in ("a.npz", "a.npy", "a.bvh"):
    export.save(clip.replace(features=features, meta={"seed": 3, "model": "x"}), folder / name)
  np.save(folder / "features.npy", features)


_ASF = (":version 1.10\n:name man\n:units\n  mass 1.0\n  length 0.45\n  angle deg\n:root\n  order TX TY TZ RX RY RZ\n"
        "  axis XYZ\n  position 0 0 0\n  orientation 0 0 0\n:bonedata\n")
_BONES = {name: (parent, tuple(map(float, (x, y, z))), length) for name, parent, x, y, z, length in map(str.split, (
    "lhipjoint root .6 -.8 0 2.5", "lfemur lhipjoint .3 -.95 0 7", "ltibia lfemur .3 -.95 0 7",
    "lfoot ltibia 0 -.3 .95 2", "ltoes lfoot 0 0 1 1", "lowerback root 0 1 0 2", "upperback lowerback 0 1 0 2",
    "thorax upperback 0 1 0 2", "lowerneck thorax 0 1 0 1.5", "upperneck lowerneck 0 1 0 1.5",
    "head upperneck 0 1 0 1.5", "lclavicle thorax .9 .4 0 3.5", "lhumerus lclavicle 1 0 0 5",
    "lradius lhumerus 1 0 0 3", "lwrist lradius 1 0 0 2", "lhand lwrist 1 0 0 1"))}


def _acclaim(folder):
  bones = dict(_BONES)
  for name, (parent, (x, y, z), length) in _BONES.items():
    if name.startswith("l") and not name.startswith("lower"):
      up = parent if parent in ("root", "thorax") else "r" + parent[1:]
      bones["r" + name[1:]] = (up, (-x, y, z), length)
  lines = [_ASF]
  for number, (name, (_, direction, length)) in enumerate(bones.items(), 1):
    lines.append(f"  begin\n    id {number}\n    name {name}\n    direction {' '.join(map(str, direction))}\n"
                 f"    length {length}\n    axis 0 0 0 XYZ\n    dof rx ry rz\n  end\n")
  lines.append(":hierarchy\n  begin\n" + "".join(f"    {parent} {name}\n" for name, (parent, *_) in bones.items())
               + "  end\n")
  (folder / "02.asf").write_text("".join(lines))
  rng, rows = np.random.default_rng(0), [":FULLY-SPECIFIED\n:DEGREES"]
  for frame in range(1, 61):
    rows.append(f"{frame}\nroot 0 17 {frame / 10} 0 0 0")
    rows += [f"{name} " + " ".join(f"{angle:.3f}" for angle in rng.normal(0, 2, 3)) for name in bones]
  (folder / "02_01.amc").write_text("\n".join(rows) + "\n")
  (folder / "captions.csv").write_text("file,caption,start,end,split\n02_01.amc,a person walks,,,train\n")


def _captures(folder):
  rows = ["file,caption,start,end,split,source,license"]
  for i, clip in enumerate(_clips(2, 24)):
    export.bvh(clip, folder / f"c{i}.bvh")
    rows.append(f'c{i}.bvh,"{clip.captions[0].text}, slowly",0,{i},{clip.split},lab,CC0')
  (folder / "captions.csv").write_text("\n".join(rows) + "\n")
  (folder / "map.json").write_text(json.dumps({joint: joint for joint in clip.skeleton.joints}))


def _run(folder):
  """A run folder as training leaves it, with weights that were never trained."""
  config = load_config("cmdm_denoiser", "tiny")
  vae, dit = CausalVAE(**module_fields(config.tokenizer)), CausalDiT(**module_fields(config.model))
  checkpoint.save_config(folder, config)
  checkpoint.save_params(folder, untrained(cmdm.denoiser_shapes(dit)))
  checkpoint.save_params(folder, untrained(cmdm.frozen_shapes(vae)), name=checkpoint.FROZEN)
  shipped = PRETRAINED / "cmdm-small"
  for name in ("Mean.npy", "Std.npy"):
    (folder / name).write_bytes((shipped / name).read_bytes())
  rows = [["a person walks", 90], ["someone jumps", 60], ["a person sits", 120]]
  checkpoint.save_text(folder, checkpoint.LENGTHS, json.dumps(rows))
  fingerprint = load_text_encoder("random-init").fingerprint
  checkpoint.save_text(folder, checkpoint.TEXT, json.dumps({"name": "random-init", "fingerprint": fingerprint}))


_URDF_LINK = """<link name="{name}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0"
  iyz="0"/></inertial></link>"""
_URDF_JOINT = _URDF_LINK + """<joint name="{joint}" type="revolute"><parent link="{parent}"/><child link="{name}"/>
  <origin xyz="{place}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>"""


def _formats(folder):
  """Files of other programs' formats."""
  clip = _clips(1, 6)[0]
  for name in ("a.glb", "a.vrma", "a.usda", "a.csv", "a.trc", "a.c3d", "a.amass.npz", "a.bvh"):
    export.save(clip, folder / name)
  with contextlib.suppress(ImportError):
    from pxr import Sdf
    Sdf.Layer.OpenAsAnonymous(str(folder / "a.usda")).Export(str(folder / "a.usdc"))
  write_character(folder / "character.glb", clip)
  write_character(folder / "character.vrm", clip, "vrm", change=with_vrm(1))
  (folder / "map.json").write_text(json.dumps({joint: [joint] for joint in clip.skeleton.joints}))
  shutil.copyfile(fixtures.path("data/plain.fbx"), folder / "a.fbx")
  (folder / "bones.json").write_text(json.dumps(rig_joints("mixamo")))
  kept = dataclasses.replace(EVERY[-1], joints=np.stack([pose(z=0.05 * t) for t in range(3)]))
  rows = [*(EVERY[i] for i in (0, 5, 7, 8, 9, 10)), kept]
  control_files.save(rows, folder / "control.json")
  (folder / "project.json").write_text(json.dumps({
      "format": "motion_jax project", "version": 1, "model": {"name": "tiny", "id": ""}, "seeds": [4, 9], "chosen": 1,
      "blocks": [{"prompt": "a person walks", "seconds": 2.4}], "sampling": {"num_steps": 4}, "cleanup": True,
      "past": serialization.to_json(clip), "control": control_files.to_json(EVERY[:4]), "edits": [
          {"take": 0, "prompt": "kicks", "change": [[2, 5]], "seed": 3, "sampling": {}, "model": {"name": "tiny"}}]}))
  numbers = np.arange(12, dtype=np.float32)
  safetensors.save_file({"a/w": numbers.reshape(3, 4), "b": numbers[:2]}, folder / "w.safetensors", {"format": "pt"})
  write(folder / "w.pt", {"net": collections.OrderedDict(w=tensor("0", "FloatStorage", (3, 4))), "it": 3},
        {"0": numbers})


def _robot(folder):
  """A small humanoid as MJCF and URDF, its mapping, and motions of it."""
  (folder / "in.xml").write_text(humanoid())
  (folder / "map.json").write_text(json.dumps({"bodies": mapping(), "stand": {"left_knee": 0.4}, "apart": [
      [["left_knee"], ["right_knee"]]], "orders": {}, "posture": {"waist": 1.0}, "name": "small", "licence": "x"}))
  robot = robots.load(folder / "in.xml", mapping())
  motion = robots.RobotMotion(robot, np.tile(robot.standing(), (5, 1)), 50.0)
  for form in ("unitree_xyzw", "gmr", "mujoco", "loco_mujoco", "mjlab"):
    robots.write(motion, folder / "a", form)
  places = {"left_hip": ("base", "0 0.1 -0.1"), "left_knee": ("left_hip", "0 0 -0.4"),
            "left_ankle": ("left_knee", "0 0 -0.4"), "left_shoulder": ("chest", "0 0.2 0.3"),
            "left_elbow": ("left_shoulder", "0 0 -0.3")}
  places |= {name.replace("left", "right"): (parent.replace("left", "right"), place.replace(" 0.", " -0.", 1))
             for name, (parent, place) in places.items()}
  joints = "".join(_URDF_JOINT.format(
      name=name, joint="waist" if name == "chest" else name, parent=parent, place=place) for name, (parent, place) in (
          ("chest", ("base", "0 0 0.1")), *places.items()))
  (folder / "in.urdf").write_text(f'<robot name="small">{_URDF_LINK.format(name="base")}{joints}</robot>')


_MAKERS = {
    "formats": _formats, "robot": _robot,
    "motion": _motion, "acclaim": _acclaim, "captures": _captures, "run": _run,
    "archive": lambda folder: write_archive(folder / "set", 5, 40),
    "humanml3d": lambda folder: humanml3d.write_folder(_clips(), folder / "set", mirror=False),
    "snapmogen": lambda folder: snapmogen.write_folder(_clips(3, 60, SNAPMOGEN), folder / "set"),
    "babel": lambda folder: babel.write_folder([clip.replace(split="train") for clip in _clips(3, 60, SMPL)],
                                               folder / "set"),
    "evaluator": lambda folder: shutil.copytree(PRETRAINED / "clip-evaluator-small", folder, dirs_exist_ok=True),
    "words": lambda folder: shutil.copytree(PRETRAINED / "words", folder, dirs_exist_ok=True)}


def put(folder, files):
  for name, content in files.items():
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)
