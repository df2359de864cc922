"""Ways to damage a file: bytes anywhere, tokens of a text, values of a JSON tree, arrays of a .npy or .npz file.

Each takes a numpy generator and a file's bytes and gives other bytes; the same generator state gives the same damage.
"""
import functools
import io
import json
import struct
import zipfile
import zlib

import numpy as np

WORDS = ("", "nan", "inf", "-inf", "1e308", "-1e308", "1e-310", "-1", "0", "0.0", "1", "99999999999999999999",
         "4294967296", "²", "１２", "٣", "1_0", "0x10", "None", "true", *'{}[]"\',;:#|/', "..", "\\", "\t", "\r", "\n",
         "\n\n", "\0", "\x1b[31m", "\ufeff", "\u2028", "é", "🙂", "\ud800", "a" * 300, "%s", "{0}", "$(true)",
         "--help", "-", "ROOT", "MOTION", "JOINT x", ":hierarchy", "begin", "end", "walk", "a person")
NUMBERS = (0, -1, 1, 2, 3, 7, 0.5, 1e-300, 1e300, 2**31, 2**63, 10**30, -(10**12), float("nan"), float("inf"), 1000,
           65536)
VALUES = (None, True, False, "", "x", "a person walks", [], {}, [[]], {"a": 1}, [1, 2], ["x"], *NUMBERS)
SHAPES = ((), (0,), (1,), (3,), (22, 3), (0, 22, 3), (1, 22, 3), (2, 22, 3), (9, 22, 3), (9, 21, 3), (9, 3, 22),
          (9, 66), (9, 67), (9, 263), (1, 263), (0, 263), (9, 251), (1, 1, 22, 3), (9, 22, 3, 1), (9, 22), (9, 135),
          (9, 272))


def pick(rng, options):
  return options[int(rng.integers(len(options)))]


def encode(text):
  return text.encode("utf-8", "surrogatepass")


# --- any file ----------------------------------------------------------------------------------------------------


def damage_bytes(rng, data):
  """Flips, cuts, inserts or overwrites bytes in one to four places."""
  data = bytearray(data)
  for _ in range(int(rng.integers(1, 5))):
    at, size = int(rng.integers(len(data) + 1)), int(2 ** rng.uniform(0, 10))
    if rng.random() < 0.3:  # headers and directories are at the ends
      near = rng.random() < 0.5
      at = int(rng.integers(min(len(data) + 1, 256))) if near else max(len(data) - int(rng.integers(256)), 0)
    how = int(rng.integers(6))
    if how == 0 and len(data):
      data[min(at, len(data) - 1)] ^= 1 << int(rng.integers(8))
    elif how == 1:
      del data[at:]
    elif how == 2:
      del data[at:at + size]
    elif how == 3:
      data[at:at] = rng.bytes(size)
    elif how == 4:
      data[at:at + size] = rng.bytes(min(size, max(len(data) - at, 0)))
    else:
      data[at:at + size] = bytes([pick(rng, (0, 255, 32, 48))]) * min(size, max(len(data) - at, 0))
  return bytes(data)


