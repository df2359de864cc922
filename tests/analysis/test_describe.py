"""Captions by kinematics say what a motion was made to do, the same at every rate, sides exchanged in a mirror."""
import csv
import re

import numpy as np
import pytest
import scipy.ndimage
from ml_collections import ConfigDict

from motion_jax.analysis.describe import corrected, describe, sentences, who_moves
from motion_jax.analysis.events import Event, find_events, punch_speed
from motion_jax.analysis.signals import Body
from motion_jax.data.build import read_captions
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.base import clip_items
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.data.kinematic_captions import with_kinematic_captions
from motion_jax.data.mirror import mirror_caption
from motion_jax.motion import rotations as rot
from motion_jax.motion.representations import get_layout
from motion_jax.motion.retarget import bend, mirror
from motion_jax.motion.retiming import resample
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError
from motion_jax_studio import cli
from motion_jax_studio.checks.violations import violation_score as score
from motion_jax_studio.language.requirements import Requirement

J = {name: number for number, name in enumerate(HUMANML3D.joints)}


def _standing(seconds, fps=20.0):
  return np.repeat(synthetic_joints("stand", 40, np.random.default_rng(0))[:1], int(seconds * fps) + 1, axis=0)


def _time(joints):
  return np.arange(len(joints)) / 20.0


def _bump(time, at, width):
  """A rise from 0 to 1 and back around a second."""
  return np.cos(np.pi * np.clip((time - at) / width, -0.5, 0.5)) ** 2


def _kick(side, times=(1.0,), seconds=4.0):
  """A straight leg swung up to the front."""
  joints = _standing(seconds)
  swing = 1.4 * sum(_bump(_time(joints), at, 0.5) for at in times)
  hip = joints[:, [J[f"{side}_hip"]]]
  leg = [J[f"{side}_{part}"] for part in ("knee", "ankle", "foot")]
  turned = rot.about_axis(-swing, "x")
  joints[:, leg] = hip + rot.rotate(turned[:, None], joints[:, leg] - hip)
  return joints


def _punch(side, times=(1.5,), seconds=4.0, reach=0.52, width=0.35):
  """A fist held before the shoulder that shoots out ahead and comes back."""
  joints = _standing(seconds)
  out = sum(_bump(_time(joints), at, width) for at in times)
  shoulder = joints[:, J[f"{side}_shoulder"]]
  ahead = 0.15 + (reach - 0.15) * out
  joints[:, J[f"{side}_wrist"]] = shoulder + np.stack([0 * out, 0 * out, ahead], -1)
  bent = np.sqrt(np.maximum(0.26 ** 2 - (ahead / 2) ** 2, 0))
  joints[:, J[f"{side}_elbow"]] = shoulder + np.stack([0 * out, -bent, ahead / 2], -1)
  return joints


def _wave(side, times, seconds=7.0):
  """An arm put up, then swung aside and back so many times, a second each, then put down."""
  joints = _standing(seconds)
  time = _time(joints)
  sign = 1 if side == "left" else -1
  up = scipy.ndimage.gaussian_filter1d(((time > 0.8) & (time < times + 1.7)).astype(float), 4)
  sway = np.where((time > 1.25) & (time < 1.25 + times), 0.5 * np.sin(2 * np.pi * (time - 1.25)), 0)
  shoulder = joints[:, J[f"{side}_shoulder"]]
  raised = np.stack([sign * 0.25 + np.sin(sway) * 0.4, 0.45 * np.cos(sway), 0.1 + 0 * sway], -1)
  joints[:, J[f"{side}_wrist"]] = shoulder + up[:, None] * raised + (1 - up)[:, None] * (
      joints[:, J[f"{side}_wrist"]] - shoulder)
  joints[:, J[f"{side}_elbow"]] = (joints[:, J[f"{side}_wrist"]] + shoulder) / 2 + [sign * 0.05, 0, -0.05]
  return joints


