"""What game engines take from a file: loops that close, their speed, the root bone, names of clips and their order."""
import json
import struct

import numpy as np
import pytest
from PIL import Image
from pxr import Usd, UsdSkel

from motion_jax import export
from motion_jax.control.constraints import InPlace, Loop
from motion_jax.control.finishing import finalize
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.data.mocap.bvh import read_bvh
from motion_jax.data.mocap.gltf import Document
from motion_jax.data.mocap.gltf_motion import animation_names, read_gltf
from motion_jax.export.rig import on_rig
from motion_jax.motion.looping import looped
from motion_jax_studio import cli
from tests.export.characters import write_character
from tests.export.test_bvh import walk
from tests.export.test_character import apart


@pytest.fixture(scope="module")
def wave():
  """A loop of a body that stands; solved frame after frame, an arm's twist at its end is off by 22 degrees."""
  joints = synthetic_joints("wave_left", 43, np.random.default_rng(0))
  return Clip(joints=looped(joints), captions=(Caption("an old person waves, left"),))


@pytest.fixture(scope="module")
def travelling():
  """A loop of a walk, before it is held in place, and after: (clip, clip)."""
  joints = synthetic_joints("walk", 70, np.random.default_rng(0)).astype(np.float32) + np.float32([0, 0, 2])
  (way, _), (still, velocity) = (finalize(joints, kinds, 20.0, 47) for kinds in ([Loop()], [Loop(), InPlace()]))
  return Clip(joints=way), Clip(joints=still, meta={"velocity": velocity.tolist()})


def keys(path):
  """(places (T, N, 3) in the world, rotations (T, N, 4) relative to the parent, seconds) of a file's joints."""
  if path.suffix == ".usda":
    stage = Usd.Stage.Open(str(path))
    animation = UsdSkel.Animation(next(p for p in stage.Traverse() if p.IsA(UsdSkel.Animation)))
    frames = np.arange(stage.GetEndTimeCode() + 1)
    turned = [[[q.GetReal(), *q.GetImaginary()] for q in animation.GetRotationsAttr().Get(t)] for t in frames]
    places = [[list(v) for v in animation.GetTranslationsAttr().Get(t)] for t in frames]
    return np.array(places), np.array(turned), frames[-1] / stage.GetTimeCodesPerSecond()
  capture = read_bvh(path) if path.suffix == ".bvh" else read_gltf(path)
  return capture.positions, capture.rotations, (capture.num_frames - 1) / capture.fps


@pytest.mark.parametrize("name, options", [
    ("a.glb", {}), ("a.glb", {"exact": True}), ("a.glb", {"rig": "ue5"}), ("a.bvh", {"unit": "metres"}), ("a.vrma", {}),
    ("a.usda", {}), ("a.glb", {"fps": 30}), ("character.glb", {})])
def test_the_last_key_of_a_loop_is_the_first_at_the_clips_length(name, options, wave, tmp_path):
  if name.startswith("character"):
    write_character(tmp_path / "body.glb", wave, size=1.3, rolls=4)
    options = {"file": tmp_path / "body.glb"}
  path, = export.save(wave, tmp_path / name, **options)
  places, turned, seconds = keys(path)
  assert seconds == pytest.approx(42 / 20, abs=1e-6)
  assert np.abs(places[-1] - places[0]).max() < 2e-5 and apart(turned[-1], turned[0]).max() < 0.1
  steps = apart(turned[1:], turned[:-1]).max(1)
  assert steps[-1] < steps[:-1].max() + 0.1, "it is reached at the pace of the motion, not by a jump"


def test_a_film_of_a_loop_leaves_out_the_closing_frame(wave, tmp_path):
  path, = export.save(wave.replace(joints=looped(wave.joints[:6])), tmp_path / "a.gif", size=(32, 32))
  with Image.open(path) as film:
    assert sum(film.seek(k) or film.info["duration"] for k in range(film.n_frames)) == 50 * 5