def other_file(rng, data):
  """Something else altogether under the same name."""
  return pick(rng, (b"", b"\n", b"\0" * 100, b"PK\x03\x04", b"PK\x05\x06" + b"\0" * 18, b"\x93NUMPY",
                    b"\x93NUMPY\x01\0v\0{", b"\x80\x04\x95\x05\0\0\0\0\0\0\0]\x94.", b"{}", b"[]", b"null", b"1",
                    b'"x"', b"[" * 100_000, b'{"a":' * 5_000, b"1" * 5_000, b"\xff\xfe\0\xd8", data[:len(data) // 2],
                    data + data, b"\n".join(data.split(b"\n")[::-1])))


# --- texts -------------------------------------------------------------------------------------------------------


def damage_text(rng, data):
  """Other words, lines in other places, another encoding."""
  text = data.decode("utf-8", "replace")
  lines = text.split("\n")
  for _ in range(int(rng.integers(1, 4))):
    # Half of the time near the top, where few lines say much.
    most = min(len(lines), 80) if rng.random() < 0.5 else len(lines)
    at, how = int(rng.integers(most)) if most else 0, int(rng.integers(9))
    if how == 0:
      del lines[at:at + 1]
    elif how == 1:
      lines.insert(at, pick(rng, lines) if lines else "")
    elif how == 2:
      lines = lines[:at]
    elif how == 3:
      lines.insert(at, pick(rng, WORDS))
    elif lines:
      lines[at] = _other_words(rng, lines[at])
    lines = lines or [""]
  text = pick(rng, ("\n", "\n", "\n", "\n", "\r\n", "\r")).join(lines)
  chance = rng.random()
  if chance < 0.10:
    return text.encode("utf-16" if chance < 0.05 else "cp1252", "replace")
  return (b"\xef\xbb\xbf" if chance < 0.15 else b"") + encode(text)


def _other_words(rng, line):
  parted = pick(rng, (" ", " ", ",", "#", ":", "|", "\t", ";"))
  words = line.split(parted)
  at, how = int(rng.integers(len(words))), int(rng.integers(5))
  if how == 0:
    words[at] = pick(rng, WORDS)
  elif how == 1:
    words.insert(at, pick(rng, WORDS))
  elif how == 2:
    del words[at]
  elif how == 3:
    words[at] = words[at][:int(rng.integers(len(words[at]) + 1))] + pick(rng, WORDS)
  else:
    words[at] = words[at] * int(rng.integers(2, 5))
  return parted.join(words)


# --- JSON --------------------------------------------------------------------------------------------------------


def damage_json(rng, data):
  """Values of another kind, keys that are missing or new, in one to three places of the tree (or of a line of it)."""
  lines = data.decode("utf-8", "replace").split("\n")
  at = int(rng.integers(len(lines))) if lines[0].strip().endswith("}") and len(lines) > 1 else None
  try:
    tree = json.loads(data if at is None else lines[at])
  except (ValueError, RecursionError):
    return damage_text(rng, data)
  for _ in range(int(rng.integers(1, 4))):
    tree = _other_value(rng, tree)
  text = json.dumps(tree)
  if at is not None:
    lines[at] = text
    text = "\n".join(lines)
  return text.encode()


def _other_value(rng, tree):
  if isinstance(tree, dict | list) and tree and rng.random() < 0.9:
    key = pick(rng, list(tree) if isinstance(tree, dict) else range(len(tree)))
    chance = rng.random()
    if chance < 0.15:
      del tree[key]
    elif chance < 0.2 and isinstance(tree, dict):
      tree[pick(rng, WORDS[:50]).encode("utf-8", "replace").decode()] = tree[key]
    elif chance < 0.25 and isinstance(tree, list):
      tree.append(tree[key])
    else:
      tree[key] = _other_value(rng, tree[key])
    return tree
  if isinstance(tree, int | float) and not isinstance(tree, bool) and rng.random() < 0.7:
    return pick(rng, NUMBERS)
  return pick(rng, VALUES)


# --- arrays ------------------------------------------------------------------------------------------------------


def damage_npy(rng, data):
  """An array of other numbers, another shape or type, a header that lies, or damaged bytes."""
  chance = rng.random()
  if chance < 0.3:
    return damage_bytes(rng, data)
  if chance < 0.35:
    return other_file(rng, data)
  try:
    array = np.load(io.BytesIO(data), allow_pickle=False)
  except Exception:
    return damage_bytes(rng, data)
  if chance < 0.5:
    return lying_npy(rng, data)
  return npy_bytes(other_array(rng, array))


def npy_bytes(array):
  file = io.BytesIO()
  np.save(file, array, allow_pickle=True)
  return file.getvalue()


def lying_npy(rng, data):
  """A header that says what the file does not hold."""
  shape = pick(rng, ("(10, 22, 3)", "(1000000000000, 22, 3)", "(99999999999999999999,)", "(-1, 22, 3)", "(0, 10**9)",
                     "()", "(4, 22, 3L)", "10", "'x'", "(1.5, 22, 3)", "(" * 200, "(2147483648, 2147483648, 2)",
                     "(0, 99999999999)", "(True, 22, 3)", "((3,),)", "(22, 3", "(5, 22, 3,)"))
  descr = pick(rng, ("'<f4'", "'<f4'", "'|O'", "'<U99999999'", "'|V0'", "'<U0'", "'>f8'", "'<c16'", "'<M8[s]'", "'zz'",
                     "7", "[('a', '<f4')]", "('<f4', (9999999,))", "None", "'" + "f4," * 99 + "'", "lambda: 0"))
  order = pick(rng, ("False", "False", "True", "2", "'x'"))
  text = f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {shape}, }}".encode("latin1")
  start = b"\x93NUMPY" + bytes([pick(rng, (1, 1, 1, 2, 3, 9)), 0])
  return start + len(text).to_bytes(2 if start[6] < 2 else 4, "little") + text + data[-int(rng.integers(1, 4000)):]


