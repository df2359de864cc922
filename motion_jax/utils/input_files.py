"""Readers for files of the user that cannot be trusted: .npy, .npz, safetensors, JSON.

Headers and directories are read before data. An array is allocated only if the file has as many bytes as its header
states, a compressed one only up to a limit that real data does not reach; only the requested members of an archive are
read; nothing is unpickled. A fault of a file raises one `InputError` that names it.
"""
import ast
import json
import math
import pathlib
import re
import sys
import zipfile

import numpy as np
from safetensors import safe_open

from motion_jax.utils import text_files
from motion_jax.utils.errors import InputError, reading, reason

NUMBERS, TEXTS = "biuf", "US"
_MAX_DIMS = 8
_MAX_SHARDS = 1_000
_MAX_HEADER = 10_000
# Joints compress to a half or a tenth; a million times the same frame is no motion.
_FREE_BYTES, _MAX_RATIO = 1 << 28, 20
_COPY = "it may be cut or damaged: copy or make it again"
INDEX = "index.json"  # how the name of a list of shards ends
_SHARD = re.compile(r"(?P<name>.+)-\d{5}-of-(?P<count>\d{5})\.safetensors")


class PickledError(InputError):
  """For a file of pickled Python objects, which is not opened."""


# --- .npy --------------------------------------------------------------------------------------------------------


def load_npy(path, kinds=NUMBERS) -> np.ndarray:
  """The array of a .npy file. kinds: letters of the numpy dtypes that are taken, numbers by default.

  Raises FileNotFoundError, or InputError for a file that is cut, damaged, pickled, or holds something else.
  """
  path = _there(path)
  with reading(path), open(path, "rb") as file:
    shape, fortran, dtype = _header(file, path, kinds)
    _check_size(path, shape, dtype, path.stat().st_size - file.tell())
    return _data(file, path, shape, fortran, dtype)


def npy_shape(path) -> tuple[int, ...]:
  """The shape that the header of a .npy file tells, after the checks of `load_npy`; its data stays unread."""
  path = _there(path)
  with reading(path), open(path, "rb") as file:
    shape, _, dtype = _header(file, path, NUMBERS)
    _check_size(path, shape, dtype, path.stat().st_size - file.tell())
    return shape


# --- .npz --------------------------------------------------------------------------------------------------------


def npz_names(path) -> list[str]:
  """The names of the arrays in a .npz file, from its directory alone."""
  path = _there(path)
  with reading(path), zipfile.ZipFile(path) as archive:
    return [name.removesuffix(".npy") for name in archive.namelist()]


def load_npz(path, numbers=(), texts=(), required=()) -> dict[str, np.ndarray]:
  """The named arrays of a .npz file, as far as it holds them; no other member is read.

  numbers, texts: names of arrays of numbers and of strings; required: those that must be there. Raises
  FileNotFoundError, or InputError for a file that is cut or damaged, lacks what is required, holds another kind of
  values, or would unpack to more than 20 times its size (256 MiB are free).
  """
  path = _there(path)
  with reading(path), zipfile.ZipFile(path) as archive:
    members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
    missing = [name for name in required if name not in members]
    if missing:
      raise InputError(f"{path} lacks {', '.join(missing)}; it holds {_some(members) or 'nothing'}")
    wanted = {name: members[name] for name in (*numbers, *texts) if name in members}
    unpacked, packed = (sum(sizes) for sizes in zip((0, 0), *((i.file_size, i.compress_size) for i in wanted.values())))
    if unpacked > _FREE_BYTES + _MAX_RATIO * min(packed, path.stat().st_size):
      raise InputError(f"{path} is refused: its {packed} bytes would unpack to {unpacked}, which no motion does; write "
                       "it again")
    return {name: _member(archive, info, f"{path}: {name!r}", NUMBERS if name in numbers else TEXTS)
            for name, info in wanted.items()}


