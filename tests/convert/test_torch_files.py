"""PyTorch's files are read without PyTorch: every dtype, view and shared storage; and no file can run anything."""
import collections
import io
import os
import pickle
import subprocess
import zipfile

import numpy as np
import pytest

from motion_jax.convert import torch_files
from motion_jax.convert.state import load_checkpoint
from motion_jax.utils.errors import InputError


class Stored:
  """Stands for a storage in a pickle that a test writes."""

  def __init__(self, key, kind, count):
    self.saved = ("storage", torch_files.Name("torch", kind), key, "cpu", count)


class Global:
  """Stands for a name in a pickle: pickled as that global, whatever it is."""

  def __init__(self, module, name):
    self.module, self.name = module, name


class Call:
  """Stands for a call of a name with arguments."""

  def __init__(self, called, *args):
    self.called, self.args = called, args

  def __reduce__(self):
    return self.called, self.args


class Writer(pickle._Pickler):
  """The pickler in Python, with names and storages as PyTorch writes them."""

  def persistent_id(self, obj):
    return obj.saved if isinstance(obj, Stored) else None

  def save_name(self, obj):
    self.write(pickle.GLOBAL + f"{obj.module}\n{obj.name}\n".encode())

  dispatch = dict(pickle._Pickler.dispatch)
  dispatch[Global] = save_name
  dispatch[torch_files.Name] = save_name

  def save_reduce(self, func, args, state=None, *rest, obj=None, **named):
    if isinstance(obj, Call) and isinstance(func, Global):
      self.save_name(func)
      self.save(args)
      self.write(pickle.REDUCE)
      return
    super().save_reduce(func, args, state, *rest, obj=obj, **named)


def tensor(key, kind, shape, strides=None, offset=0, count=None):
  strides = tuple(int(np.prod(shape[i + 1:])) for i in range(len(shape))) if strides is None else strides
  count = int(np.prod(shape)) if count is None else count
  return Call(Global("torch._utils", "_rebuild_tensor_v2"), Stored(key, kind, count), offset, shape, strides, False,
              collections.OrderedDict())


def write(path, content, storages=(), protocol=2, compression=zipfile.ZIP_STORED):
  """A checkpoint with a description of content, or the bytes of one, and storages {key: array or bytes}."""
  if not isinstance(content, bytes):
    data = io.BytesIO()
    Writer(data, protocol).dump(content)
    content = data.getvalue()
  with zipfile.ZipFile(path, "w", compression) as archive:
    archive.writestr("archive/data.pkl", content)
    archive.writestr("archive/version", "3\n")
    for key, data in dict(storages).items():
      archive.writestr(f"archive/data/{key}", bytes(data) if isinstance(data, bytes) else data.tobytes())
  return path


NUMBERS = {"DoubleStorage": "f8", "FloatStorage": "f4", "HalfStorage": "f2", "LongStorage": "i8", "IntStorage": "i4",
           "ShortStorage": "i2", "CharStorage": "i1", "ByteStorage": "u1", "BoolStorage": "?"}


@pytest.mark.parametrize("kind", NUMBERS)
def test_every_dtype(tmp_path, kind):
  array = np.array([[0, 1, 1], [1, 0, 1]], NUMBERS[kind])
  path = write(tmp_path / "a.pt", {"net": collections.OrderedDict(w=tensor("0", kind, (2, 3))), "it": 3}, {"0": array})
  loaded = torch_files.load(path)
  assert loaded["it"] == 3 and loaded["net"]["w"].dtype == array.dtype
  np.testing.assert_array_equal(loaded["net"]["w"], array)
  number, _ = load_checkpoint(write(tmp_path / "n.pt", {"n": tensor("0", kind, (), (), 1, 6)}, {"0": array}))
  assert number["n"].shape == ()
  state, plain = load_checkpoint(path)
  assert plain == {"it"} and state["net/w"].dtype == np.float32


