"""How a studio keeps up: streams side by side for minutes, memory, missed blocks, and how soon new words are seen.

  python benchmarks/studio.py --minutes 10 --streams 1 2 4 --out studio.json

Starts a studio of its own, plays the streams at the speed of their clocks, as pages do, and prints the blocks that
came too late to be played, blocks a second as fast as they can be made, seconds from a prompt to the first frame that
it changed (sent, and played), bytes a second, and the studio's memory at the beginning and at the end.
"""
import argparse
import json
import pathlib
import subprocess
import sys
import threading
import time

import numpy as np

from motion_jax_studio.client import Client

PROMPTS = ("a person walks forward", "a person jumps up", "a person waves the right hand", "a person sits down",
           "a person turns left", "a person runs forward")


def memory(pid):
  """Megabytes that a process holds."""
  lines = pathlib.Path(f"/proc/{pid}/status").read_text().splitlines()
  return int(next(line for line in lines if line.startswith("VmRSS")).split()[1]) / 1024


class Page(threading.Thread):
  """Plays a stream for some seconds: takes a block when its first frame is due, notes those that were not there."""

  def __init__(self, client, seed, seconds, speed, say_every=0.0):
    super().__init__(daemon=True)
    self.live = client.stream(PROMPTS[0], seed=seed, speed=speed)
    self.seconds, self.speed, self.say_every = seconds, speed, say_every
    self.blocks = self.late = self.bytes = self.frames = 0
    self.sent, self.seen, self.error = [], [], ""

  def run(self):
    try:
      self._play()
    except Exception as error:
      self.error = repr(error)
    finally:
      self.live.close()

  def _play(self):
    began = said = None
    border, number = None, 0
    for joints in self.live:
      now, last = time.monotonic(), self.live.last
      began = began or now
      said = said or now
      due = began + last["first_frame"] / last["fps"]
      if self.speed:
        self.late += now > due + 0.05 and self.blocks > 0
        if now > due:
          began += now - due  # the page waited; its clock with it
        else:
          time.sleep(due - now)
      self.blocks += 1
      self.frames += len(joints)
      self.bytes += 48 + len(joints) * (8 + 6 * last["joints"] + 4)
      words = [message for message in self.live.messages if message["type"] == "words"]
      if border is None and len(words) > number + 1:
        number, border = len(words) - 1, words[-1]["from_frame"]
      if border is not None and last["committed"] > border:
        self.sent.append(now - said)
        self.seen.append(max(now, began + border / last["fps"]) - said)
        border, said = None, time.monotonic()
      elif self.say_every and number == len(words) - 1 and border is None and time.monotonic() - said > self.say_every:
        self.live.say(PROMPTS[(number + 1) % len(PROMPTS)])
        said = time.monotonic()
      if time.monotonic() - began > self.seconds:
        return


def measured(client, pid, count, seconds, speed, say_every=0.0):
  """The measurements of all pages together."""
  before = memory(pid)
  pages = [Page(client, seed, seconds, speed, say_every) for seed in range(count)]
  start = time.monotonic()
  for page in pages:
    page.start()
  trace = []
  while any(page.is_alive() for page in pages):
    time.sleep(min(5.0, seconds / 10))
    trace.append(memory(pid))
  passed = time.monotonic() - start
  middle = lambda values: round(float(np.median(values)), 3) if values else None
  return {"streams": count, "seconds": round(passed, 1), "blocks": sum(page.blocks for page in pages),
          "missed": sum(page.late for page in pages),
          "blocks_per_second": round(sum(page.blocks for page in pages) / passed, 2),
          "times_real_time": round(sum(page.frames for page in pages) / 20 / passed / count, 2),
          "bytes_per_second": round(sum(page.bytes for page in pages) / passed / count),
          "seconds_to_changed_frame_sent": middle([s for page in pages for s in page.sent]),
          "seconds_to_changed_frame_played": middle([s for page in pages for s in page.seen]),
          "prompts": sum(len(page.sent) for page in pages), "errors": [page.error for page in pages if page.error],
          "megabytes": [round(value) for value in (before, *trace[::max(1, len(trace) // 8)], trace[-1])]}


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("--minutes", type=float, default=10.0, help="of the soak at the speed of a clock")
  parser.add_argument("--seconds", type=float, default=20.0, help="of each run as fast as can be")
  parser.add_argument("--streams", type=int, nargs="+", default=[1, 2, 4])
  parser.add_argument("--soak-streams", type=int, default=1, help="streams side by side in the soak")
  parser.add_argument("--model", default="cmdm-small")
  parser.add_argument("--out", help="a .json file for the figures")
  args = parser.parse_args()
  began = time.monotonic()
  studio = subprocess.Popen([sys.executable, "-m", "motion_jax_studio.cli", "studio", "--port", "0",
                             "--model", args.model], stdout=subprocess.PIPE, text=True)
  try:
    client = Client(studio.stdout.readline().split("is at ")[1].strip())
    found = {"seconds_to_address": round(time.monotonic() - began, 2)}
    with client.stream(PROMPTS[0], seed=0, speed=0) as live:
      next(iter(live))
    found["seconds_to_first_frame"] = round(time.monotonic() - began, 2)
    with client.stream(PROMPTS[0], seed=0, speed=0) as live:
      start = time.monotonic()
      next(iter(live))
    found["seconds_to_first_frame_once_ready"] = round(time.monotonic() - start, 2)
    found["as_fast_as_can_be"] = [measured(client, studio.pid, count, args.seconds, 0) for count in args.streams]
    print(json.dumps(found, indent=1), flush=True)
    found["soak"] = measured(client, studio.pid, args.soak_streams, 60 * args.minutes, 1, say_every=6.0)
    print(json.dumps(found["soak"], indent=1))
  finally:
    start = time.monotonic()
    studio.send_signal(2)
    studio.wait(20)
    print(f"ended {time.monotonic() - start:.2f} s after Ctrl-C")
  if args.out:
    pathlib.Path(args.out).write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
  main()