def _member(archive, info, what, kinds):
  with reading(what), archive.open(info) as file:
    shape, fortran, dtype = _header(file, what, kinds)
    _check_size(what, shape, dtype, info.file_size - file.tell())
    array = _data(file, what, shape, fortran, dtype)
    while file.read(1 << 16):  # to the end, where zipfile compares the checksum
      pass
    return array


# --- what both are made of ---------------------------------------------------------------------------------------


def _there(path):
  path = pathlib.Path(path)
  if not path.is_file():
    raise FileNotFoundError(f"there is no file {path}")
  return path


def _header(file, what, kinds):
  """(shape, whether columns come first, dtype) of an array in numpy's format, each checked."""
  start = file.read(8)
  if start[:6] != b"\x93NUMPY":
    raise InputError(f"{what} is no array in numpy's format; {_COPY}" if start[:1] != b"\x80" else
                     f"{what} is a pickle, which could run code and is not opened; save it with numpy.save")
  wide = start[6] > 1
  size = int.from_bytes(file.read(4 if wide else 2), "little")
  if size > _MAX_HEADER:
    raise InputError(f"{what} has a header of {size} bytes; {_COPY}")
  try:
    text = re.sub(r"(?<=\d)L\b", "", file.read(size).decode("latin1"))  # Python 2 wrote (10L, 3L)
    header = ast.literal_eval(text.strip())
    shape, fortran, descr = header["shape"], header["fortran_order"], header["descr"]
    dtype = np.dtype(descr)
  except Exception as error:  # a flipped bit makes any text of it
    raise InputError(f"{what} has a header that says nothing ({reason(error, 60)}); {_COPY}") from error
  if not isinstance(shape, tuple) or len(shape) > _MAX_DIMS or not all(
      type(count) is int and 0 <= count < 1 << 40 for count in shape):
    raise InputError(f"{what} has the shape {str(shape)[:60]}; {_COPY}")
  if dtype.hasobject:
    raise PickledError(f"{what} holds Python objects, which are pickled and not opened, as that could run code; save "
                       "plain numbers with numpy.save")
  if dtype.kind not in kinds or not dtype.itemsize:
    expected = "numbers" if kinds == NUMBERS else "text"
    raise InputError(f"{what} holds {str(dtype)[:60]} values, expected {expected}; save them with numpy.save as such")
  return shape, bool(fortran), dtype


def _check_size(what, shape, dtype, there):
  expected = math.prod(shape) * dtype.itemsize
  if expected > there:
    raise InputError(f"{what} should hold {expected} bytes ({shape} of {dtype}) and has {there}; {_COPY}")


def _data(file, what, shape, fortran, dtype):
  buffer, left = bytearray(), math.prod(shape) * dtype.itemsize
  while left and (block := file.read(min(left, 1 << 24))):  # grows with what comes, not with what was announced
    buffer += block
    left -= len(block)
  if left:
    raise InputError(f"{what} ends {left} bytes early; {_COPY}")
  if buffer and dtype.kind == "U" and (np.frombuffer(buffer, dtype.byteorder + "u4") > sys.maxunicode).any():
    raise InputError(f"{what} holds text that is damaged; {_COPY}")  # Python cannot make a string of it
  array = np.frombuffer(buffer, dtype).reshape(shape[::-1] if fortran else shape)
  return array.T if fortran else array


def _some(names, most=8):
  names = sorted(map(str, names))
  return ", ".join(name[:40] for name in names[:most]) + (", ..." if len(names) > most else "")


# --- safetensors, JSON -------------------------------------------------------------------------------------------


def load_safetensors(path, keep=lambda name: True, advice=_COPY) -> dict[str, np.ndarray]:
  """{name: float32 array} of those tensors of a safetensors file, or of all shards of one, that are wanted.

  Raises FileNotFoundError, or InputError for a file that is cut or damaged.
  """
  arrays: dict[str, np.ndarray] = {}
  for part in shards(path):
    with reading(part, advice), safe_open(str(part), "numpy") as file:
      names = [name for name in file.keys() if keep(name)]
      if twice := [name for name in names if name in arrays]:
        raise InputError(f"{twice[0]} is in {part.name} and in another shard beside it; {advice}")
      arrays |= {name: np.asarray(file.get_tensor(name), np.float32) for name in names}
  return arrays


