"""The Blender add-on: its own WebSocket against a real studio, its operators, and a scene where bpy is installed."""
import importlib.util
import os
import subprocess
import sys
import threading
import time
import types

import numpy as np
import pytest

from motion_jax import export
from motion_studio.client import Client
from tests.conftest import ROOT
from tests.studio.server.conftest import TOKEN

ADDON = ROOT / "blender" / "motion_jax_addon.py"


def stand_in():
  """What the add-on asks of bpy, as far as it is not the scene itself."""
  bpy = types.ModuleType("bpy")
  prop = lambda **about: about
  bpy.types = types.SimpleNamespace(PropertyGroup=object, Operator=object, Panel=object, Scene=type("Scene", (), {}))
  bpy.props = types.SimpleNamespace(**dict.fromkeys(
      ("StringProperty", "FloatProperty", "IntProperty", "BoolProperty", "PointerProperty"), prop))
  bpy.registered, bpy.timers = [], []
  bpy.utils = types.SimpleNamespace(register_class=bpy.registered.append, unregister_class=bpy.registered.remove)
  bpy.app = types.SimpleNamespace(timers=types.SimpleNamespace(
      register=bpy.timers.append, unregister=bpy.timers.remove, is_registered=bpy.timers.__contains__))
  settings = types.SimpleNamespace(address="", prompt="a person walks", seconds=2, seed=3, record=False)
  bpy.context = types.SimpleNamespace(scene=types.SimpleNamespace(motion_jax=settings),
                                      window_manager=types.SimpleNamespace(windows=[]))
  return bpy


@pytest.fixture
def addon(monkeypatch):
  monkeypatch.setitem(sys.modules, "bpy", stand_in())
  spec = importlib.util.spec_from_file_location("motion_jax_addon", ADDON)
  module = importlib.util.module_from_spec(spec)
  spec.loader.exec_module(module)
  yield module
  module.stop()


def test_it_registers_and_needs_the_standard_library_alone(addon):
  addon.register()
  assert len(addon.bpy.registered) == 6 and hasattr(addon.bpy.types.Scene, "motion_jax")
  addon.unregister()
  assert not addon.bpy.registered and not hasattr(addon.bpy.types.Scene, "motion_jax")
  lines = ADDON.read_text().splitlines()
  used = {line.split()[1].split(".")[0] for line in lines if line.strip().startswith(("import ", "from "))}
  assert used <= set(sys.stdlib_module_names) | {"bpy", "mathutils"}


@pytest.mark.slow
def test_it_streams_what_the_client_streams(addon, address):
  shown = []
  addon.make_sticks = lambda frame, parents, names: "sticks"
  addon.show = lambda armature, frame, parents, names, keyframe: shown.append((frame, keyframe))
  addon.start(address, "a person walks", 3)
  assert addon.bpy.timers == [addon.step]
  addon._live["stream"].send(type="speed", value=0)
  deadline = time.monotonic() + 30
  while len(shown) < 80:
    assert time.monotonic() < deadline and addon.step() is not None
    if len(shown) == 40:
      addon.Say().work(types.SimpleNamespace(prompt="a person jumps"))
  with Client(address).stream("a person walks", seed=3, speed=0) as live:
    plain = np.concatenate([next(iter(live)) for _ in range(3)])
  assert np.abs(np.array([frame for frame, _ in shown[:26]]) - plain[:26]).max() < 1e-6
  assert addon._live["stream"].prompt == "a person jumps" and shown[0][1] is None
  addon.bpy.context.scene.motion_jax.record = True
  while shown[-1][1] is None:
    addon.step()
  assert shown[-1][1] == len(shown)
  addon.StopLive().work(None)
  assert addon.step() is None


def finished(addon):
  """Plays Blender's timers until the request is done."""
  deadline = time.monotonic() + 60
  while addon.finish() is not None:
    assert time.monotonic() < deadline
    time.sleep(0.02)


@pytest.mark.slow
def test_it_fetches_a_file_that_opens(addon, address, tmp_path):
  settings = types.SimpleNamespace(address=address, prompt="a person walks", seconds=2, seed=3)
  fetched = []
  addon.load_motion = lambda data, name: fetched.append((data, name))
  addon.Make().work(settings)
  finished(addon)
  path = tmp_path / "made.bvh"
  path.write_bytes(fetched[0][0])
  assert fetched[0][1] == "a person walks" and b"Frames: 40" in path.read_bytes()


def test_blender_stays_usable_while_a_motion_is_made_and_notes_are_shown(addon, monkeypatch):
  ready, loaded = threading.Event(), []
  monkeypatch.setattr(addon.Studio, "bvh", lambda self, *words: (ready.wait(30), (b"BVH", ["no kick seen"]))[1])
  addon.load_motion = lambda data, name: loaded.append((data, name))
  settings = types.SimpleNamespace(address="http://x/?token=y", prompt="a person kicks", seconds=2, seed=3)
  addon.Make().work(settings)  # returns at once, though nothing is made yet
  assert addon.bpy.timers == [addon.finish] and addon.finish() > 0 and not loaded
  assert addon._making["lines"] == ["generating: a person kicks"]
  with pytest.raises(ValueError, match="a motion is being generated"):
    addon.Make().work(settings)
  ready.set()
  finished(addon)
  assert loaded == [(b"BVH", "a person kicks")] and addon._making["lines"] == ["no kick seen"]
  shown, panel = [], addon.Panel()
  panel.layout = types.SimpleNamespace(prop=lambda *a: None, operator=lambda *a: None,
                                       label=lambda text, icon: shown.append((text, icon)))
  panel.draw(addon.bpy.context)
  assert shown == [("no kick seen", "INFO")]


