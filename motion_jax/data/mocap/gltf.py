"""Read glTF 2.0 files (.glb, .gltf, .vrm) and add data to them; what is in a file already keeps its bytes.

A `Document` is the file's JSON and its buffers. Accessors are read with strides, offsets, sparse values and normalized
integers; compressed ones (Draco, meshopt) are not.
"""
import base64
import functools
import json
import pathlib
import struct
import urllib.parse

import numpy as np

from motion_jax.motion import rotations as rot
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError, reading, reason

ENDINGS = (".glb", ".gltf", ".vrm")
MOTIONS = (*ENDINGS, ".vrma")  # files with an animation; a .vrma has no body
LARGEST = 1 << 28  # bytes
_JSON, _BIN = 0x4E4F534A, 0x004E4942
_DTYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
FLOAT = 5126
_SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_PACKED = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_ZEROS = 4  # values of an accessor without a buffer for each byte of the file
_MOST = 1e12  # a place, a scale, or what else a file holds
_CUT = "the file is cut or damaged, copy or export it again"


class Unreadable(InputError):
  """For data of a file in a form that is not read here."""


class Document:
  """A glTF file: `json`, its JSON, and its buffers. Raises InputError that begins with the path for a bad file."""

  def __init__(self, path):
    self.path = path = pathlib.Path(path)
    self._buffers: dict[int, bytes] = {}
    if not path.is_file():
      raise FileNotFoundError(f"there is no file {path}")
    self._size = size = path.stat().st_size
    if size > LARGEST:
      raise InputError(f"{path}: got {size / 2**20:,.0f} MiB, expected at most {LARGEST >> 20}; make its textures "
                       "smaller, for instance with npx @gltf-transform/cli resize")
    with reading(path):
      text, self._binary = _chunks(path, path.read_bytes())
    try:
      self.json = json.loads(text)
    except (ValueError, RecursionError):
      raise InputError(f"{path}: its JSON cannot be read; {_CUT}") from None
    asset = self.json.get("asset") if isinstance(self.json, dict) else None
    version = asset.get("version") if isinstance(asset, dict) else None
    if not isinstance(version, str) or not version.startswith("2."):
      raise InputError(f"{path}: got glTF version {str(version)[:20]}, expected 2.0; export it again as glTF 2.0")
    with self.checked():
      self.nodes = self.json.get("nodes", [])
      self.parents = self._parents()

  def checked(self):
    """A block in which what wrong types and numbers in the file raise becomes one InputError."""
    return _Checked(self.path)

  def _parents(self):
    """The parent of each node, -1 for a root."""
    parents = [-1] * len(self.nodes)
    for number, node in enumerate(self.nodes):
      for child in node.get("children", ()):
        if not 0 <= child < len(parents) or parents[child] >= 0:
          raise InputError(f"{self.path}: node {number} has the child {child}, which is no node of its own; {_CUT}")
        parents[child] = number
    below = [j for j, parent in enumerate(parents) if parent < 0]
    for node in below:
      below.extend(self.nodes[node].get("children", ()))
    if len(below) < len(parents):  # a node below no root
      raise InputError(f"{self.path}: node {min({*range(len(parents))} - {*below})} hangs on itself; {_CUT}")
    return parents

  @functools.cached_property
  def order(self):
    """Nodes, parents before children."""
    order = [j for j, parent in enumerate(self.parents) if parent < 0]
    for node in order:
      order.extend(self.nodes[node].get("children", ()))
    return order

  @functools.cached_property
  def shown(self) -> set[int]:
    """The nodes of the scene that the file opens with; all nodes of a file without scenes."""
    with self.checked():
      scenes = self.json.get("scenes") or [{"nodes": [j for j, parent in enumerate(self.parents) if parent < 0]}]
      below = list(scenes[self.json.get("scene", 0)].get("nodes", ()))
      for node in below:
        below.extend(self.nodes[node].get("children", ()))
      return set(below)

  def name(self, node) -> str:
    """A node's name, "node 7" for one without."""
    return str(self.nodes[node].get("name") or f"node {node}")

  # --- arrays ------------------------------------------------------------------------------------------------------

  def _buffer(self, number):
    if number not in self._buffers:
      self._buffers[number] = self._read_buffer(number)
    return self._buffers[number]

  def _read_buffer(self, number):
    about = self.json["buffers"][number]
    if "uri" not in about:
      if number or self._binary is None:
        raise Unreadable(f"{self.path}: its buffer {number} has no data; {_CUT}")
      data = self._binary
    else:
      data = self._from_uri(about["uri"])
    if len(data) < about["byteLength"]:
      raise InputError(f"{self.path}: its buffer {number} has {len(data):,} of {about['byteLength']:,} bytes; {_CUT}")
    return data

  def _from_uri(self, uri):
    if uri.startswith("data:"):
      return base64.b64decode(uri.partition(",")[2])
    beside = self.path.parent / urllib.parse.unquote(uri)
    if "://" in uri or not beside.resolve().is_relative_to(self.path.parent.resolve()):
      raise InputError(f"{self.path}: got the address {uri[:60]!r}, expected a file beside it")
    if not beside.is_file():
      raise InputError(f"{self.path}: it needs the file {uri[:60]!r} beside it, which is not there; export a .glb, "
                       "which holds all in one file")
    return beside.read_bytes()

  def array(self, number) -> np.ndarray:
    """The values (N, K) of an accessor, float64 where they are real or normalized numbers.

    Raises InputError for one that ends outside its buffer, `Unreadable` for a compressed one.
    """
    with self.checked():
      about = self.json["accessors"][number]
      dtype, width, count = np.dtype(_DTYPES[about["componentType"]]), _SIZES[about["type"]], about["count"]
      # Values without a buffer are zeros: a few bytes may not ask for gigabytes.
      most = LARGEST if "bufferView" in about else _ZEROS * self._size
      if not 0 <= count <= most:
        raise InputError(f"{self.path}: accessor {number} states {count:,} values; {_CUT}")
      if "bufferView" in about:
        values = self._view(about["bufferView"], about.get("byteOffset", 0), dtype, count, width).copy()
      else:
        values = np.zeros((count, width), dtype)
      if sparse := about.get("sparse"):
        where, what = sparse["indices"], sparse["values"]
        rows = self._view(where["bufferView"], where.get("byteOffset", 0), np.dtype(_DTYPES[where["componentType"]]),
                          sparse["count"], 1)[:, 0]
        values[rows] = self._view(what["bufferView"], what.get("byteOffset", 0), dtype, sparse["count"], width)
      if about.get("normalized"):
        return np.maximum(values / np.iinfo(dtype).max, -1.0)
      if dtype.kind != "f":
        return values
      with np.errstate(invalid="ignore"):
        values = values.astype(np.float64)
      if not (np.abs(values) < _MOST).all():
        raise InputError(f"{self.path}: accessor {number} holds NaN, infinity or numbers from {_MOST:g} on; {_CUT}")
      return values

  def _view(self, number, offset, dtype, count, width):
    view = self.json["bufferViews"][number]
    if any(name in view.get("extensions", {}) for name in _PACKED):
      raise Unreadable(f"{self.path}: its data is compressed (meshopt), which is not read; unpack it with npx "
                       "@gltf-transform/cli copy")
    size = dtype.itemsize * width
    stride = view.get("byteStride", size)
    length = stride * (count - 1) + size if count else 0
    data = self._buffer(view["buffer"])
    first = view.get("byteOffset", 0)
    start = first + offset
    if min(first, offset, count) < 0 or stride < size or start + length > len(data):
      raise InputError(f"{self.path}: buffer view {number} ends outside its buffer; {_CUT}")
    return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize))

  def bind_matrices(self, skin) -> np.ndarray | None:
    """The inverse bind matrices (J, 4, 4) of a skin's joints; None where it has none, which means identities."""
    with self.checked():
      if "inverseBindMatrices" not in skin:
        return None
      found, count = self.array(skin["inverseBindMatrices"]), len(skin["joints"])
      if found.ndim != 2 or found.shape[1] != 16 or len(found) < count:
        raise InputError(f"{self.path}: a skin has {count} joints and {len(found)} inverse bind matrices, expected one "
                         "for each joint; export the file again")
      return found[:count].reshape(-1, 4, 4).swapaxes(1, 2)

  # --- nodes -------------------------------------------------------------------------------------------------------

  def rest(self):
    """(translations (N, 3), rotations (N, 4) as w, x, y, z, scales (N, 3)) of all nodes, as the file has them.

    A node's matrix is taken apart; what it shears is lost.
    """
    with self.checked():
      count = len(self.nodes)
      moved, scale = np.zeros((count, 3)), np.ones((count, 3))
      turned = np.tile([1.0, 0, 0, 0], (count, 1))
      for j, node in enumerate(self.nodes):
        if "matrix" in node:
          moved[j], turned[j], scale[j] = take_apart(np.array(node["matrix"], np.float64).reshape(4, 4).T)
        else:
          moved[j] = node.get("translation", moved[j])
          scale[j] = node.get("scale", scale[j])
          x, y, z, w = node.get("rotation", (0, 0, 0, 1))
          turned[j] = w, x, y, z
      norm = np.linalg.norm(turned, axis=-1, keepdims=True)
      if not all((np.abs(values) < _MOST).all() for values in (moved, scale, norm)) or not (norm > 1e-6).all():
        raise InputError(f"{self.path}: a node is placed by numbers that are not finite, or from {_MOST:g} on; {_CUT}")
      return moved, turned / norm, scale

  def world(self, moved, turned, scale) -> np.ndarray:
    """World matrices (..., N, 4, 4) of all nodes by their own translations, rotations and scales (..., N, 3 or 4)."""
    return world_matrices(self.order, self.parents, moved, turned, scale)

  # --- writing -----------------------------------------------------------------------------------------------------

  def add(self, array, shape, bounds=False) -> int:
    """Appends float32 values (N, K) as accessor type `shape`; returns the accessor's number. Raises InputError for NaN.
    """
    array = np.ascontiguousarray(array, "<f4")
    if not np.isfinite(array).all():
      raise InputError(f"{self.path}: no motion can be put on its bones, as a bone is scaled to nothing; {_CUT}")
    with self.checked():
      return self._appended(array, shape, bounds)

  def _appended(self, array, shape, bounds):
    buffers = self.json.setdefault("buffers", [])
    if not hasattr(self, "_added"):
      in_place = self._binary is not None and bool(buffers) and "uri" not in buffers[0]
      self._added = bytearray(self._binary[:buffers[0]["byteLength"]] if in_place else b"")
      self._added_to = 0 if in_place else len(buffers)
      if not in_place:
        buffers.append({"byteLength": 0})
    self._added += b"\0" * (-len(self._added) % 4)
    views, accessors = (self.json.setdefault(key, []) for key in ("bufferViews", "accessors"))
    views.append({"buffer": self._added_to, "byteOffset": len(self._added), "byteLength": array.nbytes})
    accessor = {"bufferView": len(views) - 1, "componentType": FLOAT, "count": len(array), "type": shape}
    if bounds:
      accessor |= {"min": array.reshape(len(array), -1).min(0).tolist(),
                   "max": array.reshape(len(array), -1).max(0).tolist()}
    accessors.append(accessor)
    self._added += array.tobytes()
    buffers[self._added_to]["byteLength"] = len(self._added)
    return len(accessors) - 1

  def write(self, path) -> pathlib.Path:
    """Writes the document as one binary file (.glb, .vrm), with files that stand beside a .gltf packed into it."""
    path, document = pathlib.Path(path), dict(self.json)
    binary = bytes(self._added) if hasattr(self, "_added") else self._binary
    if document.get("buffers") and ("uri" in document["buffers"][0] or any(
        "uri" in about and not about["uri"].startswith("data:")
        for about in (*document["buffers"], *document.get("images", ())))):
      document, binary = self._packed(document)
    try:
      text = json.dumps(document, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
    except ValueError as error:  # NaN, or a half of a surrogate pair
      raise InputError(f"{self.path}: its JSON cannot be written again ({reason(error)}); {_CUT}") from None
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), _JSON) + text
    if binary is not None:
      binary += b"\0" * (-len(binary) % 4)
      chunks += struct.pack("<II", len(binary), _BIN) + binary
    with atomic_path(path) as temporary:
      with open(temporary, "wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)))
        file.write(chunks)
    return path

  def _packed(self, document):
    """The document with all buffers, and images that are files beside it, in one buffer; and that buffer."""
    with self.checked():
      data, starts = bytearray(), []
      for number, about in enumerate(document["buffers"]):
        own = hasattr(self, "_added") and number == self._added_to
        part = self._added if own else (
            b"" if "uri" not in about and (number or self._binary is None) else self._buffer(number))
        data += b"\0" * (-len(data) % 4)
        starts.append(len(data))
        data += part[:about["byteLength"]]
      views = [view | {"buffer": 0, "byteOffset": starts[view["buffer"]] + view.get("byteOffset", 0)}
               for view in document.get("bufferViews", ())]
      images = []
      for image in document.get("images", ()):
        if "uri" in image and not image["uri"].startswith("data:"):
          part = self._from_uri(image["uri"])
          data += b"\0" * (-len(data) % 4)
          views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(part)})
          data += part
          kind = "image/png" if part[:4] == b"\x89PNG" else "image/jpeg" if part[:2] == b"\xff\xd8" else (
              "image/webp" if part[8:12] == b"WEBP" else "image/ktx2")
          image = {key: value for key, value in image.items() if key != "uri"} | {
              "bufferView": len(views) - 1, "mimeType": image.get("mimeType", kind)}
        images.append(image)
      document = document | {"buffers": [{"byteLength": len(data)}], "bufferViews": views}
      return document | ({"images": images} if images else {}), bytes(data)