def shards(path) -> list[pathlib.Path]:
  """The files that hold the tensors of a safetensors file: itself; those that NAME.index.json lists; or, of one of
  NAME-00001-of-0000N.safetensors, all N beside it.

  Raises FileNotFoundError with those that are missing, or InputError for an index of another form.
  """
  path = _there(path)
  part = _SHARD.fullmatch(path.name)
  if part:
    count = int(part["count"])
    names = {f"{part['name']}-{i:05d}-of-{part['count']}.safetensors" for i in range(1, min(count, _MAX_SHARDS) + 1)}
  elif path.name.endswith(INDEX):
    names = read_json(path, advice="fetch it again").get("weight_map")
    names = set(names.values()) if isinstance(names, dict) else {None}
    if not names or not all(isinstance(name, str) and name == pathlib.PurePath(name).name for name in names):
      raise InputError(f"{path} lists no shards: expected weight_map, an object of tensors and of files beside it; "
                       "fetch it again")
  else:
    return [path]
  missing = sorted(name for name in names if not (path.parent / name).is_file())
  if missing:
    raise FileNotFoundError(f"{path} is a part of {len(names)} files, of which {len(missing)} are missing in "
                            f"{path.parent}: {_some(missing)}; fetch them, too")
  return [path.parent / name for name in sorted(names)]


def tensor_sizes(path, advice=_COPY) -> dict[str, int]:
  """{name: how many numbers} of the tensors of a safetensors file, from its header alone."""
  path = _there(path)
  with reading(path, advice), safe_open(str(path), "numpy") as file:
    return {name: math.prod(file.get_slice(name).get_shape()) for name in file.keys()}


def read_json(path, kind=dict, advice=_COPY):
  """The value of a JSON file, of the given kind: dict, list, or a tuple of such.

  Raises FileNotFoundError, or InputError that names the line.
  """
  value = parse_json(text_files.read_text(path), path, advice)
  if not isinstance(value, kind):
    expected = " or ".join({dict: "an object", list: "a list"}.get(accepted, accepted.__name__) for accepted in (
        kind if isinstance(kind, tuple) else (kind,)))
    raise InputError(f"{path} holds a JSON {_called(value)}, expected {expected}; {advice}")
  return value


def read_json_lines(path) -> list[tuple[int, dict]]:
  """[(line number, object)] of a file with a JSON object a line. Raises as `read_json`."""
  lines = text_files.read_lines(path)
  return [(number, json_row(line, path, number)) for number, line in enumerate(lines, 1) if line.strip()]


def json_row(line, path, number) -> dict:
  """The object on a line of a JSONL file."""
  row = parse_json(line, path, "each line is a JSON object", number)
  if not isinstance(row, dict):
    raise InputError(f"{path} line {number}: got a JSON {_called(row)}, expected an object")
  return row


def parse_json(text, path, advice=_COPY, first=1):
  """The value of a JSON text that begins on line `first` of a file. Raises InputError with the line."""
  try:
    value = json.loads(text)
    whole = text_files.is_text(value)
  except json.JSONDecodeError as error:
    raise InputError(f"{path} line {first + error.lineno - 1}: no valid JSON ({error.msg}); {advice}") from None
  except (ValueError, RecursionError) as error:  # a number of 5000 digits, a thousand brackets
    raise InputError(f"{path} line {first}: no valid JSON ({reason(error, 80)}); {advice}") from None
  if not whole:
    raise InputError(f"{path} line {first}: a text holds half of a character (\\ud800 to \\udfff alone); {advice}")
  return value


def _called(value):
  return {dict: "object", list: "list", str: "text", bool: "truth value", type(None): "null"}.get(type(value), "number")
