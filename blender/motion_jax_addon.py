"""Blender add-on: text-to-motion with a `motion-jax studio` on this or another machine.

Install this file with Edit > Preferences > Add-ons > Install from Disk. Start `motion-jax studio` and copy the address
that it prints into the panel (3D view, sidebar, tab Motion). "Generate" puts a motion on a new armature while Blender
stays usable. "Start live" streams a motion to a stick armature, and "Send prompt" changes its prompt. Needs only the
standard library.
"""
import base64
import collections
import json
import os
import socket
import struct
import tempfile
import textwrap
import threading
import urllib.error
import urllib.parse
import urllib.request

import bpy

bl_info = {"name": "motion_jax", "author": "motion_jax", "version": (0, 1, 0), "blender": (4, 0, 0),
           "location": "3D View > Sidebar > Motion", "description": "Text-to-motion", "category": "Animation"}


# --- the studio: docs/protocol.md of motion_jax ----------------------------------------------------------------------


class Studio:
  """The studio at the printed address, which contains the token."""

  def __init__(self, address):
    self.parts = urllib.parse.urlsplit(address.strip())
    self.token = urllib.parse.parse_qs(self.parts.query).get("token", [""])[0]

  def request(self, path, body):
    """The bytes of the reply. Raises ValueError with one sentence."""
    call = urllib.request.Request(f"http://{self.parts.netloc}{path}", json.dumps(body).encode(),
                                     {"Authorization": f"Bearer {self.token}"})
    try:
      with urllib.request.urlopen(call, timeout=600) as reply:
        return reply.read()
    except urllib.error.HTTPError as error:
      raise ValueError(json.loads(error.read())["error"]["message"]) from None
    except (OSError, ValueError) as error:
      raise ValueError(f"no studio answers at {self.parts.netloc or 'this address'}: {error}") from None

  def bvh(self, prompt, seconds, seed):
    """(bytes of a BVH file in centimetres, the studio's notes) for a prompt."""
    made = json.loads(self.request("/v1/generate", {"prompt": prompt, "seconds": seconds or None, "seed": seed}))
    return self.request("/v1/export", {"motion": made["motions"][0], "format": "bvh"}), made.get("notes", [])


class Request:
  """A request that runs in a thread; only Blender's main thread may change the scene."""

  def __init__(self, studio, prompt, seconds, seed):
    self.prompt, self.result, self.error = prompt, None, ""
    threading.Thread(target=self._make, args=(studio, prompt, seconds, seed), daemon=True).start()

  def _make(self, *request):
    studio, *fields = request
    try:
      self.result = studio.bvh(*fields)
    except Exception as error:  # any error: the panel shows it
      self.error = str(error) or type(error).__name__


class Live:
  """A stream that is received in a thread: `frames` gets lists of joints [(x, y, z)] in metres, y up."""

  def __init__(self, studio, prompt, seed):
    self.frames, self.parents, self.names, self.fps = collections.deque(), None, None, 20.0
    self.error, self.prompt = "", prompt
    self._socket = _connect(studio)
    self._lock, self._waiting = threading.Lock(), collections.deque()
    self.send(type="start", prompt=prompt, seed=seed, ahead=3)
    threading.Thread(target=self._listen, daemon=True).start()

  def send(self, **message):
    data = json.dumps(message).encode()
    length = bytes([0x80 | len(data)]) if len(data) < 126 else b"\xfe" + struct.pack(">H", len(data))
    mask = os.urandom(4)
    with self._lock:
      self._socket.sendall(b"\x81" + length + mask + bytes(b ^ mask[i % 4] for i, b in enumerate(data)))

  def next(self):
    """The next frame, or None if none has arrived; acknowledges a block with its last frame."""
    if not self.frames:
      return None
    sequence, frame = self.frames.popleft()
    if sequence is not None:
      self.send(type="ack", sequence=sequence)
    return frame

  def close(self):
    try:
      self._socket.shutdown(socket.SHUT_RDWR)
    except OSError:
      pass
    self._socket.close()

  def _listen(self):
    try:
      while True:
        kind, data = self._message()
        if kind == 8:
          return
        if kind == 9:  # a ping
          with self._lock:
            self._socket.sendall(b"\x8a" + bytes([0x80 | len(data)]) + b"\0\0\0\0" + data)
        elif kind == 1:
          message = json.loads(data)
          if message["type"] == "started":
            self.parents, self.names, self.fps = message["parents"], message["joints"], message["fps"]
          elif message["type"] == "error":
            self.error = message["message"]
          elif message["type"] == "words":
            self.prompt = message["prompt"]
        elif kind == 2:
          sequence, frames = unpack(data)
          self.frames.extend([(None, frame) for frame in frames[:-1]] + [(sequence, frames[-1])])
    except (OSError, ValueError) as error:
      self.error = self.error or f"the connection to the studio was lost ({error})"

  def _message(self):
    first, second = self._read(2)
    size = second & 127
    if size == 126:
      size, = struct.unpack(">H", self._read(2))
    elif size == 127:
      size, = struct.unpack(">Q", self._read(8))
    return first & 15, self._read(size)

  def _read(self, count):
    data = b""
    while len(data) < count:
      piece = self._socket.recv(count - len(data))
      if not piece:
        raise OSError("the connection ended")
      data += piece
    return data