class _Checked:
  """Turns what wrong types and numbers in a file raise into one InputError."""

  def __init__(self, path):
    self.path = path

  def __enter__(self):
    return self

  def __exit__(self, kind, error, _):
    if kind is not None and not issubclass(kind, InputError) and issubclass(
        kind, KeyError | IndexError | TypeError | ValueError | AttributeError | OverflowError):
      raise InputError(f"{self.path}: its glTF is not as the format says ({kind.__name__}: {str(error)[:60]}); {_CUT}"
                       ) from None


def _chunks(path, data):
  """The JSON text and the binary chunk (None without one) of a file's bytes."""
  if data[:4] != b"glTF":
    if data.lstrip()[:1] != b"{":
      raise InputError(f"{path}: it begins like no glTF file, expected a .glb, .gltf or .vrm; export it again")
    return data, None
  _, version, length = struct.unpack("<4sII", data[:12].ljust(12, b"\0"))
  if version != 2:
    raise InputError(f"{path}: got binary glTF version {version}, expected 2; export it again as glTF 2.0")
  if length > len(data):
    raise InputError(f"{path}: it has {len(data):,} of the {length:,} bytes that its header states; {_CUT}")
  found, at = {}, 12
  while at + 8 <= length:
    size, kind = struct.unpack_from("<II", data, at)
    if at + 8 + size > length:
      raise InputError(f"{path}: a chunk of {size:,} bytes ends outside the file; {_CUT}")
    found.setdefault(kind, data[at + 8:at + 8 + size])
    at += 8 + size
  if _JSON not in found:
    raise InputError(f"{path}: it holds no JSON chunk; {_CUT}")
  return found[_JSON], found.get(_BIN)