def _jump(height, times=1):
  """Flights of a whole body that keeps its pose, as gravity has them."""
  flight = np.sqrt(8 * height / 9.81)
  joints = _standing(1.5 + 1.5 * times)
  for number in range(times):
    done = (_time(joints) - 1.0 - 1.2 * number) / flight
    joints[..., 1] += (height * np.clip(4 * done * (1 - done), 0, None))[:, None]
  return joints


def _walk(turn=0.0, seconds=6.0, speed=1.2, ways=None):
  """A walk whose heading turns by degrees to the left, evenly; ways (degrees) is where it leads against the heading."""
  num = int(20 * seconds) + 1
  straight = synthetic_joints("walk", 121, np.random.default_rng(3))
  frames = np.linspace(24, 96, num)  # its middle, where it is at its pace
  pose = straight[frames.round().astype(int)]
  pose = pose - pose[:, :1] * [1, 0, 1]
  heading = np.radians(turn) * np.linspace(0, 1, num)
  course = heading + np.radians(ways or 0.0)
  step = np.stack([np.sin(course), 0 * course, np.cos(course)], -1) * speed / 20
  path = np.cumsum(step, axis=0)
  return rot.rotate(rot.about_axis(heading, "y")[:, None], pose) + path[:, None]


def _turn(degrees, seconds=3.0):
  joints = _standing(seconds)
  heading = np.radians(degrees) * scipy.ndimage.gaussian_filter1d((_time(joints) > seconds / 2).astype(float), 6)
  return rot.rotate(rot.about_axis(heading, "y")[:, None], joints)


def _squat(times, lowest=0.45):
  joints = _standing(1 + 2 * times)
  phase = np.clip((_time(joints) - 0.5) / 2, 0, times)
  body = [number for number in range(22) if number not in [J[f"{side}_{part}"] for side in ("left", "right")
                                                           for part in ("knee", "ankle", "foot")]]
  joints[:, body, 1] -= ((joints[0, 0, 1] - lowest) * np.sin(np.pi * phase) ** 2)[:, None]
  for side in ("left", "right"):
    thigh, shin = HUMANML3D.bone_lengths[[J[f"{side}_knee"], J[f"{side}_ankle"]]]
    joints[:, J[f"{side}_knee"]] = bend(joints[:, J[f"{side}_hip"]], joints[:, J[f"{side}_ankle"]],
                                        np.tile([0.0, 0.0, 1.0], (len(joints), 1)), thigh, shin)
  return joints


def _leaning(degrees, first, past, seconds=5.0):
  """A trunk that bends forward between two seconds, over straight knees."""
  joints, legs = _standing(seconds), ("hip", "knee", "ankle", "foot")
  upper = [number for number, name in enumerate(HUMANML3D.joints) if number and not name.endswith(legs)]
  time = _time(joints)
  bent = scipy.ndimage.gaussian_filter1d(((time > first) & (time < past)).astype(float), 5) * np.radians(degrees)
  joints[:, upper] = joints[:, :1] + rot.rotate(rot.about_axis(bent, "x")[:, None], joints[:, upper] - joints[:, :1])
  return joints


def _hop(side, times):
  """Jumps on the leg of a side, the other foot held up behind."""
  joints, other = _jump(0.2, times), "right" if side == "left" else "left"
  joints[:, [J[f"{other}_ankle"], J[f"{other}_foot"]]] += [0, 0.35, -0.3]
  return joints


def _reach_down(side):
  """A hand that goes to the ground and comes up again."""
  joints = _standing(4.0)
  down = _bump(_time(joints), 2.0, 1.5)[:, None]
  wrist = joints[:, J[f"{side}_wrist"]]
  joints[:, J[f"{side}_wrist"]] = (1 - down) * wrist + down * (wrist * [1, 0, 1] + [0, 0.05, 0.3])
  return joints