def other_array(rng, array):
  how = int(rng.integers(9))
  if how == 0:
    array = np.zeros(pick(rng, SHAPES), pick(rng, ("f4", "f8", "i4", "f2")))
  elif how == 1:
    kinds = "f2", "f8", "i1", "u8", ">f4", "?", "c8", "U8", "S4", "O"
    array = array.astype(pick(rng, kinds)) if array.dtype.kind in "fiub" else np.zeros(3)
  elif how in (2, 3) and array.size and array.dtype.kind in "fiu":
    array = array.copy()
    values = (0, -1, 1e-300, 1e30, 1e300, 40.0, np.nan, np.inf) if array.dtype.kind == "f" else (0, -1, 1, 100)
    with np.errstate(all="ignore"):
      array.reshape(-1)[rng.integers(array.size, size=int(rng.integers(1, 6)))] = pick(rng, values)
  elif how == 4 and array.ndim:
    array = array[:int(rng.integers(len(array) + 1))]
  elif how == 5 and array.dtype.kind in "fiu":
    with np.errstate(all="ignore"):
      array = array * np.asarray(pick(rng, (1000.0, 100.0, 0.0, -1.0, 1e-30, 1e30, np.nan)), np.float32)
  elif how == 6 and array.ndim > 1:
    array = array.reshape(len(array), -1) if rng.random() < 0.5 and array.size else np.swapaxes(array, 0, -1)
  elif how == 7 and array.ndim:
    array = np.repeat(array, int(rng.integers(2, 40)), axis=0)
  else:
    array = np.asarray(array)[None] if rng.random() < 0.5 else np.asfortranarray(array)
  return array


def damage_npz(rng, data):
  """Members that are missing, new, other or damaged; a bomb; damaged bytes of the archive."""
  chance = rng.random()
  if chance < 0.35:
    return damage_bytes(rng, data)
  if chance < 0.40:
    return other_file(rng, data)
  try:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
      members = {name: archive.read(name) for name in archive.namelist()}
  except Exception:
    return damage_bytes(rng, data)
  for _ in range(int(rng.integers(1, 3))):
    name = pick(rng, list(members) or ["joints.npy"])
    how = int(rng.integers(7))
    if how == 0:
      members.pop(name, None)
    elif how == 1:
      other = pick(rng, ("joints.npy", "features.npy", "x", "../../up.npy", "fps.npy", "names.npy"))
      members[other] = members.get(name, b"")
    elif how == 2:
      members[name] = bomb_of(rng)
    elif how == 3:
      values = "", "x", "[]", "{}", "[[1]]", '{"id": 5}', "nan", "[" * 20_000, *NUMBERS[:6]
      members[name] = npy_bytes(np.array(pick(rng, values)))
    else:
      members[name] = damage_npy(rng, members.get(name, b""))
  file = io.BytesIO()
  packing = pick(rng, (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2))
  with zipfile.ZipFile(file, "w", packing) as archive:
    for name, content in members.items():
      archive.writestr(name, content)
  return file.getvalue()


def bomb_of(rng):
  """A .npy of zeros that compresses to a thousandth: 64 MiB inside the archive of a case, 3 GB where it only lies."""
  count = 1 << 24
  header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({pick(rng, (count, 3 * 10**8))},), }}".encode()
  return b"\x93NUMPY\x01\0" + len(header).to_bytes(2, "little") + header + bytes(4 * (1 << 20))


@functools.cache
def _packed_zeros(block, count, start):
  """(packed bytes, checksum) of start and of blocks of zeros behind it, which are never held."""
  packer, crc = zlib.compressobj(9, zlib.DEFLATED, -15), zlib.crc32(start)
  first, again = (packer.compress(part) + packer.flush(zlib.Z_FULL_FLUSH) for part in (start, bytes(block)))
  for _ in range(count):
    crc = zlib.crc32(bytes(block), crc)
  return first + again * count + packer.flush(), crc


