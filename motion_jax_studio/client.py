"""A client of `motion-jax studio`: motion on request and live. It needs only numpy and websockets.

  studio = Client("http://127.0.0.1:8765/?token=...")     # the address that the studio printed
  motion = studio.generate("a person waves", seconds=4)[0]
  open("wave.glb", "wb").write(studio.export(motion, "glb"))
  with studio.stream("a person walks") as live:
    for frames in live:                                   # (n, 22, 3) metres
      live.say("a person jumps")
  with studio.stream("a person walks", pose="robot:g1") as live:
    for rows in live.poses():                             # (n, 36) qpos, 50 a second; live.about says what they hold
      ...
"""
import base64
import json
import struct
import urllib.error
import urllib.parse
import urllib.request

import numpy as np


class Client:
  """The requests of docs/protocol.md. A refused request raises ValueError with the studio's message."""

  def __init__(self, address):
    parts = urllib.parse.urlsplit(address)
    self.base, self.token = f"http://{parts.netloc}", urllib.parse.parse_qs(parts.query).get("token", [""])[0]

  def request(self, path, body=None):
    data = None if body is None else body if isinstance(body, bytes) else json.dumps(body).encode()
    call = urllib.request.Request(self.base + path, data, {"authorization": f"Bearer {self.token}"})
    try:
      with urllib.request.urlopen(call) as reply:
        return reply.read()
    except urllib.error.HTTPError as error:
      raise ValueError(json.loads(error.read())["error"]["message"]) from None

  def models(self):
    return json.loads(self.request("/v1/models"))["models"]

  def generate(self, prompt, **fields):
    return json.loads(self.request("/v1/generate", {"prompt": prompt, **fields}))["motions"]

  def multi_prompt(self, segments, **fields):
    rows = [{"prompt": prompt, "seconds": seconds} for prompt, seconds in segments]
    return json.loads(self.request("/v1/multi-prompt", {"segments": rows, **fields}))

  def edit(self, motion, prompt, **fields):
    return json.loads(self.request("/v1/edit", {"motion": motion, "prompt": prompt, **fields}))["motion"]

  def export(self, motion, format, **fields):
    return self.request("/v1/export", {"motion": motion, "format": format, **fields})

  def stream(self, prompt, **fields):
    return Live(f"{self.base.replace('http', 'ws', 1)}/v1/stream?token={urllib.parse.quote(self.token)}",
                {"type": "start", "prompt": prompt, **fields})


def joints_of(motion):
  """Joints (T, J, 3) float32 of a motion that the studio returned."""
  return np.frombuffer(base64.b64decode(motion["joints"]), "<f4").reshape(motion["shape"])


class Live:
  """Yields joints (n, J, 3) block by block; `last` is the header of the latest block, `messages` the other messages.

  `poses` yields the poses that the stream's `pose=` adds to the joints, and `about` describes their values.
  """

  def __init__(self, address, start):
    from websockets.sync.client import connect
    self._open = connect(address, max_size=None)
    self._socket, self.last, self.messages = self._open.__enter__(), {}, []
    self.send(**start)

  def send(self, **message):
    self._socket.send(json.dumps(message))

  def say(self, prompt, **fields):
    self.send(type="prompt", prompt=prompt, **fields)

  @property
  def about(self):
    """Description of a row of `poses`; {} before the stream has started."""
    return next((message["pose"] for message in reversed(self.messages) if message.get("pose")), {})

  def __iter__(self):
    return (joints for kind, joints in self._read() if kind == "joints")

  def poses(self):
    return (rows for kind, rows in self._read() if kind == "poses")

  def _read(self):
    from websockets.exceptions import ConnectionClosed
    try:
      for message in self._socket:
        if isinstance(message, str):
          self.messages.append(json.loads(message))
          if self.messages[-1]["type"] == "error":
            raise ValueError(self.messages[-1]["message"])
          if self.messages[-1].get("state") in ("ended", "stopped"):
            return
        elif message[:4] == b"MJXP":
          size, n, width = *struct.unpack_from("<H", message, 6), *struct.unpack_from("<HH", message, 20)
          yield "poses", np.frombuffer(message, "<f4", n * width, size).reshape(n, width)
        else:
          yield "joints", self._joints(message)
    except ConnectionClosed:
      return

  def _joints(self, message):
    names = "sequence run first_frame frames joints words committed begun milliseconds fps".split()
    size, *values = struct.unpack_from("<6xHIIIHHIIIff", message)
    self.last = dict(zip(names, values))
    n, count = self.last["frames"], self.last["joints"]
    ground = np.frombuffer(message, "<f4", n * 2, size).reshape(n, 1, 2)
    joints = np.frombuffer(message, "<f2", n * count * 3, size + 8 * n).reshape(n, count, 3).astype(np.float32)
    joints[..., [0, 2]] += ground
    self.last["contacts"] = np.frombuffer(message, "u1", 4 * n, size + n * (8 + 6 * count)).reshape(n, 4) > 0
    self.send(type="ack", sequence=self.last["sequence"])
    return joints

  def close(self):
    self._open.__exit__(None, None, None)

  def __enter__(self):
    return self

  def __exit__(self, *_):
    self.close()
