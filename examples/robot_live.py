"""A live Unitree G1 in MuJoCo without a window: one configuration per 20 ms tick, from the words that you type.

  motion-jax studio                                                       prints an address with a token
  python examples/robot_live.py "http://127.0.0.1:8765/?token=..." [seconds]
"""
import importlib.util
import pathlib
import queue
import sys
import threading
import time

import mujoco
import numpy as np

from motion_jax_studio.client import Client

TICK = 0.02
address, seconds = sys.argv[1], float(sys.argv[2]) if len(sys.argv) > 2 else 10.0
package = pathlib.Path(importlib.util.find_spec("motion_jax").submodule_search_locations[0])
model = mujoco.MjModel.from_xml_path(str(package / "robots" / "assets" / "g1" / "g1.xml"))
data, rows = mujoco.MjData(model), queue.Queue()
with Client(address).stream("a person walks forward", seed=1, pose="robot:g1") as live:
  read = lambda: [rows.put(row) for block in live.poses() for row in block]
  threading.Thread(target=read, daemon=True).start()
  if sys.stdin.isatty():
    threading.Thread(target=lambda: [live.say(line.strip()) for line in sys.stdin if line.strip()], daemon=True).start()
  data.qpos[:], largest, late = rows.get(), 0.0, 0
  ticks = time.perf_counter() + TICK * np.arange(round(seconds / TICK))
  for number, due in enumerate(ticks):
    time.sleep(max(0.0, due - time.perf_counter()))
    if rows.empty():
      late += 1  # a robot holds its pose until the next row comes
      continue
    before, data.qpos[:] = data.qpos[7:].copy(), rows.get()
    largest = max(largest, float(np.abs(data.qpos[7:] - before).max()))
    mujoco.mj_kinematics(model, data)  # a controller would track data.qpos here
    if number % 50 == 0:
      print(f"{number * TICK:5.1f} s  pelvis at {data.body('pelvis').xpos.round(2)}, {rows.qsize()} rows wait")
print(f"largest step of a joint {largest:.3f} rad a tick, {late} of {len(ticks)} ticks without a new row")