def _lie_down():
  """A body that tips over backward and comes to lie."""
  joints = _standing(5.0)
  tipped = np.pi / 2 * np.clip(_time(joints) - 2, 0, 1)
  lying = rot.rotate(rot.about_axis(-tipped, "x")[:, None], joints - joints[:, :1] * [1, 0, 1])
  return lying + [0, 0.1, 0] * np.clip(_time(joints) - 2, 0, 1)[:, None, None]


def _arm_circles(turns, seconds=3.0):
  """Both straight arms swung round, from where they hang to ahead, up and back."""
  joints = _standing(seconds)
  angle = 2 * np.pi * turns * np.linspace(0, 1, len(joints))
  for side, sign in (("left", 1), ("right", -1)):
    line = np.stack([0 * angle + 0.2 * sign, -np.cos(angle), np.sin(angle)], -1)
    for part, reach in (("elbow", 0.26), ("wrist", 0.5)):
      joints[:, J[f"{side}_{part}"]] = joints[:, J[f"{side}_shoulder"]] + reach * line
  return joints


MOTIONS = {
    "left kick": (_kick("left"), r"kick.* the left (foot|leg)\b"),
    "two right kicks": (_kick("right", (1.0, 2.2)), r"kicks twice with the right|two kicks with the right"),
    "right punch": (_punch("right"), r"punch.* with the right (hand|fist)"),
    "two left punches": (_punch("left", (1.5, 2.2)), r"punches twice with the left|two punches with the left"),
    "wave": (_wave("left", 4), r"wave.* four times"),
    "raise": (_wave("right", 0), r"(raises|lifts|puts) the right (hand|arm)"),
    "turn left": (_turn(90), r"90[- ]degree|turns to the left"),
    "turn around": (_turn(-180), r"turns (around|180 degrees) to the right"),
    "walk": (_walk(), r"(walks|walking) (forward|straight ahead|ahead)"),
    "slow walk": (_walk(speed=0.6), r"(walks|walking) .*slowly"),
    "quick walk": (_walk(speed=1.62), r"(walks|walking) .*quickly"),
    "circle": (_walk(-360, 10), r"in a circle(, turning| to the) right"),
    "curve": (_walk(90, 4), r"turns (90 degrees )?to the left|in a curve to the left|90-degree turn to the left"),
    "backward": (_walk(ways=180, speed=0.7), r"(walks|walking) backward\.$"),
    "diagonal": (_walk(ways=-40), r"diagonally forward to the right"),
    "sideways": (_walk(ways=90, speed=0.6), r"sideways to the left"),
    "still": (_standing(3), r"still|does not move"),
    "jump": (_jump(0.3), r"jumps (about 30 centimeters high|up|into the air)"),
    "three jumps": (_jump(0.3, 3), r"(jumps|hops).* three times"),
    "two squats": (_squat(2), r"squats .*twice|two( deep)? squats"),
    "two hops": (_hop("left", 2), r"hops twice on .*left"),
    "bow": (_leaning(50, 1.5, 3.0), r"bow"),
    "reach": (_reach_down("left"), r"(floor|ground) with the left hand"),
    "lie": (_lie_down(), r"lies (down )?on the (floor|ground)"),
    "arm circle": (_arm_circles(1.2), r"both arms .*backward"),
    "half circle": (_walk(180, 6), r"half circle to the left|u-turn to the left"),
    "run": (synthetic_joints("run", 120, np.random.default_rng(0)), r"runs|is running"),
}


@pytest.mark.parametrize("name", MOTIONS)
def test_says_what_is_done_of_a_mirror_image_with_sides_exchanged_and_at_any_rate(name):
  joints, pattern = MOTIONS[name]
  said = describe(joints)
  assert said and all(re.search(pattern, sentence) for sentence in said), (said, find_events(joints))
  assert describe(mirror(joints), key="x") == [mirror_caption(sentence) for sentence in describe(joints, key="x")]
  assert describe(resample(joints, 20.0, 30.0), 30.0) == said
  moved = rot.rotate(rot.about_axis(np.array(2.0), "y"), joints) + [3, 0, -4]
  assert describe(moved) == said, "place and direction do not matter"
  events = find_events(joints)
  assert all(0 <= event.start < event.end <= len(joints) / 20 for event in events)
  assert events == sorted(events, key=lambda event: (event.start, event.end, event.kind, event.side))