def world_matrices(order, parents, moved, turned, scale) -> np.ndarray:
  """World matrices (..., N, 4, 4) of nodes by their own translations, rotations and scales (..., N, 3 or 4)."""
  world = np.zeros(np.broadcast_shapes(moved.shape[:-1], turned.shape[:-1], scale.shape[:-1]) + (4, 4))
  world[..., :3, :3] = rot.to_matrix(turned) * scale[..., None, :]
  world[..., :3, 3], world[..., 3, 3] = moved, 1
  for node in order:
    if parents[node] >= 0:
      world[..., node, :, :] = world[..., parents[node], :, :] @ world[..., node, :, :]
  return world


def take_apart(matrix):
  """(translation (..., 3), rotation (..., 4) as w, x, y, z, scale (..., 3)) of matrices (..., 4, 4).

  Of a mirror the first scale is negative.
  """
  linear = matrix[..., :3, :3]
  scale = np.linalg.norm(linear, axis=-2)
  scale[..., 0] *= np.where(np.linalg.det(linear) < 0, -1, 1)
  u, _, v = np.linalg.svd(linear / np.where(np.abs(scale) > 1e-12, scale, 1)[..., None, :])
  flip = np.ones(scale.shape)
  flip[..., 2] = np.sign(np.linalg.det(u @ v))
  return matrix[..., :3, 3].copy(), rot.from_matrix(u * flip[..., None, :] @ v), scale
