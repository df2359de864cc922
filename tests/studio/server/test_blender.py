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

from motion_jax_studio.client import Client
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
def test_it_streams_what_the_client_streams_and_fetches_a_file(addon, address):
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
  fetched = []
  addon.load_motion = lambda data, name: fetched.append((data, name))
  addon.Make().work(types.SimpleNamespace(address=address, prompt="a person walks", seconds=2, seed=3))
  finished(addon)
  (data, name), = fetched
  assert name == "a person walks" and b"Frames: 40" in data


def finished(addon):
  """Plays Blender's timers until the request is done."""
  deadline = time.monotonic() + 60
  while addon.finish() is not None:
    assert time.monotonic() < deadline
    time.sleep(0.02)


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
scene, objects, ops = bpy.context.scene, bpy.data.objects, bpy.ops.motion_jax
settings = scene.motion_jax
settings.address, settings.prompt, settings.seed, settings.record, settings.seconds = sys.argv[2], "walks", 3, True, 2
assert ops.make() == {"FINISHED"} and "walks" not in objects
deadline = time.monotonic() + 120
while addon.finish() is not None and time.monotonic() < deadline:
  time.sleep(0.05)
made, action = objects["walks"], objects["walks"].animation_data.action
assert made.type == "ARMATURE" and len(made.data.bones) >= 20 and action.name == made.data.name == "walks"
assert scene.render.fps == 20 and (scene.frame_start, scene.frame_end) == (1, 40) == tuple(action.frame_range)
assert ops.start_live() == {"FINISHED"}
while addon._live["frame"] <= 30 and time.monotonic() < deadline:
  addon.step()
sticks = addon._live["armature"]
assert len(sticks.pose.bones) == 21 and sticks.animation_data.action.frame_range[1] == 30
bpy.context.view_layer.update()
print("STICKS", *sticks.pose.bones["left_knee"].head)
assert ops.say() == {"FINISHED"} and ops.stop_live() == {"FINISHED"}
addon.unregister()
"""


def test_a_scene_in_blender(address, library, tmp_path):
  """With Blender as a module (pip install bpy), in a process of its own; MOTION_JAX_BPY names a Python that has it."""
  python = os.environ.get("MOTION_JAX_BPY") or (importlib.util.find_spec("bpy") and sys.executable)
  if not python:
    pytest.skip("bpy is not installed: 374 MB that CI does without")
  script = tmp_path / "scene.py"
  script.write_text(SCENE)
  done = subprocess.run([python, str(script), str(ADDON), address], capture_output=True, text=True, timeout=120,
                        check=False)
  assert done.returncode == 0, done.stderr + done.stdout
  x, y, z = map(float, next(line for line in done.stdout.splitlines() if line.startswith("STICKS")).split()[1:])
  model = library.model("tiny", "stream")
  live = model.stream("walks", seed=3, cleanup=True, lag=max(1, model.sampling().num_steps // 2), num_frames=36)
  hip = np.concatenate(list(live))[29, model.stats.layout.skeleton.joints.index("left_hip")]
  assert np.abs(hip - [x, z, -y]).max() < 5e-3, "a stick begins at its parent"