@pytest.mark.parametrize("kind, joints, expected, off", [
    ("turn", _turn(-90), dict(side="right", amount=-90), 10), ("jump", _jump(0.3), dict(side="", amount=0.3), 0.03),
    ("wave", _wave("left", 4), dict(side="left", amount=1), 0.1), ("bow", MOTIONS["bow"][0], dict(amount=50), 8),
    ("walk", _walk(speed=0.6), dict(way="forward", path="straight", amount=0.6), 0.05),
    ("walk", _walk(speed=0.9)[::-1].copy(), dict(way="backward", amount=0.9), 0.1)])
def test_how_far_high_fast_and_often(kind, joints, expected, off):
  event, = (event for event in find_events(joints) if event.kind == kind)
  assert event.amount == pytest.approx(expected["amount"], abs=off)
  assert event._asdict() | expected == event._asdict() | {"amount": expected["amount"]}


def test_a_standing_body_does_nothing_else():
  assert {event.kind for event in find_events(_standing(4.0))} == {"still"}
  assert find_events(_walk()[:9]) == [] and find_events(np.zeros((0, 22, 3))) == [], "less than half a second"


def test_a_jump_that_goes_far_is_a_long_jump():
  joints = _jump(0.3)
  air = np.clip((_time(joints) - _time(joints)[np.argmax(joints[:, 0, 1] > joints[0, 0, 1] + 0.02)]) / 0.6, 0, 1)
  joints[..., 2] += 1.4 * air[:, None]
  event, = (event for event in find_events(joints) if event.kind == "jump")
  assert (event.way, event.path) == ("forward", "long") and not any(e.path == "long" for e in find_events(_jump(0.3)))
  said = {sentence for key in "abcdefg" for sentence in describe(joints, key=key)}
  assert len(said) >= 6 and all(re.search("long|far|broad|leap", sentence) for sentence in said), said


def test_one_action_is_put_in_many_words():
  said = " ".join(sentence for key in "abcdefghijkl" for joints in (_walk(ways=90, speed=0.6), _punch("right"))
                  for sentence in describe(joints, key=key))
  for words in ("sidesteps to the left", "takes side steps to the left", "shuffles sideways", "throws a right punch",
                "jabs with the right", "throws a punch with the right fist"):
    assert words in said, said


def test_a_hand_that_waves_on_where_the_other_is_lowered_waves():
  joints, arm = _wave("left", 5, 9.0), [J["right_elbow"], J["right_wrist"]]
  assert [(event.start < 1.5, event.side) for event in find_events(joints) if event.kind == "wave"] == [(True, "left")]
  joints[:, arm] = _wave("right", 0, 9.0)[:, arm]  # both are put up
  waves = [event for event in find_events(joints) if event.kind == "wave"]
  assert [event.side for event in waves] == ["left"] and waves[0].start > 1.5


@pytest.mark.parametrize("joints, kind, side", [
    (_wave("left", 5)[26:], "wave", "left"), (_wave("left", 5)[18:], "wave", "left"), (_wave("left", 0)[25:30], "", ""),
    (_wave("left", 0, 9.0)[22:32].repeat(4, 0), "", ""), (_punch("right")[20:], "punch", "right"),
    (_hop("left", 2)[18:], "hop", "left"), (_kick("left", (0.2, 1.4))[4:], "kick", "left")])
def test_what_a_body_does_that_begins_in_the_pose_for_it(joints, kind, side):
  """With a hand up, fists before the shoulders, on one leg: the way into the pose need not be seen. To be up is not to
  go up."""
  events = find_events(joints)
  assert {(event.kind, event.side) for event in events if event.kind != "still"} == ({(kind, side)} if kind else set())
  assert find_events(mirror(joints)) == [event._replace(side=mirror_caption(event.side)) for event in events]


