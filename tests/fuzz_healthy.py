"""Healthy inputs of every kind, which the fuzzer damages: files as bytes, made once in each process."""
import functools
import json
import pathlib
import shutil
import tempfile

import numpy as np

from motion_jax import export
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
from tests.conftest import load_config
from tests.data.test_build import write_archive


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


_MAKERS = {
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