def _connect(studio):
  """A socket after the WebSocket handshake."""
  try:
    found = socket.create_connection((studio.parts.hostname, studio.parts.port or 80), timeout=10)
    key = base64.b64encode(os.urandom(16)).decode()
    found.sendall(f"GET /v1/stream?token={urllib.parse.quote(studio.token)} HTTP/1.1\r\nHost: {studio.parts.netloc}\r\n"
                  f"Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: {key}\r\n"
                  "Sec-WebSocket-Version: 13\r\n\r\n".encode())
    reply = b""
    while b"\r\n\r\n" not in reply:
      piece = found.recv(1)
      if not piece:
        break
      reply += piece
  except (OSError, TypeError) as error:
    raise ValueError(f"no studio answers at {studio.parts.netloc or 'this address'}: {error}") from None
  if b" 101 " not in reply.split(b"\r\n")[0]:
    raise ValueError("the studio refused the connection; enter the complete printed address with the token")
  found.settimeout(None)
  return found


def unpack(data):
  """(sequence number, frames) of a block: each a list of joints (x, y, z)."""
  header, sequence, n, count = *struct.unpack_from("<6xHI", data), *struct.unpack_from("<20xHH", data)
  ground = struct.unpack_from(f"<{2 * n}f", data, header)
  joints = struct.unpack_from(f"<{3 * n * count}e", data, header + 8 * n)
  return sequence, [[(joints[3 * (i * count + j)] + ground[2 * i], joints[3 * (i * count + j) + 1],
                      joints[3 * (i * count + j) + 2] + ground[2 * i + 1]) for j in range(count)] for i in range(n)]


# --- the scene -------------------------------------------------------------------------------------------------------

_live = {"stream": None, "armature": None, "frame": 0}
_making = {"request": None, "lines": [], "failed": False}  # and the panel's text about the last request


def load_motion(data, name):
  """Loads a BVH file as a new armature and sets the scene's frame rate and length; returns the armature's object.

  The action is named after the prompt. All motions of a model have the same bones, so it also plays on their armatures.
  """
  path = os.path.join(tempfile.mkdtemp(), "motion.bvh")
  try:
    with open(path, "wb") as file:
      file.write(data)
    bpy.ops.import_anim.bvh(filepath=path, global_scale=0.01, update_scene_fps=True, rotate_mode="QUATERNION")
  finally:
    os.remove(path)
    os.rmdir(os.path.dirname(path))
  scene, made = bpy.context.scene, bpy.context.view_layer.objects.active
  made.name = made.data.name = made.animation_data.action.name = name[:60]
  # The end of the longest motion in the scene, not the 250 frames of a new scene.
  moving = [one.animation_data.action for one in scene.objects if one.animation_data and one.animation_data.action]
  scene.frame_start, scene.frame_end = 1, max(int(action.frame_range[1]) for action in moving)
  scene.frame_set(1)
  return made


def finish():
  """A timer: loads the requested motion once it has arrived. Returns seconds until the next call, or None."""
  request = _making["request"]
  if request is None:
    return None
  if request.result is None and not request.error:
    return 0.2
  _making["request"] = None
  try:
    if request.error:
      raise RuntimeError(request.error)
    data, notes = request.result
    load_motion(data, request.prompt)
    show_status(*notes)
  except RuntimeError as error:  # also from Blender's importer
    show_status(str(error), failed=True)
  return None


def show_status(*lines, failed=False):
  """Shows lines in the panel and in the console."""
  _making.update(lines=list(lines), failed=failed)
  for line in lines:
    print(f"motion_jax: {line}")
  for window in bpy.context.window_manager.windows:
    for area in window.screen.areas:
      area.tag_redraw()


def z_up(point):
  return point[0], -point[2], point[1]


def make_sticks(frame, parents, names):
  """A new armature with an unconnected bone from each joint's parent to the joint."""
  data = bpy.data.armatures.new("motion_jax live")
  made = bpy.data.objects.new("motion_jax live", data)
  bpy.context.collection.objects.link(made)
  bpy.context.view_layer.objects.active = made
  bpy.ops.object.mode_set(mode="EDIT")
  for joint, parent in enumerate(parents):
    if parent >= 0:
      bone = data.edit_bones.new(names[joint])
      bone.head, bone.tail = z_up(frame[parent]), z_up(frame[joint])
  bpy.ops.object.mode_set(mode="POSE")
  return made