def test_in_doubt_nothing_is_said():
  both = (_wave("left", 0) + _standing(7)) / 2  # a hand that goes half way up
  assert not any(event.kind in ("raise", "wave") for event in find_events(both))
  assert describe(_standing(0.2)) == []
  shuffle = _walk(ways=17)  # between forward and diagonal
  assert not re.search("forward|ahead|diagonal", " ".join(describe(shuffle)))


def test_how_near_a_fist_comes_to_a_punch():
  """Slower ones less; of the other side, or one that does not get where a punch ends, not at all."""
  speed = lambda side="", **how: punch_speed(Body(_punch("left", **how), 20.0), side)
  assert 2.2 < speed() == speed("left") and speed("right") < 0.1
  assert 0.5 < speed(width=1.6) < speed(width=0.8) < speed()
  assert speed(reach=0.3) < 0.1 and punch_speed(Body(_punch("left")[:3], 20.0)) == 0
  asked = [Requirement("punch", "left", 1, False)]
  assert score(_punch("left"), asked) == 0 < score(_punch("left", width=0.8), asked) < 0.9
  assert score(_punch("left", width=1.6), asked) > score(_punch("left", width=0.8), asked)
  assert score(_punch("right"), asked) > 0.95


def test_a_slow_hand_is_no_punch():
  """Nor one that does not reach far, or that stays out there, as one that points does."""
  points = _punch("left")
  points[30:] = points[30]
  assert not any(event.kind == "punch" for event in find_events(points))
  assert not any(event.kind == "punch" for event in find_events(_punch("left", width=1.6)))
  assert not any(event.kind == "punch" for event in find_events(_punch("left", reach=0.3, width=0.5)))


def test_beside_captions_only_what_they_speak_of():
  joints = _kick("left")
  assert describe(joints, words="a person kicks.") and describe(joints, words="front kick, left leg")
  assert describe(joints, words="a person reads a newspaper.") == []
  assert describe(joints, words="a person kicks in a wild dance.") == []


def test_captions_of_a_clip_and_of_its_mirror_image():
  clip = Clip(_kick("left").astype(np.float32), captions=(Caption("a person kicks."),), id="k", split="train",
              meta={"label": "kick"})
  new = with_kinematic_captions(clip)
  assert new.captions[0] == clip.captions[0] and len(new.captions) > 1
  assert new.captions == with_kinematic_captions(clip).captions
  plain, both = (clip_items([clip], ConfigDict({"mode": "corrected", "mirror": True} | more), "train",
                            get_layout("coordinates")) for more in ({}, {"kinematic_captions": True}))
  assert [item.captions for item in plain] == [("a person kicks.",)] * 2
  assert all("left" in caption for caption in both[0].captions[1:])
  assert all("right" in caption and "left" not in caption for caption in both[1].captions[1:])
  np.testing.assert_array_equal(plain[1].features, both[1].features)


@pytest.mark.parametrize("captions, who", [
    (["a person waves in exhaustion.", "an exhausted person waves."], "an exhausted person"),
    (["An old man walks."], "An old man"), (["a person walks like an old person."], ""),
    (["someone old walks."], ""), (["a person walks."], ""), ([], "")])
def test_who_moves_tells_the_manner(captions, who):
  assert who_moves(captions) == who


def test_sentences_by_kinematics_keep_the_manner_of_the_clip():
  """Else "a person waves" would mean any manner; of what few clips show one sentence in three leaves it out."""
  texts_of = {}
  for action, joints in (("waves the left hand", _wave("left", 4)), ("kicks", _kick("left"))):
    said = (Caption(f"a person {action} in exhaustion."), Caption(f"an exhausted person {action}."))
    for plain in (False, True):
      clip = Clip(joints.astype(np.float32), captions=said[:1] if plain else said, id="k", split="train")
      added = with_kinematic_captions(clip).captions[len(clip.captions):]
      texts_of[action, plain] = [caption.text for caption in added]
  mannered = [[text.startswith("an exhausted person ") for text in texts] for texts in texts_of.values()]
  assert all(len(one) == 3 for one in mannered)
  assert [sum(one) for one in mannered] == [3, 0, 2, 0]


