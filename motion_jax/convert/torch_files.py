"""PyTorch's checkpoint files (.pt, .pth, .tar, .ckpt) as numpy arrays, without PyTorch and without running anything.

A file is a zip: `data.pkl`, which describes the objects, and `data/KEY`, the bytes of each storage. The description is
a pickle. Here its opcodes are interpreted one by one (`pickletools` splits them, `pickle` is not used), on a table of
what may be built: tensors on storages, parameters, ordered dictionaries, numbers and shapes. Everything else that a
pickle can name is refused by its name before anything is made, so a file cannot run code.
"""
import math
import os
import pickletools
import re
import tarfile
import zipfile
from collections import OrderedDict
from collections.abc import Callable
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from motion_jax.utils.errors import InputError

_REPEATED = 1 << 24  # numbers of an expanded tensor, which a few in the file stand for
_SHARED = 4          # times the size of the file that all tensors together may have: weights may be tied
_LARGEST_INT = 1 << 64
DTYPES = {
    "DoubleStorage": np.float64, "FloatStorage": np.float32, "HalfStorage": np.float16,
    "BFloat16Storage": jnp.bfloat16, "LongStorage": np.int64, "IntStorage": np.int32, "ShortStorage": np.int16,
    "CharStorage": np.int8, "ByteStorage": np.uint8, "BoolStorage": np.bool_, "ComplexFloatStorage": np.complex64,
    "ComplexDoubleStorage": np.complex128,
}
# The dtypes of untyped storages, which `_rebuild_tensor_v3` names.
TORCH_DTYPES = {
    "float64": np.float64, "float32": np.float32, "float16": np.float16, "bfloat16": jnp.bfloat16,
    "int64": np.int64, "int32": np.int32, "int16": np.int16, "int8": np.int8, "uint8": np.uint8, "bool": np.bool_,
    "uint16": np.uint16, "uint32": np.uint32, "uint64": np.uint64, "complex64": np.complex64,
    "complex128": np.complex128, "float8_e4m3fn": jnp.float8_e4m3fn, "float8_e5m2": jnp.float8_e5m2,
}


class Name(NamedTuple):
  """A global that a pickle names: known ones only."""
  module: str
  name: str

  def __str__(self) -> str:
    return f"{self.module}.{self.name}"


class Dtype(NamedTuple):
  """A dtype of numpy, of the numbers that a training script keeps beside its weights."""
  code: str


class Storage(NamedTuple):
  """The bytes of a storage; dtype None: untyped, the tensor on it says what they are.

  left: [bytes that the tensors of the file may still take], one list for all its storages.
  """
  data: bytes
  dtype: Any
  left: list[int]


def _array(storage, offset, shape, strides, dtype=None):
  """The tensor on a storage as an array of its own; sizes are checked before anything is made."""
  if dtype is None and storage.dtype is None:
    raise InputError("a tensor lies on a storage of a type that is not known; save it as one of "
                     f"{', '.join(sorted(TORCH_DTYPES))}")
  dtype = np.dtype(dtype or storage.dtype)
  sizes = (*shape, *strides, offset)
  if len(shape) != len(strides) or any(not isinstance(size, int) or size < 0 for size in sizes):
    raise InputError("a tensor has a shape, strides or an offset that are no sizes")
  count = len(storage.data) // dtype.itemsize
  past = offset + 1 + sum((size - 1) * stride for size, stride in zip(shape, strides))
  if math.prod(shape) and past > count:
    raise InputError(f"a tensor of shape {shape} needs {past} numbers of a storage of {count}")
  if math.prod(shape) > max(count, _REPEATED):  # strides of 0 repeat numbers without bound
    raise InputError(f"a tensor of shape {shape} repeats the {count} numbers of its storage")
  storage.left[0] -= math.prod(shape) * dtype.itemsize
  if storage.left[0] < 0:
    raise InputError(f"its tensors together are over {_SHARED} times as large as the file")
  # As raw bytes, for numpy has no strides of some small floats.
  flat = np.frombuffer(storage.data, f"V{dtype.itemsize}", count)
  steps = tuple(stride * dtype.itemsize for stride in strides)
  return np.array(np.lib.stride_tricks.as_strided(flat[offset:], shape, steps, writeable=False)).view(dtype)


