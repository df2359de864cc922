"""Joint names: tables are found by their own names, other programs' by their words, and a user's own mapping helps."""
import numpy as np
import pytest

from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D, KIT, SNAPMOGEN
from motion_jax.rigs.joint_maps import TABLES, map_joints, skeleton_of
from motion_jax.rigs.joint_names import key
from tests.rigs.rig_names import RIGS, Rig, build, pose

INDEX = {name: j for j, name in enumerate(HUMANML3D.joints)}


def _names(table):
  needs = lambda entry: getattr(entry, "needs", [entry] if isinstance(entry, str) else entry)
  return sorted({name for entry in TABLES[table].values() for name in needs(entry)})


def read(rig, mapping=None, frames=3, turn=None):
  """map_joints of a rig in a T-pose, all of it turned by turn (T, 4)."""
  names, parents, places, where = build(rig)
  turned = np.tile([1.0, 0, 0, 0], (frames, len(names), 1)) if turn is None else np.repeat(turn[:, None], len(names), 1)
  joints, label = map_joints(names, rot.rotate(turned, places[None]), mapping, turned, parents)
  return joints, label, places, where


@pytest.mark.parametrize("table", TABLES)
def test_table_is_complete_and_found_by_its_names(table):
  assert set(TABLES[table]) == set(HUMANML3D.joints)
  sides = [entry for joint, entry in TABLES[table].items() if joint[:4] in ("left", "righ") and isinstance(entry, str)]
  assert len(set(sides)) == len(sides), "left is not right"
  names = _names(table)
  positions = np.random.default_rng(0).normal(size=(4, len(names) + 1, 3))
  turned = np.tile([1.0, 0, 0, 0], (4, len(names) + 1, 1))
  joints, label = map_joints([*names, "other"], positions, None, turned)
  assert joints.shape == (4, 22, 3) and label == table and np.isfinite(joints).all()


def test_one_spelling_for_all_ways_to_write_a_side():
  spellings = "LeftUpLeg", "Left_UpLeg", "left up leg", "UpLeg_L", "upLeg.l", "lUpLeg", "LUpLeg", "mixamorig:LeftUpLeg"
  assert {key(name) for name in spellings} == {"left upleg"}
  assert key("LUArm") == "left uarm" and key("spine_01") == key("Spine1") and key("LEG") == "leg"
  assert key("HIP_RIGHT") == "right hip" and key("J_Bip_C_Hips") == "jbiphips"


@pytest.mark.parametrize("kind", RIGS)
def test_names_of_other_programs(kind):
  """Limbs, head and toes are the file's; what it lacks is put where a body has it."""
  joints, label, places, where = read(RIGS[kind])
  for joint, index in where.items():
    if joint != "pelvis":
      np.testing.assert_allclose(joints[0, INDEX[joint]], places[index], err_msg=joint)
  assert label and np.linalg.norm(joints[0] - pose(), axis=-1).max() < (0.03 if kind == "SMPL" else 0.14)
  assert (joints[:, INDEX["left_foot"], 2] > joints[:, INDEX["left_ankle"], 2] + 0.08).all()


def test_a_pelvis_between_the_hips_is_raised():
  """Xsens' Hips lie on the line through the hips, HumanML3D's pelvis 9 cm above, and the spine follows."""
  rig = RIGS["Xsens, 100STYLE, VictorS-67/pybvh:bvh_data/bvh_test2.bvh"]
  names, parents, places, _ = build(rig)
  trunk = rig.trunk.split()
  low, neck = places[names.index("Hips")] - [0, 0.086, 0], places[names.index("Neck")]
  for i, name in enumerate(trunk[:5]):
    places[names.index(name)] = low + i / 5 * (neck - low)
  joints, _ = map_joints(names, places[None], None, None, parents)
  heights = joints[0, [INDEX[joint] for joint in ("pelvis", "spine1", "spine2", "spine3", "neck")], 1]
  np.testing.assert_allclose(heights, pose()[[INDEX[j] for j in ("pelvis", "spine1", "spine2", "spine3", "neck")], 1],
                             atol=0.01)


