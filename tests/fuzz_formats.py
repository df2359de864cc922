"""Kinds of the fuzzer for files of other programs: scenes, captures, robots, mappings, projects, constraints, weights.

Those that are read by a library in a process of its own (c3d, fbx, usda, usdc) cost a start of Python each.
"""
import importlib.util

from motion_jax import export, robots
from motion_jax.control import compiling, files
from motion_jax.convert.state import load_state
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.export.character import character
from motion_jax_studio.server import project
from motion_jax_studio.server.limits import Limits
from tests.fuzz_cases import Case, command, damaged
from tests.fuzz_damage import damage, pick
from tests.fuzz_healthy import healthy, put

CLIP = synthetic_clips(0, 1)[0].cut(0, 3)
ROBOT_TABLES = "unitree_xyzw.csv", "gmr.npz", "mujoco.npz", "loco_mujoco.npz", "mjlab.npz"


def _loaded(name, maker="formats"):
  """A file that holds a motion."""
  def kind(rng, folder):
    ending = name[name.index("."):]
    put(folder, {f"in{ending}": damage(rng, name, healthy(maker)[name])})
    if rng.random() < 0.1:
      return command("render", f"in{ending}", "--out", "out/made.bvh")
    return Case(f"load in{ending}", lambda: export.load(f"in{ending}"))
  return kind


def _character(name):
  """A character that a motion is written into."""
  def kind(rng, folder):
    ending = name[name.index("."):]
    put(folder, {f"in{ending}": damage(rng, name, healthy("formats")[name])})
    return Case(f"character in{ending}", lambda: character(CLIP, f"out/made{ending}", f"in{ending}"))
  return kind


def _either(*kinds):
  return lambda rng, folder: pick(rng, kinds)(rng, folder)


def mappings(rng, folder):
  """Tables {our joint: theirs}, of motions and of characters."""
  made, is_motion = healthy("formats"), rng.random() < 0.5
  put(folder, {"map.json": damage(rng, "map.json", made["map.json" if is_motion else "bones.json"])} | {
      name: made[name] for name in ("a.bvh", "character.glb")})
  if is_motion:
    return Case("load with a mapping", lambda: export.load("a.bvh", mapping="map.json"))
  return Case("character with a mapping", lambda: character(CLIP, "out/made.glb", "character.glb", "map.json"))


def projects(rng, folder):
  put(folder, {"in.json": damage(rng, "in.json", healthy("formats")["project.json"])})
  return Case("project.read", lambda: project.read("in.json", Limits()))


def constraints(rng, folder):
  put(folder, {"in.json": damage(rng, "in.json", healthy("formats")["control.json"])})

  def call():
    found = files.load("in.json", lambda path, frame: export.load(path).joints)
    compiling.clip_to_feasible(compiling.compile(found, 61, 20.0, synthetic_clips(0, 1)[0].joints[:61]), warn=False)
    files.save(found, "out/made.json")

  return Case("constraints", call)


def weights(rng, folder):
  """Safetensors and PyTorch checkpoints, as `motion-jax convert` reads them."""
  name = pick(rng, ("w.safetensors", "w.pt"))
  put(folder, {name: damage(rng, name, healthy("formats")[name])})
  return Case(f"load_state {name}", lambda: load_state(name))


def _robot(ending):
  """The description of a robot and its mapping."""
  def kind(rng, folder):
    made = healthy("robot")
    put(folder, damaged(rng, {name: made[name] for name in (f"in{ending}", "map.json")}))
    return Case(f"robots.load in{ending}", lambda: robots.load(f"in{ending}", "map.json").rest)
  return kind


def _robot_motion(*names):
  """A robot's table, and the .json beside it."""
  def kind(rng, folder):
    made, name = healthy("robot"), f"a.{pick(rng, names)}"
    side_car = name.rpartition(".")[0] + ".json"
    put(folder, damaged(rng, {one: made[one] for one in (name, side_car)}))
    read = robots.read_csv if name.endswith(".csv") else robots.read_npz
    return Case(f"{read.__name__} {name}", lambda: read(name, _small()).to_clip())
  return kind


def _small():
  if not _small.__dict__:
    import pathlib
    import tempfile
    with tempfile.TemporaryDirectory() as folder:
      put(pathlib.Path(folder), healthy("robot"))
      _small.robot = robots.load(pathlib.Path(folder) / "in.xml", pathlib.Path(folder) / "map.json")
  return _small.robot


FORMATS = {
    "glb": _either(_loaded("a.glb"), _character("character.glb")), "vrm": _character("character.vrm"),
    "vrma": _loaded("a.vrma"), "amass": _loaded("a.amass.npz"), "c3d": _loaded("a.c3d"),
    "trc": _loaded("a.trc"), "points": _loaded("a.csv"), "robot_csv": _robot_motion(ROBOT_TABLES[0]),
    "robot_npz": _robot_motion(*ROBOT_TABLES[1:]), "mjcf": _robot(".xml"), "urdf": _robot(".urdf"),
    "mappings": mappings, "projects": projects, "constraints": constraints, "weights": weights}
if importlib.util.find_spec("ufbx"):
  FORMATS["fbx"] = _loaded("a.fbx")
if importlib.util.find_spec("pxr"):
  FORMATS |= {"usda": _loaded("a.usda"), "usdc": _loaded("a.usdc")}
