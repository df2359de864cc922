"""A user's own character: it comes back whole, and moves as the motion does."""
import json
import re
import shutil

import numpy as np
import pytest

from motion_jax import export
from motion_jax.data.clip import Caption
from motion_jax.data.mocap.gltf import Document
from motion_jax.data.mocap.gltf_motion import animation_names, read_gltf
from motion_jax.export.character import check_character
from motion_jax.export.rig import rigged
from motion_jax.motion import rotations as rot
from motion_jax.motion.pose import pose_to_joints
from motion_jax.motion.skeleton import HUMANML3D, KIT
from motion_jax.utils.errors import InputError
from motion_jax_studio import cli
from tests.export.characters import mirrored, rig_joints, two_bodies, with_vrm, write_character
from tests.export.test_bvh import walk

CLIP = walk(40, 0.2).replace(captions=(Caption("a person walks"),))
POSE = rigged(CLIP)
JOINTS = pose_to_joints(POSE)
Z_UP = np.array([np.sqrt(0.5), -np.sqrt(0.5), 0, 0])
# As files of other programs are: the rig, and what is odd about its nodes.
KINDS = {
    "mixamo": dict(rig="mixamo", scale=0.01, armature=Z_UP), "biped": dict(rig="biped", rolls=1),
    "ue5": dict(rig="ue5", rolls=5), "lafan": dict(rig="lafan", quantized=True),
    "humanik": dict(rig="humanik", rolls=3, copies=2),
    "lies": dict(rig="mixamo", change=lambda body: body["nodes"][-2].update(rotation=Z_UP[[1, 2, 3, 0]].tolist())),
    "runs": dict(rig="mixamo", rolls=7, change=lambda body: bent_limbs(body))}


def bent_limbs(document):
  """A pose in the middle of a run, at rest."""
  for node in document["nodes"]:
    if node["name"].endswith(("RightUpLeg", "LeftArm", "Spine1")):
      x, y, z, w = node["rotation"]
      node["rotation"] = rot.multiply(np.array([w, x, y, z]), rot.about_axis(0.9, "x"))[[1, 2, 3, 0]].tolist()


def animate(tmp_path, clips=CLIP, **kind):
  names = write_character(tmp_path / "body.glb", CLIP, **kind)
  return export.save(clips, tmp_path / "out.glb", file=tmp_path / "body.glb")[0], names


def bones(path, rig, animation=None):
  """Places (T, 22, 3) and world rotations from rest (T, 22, 4) of the bones in place of the 22 joints."""
  capture, found = read_gltf(path, animation), rig_joints(rig)
  index = [capture.names.index(found[joint]) for joint in HUMANML3D.joints]
  return capture.positions[:, index], capture.turned[:, index]


def off_joints(places):
  """Metres from the clip's joints, apart from where it stands: the sole of a box is not where the clip's floor is."""
  off = places - JOINTS
  off -= np.median(off[..., 1]) * np.array([0, 1, 0])
  return np.abs(off - off[:1, :1] * [1, 0, 1]).max()


def apart(q, p):
  """Degrees between rotations."""
  return np.degrees(2 * np.arccos(np.clip(np.abs((q * p).sum(-1)), 0, 1)))


@pytest.mark.parametrize("kind", KINDS)
def test_a_character_of_the_same_proportions_moves_as_the_motion(kind, tmp_path):
  path, _ = animate(tmp_path, **KINDS[kind])
  places, turned = bones(path, KINDS[kind]["rig"])
  # Arms of a biped hang on the neck; one that lies does not show where its soles are; ue5 rests with lowered arms.
  assert off_joints(places) < {"biped": 0.02, "lies": 0.04, "ue5": 0.05}.get(kind, 0.001)
  assert kind in ("biped", "lies", "runs", "ue5") or apart(turned, POSE.turned).max() < 0.5