def _rebuild_tensor(storage, offset, shape, strides, *more):
  return _array(_storage(storage), offset, tuple(shape), tuple(strides))


def _rebuild_tensor_v3(storage, offset, shape, strides, requires_grad, hooks, dtype, *more):
  if not isinstance(dtype, Name) or dtype.name not in TORCH_DTYPES:
    raise InputError(f"a tensor has the dtype {dtype if isinstance(dtype, Name) else type(dtype).__name__}")
  return _array(_storage(storage), offset, tuple(shape), tuple(strides), TORCH_DTYPES[dtype.name])


def _storage(storage):
  if not isinstance(storage, Storage):
    raise InputError(f"a tensor lies on {type(storage).__name__}, expected a storage")
  return storage


def _parameter(data, *more):
  if not isinstance(data, np.ndarray):
    raise InputError(f"a parameter holds {type(data).__name__}, expected a tensor")
  return data


def _ordered_dict(items=()):
  pairs = [tuple(pair) for pair in (items.items() if isinstance(items, dict) else items)]
  _keys([pair[0] for pair in pairs])
  return OrderedDict(pairs)


def _dtype(code, *more):
  if not isinstance(code, str) or not re.fullmatch(r"[<|=]?[fiub][1248]", code):
    raise InputError("a number has a dtype of numpy other than integers, floats and booleans")
  return Dtype(code)


def _scalar(dtype, data):
  if not isinstance(dtype, Dtype) or not isinstance(data, bytes):
    raise InputError(f"a number is made of {type(dtype).__name__} and {type(data).__name__}")
  return np.frombuffer(data, dtype.code, 1)[0].item()


def _encode(text, encoding="latin1"):
  if encoding != "latin1":
    raise InputError("bytes are encoded in another way than pickle's own")
  return text.encode("latin1")


# What a pickle may call, and what comes of it.
CALLS: dict[Name, Callable[..., Any]] = {
    Name("torch._utils", "_rebuild_tensor"): _rebuild_tensor,
    Name("torch._utils", "_rebuild_tensor_v2"): _rebuild_tensor,
    Name("torch._utils", "_rebuild_tensor_v3"): _rebuild_tensor_v3,
    Name("torch._utils", "_rebuild_parameter"): _parameter,
    Name("collections", "OrderedDict"): _ordered_dict,
    Name("collections", "Counter"): lambda items=(): dict(_ordered_dict(items)),
    Name("torch", "Size"): lambda items=(): tuple(items),
    Name("numpy", "dtype"): _dtype,
    Name("numpy.core.multiarray", "scalar"): _scalar,
    Name("numpy._core.multiarray", "scalar"): _scalar,
    Name("_codecs", "encode"): _encode,
}
# Names that stand for themselves: the types of storages, dtypes.
PLAIN = {Name("torch", name) for name in (*DTYPES, *TORCH_DTYPES)} | {
    Name("torch.storage", "UntypedStorage"), Name("torch", "UntypedStorage"), Name("torch", "Tensor"),
    Name("torch.nn.parameter", "Parameter"), Name("torch.serialization", "_get_layout")}


def load(path: str | os.PathLike) -> Any:
  """What a checkpoint holds: dictionaries, lists and numbers as they are, tensors as numpy arrays.

  Raises InputError for a file that is no such zip, is damaged, or names anything but tensors and plain values.
  """
  if not zipfile.is_zipfile(path):
    with open(path, "rb") as file:
      start = file.read(16)
    if start[:1] == b"\x80" or tarfile.is_tarfile(path):
      raise InputError(f"{path} is a checkpoint from before PyTorch 1.6, whose parts are several pickles; save it "
                       "again with a current PyTorch, torch.save(torch.load(old, weights_only=True), new)")
    raise InputError(f"{path} is no whole PyTorch checkpoint (no zip archive); fetch it again")
  try:
    with zipfile.ZipFile(path) as archive:
      return _load_zip(archive, path)
  except InputError as error:
    message = str(error)
    if not message.startswith(str(path)):
      message = f"{path} {message[3:]}" if message.startswith("it ") else f"{path}: {message}"
    raise InputError(message) from error
  except (zipfile.BadZipFile, zipfile.LargeZipFile, EOFError, ValueError, KeyError, IndexError, TypeError,
          UnicodeDecodeError, OverflowError, RecursionError, AttributeError, NotImplementedError, OSError) as error:
    raise InputError(f"{path} is no whole PyTorch checkpoint ({type(error).__name__}); fetch it again") from error