def test_views_shared_storages_and_empty_tensors(tmp_path):
  data = np.arange(12, dtype=np.float32)
  loaded = torch_files.load(write(tmp_path / "a.pt", {
      "whole": tensor("0", "FloatStorage", (3, 4)), "turned": tensor("0", "FloatStorage", (4, 3), (1, 4), 0, 12),
      "column": tensor("0", "FloatStorage", (3,), (4,), 2, 12), "none": tensor("1", "FloatStorage", (0, 4)),
      "number": tensor("0", "FloatStorage", (), (), 7, 12),
      "spread": tensor("0", "FloatStorage", (2, 3), (0, 1), 0, 12),
      "param": Call(Global("torch._utils", "_rebuild_parameter"), tensor("0", "FloatStorage", (12,)), True, {})},
      {"0": data, "1": b""}))
  whole = data.reshape(3, 4)
  for name, expected in dict(whole=whole, turned=whole.T, column=whole[:, 2], none=np.zeros((0, 4)), number=data[7],
                             spread=np.tile(data[:3], (2, 1)), param=data).items():
    np.testing.assert_array_equal(loaded[name], expected, err_msg=name)


def test_numbers_that_scripts_keep_beside_their_weights(tmp_path):
  scalar = Call(Global("numpy.core.multiarray", "scalar"), Call(Global("numpy", "dtype"), "f8", False, True),
                Call(Global("_codecs", "encode"), np.float64(0.25).tobytes().decode("latin1"), "latin1"))
  loaded = torch_files.load(write(tmp_path / "a.pt", {"best_fid": scalar, "milestones": Call(
      Global("collections", "Counter"), {5: 1}), "lr": [2e-4, None, True, "x", (1, 2)]}))
  assert loaded == {"best_fid": 0.25, "milestones": {5: 1}, "lr": [2e-4, None, True, "x", (1, 2)]}



class Calls:
  """Pickled as a call."""

  def __init__(self, *call):
    self.call = call

  def __reduce__(self):
    return self.call