def test_a_foot_without_toes_is_fixed_to_its_ankle():
  """The ankle turns up by 30 degrees in half of the frames: so does the foot that is made."""
  rig = RIGS["Vicon, mocapdata.com, OlafHaag/bvh-toolbox:test_mocapbank.bvh"]
  names, parents, places, _ = build(rig)
  turned = np.tile([1.0, 0, 0, 0], (9, len(names), 1))
  turned[6:, names.index("LeftAnkle")] = rot.about_axis(np.radians(-30.0), "x")
  joints, _ = map_joints(names, np.repeat(places[None], 9, 0), None, turned, parents)
  foot = joints[:, INDEX["left_foot"]] - joints[:, INDEX["left_ankle"]]
  assert foot[0, 2] > 0.1 and -0.1 < foot[0, 1] < -0.03 and abs(foot[0, 0]) < 0.02
  np.testing.assert_allclose(np.degrees(np.arccos((rot.unit(foot[0]) * rot.unit(foot[8])).sum())), 30, atol=0.1)
  assert foot[8, 1] > foot[0, 1]


def test_facing_does_not_matter():
  turn = rot.about_axis(np.radians(np.array([0.0, 140.0, 250.0])), "y")
  for kind in ("Vicon, mocapdata.com, OlafHaag/bvh-toolbox:test_mocapbank.bvh", "Kinect", "Human3.6M"):
    joints, *_ = read(RIGS[kind], turn=turn)
    np.testing.assert_allclose(rot.rotate(rot.conjugate(turn)[:, None], joints), np.repeat(joints[:1], 3, 0), atol=1e-9)


def test_skeletons_of_ours_keep_their_joints():
  assert skeleton_of([*KIT.joints, "head_end"]) is KIT and skeleton_of(SNAPMOGEN.joints) is SNAPMOGEN
  assert skeleton_of([*KIT.joints, "tail"]) is HUMANML3D and skeleton_of(["Hips"]) is HUMANML3D


def test_own_mapping_averages_and_ignores_case():
  mapping = {joint: joint.upper() for joint in HUMANML3D.joints} | {"head": ["Nose", "mixamorig:Neck"]}
  names = [*HUMANML3D.joints, "nose"]
  positions = np.random.default_rng(0).normal(size=(3, 23, 3))
  joints, label = map_joints(names, positions, mapping)
  assert label == "own"
  np.testing.assert_allclose(joints[:, 15], (positions[:, 12] + positions[:, 22]) / 2)
  np.testing.assert_array_equal(joints[:, :15], positions[:, :15])


_ODD = Rig("Hips Spine Spine1 Spine2 Neck Head", "+Oberschenkel +Leg +Fuss +ToeBase", "+Shoulder +Arm +ForeArm +Hand",
           "Spine2")


def test_a_mapping_need_only_name_what_is_not_known():
  with pytest.raises(ValueError, match=r'Mixamo, HumanIK, without left_hip \("upleg"\), .*right_ankle \("foot"\); the '
                     r'file has Hips, .*{"left_hip": "...", .*"right_ankle": "..."} .*by --mapping FILE.json'):
    read(_ODD)
  mapping = {f"{side}_{joint}": f"{side}{word}" for side in ("left", "right")
             for joint, word in (("hip", "oberschenkel"), ("ankle", "fuss"))}
  joints, label, places, where = read(_ODD, mapping)
  assert label == "own"
  np.testing.assert_allclose(joints[0, INDEX["left_foot"]], places[where["left_foot"]])


def test_errors_list_what_is_missing_and_what_is_there():
  with pytest.raises(ValueError, match='no skeleton that is known; the file has tail, dog.*{"left_hip": "..."'):
    map_joints(["tail", "dog"], np.zeros((2, 2, 3)), parents=(-1, 0))
  names, parents, places, _ = build(RIGS["Mixamo in three.js"])
  names = [name.replace("Head", "Top").replace("Neck", "Up") for name in names]
  with pytest.raises(ValueError, match='"head": "..."'):
    map_joints(names, places[None], None, None, parents)
  for mapping, words in (({"tail": "head"}, "the mapping names tail, expected our joints pelvis"),
                         ({"head": "Kopf"}, "the mapping names the joints Kopf; the file has pelvis"),
                         ("none", "got mapping 'none', expected one of cmu_asf"),
                         ("bandai", "mapping 'bandai' needs the joints Chest")):
    with pytest.raises(ValueError, match=words):
      map_joints(HUMANML3D.joints, np.zeros((2, 22, 3)), mapping)
  names = _names("cmu_asf")
  with pytest.raises(ValueError, match="needs the rotation of joint"):
    map_joints(names, np.random.default_rng(0).normal(size=(2, len(names), 3)))