def _load_zip(archive, path):
  names = archive.namelist()
  pickles = [name for name in names if name == "data.pkl" or name.endswith("/data.pkl")]
  if len(pickles) != 1:
    raise InputError(f"{path} is a zip with {len(pickles)} files data.pkl, expected one; it is no PyTorch checkpoint")
  root = pickles[0][:-len("data.pkl")]
  if f"{root}constants.pkl" in names or any(name.startswith(f"{root}code/") for name in names):
    raise InputError(f"{path} is a TorchScript archive, which holds programs; save module.state_dict() instead")
  members, size = archive.infolist(), os.path.getsize(path)
  if any(info.compress_type != zipfile.ZIP_STORED for info in members):
    raise InputError(f"{path} is a compressed zip, which PyTorch does not write; it may unpack to more than it holds")
  if any(info.flag_bits & 1 for info in members):
    raise InputError(f"{path} is an encrypted zip, which PyTorch does not write; unpack it and save it again")
  if sum(info.file_size for info in members) > size:
    raise InputError(f"{path} holds parts that lie inside one another; fetch it again")
  order = f"{root}byteorder"
  if order in names and archive.read(order).strip() not in (b"little", b""):
    raise InputError(f"{path} was written on a machine of the other byte order; save it again on a usual one")
  kept: dict[str, bytes] = {}
  left = [_SHARED * size + 4 * _REPEATED]

  def storage_of(saved):
    if not isinstance(saved, tuple) or len(saved) != 5 or saved[0] != "storage":
      raise InputError(f"a persistent object is a {type(saved).__name__}, expected a storage")
    _, kind, key, _, count = saved
    if not isinstance(kind, Name) or not isinstance(key, str):
      raise InputError(f"a storage is of the type {type(kind).__name__}, expected one of PyTorch's")
    if key not in kept:
      kept[key] = archive.read(f"{root}data/{key}")
    dtype = DTYPES.get(kind.name)
    expected = count * (1 if dtype is None else np.dtype(dtype).itemsize)
    if len(kept[key]) < expected:
      raise InputError(f"storage {key} holds {len(kept[key])} bytes of {expected}; fetch the file again")
    return Storage(kept[key], dtype, left)

  return interpret(archive.read(pickles[0]), storage_of)


_MARK = object()