def show(armature, frame, parents, names, keyframe=None):
  """Poses the stick armature; keyframe: the scene frame at which to insert keyframes, or None."""
  from mathutils import Matrix, Vector
  for joint, parent in enumerate(parents):
    if parent < 0:
      continue
    bone = armature.pose.bones[names[joint]]
    head, tail = Vector(z_up(frame[parent])), Vector(z_up(frame[joint]))
    rest = bone.bone.matrix_local.to_3x3()
    along = rest @ Vector((0, 1, 0))
    turn = along.rotation_difference(tail - head).to_matrix() @ rest
    bone.matrix = Matrix.Translation(head) @ turn.to_4x4()
    if keyframe is not None:
      bone.rotation_mode = "QUATERNION"
      bone.keyframe_insert("location", frame=keyframe)
      bone.keyframe_insert("rotation_quaternion", frame=keyframe)


def step():
  """A timer: shows the next frame. Returns seconds until the next call, or None at the end of the stream."""
  stream = _live["stream"]
  if stream is None:
    return None
  frame = stream.next()
  if frame is None:
    if stream.error:
      show_status(stream.error, failed=True)
      stop()
      return None
    return 0.05
  if _live["armature"] is None:
    _live["armature"], _live["frame"] = make_sticks(frame, stream.parents, stream.names), 1
  keep = bpy.context.scene.motion_jax.record
  show(_live["armature"], frame, stream.parents, stream.names, _live["frame"] if keep else None)
  _live["frame"] += 1
  return 1 / stream.fps


def start(address, prompt, seed):
  stop()
  _live.update(stream=Live(Studio(address), prompt, seed), armature=None)
  bpy.app.timers.register(step)


def stop():
  stream, _live["stream"] = _live["stream"], None
  if stream is not None:
    stream.close()


# --- the panel -------------------------------------------------------------------------------------------------------


class Settings(bpy.types.PropertyGroup):
  address: bpy.props.StringProperty(name="Address", description="The address that motion-jax studio printed",
                                    default="http://127.0.0.1:8765/?token=")
  prompt: bpy.props.StringProperty(name="Prompt", default="a person walks forward")
  seconds: bpy.props.FloatProperty(name="Seconds", description="0: as long as similar training clips", default=0,
                                   min=0, max=120)
  seed: bpy.props.IntProperty(name="Seed", default=0, min=0)
  record: bpy.props.BoolProperty(name="Keep as keyframes", default=False)


class _Operator:
  def execute(self, context):
    try:
      self.work(context.scene.motion_jax)
    except ValueError as error:
      self.report({"ERROR"}, str(error))
      return {"CANCELLED"}
    return {"FINISHED"}


class Make(_Operator, bpy.types.Operator):
  """Generate a motion of the prompt on a new armature"""
  bl_idname, bl_label, bl_options = "motion_jax.make", "Generate", {"REGISTER", "UNDO"}

  def work(self, settings):
    if _making["request"] is not None:
      raise ValueError("a motion is being generated; wait until it arrives")
    _making["request"] = Request(Studio(settings.address), settings.prompt, settings.seconds, settings.seed)
    show_status(f"generating: {settings.prompt}")
    bpy.app.timers.register(finish)


class StartLive(_Operator, bpy.types.Operator):
  """Stream a motion into the scene while it is generated"""
  bl_idname, bl_label = "motion_jax.start_live", "Start live"

  def work(self, settings):
    start(settings.address, settings.prompt, settings.seed)


class Say(_Operator, bpy.types.Operator):
  """Change the prompt of the stream"""
  bl_idname, bl_label = "motion_jax.say", "Send prompt"

  def work(self, settings):
    if _live["stream"] is None:
      raise ValueError("there is no stream; press Start live first")
    _live["stream"].send(type="prompt", prompt=settings.prompt)


class StopLive(_Operator, bpy.types.Operator):
  """End the stream and keep the armature"""
  bl_idname, bl_label = "motion_jax.stop_live", "Stop"

  def work(self, settings):
    stop()


class Panel(bpy.types.Panel):
  bl_idname, bl_label, bl_category = "VIEW3D_PT_motion_jax", "motion_jax", "Motion"
  bl_space_type, bl_region_type = "VIEW_3D", "UI"

  def draw(self, context):
    for name in ("address", "prompt", "seconds", "seed", "record"):
      self.layout.prop(context.scene.motion_jax, name)
    for one in (Make, StartLive, Say, StopLive):
      self.layout.operator(one.bl_idname)
    for line in _making["lines"]:
      for row in textwrap.wrap(line, 40):  # a label is one line, cut off at the panel's edge
        self.layout.label(text=row, icon="ERROR" if _making["failed"] else "INFO")


CLASSES = (Settings, Make, StartLive, Say, StopLive, Panel)


def register():
  for one in CLASSES:
    bpy.utils.register_class(one)
  bpy.types.Scene.motion_jax = bpy.props.PointerProperty(type=Settings)


def unregister():
  stop()
  _making["request"] = None
  for timer in (step, finish):
    if bpy.app.timers.is_registered(timer):
      bpy.app.timers.unregister(timer)
  del bpy.types.Scene.motion_jax
  for one in reversed(CLASSES):
    bpy.utils.unregister_class(one)


if __name__ == "__main__":
  register()