@pytest.mark.parametrize("rig", ["mixamo", "rigify"])
def test_feet_of_other_proportions_stand_on_the_floor_and_do_not_slide(rig, tmp_path):
  """Nor in the T-pose that comes first."""
  write_character(tmp_path / "body.glb", CLIP, rig=rig, size=1.7, rolls=6)
  path, = export.save(CLIP, tmp_path / "out.glb", file=tmp_path / "body.glb", t_pose=True)
  (rest, *places), turned = bones(path, rig)
  places = np.array(places)
  assert len(places) == CLIP.num_frames and apart(turned[0], np.array([1.0, 0, 0, 0])).max() < 0.1
  assert 0.02 < rest[[10, 11], 1].min() < 0.05 and abs(check_character(path).scale - 1.7) < 0.02
  ankles = places[:, [7, 8]]
  low = places[:, [10, 11], 1].min()
  assert 0.02 < low < 0.05  # half a box of 1.7 * 4 cm, and nothing below the floor
  stands = JOINTS[:, [7, 8], 1] < np.percentile(JOINTS[:, [7, 8], 1], 30)
  still = np.linalg.norm(np.diff(JOINTS[:, [7, 8]], axis=0), axis=-1) < 0.004
  moved = np.linalg.norm(np.diff(ankles, axis=0), axis=-1)[still & stands[1:]]
  assert len(moved) and moved.max() < 1.7 * 0.006


def test_nothing_of_the_file_changes_but_what_is_added(tmp_path):
  names = write_character(tmp_path / "body.glb", CLIP, quantized=True, change=lambda document: document.update(
      images=[{"bufferView": 0, "mimeType": "image/png"}], extras={"my": ["own", 0.1]}))
  before = Document(tmp_path / "body.glb")
  export.save(CLIP, tmp_path / "one.glb", file=tmp_path / "body.glb")
  export.save([CLIP, CLIP.replace(captions=(Caption("again"),))], tmp_path / "all.glb", file=tmp_path / "one.glb")
  after = Document(tmp_path / "all.glb")
  assert animation_names(after) == ["a_person_walks_2", "again", "a_person_walks"]
  for key, value in before.json.items():
    if key == "buffers":
      continue
    longer = key in ("accessors", "bufferViews")
    assert (after.json[key][:len(value)] if longer else after.json[key]) == value, key
  size = before.json["buffers"][0]["byteLength"]
  assert (tmp_path / "all.glb").read_bytes().find((tmp_path / "body.glb").read_bytes()[-size:]) > 0
  channels = after.json["animations"][0]["channels"]
  assert {one["target"]["path"] for one in channels} == {"rotation", "translation"} and len(channels) <= len(names) + 1
  for one in after.json["animations"][0]["samplers"][1:]:
    q = after.array(one["output"])
    assert (q[1:] * q[:-1]).sum(-1).min() > 0  # no jump to the other sign


def test_files_beside_a_gltf_are_packed(tmp_path):
  write_character(tmp_path / "body.glb", CLIP)
  document = Document(tmp_path / "body.glb")
  (tmp_path / "data 1.bin").write_bytes(document._binary)
  (tmp_path / "skin.png").write_bytes(b"\x89PNG own bytes")
  text = document.json | {"images": [{"uri": "skin.png"}]}
  text["buffers"] = [text["buffers"][0] | {"uri": "data%201.bin"}]
  (tmp_path / "body.gltf").write_text(json.dumps(text))
  (tmp_path / "away").mkdir()
  export.save(CLIP, tmp_path / "away" / "out.glb", file=tmp_path / "body.gltf")
  packed = Document(tmp_path / "away" / "out.glb")
  view = packed.json["bufferViews"][packed.json["images"][0]["bufferView"]]
  assert packed._binary[view["byteOffset"]:][:view["byteLength"]] == b"\x89PNG own bytes"
  export.save(CLIP, tmp_path / "plain.glb", file=tmp_path / "body.glb")
  for first, second in zip(bones(tmp_path / "away" / "out.glb", "mixamo"), bones(tmp_path / "plain.glb", "mixamo")):
    np.testing.assert_array_equal(first, second)


def test_animated_nodes_have_no_matrix(tmp_path):
  """glTF 2.0, 3.5; such nodes come from assimp and COLLADA."""
  def to_matrices(document):
    for node in document["nodes"]:
      if "translation" in node:
        turn = rot.to_matrix(np.array(node.pop("rotation"))[[3, 0, 1, 2]])
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = turn, node.pop("translation")
        node["matrix"] = matrix.T.ravel().tolist()
  plain, _ = animate(tmp_path)
  expected = bones(plain, "mixamo")[0]
  path, _ = animate(tmp_path, change=to_matrices)
  document = Document(path)
  targets = {channel["target"]["node"] for channel in document.json["animations"][0]["channels"]}
  assert targets and not any("matrix" in document.nodes[node] for node in targets)
  np.testing.assert_allclose(bones(path, "mixamo")[0], expected, atol=1e-5)