@pytest.mark.parametrize("kind, asked, plain", [
    ("walk", None, 0), ("kick", None, 1), ("walk", 2, 2), ("kick", 2, 2), ("kick", 0, 0)])
def test_so_many_sentences_leave_the_manner_out(kind, asked, plain):
  way = {"walk": dict(way="forward", path="circle", side="left"), "kick": dict(side="left", count=1)}[kind]
  made = sentences([Event(kind, 0, 5, amount=1.0, **way)], 5.0, key="k", subject="an old man", plain=asked)
  texts_of = [text.startswith("an old man ") for text in made]
  assert texts_of == sorted(texts_of) and texts_of.count(False) == plain and any(texts_of), made


def test_wrong_captions_are_corrected_where_the_motion_says_so():
  text = "someone walks to the left slowly."
  diagonal = [Event("walk", 0, 5, amount=1.0, way="forward-left")]
  assert corrected(text, "walk-left", diagonal) == "someone walks diagonally forward to the left slowly."
  assert corrected(text, "walk-left", [Event("walk", 0, 5, way="left")]) == text
  assert corrected(text, "walk", diagonal) == text
  turned = "a person turns to the left while walking."
  right, left = (Event("turn", 1, 2, side=side) for side in ("right", "left"))
  assert corrected(turned, "walk-turn-left", [right]) == turned.replace("left", "right")
  assert corrected(turned, "walk-turn-left", [right, left]) == corrected(turned, "walk-turn-left", []) == turned


def _write_bvh(folder, action):
  from motion_jax import export
  folder.mkdir(parents=True, exist_ok=True)
  joints = synthetic_joints(action, 80, np.random.default_rng(0)).astype(np.float32)
  return export.bvh(Clip(joints, id=action), folder / f"{action}.bvh")


def test_a_folder_of_files(tmp_path, capsys):
  _write_bvh(tmp_path / "mine", "walk")
  _write_bvh(tmp_path / "mine" / "deeper", "wave_left")
  table = tmp_path / "captions.csv"
  assert not cli.main(["data", "describe", str(tmp_path / "mine"), "--out", str(table)])
  texts_of = capsys.readouterr().out
  assert "2 motions" in texts_of and "data build" in texts_of
  rows = read_captions(table)
  assert {row["file"] for row in rows} == {"walk.bvh", "deeper/wave_left.bvh"}
  assert all("left" in row["caption"] for row in rows if "wave" in row["file"])
  with open(table, newline="", encoding="utf-8") as file:
    assert next(csv.reader(file)) == ["file", "caption", "start", "end"]


@pytest.mark.parametrize("make, words", [
    (lambda folder: folder.mkdir(), "holds no motion to describe"),
    (lambda folder: None, "there is no"),
    (lambda folder: (folder.mkdir(), (folder / "x.bvh").write_text("no motion")), "x.bvh"),
])
def test_bad_input_is_one_line(tmp_path, capsys, make, words):
  make(tmp_path / "in")
  assert cli.main(["data", "describe", str(tmp_path / "in")]) == 1
  error = capsys.readouterr().err
  assert words in error and len(error.strip().splitlines()) == 1


def test_a_table_is_not_written_over(tmp_path):
  from motion_jax.data.describe_folders import check_table
  (tmp_path / "a.csv").write_text("")
  with pytest.raises(FileExistsError, match="exists already"):
    check_table(tmp_path / "a.csv")
  with pytest.raises(InputError, match="expected a .csv"):
    check_table(tmp_path / "a.txt")