def interpret(data: bytes, storage_of: Callable[[Any], Any]) -> Any:
  """The object that a pickle describes, of the types above; storage_of makes what it keeps outside of it.

  Opcodes that build anything else, and names outside of the tables, raise InputError.
  """
  stack: list[Any] = []
  memo: dict[int, Any] = {}

  def since_mark():
    place = max(i for i, item in enumerate(stack) if item is _MARK)
    items = stack[place + 1:]
    del stack[place:]
    return items

  for opcode, argument, _ in pickletools.genops(data):
    name = opcode.name
    if name in _PUSH_ARGUMENT:
      if isinstance(argument, int) and abs(argument) >= _LARGEST_INT:
        raise InputError("it holds a whole number of over 64 bits; no checkpoint has one")
      stack.append(argument)
    elif name in _CONSTANTS:
      stack.append(_CONSTANTS[name]())
    elif name in ("PROTO", "FRAME"):
      continue
    elif name == "STOP":
      return stack.pop()
    elif name == "MARK":
      stack.append(_MARK)
    elif name == "POP":
      stack.pop()
    elif name == "POP_MARK":
      since_mark()
    elif name == "DUP":
      stack.append(stack[-1])
    elif name in ("PUT", "BINPUT", "LONG_BINPUT"):
      memo[argument] = stack[-1]
    elif name == "MEMOIZE":
      memo[len(memo)] = stack[-1]
    elif name in ("GET", "BINGET", "LONG_BINGET"):
      stack.append(memo[argument])
    elif name == "TUPLE":
      stack.append(tuple(since_mark()))
    elif name in ("TUPLE1", "TUPLE2", "TUPLE3"):
      count = int(name[-1])
      items = tuple(stack[-count:])
      del stack[-count:]
      stack.append(items)
    elif name == "LIST":
      stack.append(since_mark())
    elif name == "DICT":
      items = since_mark()
      stack.append(dict(zip(_keys(items[::2]), items[1::2])))
    elif name == "FROZENSET":
      stack.append(frozenset(_keys(since_mark())))
    elif name == "APPEND":
      item = stack.pop()
      _plain(stack[-1], list, name).append(item)
    elif name == "APPENDS":
      items = since_mark()
      _plain(stack[-1], list, name).extend(items)
    elif name == "ADDITEMS":
      items = since_mark()
      _plain(stack[-1], set, name).update(_keys(items))
    elif name == "SETITEM":
      value, key = stack.pop(), stack.pop()
      _plain(stack[-1], dict, name).update(zip(_keys([key]), [value]))
    elif name == "SETITEMS":
      items = since_mark()
      _plain(stack[-1], dict, name).update(zip(_keys(items[::2]), items[1::2]))
    elif name == "GLOBAL":
      stack.append(_known(*argument.split(" ", 1)))
    elif name == "STACK_GLOBAL":
      attribute, module = stack.pop(), stack.pop()
      stack.append(_known(module, attribute))
    elif name == "REDUCE":
      arguments, called = stack.pop(), stack.pop()
      stack.append(_call(called, arguments))
    elif name == "BUILD":
      # State of an OrderedDict that torch sets, such as _metadata of a state dict: nothing of it is needed.
      stack.pop()
      _plain(stack[-1], OrderedDict | Dtype, name)
    elif name == "BINPERSID":
      stack.append(storage_of(stack.pop()))
    else:
      raise InputError(f"it uses the pickle opcode {name}, which can build objects of any kind; it is refused")
  raise InputError("its description ends too early; fetch it again")


_PUSH_ARGUMENT = {
    "INT", "BININT", "BININT1", "BININT2", "LONG", "LONG1", "LONG4", "FLOAT", "BINFLOAT", "STRING", "BINSTRING",
    "SHORT_BINSTRING", "UNICODE", "BINUNICODE", "SHORT_BINUNICODE", "BINUNICODE8", "BINBYTES", "SHORT_BINBYTES",
    "BINBYTES8"}
_CONSTANTS: dict[str, Callable[[], Any]] = {
    "NONE": lambda: None, "NEWTRUE": lambda: True, "NEWFALSE": lambda: False, "EMPTY_TUPLE": tuple, "EMPTY_LIST": list,
    "EMPTY_DICT": dict, "EMPTY_SET": set}


def _known(module, name):
  found = Name(str(module), str(name))
  if found in CALLS or found in PLAIN:
    return found
  raise InputError(f"it holds a {found} besides tensors and plain values; building such a thing can run code, so it is "
                   "refused. Where you trust the file, save its tensors alone, with torch.save(state_dict) or "
                   "safetensors, and convert that")


def _call(called, arguments):
  if not isinstance(called, Name) or called not in CALLS or not isinstance(arguments, tuple):
    raise InputError(f"it calls {called if isinstance(called, Name) else type(called).__name__}, which is refused")
  return CALLS[called](*arguments)


def _keys(items):
  """Keys of a dictionary or members of a set: plain ones, for nested tuples can take for ever to hash."""
  for item in items:
    if not isinstance(item, str | int | float | bool | None | Name):
      raise InputError(f"it has a {type(item).__name__} as a key, expected texts or numbers; no checkpoint has one")
  return items


def _plain(value, kind, opcode):
  if not isinstance(value, kind):
    raise InputError(f"the opcode {opcode} changes a {type(value).__name__}, which is refused")
  return value