@pytest.mark.parametrize("version", [0, 1])
def test_vrm_states_its_bones_whatever_their_names(version, tmp_path):
  turn = rot.about_axis(np.pi, "y") if version == 0 else np.array([1.0, 0, 0, 0])  # VRM 0 faces -z
  write_character(tmp_path / "body.vrm", CLIP, "vrm", change=with_vrm(version),
                  raised={rig_joints("vrm")["pelvis"]: turn})
  export.save(CLIP, tmp_path / "out.vrm", file=tmp_path / "body.vrm")
  capture = read_gltf(tmp_path / "out.vrm")
  path = capture.positions[:, 0] - capture.positions[0, 0]
  expected = (JOINTS[:, 0] - JOINTS[0, 0]) * ([-1, 1, -1] if version == 0 else 1)
  assert np.abs(path - expected).max() < 0.001


BAD = {
    "no skin": (dict(change=lambda d: d.pop("skins") and [node.pop("skin", 0) for node in d["nodes"]]), "has no skin"),
    "no legs": (dict(leave_out=("UpLeg",)), "without .*left_hip"),
    "mirrored": (dict(change=mirrored), "mirrored by a negative scale"),
    "joint nowhere": (dict(change=lambda d: d["skins"][0]["joints"].append(999)), "not as the format says"),
    "cycle": (dict(change=lambda d: (d["nodes"][3].update(children=[0]), d["nodes"][-2].pop("children"))),
              "itself|own"),
    "not finite": (dict(change=lambda d: d["nodes"][0].update(translation=[1e400, 0, 0])), "not finite"),
    "one matrix less": (dict(change=lambda d: d["accessors"][-1].update(count=d["accessors"][-1]["count"] - 1)),
                        "25 joints and 24 inverse bind matrices, expected one for each"),
    "text": (dict(change=lambda d: d["nodes"][0].update(translation="far")), "not as the format says"),
    "accessor": (dict(change=lambda d: d["accessors"][0].update(count=10 ** 7)), "outside its buffer"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_bad_character_gets_one_sentence_and_nothing_is_written(name, tmp_path):
  kind, message = BAD[name]
  write_character(tmp_path / "body.glb", CLIP, **kind)
  with pytest.raises(InputError, match=message) as error:
    export.save(CLIP, tmp_path / "out.glb", file=tmp_path / "body.glb")
  assert "\n" not in str(error.value) and [one.name for one in tmp_path.iterdir()] == ["body.glb"]


def test_two_bodies_and_cut_files_and_other_endings(tmp_path):
  write_character(tmp_path / "body.glb", CLIP)
  write_character(tmp_path / "two.glb", CLIP, change=two_bodies)
  data = (tmp_path / "body.glb").read_bytes()
  (tmp_path / "cut.glb").write_bytes(data[:len(data) // 2])
  (tmp_path / "body.fbx").write_bytes(data)
  with open(tmp_path / "large.glb", "wb") as file:
    file.truncate(300 << 20)
  for name, message in (("two.glb", "holds two bodies"), ("cut.glb", "cut or damaged"), ("large.glb", "got 300 MiB"),
                        ("body.fbx", "Blender converts"), ("none.glb", "there is no file")):
    with pytest.raises((InputError, FileNotFoundError), match=message):
      export.save(CLIP, tmp_path / "out.glb", file=tmp_path / name)
  with pytest.raises(InputError, match="skeleton 'kit'"):
    export.save(walk(4).on_skeleton(KIT), tmp_path / "out.glb", file=tmp_path / "body.glb")
  with pytest.raises(InputError, match="--character"):
    export.save(CLIP, tmp_path / "out.vrm")
  assert not list(tmp_path.glob("out.*"))


@pytest.mark.parametrize("apart, scene, moved, rename", [
    (0.0, None, True, str), (5.0, 1, False, str), (0.0, None, True, "{}_1".format), (0.0, None, True, "{}.001".format),
    (0.0, None, True, lambda name: name.replace("mixamorig:", "clothes:")),
    (0.0, None, True, lambda name: name if re.search("Shoulder|Arm|Hand", name) else f"other {name}")])
def test_clothes_with_a_skeleton_of_their_own_move_along(apart, scene, moved, rename, tmp_path):
  """Whole or, as of gloves, in part. What is in a scene that the file does not open with stays as it is."""
  def dress(document):
    count = len(document["nodes"])
    two_bodies(document, apart, scene)
    for node in document["nodes"][count:]:
      node["name"] = rename(node["name"])
  write_character(tmp_path / "body.glb", CLIP, rolls=2, change=dress)
  figure = check_character(tmp_path / "body.glb")  # a copy's Spine_1 once counted as Spine1, which nothing turned
  assert {*figure.parts.values(), *figure.bones.spine, *figure.bones.neck} == set(range(len(figure.nodes)))
  path, = export.save(CLIP, tmp_path / "out.glb", file=tmp_path / "body.glb")
  document = Document(path)
  hands = [node for node in range(len(document.nodes)) if "LeftHand" in document.name(node)]
  keys = {channel["target"]["node"]: channel["sampler"] for channel in document.json["animations"][0]["channels"]
          if channel["target"]["path"] == "rotation"}
  assert len(hands) == 2 and (hands[1] in keys) == moved
  if moved:
    first, second = (document.array(document.json["animations"][0]["samplers"][keys[node]]["output"]) for node in hands)
    np.testing.assert_array_equal(first, second)
  np.testing.assert_allclose(export.load(path).joints[:, 20], bones(path, "mixamo")[0][:, 20], atol=1e-5)


def test_a_skin_may_hold_a_part_of_the_animated_skeleton(tmp_path):
  path, = export.save(CLIP, tmp_path / "a.glb")
  document = Document(path)
  for joints in ([15, 16, 17, 18, 19], [0]):
    document.json["skins"][0]["joints"] = joints
    document.write(tmp_path / "b.glb")
    np.testing.assert_allclose(export.load(tmp_path / "b.glb").joints, export.load(path).joints, atol=1e-6)


def test_a_mapping_names_bones_that_no_rig_has(tmp_path):
  def rename(document):
    for number, node in enumerate(document["nodes"]):
      node["name"] = f"stick {number}"
  names = write_character(tmp_path / "body.glb", CLIP, change=rename)
  with pytest.raises(InputError, match='no rig.*Fill in a JSON file .*"left_hip": "..."') as error:
    check_character(tmp_path / "body.glb")
  assert "--character-mapping" in str(error.value)
  mapping = {joint: f"stick {names.index(bone)}" for joint, bone in rig_joints("mixamo").items()}
  export.save(CLIP, tmp_path / "out.glb", file=tmp_path / "body.glb", mapping=mapping)
  capture = read_gltf(tmp_path / "out.glb")
  at = [capture.names.index(mapping[joint]) for joint in HUMANML3D.joints]
  assert off_joints(capture.positions[:, at]) < 0.001
  with pytest.raises(InputError, match="'stick 0' to .*, expected one of them"):
    check_character(tmp_path / "body.glb", mapping | {"left_knee": "stick 0"})
  with pytest.raises(InputError, match="names the bones elbow of mine"):
    check_character(tmp_path / "body.glb", mapping | {"left_elbow": "elbow of mine"})


def test_the_command_line_animates_and_reads_back(tmp_path, capsys):
  write_character(tmp_path / "body.glb", CLIP)
  export.save(CLIP, tmp_path / "walk.npz")
  run = lambda *arguments: cli.main(["render", str(tmp_path / "walk.npz"), *map(str, arguments)])
  run("--character", tmp_path / "body.glb", "--out", tmp_path / "out.glb")
  assert "by the names of Mixamo" in capsys.readouterr().out
  found = export.load(tmp_path / "out.glb")
  assert np.ptp((found.joints - JOINTS)[:, [4, 7, 16, 20]], axis=0).max() < 0.005
  shutil.copy(tmp_path / "out.glb", tmp_path / "body.glb")
  run("--character", tmp_path / "body.glb", "--out", tmp_path / "out.glb")
  with pytest.raises(InputError, match="holds 2 animations .1 'a_person_walks_2', 2 'a_person_walks'.; name one"):
    export.load(tmp_path / "out.glb")
  for name in ("2", "a_person_walks_2"):
    assert export.load(f"{tmp_path / 'out.glb'}#{name}").num_frames == CLIP.num_frames
  assert run("--character", tmp_path / "body.glb", "--out", tmp_path / "out.bvh")
  assert "no file of --out" in capsys.readouterr().err