def deflated_bomb(members):
  """A .npz whose every member unpacks to 768 MiB of zeros, a thousand times its own, as joints of a motion."""
  block, count = 1 << 24, 48
  rows = (count * block - 128) // 264  # numpy's header takes 128 bytes, a frame of 22 joints 264
  header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({rows}, 22, 3), }}".encode().ljust(118)
  start = b"\x93NUMPY\x01\0" + len(header).to_bytes(2, "little") + header
  packed, crc = _packed_zeros(block, count, start)
  file, central = b"", b""
  for name in map(str.encode, members):
    fields = 20, 0, 8, 0, 0x21, crc, len(packed), len(start) + count * block, len(name), 0
    central += struct.pack("<4sH5H3L2H3H2L", b"PK\x01\x02", 20, *fields, 0, 0, 0, 0, len(file)) + name
    file += struct.pack("<4s5H3L2H", b"PK\x03\x04", *fields) + name + packed
  return file + central + struct.pack("<4s4H2LH", b"PK\x05\x06", 0, 0, *[len(members)] * 2, len(central), len(file), 0)


# --- JSON inside of binary files -------------------------------------------------------------------------------------


def damage_glb(rng, data):
  """Another JSON chunk of a binary glTF, numbers of its buffer, or bytes anywhere."""
  size = int.from_bytes(data[12:16], "little")
  if rng.random() < 0.3 or not 0 < size <= len(data) - 20:
    return damage_bytes(rng, data)
  text, rest = data[20:20 + size], data[20 + size:]
  if rng.random() < 0.8:
    text = damage_json(rng, text)
  else:
    values = struct.pack("<f", pick(rng, (0, -1, 1e30, float("nan"), float("inf"), 1e-30)))
    at = 8 + 4 * int(rng.integers(max(len(rest) // 4 - 2, 1)))
    rest = rest[:at] + values + rest[at + 4:]
  text += b" " * (-len(text) % 4)
  total = pick(rng, (20 + len(text) + len(rest),) * 20 + (0, 2**32 - 1))
  return data[:8] + struct.pack("<II", total, len(text)) + data[16:20] + text + rest


def damage_safetensors(rng, data):
  """Another JSON header, or bytes anywhere."""
  size = int.from_bytes(data[:8], "little")
  if rng.random() < 0.3 or not 0 < size <= len(data) - 8:
    return damage_bytes(rng, data)
  header = damage_json(rng, data[8:8 + size])
  return len(header).to_bytes(8, "little") + header + data[8 + size:]


def damage_zip(rng, data):
  """Members of a zip that are damaged, gone or of another name; bytes anywhere."""
  if rng.random() < 0.3:
    return damage_bytes(rng, data)
  with zipfile.ZipFile(io.BytesIO(data)) as archive:
    members = {name: archive.read(name) for name in archive.namelist()}
  name, file = pick(rng, list(members)), io.BytesIO()
  content = members.pop(name)
  if rng.random() < 0.9:
    other = pick(rng, WORDS[1:]).encode("utf-8", "replace").decode().replace("\0", "x")
    members[name if rng.random() < 0.9 else other] = damage_bytes(rng, content)
  with zipfile.ZipFile(file, "w", pick(rng, (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED))) as archive:
    for name, content in members.items():
      archive.writestr(name, content)
  return file.getvalue()


# --- by name -----------------------------------------------------------------------------------------------------


def damage(rng, name, data):
  """Damage that fits the kind of file, and now and then one that does not."""
  if rng.random() < 0.05:
    return other_file(rng, data)
  for ending, damaging in ((".npz", damage_npz), (".npy", damage_npy), (".safetensors", damage_safetensors),
                           (".glb", damage_glb), (".vrm", damage_glb), (".vrma", damage_glb), (".pt", damage_zip),
                           (".c3d", damage_bytes)):
    if name.endswith(ending):
      return damaging(rng, data)
  if name.endswith((".json", ".jsonl")):
    return damage_json(rng, data) if rng.random() < 0.7 else damage_text(rng, data)
  return damage_text(rng, data) if rng.random() < 0.8 else damage_bytes(rng, data)