HOSTILE = {
    "os.system": (lambda: pickle.dumps({"a": Calls(os.system, ("touch ran",))}, 2), r"(posix|nt)\.system"),
    "eval": (lambda: pickle.dumps({"a": Calls(eval, ("open('ran', 'w').close()",))}, 2), r"eval"),
    "subprocess.Popen": (lambda: pickle.dumps({"a": Calls(subprocess.Popen, (["touch", "ran"],))}, 4),
                         r"subprocess\.Popen"),
    "getattr": (lambda: pickle.dumps(getattr, 4), r"builtins\.getattr"),
    "torch.load": (lambda: b"\x80\x02ctorch\nload\nX\x01\x00\x00\x00a\x85R.", r"torch\.load"),
    "a name of a known module": (lambda: b"\x80\x02ctorch._utils\n_import_dotted_name\nX\x01\x00\x00\x00a\x85R.",
                                 r"torch\._utils\._import_dotted_name"),
    "a name with dots": (lambda: b"\x80\x04\x8c\x0bcollections\x8c\x14OrderedDict.__init__\x93.",
                         r"collections\.OrderedDict\.__init__"),
    "INST": (lambda: b"\x80\x02(X\x09\x00\x00\x00touch raniposix\nsystem\n.", "opcode INST"),
    "OBJ": (lambda: b"\x80\x02(ctorch\nSize\n)o.", "opcode OBJ"),
    "NEWOBJ": (lambda: b"\x80\x02ccollections\nOrderedDict\n)\x81.", "opcode NEWOBJ"),
    "EXT1": (lambda: b"\x80\x02\x82\x01.", "opcode EXT1"),
    "BUILD of a dict": (lambda: b"\x80\x02}}b.", "opcode BUILD changes a dict"),
    "a call of a value": (lambda: b"\x80\x02X\x01\x00\x00\x00a)R.", "calls str"),
    "a storage that is none": (lambda: b"\x80\x02X\x01\x00\x00\x00aQ.", "persistent object is a str"),
    "a stack that is empty": (lambda: b"\x80\x02R.", "no whole PyTorch checkpoint"),
    "an end that is missing": (lambda: b"\x80\x02}q\x00", "no whole PyTorch checkpoint"),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_pickles_are_refused_by_name_and_run_nothing(tmp_path, monkeypatch, name):
  monkeypatch.chdir(tmp_path)
  make, message = HOSTILE[name]
  with pytest.raises(InputError, match=message) as error:
    torch_files.load(write(tmp_path / "a.pt", make()))
  assert "\n" not in str(error.value) and len(str(error.value)) < 500
  assert not (tmp_path / "ran").exists()


SIZES = {
    "more numbers than the storage has": tensor("0", "FloatStorage", (100,), None, 0, 4),
    "a negative stride": tensor("0", "FloatStorage", (4,), (-1,), 3, 4),
    "an offset behind the end": tensor("0", "FloatStorage", (2,), (1,), 3, 4),
    "numbers repeated without end": tensor("0", "FloatStorage", (1 << 40,), (0,), 0, 4),
    "a size that is no number": tensor("0", "FloatStorage", ("a",), (1,), 0, 4),
    "a storage shorter than it says": tensor("0", "FloatStorage", (4,), (1,), 0, 400),
    "a storage that is not there": tensor("7", "FloatStorage", (4,)),
    "a storage of unknown type": tensor("0", "StrangeStorage", (4,)),
    "a number of a million digits": 1 << 3_000_000,
    # Each within bounds, all together far larger than the file.
    "many repetitions": [tensor("0", "FloatStorage", (1 << 24,), (0,), 0, 4) for _ in range(8)],
}


def nested(depth):
  """A tuple of itself twice, `depth` times over: hashing it takes 2^depth steps."""
  return b"\x80\x02}(" + b")" + b"".join(b"q%ch%c\x86" % (i, i) for i in range(depth)) + b"K\x01u."


@pytest.mark.parametrize("data", [nested(60), b"\x80\x04\x8f(" + nested(60)[4:-4] + b"\x90."])
def test_keys_that_take_for_ever_to_hash_are_refused(data, tmp_path):
  with pytest.raises(InputError, match="has a tuple as a key"):
    torch_files.load(write(tmp_path / "a.pt", data))


def test_encrypted_archives_and_parts_inside_one_another_are_refused(tmp_path):
  path = write(tmp_path / "a.pt", {"a": 1}, {"0": bytes(64)})
  data = bytearray(path.read_bytes())
  place = data.index(b"PK\x01\x02")  # the first entry of the directory
  data[place + 8] |= 1
  (tmp_path / "encrypted.pt").write_bytes(data)
  with pytest.raises(InputError, match="encrypted zip"):
    torch_files.load(tmp_path / "encrypted.pt")
  data = bytearray(path.read_bytes())
  for offset in (20, 24):  # sizes of a part, compressed and not
    data[place + offset:place + offset + 4] = (1 << 20).to_bytes(4, "little")
  (tmp_path / "inside.pt").write_bytes(data)
  with pytest.raises(InputError, match="inside one another"):
    torch_files.load(tmp_path / "inside.pt")


@pytest.mark.parametrize("name", SIZES)
def test_sizes_that_cannot_be_are_refused(tmp_path, name):
  with pytest.raises(InputError):
    torch_files.load(write(tmp_path / "a.pt", {"a": SIZES[name]}, {"0": np.zeros(4, np.float32)}))


def test_entries_without_end_and_zips_that_grow_are_refused(tmp_path):
  bomb = b"\x80\x02" + b"}q\x00" + b"".join(
      b"}q%c(X\x01\x00\x00\x00ah%cX\x01\x00\x00\x00bh%cu" % (i + 1, i, i) for i in range(60)) + b"."
  with pytest.raises(ValueError, match="nests its entries without end"):
    load_checkpoint(write(tmp_path / "bomb.pt", bomb))
  with pytest.raises(ValueError, match="nests its entries without end"):
    load_checkpoint(write(tmp_path / "ring.pt", b"\x80\x02}q\x00X\x01\x00\x00\x00ah\x00s."))
  with pytest.raises(InputError, match="compressed zip"):
    torch_files.load(write(tmp_path / "zip.pt", {"a": 1}, {"0": bytes(10_000)}, compression=zipfile.ZIP_DEFLATED))


def test_what_is_no_checkpoint_is_told(tmp_path):
  for name, data, message in (("old.pt", pickle.dumps(0x1950a86a20f9469cfc6c, 2), "before PyTorch 1.6"),
                           ("page.pt", b"<html>", "no zip archive"), ("empty.pt", b"", "no zip archive")):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(InputError, match=message):
      torch_files.load(tmp_path / name)
  with pytest.raises(ValueError, match="holds a ndarray, expected a dict"):
    load_checkpoint(write(tmp_path / "bare.pt", tensor("0", "FloatStorage", (2,)), {"0": np.ones(2, np.float32)}))
  (tmp_path / "cut.pt").write_bytes((tmp_path / "bare.pt").read_bytes()[:-100])
  with pytest.raises(InputError, match="no whole PyTorch checkpoint"):
    torch_files.load(tmp_path / "cut.pt")
  with zipfile.ZipFile(tmp_path / "other.zip", "w") as archive:
    archive.writestr("a.txt", "a")
  with pytest.raises(InputError, match="0 files data.pkl"):
    torch_files.load(tmp_path / "other.zip")
  with zipfile.ZipFile(tmp_path / "script.pt", "w") as archive:
    archive.writestr("m/data.pkl", b".")
    archive.writestr("m/code/__torch__.py", "")
  with pytest.raises(InputError, match="TorchScript"):
    torch_files.load(tmp_path / "script.pt")


# --- files that PyTorch wrote ------------------------------------------------------------------------------------


@pytest.mark.torch
def test_what_torch_wrote(tmp_path):
  import torch
  base = torch.arange(24.0).reshape(4, 6)
  dtypes = ["float64", "float32", "float16", "bfloat16", "int64", "int32", "int16", "int8", "uint8", "bool", "uint16",
            "uint32", "float8_e4m3fn", "float8_e5m2", "complex64"]
  content = {name: torch.ones(3).to(getattr(torch, name)) for name in dtypes}
  content |= {"t": base.T, "slice": base[1:, ::2], "expand": base[:1].expand(5, 6), "scalar": base.sum(),
              "empty": torch.zeros(0, 3), "param": torch.nn.Parameter(base), "again": base, "size": base.shape}
  net = torch.nn.TransformerEncoderLayer(8, 2, 16)
  optimizer = torch.optim.AdamW(net.parameters())
  torch.save({"net": net.state_dict(), "more": content, "ep": 3, "opt": optimizer.state_dict()}, tmp_path / "a.tar")
  loaded = torch_files.load(tmp_path / "a.tar")
  for name, value in content.items():
    expected = tuple(value) if name == "size" else value.detach()
    made = loaded["more"][name]
    if name == "size":
      assert made == expected
    else:
      assert made.shape == tuple(expected.shape), name
      wide = np.complex64 if name == "complex64" else np.float64
      np.testing.assert_array_equal(made.astype(wide), expected.to(getattr(torch, wide.__name__)).numpy(), err_msg=name)
  for name, value in net.state_dict().items():
    np.testing.assert_array_equal(loaded["net"][name], value.numpy())
  assert loaded["ep"] == 3 and loaded["opt"]["param_groups"][0]["lr"] == 1e-3


@pytest.mark.torch
def test_old_files_modules_and_scripts_of_torch_are_refused(tmp_path):
  import torch
  torch.save({"a": torch.ones(2)}, tmp_path / "old.pth", _use_new_zipfile_serialization=False)
  with pytest.raises(InputError, match="before PyTorch 1.6"):
    torch_files.load(tmp_path / "old.pth")
  torch.save(torch.nn.Linear(2, 2), tmp_path / "module.pth")
  with pytest.raises(InputError, match=r"torch\.nn\.modules\.linear\.Linear"):
    torch_files.load(tmp_path / "module.pth")
  torch.jit.script(torch.nn.Linear(2, 2)).save(str(tmp_path / "script.pt"))
  with pytest.raises(InputError, match="TorchScript"):
    torch_files.load(tmp_path / "script.pt")
  torch.save({"a": torch.eye(3).to_sparse()}, tmp_path / "sparse.pth")
  with pytest.raises(InputError, match="sparse"):
    torch_files.load(tmp_path / "sparse.pth")