@pytest.mark.parametrize("change, told", [
    (lambda address: address.replace(TOKEN, "wrong"), "token"), (lambda address: "nonsense", "no studio answers"),
    (lambda address: "http://127.0.0.1:1/?token=x", "no studio answers")])
def test_what_goes_wrong_is_shown(addon, address, change, told):
  reported, live = [], addon.StartLive()
  context = types.SimpleNamespace(scene=types.SimpleNamespace(motion_jax=types.SimpleNamespace(
      address=change(address), prompt="a person walks", seconds=2, seed=3)))
  live.report = lambda kind, text: reported.append(text)
  assert live.execute(context) == {"CANCELLED"}
  assert addon.Make().execute(context) == {"FINISHED"}  # it has begun
  finished(addon)
  assert addon._making["failed"] and len(addon._making["lines"]) == 1
  assert all(told in text and "\n" not in text for text in reported + addon._making["lines"])
  say = addon.Say()
  with pytest.raises(ValueError, match="press Start live first"):
    say.work(context.scene.motion_jax)


SCENE = """
import importlib.util, sys, time
import bpy
spec = importlib.util.spec_from_file_location("motion_jax_addon", sys.argv[1])
addon = importlib.util.module_from_spec(spec)
spec.loader.exec_module(addon)
addon.register()
settings = bpy.context.scene.motion_jax
settings.address, settings.prompt, settings.seed, settings.record = sys.argv[2], "a person walks", 3, True
addon.load_motion(open(sys.argv[3], "rb").read(), "walk")
made = bpy.data.objects["walk"]
assert made.type == "ARMATURE" and len(made.data.bones) >= 20
scene, last = bpy.context.scene, made.animation_data.action.frame_range[1]
assert made.animation_data.action.name == made.data.name == "walk"
assert scene.render.fps == 20 and (scene.frame_start, scene.frame_end) == (1, last) and 20 <= last < 250, last
settings.seconds = 2
assert bpy.ops.motion_jax.make() == {"FINISHED"} and "a person walks" not in bpy.data.objects
deadline = time.monotonic() + 60
while addon.finish() is not None and time.monotonic() < deadline:
  time.sleep(0.05)
action = bpy.data.objects["a person walks"].animation_data.action
assert action.name == "a person walks" and action.frame_range[1] == 40 and scene.frame_end == max(40, last)
one, other = (bpy.data.objects[name].data.bones for name in ("walk", "a person walks"))
off = max((a.head_local - b.head_local).length for a, b in zip(one, other))
assert [bone.name for bone in one] == [bone.name for bone in other] and off < 1e-5, off  # one skeleton for all motions
assert bpy.ops.motion_jax.start_live() == {"FINISHED"}
deadline, frames = time.monotonic() + 60, 0
while frames < 30 and time.monotonic() < deadline:
  addon.step()
  frames = addon._live["frame"] - 1
sticks = addon._live["armature"]
assert frames == 30 and len(sticks.pose.bones) == 21, frames
bpy.context.view_layer.update()
head = sticks.pose.bones["head"]
print("STICKS", *sticks.pose.bones["left_knee"].head, *head.tail, sticks.animation_data.action.frame_range[1])
assert bpy.ops.motion_jax.say() == {"FINISHED"} and bpy.ops.motion_jax.stop_live() == {"FINISHED"}
addon.unregister()
"""


def test_a_scene_in_blender(address, library, tmp_path):
  """With Blender as a module (pip install bpy), in a process of its own; MOTION_JAX_BPY names a Python that has it."""
  python = os.environ.get("MOTION_JAX_BPY") or (importlib.util.find_spec("bpy") and sys.executable)
  if not python:
    pytest.skip("bpy is not installed: 374 MB that CI does without")
  from motion_jax.data.datasets.synthetic import synthetic_clips
  script = tmp_path / "scene.py"
  script.write_text(SCENE)
  export.save(synthetic_clips(seed=0, num=1)[0], tmp_path / "walk.bvh")
  done = subprocess.run([python, str(script), str(ADDON), address, str(tmp_path / "walk.bvh")], capture_output=True,
                        text=True, timeout=120, check=False)
  assert done.returncode == 0, done.stderr + done.stdout
  told = [line for line in done.stdout.splitlines() if line.startswith("STICKS")][0].split()[1:]
  knee, head, last = np.array(told[:3], float), np.array(told[3:6], float), float(told[6])
  model = library.model("tiny", "stream")
  live = model.stream("a person walks", seed=3, cleanup=True, lag=max(1, model.sampling().num_steps // 2))
  frames = []
  while len(frames) < 30:
    frames.extend(next(live))
  up = lambda point: np.array([point[0], -point[2], point[1]])
  names = model.stats.layout.skeleton.joints
  # A stick begins at its parent; it has the length of its bone in the first frame.
  assert np.abs(knee - up(frames[29][names.index("left_hip")])).max() < 5e-3 and last == 30
  assert np.isfinite(head).all()