def test_a_cycle_begins_at_the_origin_and_keeps_its_speed(travelling, tmp_path):
  way, still = travelling
  assert way.num_frames == 48, "47 frames and the first one again"
  for clip in travelling:
    np.testing.assert_allclose(clip.joints[0, 0, [0, 2]], 0, atol=1e-5)
  went = way.joints[-1, 0] - way.joints[0, 0]
  assert went[2] > 1 and abs(went[0]) < 0.05 and np.abs(still.joints[-1] - still.joints[0]).max() < 1e-4
  for clip in travelling:
    path, = export.save(clip, tmp_path / "a.glb")
    about = Document(path).json["animations"][0]["extras"]
    assert about["loop"] and about["speed"] == pytest.approx(went[2] / (47 / 20), rel=0.02)
    assert about["velocity"][2] == pytest.approx(about["speed"], rel=0.02)
  assert not Document(export.save(way.cut(0, 20), tmp_path / "a.glb")[0]).json["animations"][0]["extras"]["loop"]


def test_a_root_bone_carries_the_body(tmp_path):
  """Over the floor, below the pelvis, turning with it: where the rig has one, and where the character has."""
  clip = walk(40, 0.2)
  moved = on_rig(clip, "ue5")
  plain = on_rig(clip)
  flat = moved.root * [1, 0, 1]
  assert np.abs(moved.ground[:, 1]).max() == 0 and np.linalg.norm(moved.ground - flat, axis=-1).max() < 0.12
  assert np.abs(np.diff(moved.ground, n=2, axis=0)).max() < 0.7 * np.abs(np.diff(flat, n=2, axis=0)).max()
  assert 60 < apart(moved.turned[-1, :1], moved.turned[0, :1])[0] < 84
  write_character(tmp_path / "body.glb", clip, rig="ue5", size=1.5, rolls=3)
  for options in ({"rig": "ue5"}, {"file": tmp_path / "body.glb"}):
    path, = export.save(clip, tmp_path / "a.glb", **options)
    capture = read_gltf(path)
    root, pelvis = (capture.positions[:, capture.names.index(name)] for name in ("root", "pelvis"))
    size = np.linalg.norm(pelvis[-1] - pelvis[0]) / np.linalg.norm(plain.root[-1] - plain.root[0])
    assert np.linalg.norm((root - pelvis)[:, [0, 2]], axis=-1).max() < 0.12 * size and np.ptp(root[:, 1]) < 1e-5
    assert np.linalg.norm(root[-1] - root[0]) > 1 and (size == pytest.approx(1, abs=1e-3)) == ("rig" in options)
  early = on_rig(clip, "ue5", t_pose=True)
  np.testing.assert_allclose(early.ground[1:], moved.ground, atol=1e-12)
  assert np.abs(early.ground[0] - moved.ground[0]).max() < 1e-3 and apart(early.turned[0, 0], [1.0, 0, 0, 0]) < 1e-6


def test_clips_have_names_without_blanks_and_new_ones_come_first(wave, tmp_path, capsys):
  body, other = tmp_path / "body.glb", wave.replace(captions=(Caption("über den Zaun! (2)"),))
  write_character(body, wave)
  names = lambda path: animation_names(Document(path))
  export.save(wave, body, file=body)
  export.save([other, wave], body, file=body)
  assert names(body) == ["über_den_Zaun_2", "an_old_person_waves_left_2", "an_old_person_waves_left"]
  export.save(wave, tmp_path / "wave.npz")
  run = lambda *flags: cli.main(["render", str(tmp_path / "wave.npz"), "--out", str(tmp_path / "out.glb"), *flags])
  assert run("--character", str(body), "--replace-animations", "--name", "Wave") == 0
  assert names(tmp_path / "out.glb") == ["Wave"]
  assert run("--name", "Wave") == 0 and names(tmp_path / "out.glb") == ["Wave"]
  data = (tmp_path / "out.glb").read_bytes()
  about = json.loads(data[20:20 + struct.unpack_from("<I", data, 12)[0]])["animations"][0]["extras"]
  assert about["caption"] == "an old person waves, left" and about["loop"] and about["fps"] == 20
  with pytest.raises(SystemExit):
    run("--name", "a b")
  assert "expected up to 60 letters" in capsys.readouterr().err
