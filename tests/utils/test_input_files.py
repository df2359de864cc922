"""Files of other people: headers are believed as far as the file bears them out, damage is one line, bombs stay packed,
and only what is needed is read."""
import json
import tracemalloc
import zipfile

import numpy as np
import pytest
from safetensors.numpy import save_file

from motion_jax import export
from motion_jax.data import doctor
from motion_jax.data.datasets.archive import read_archive
from motion_jax.utils.errors import InputError, reading
from motion_jax.utils.input_files import (
  load_npy,
  load_npz,
  load_safetensors,
  npy_shape,
  npz_names,
  read_json,
  shards,
)
from tests.data.test_build import write_archive
from tests.fuzz_damage import deflated_bomb


def _header(descr="<f4", shape="(10, 22, 3)", data=b"", version=1):
  text = f"{{'descr': {descr!r}, 'fortran_order': False, 'shape': {shape}, }}".encode("latin1")
  return b"\x93NUMPY" + bytes([version, 0]) + len(text).to_bytes(2 if version == 1 else 4, "little") + text + data


def _one_line(error):
  text = str(error.value)
  return isinstance(error.value, InputError) and len(text.split("\n")) == 1 and text


@pytest.mark.parametrize("dtype, shape", [("<f4", (4, 22, 3)), (">f8", (0, 3)), ("<f2", ()), ("?", (2, 2))])
def test_numbers_come_back_as_numpy_writes_them(tmp_path, dtype, shape):
  for order in "CF":
    array = np.asarray(np.arange(np.prod(shape)).reshape(shape).astype(dtype), order=order)
    np.save(tmp_path / "a.npy", array)
    loaded = load_npy(tmp_path / "a.npy")
    assert loaded.dtype == array.dtype and np.array_equal(loaded, array) and npy_shape(tmp_path / "a.npy") == shape
    np.savez_compressed(tmp_path / "a.npz", x=array, words=np.array(["a", "bc"]))
    found = load_npz(tmp_path / "a.npz", ("x",), ("words",))
    assert np.array_equal(found["x"], array) and found["words"].tolist() == ["a", "bc"]
  assert npz_names(tmp_path / "a.npz") == ["x", "words"]


@pytest.mark.parametrize("content, words", [
    (_header(shape="(1000000000000, 22, 3)", data=b"0000"), "and has 4"),
    (_header(shape="(-1, 22, 3)"), "has the shape"), (_header(shape="(0, 99999999999999999999)"), "has the shape"),
    (_header(shape="(" * 300), "header"), (_header("<U99999999", "(3,)"), "expected numbers"),
    (_header("|O", "(1,)", b"\x80\x04N."), "pickled"), (_header(version=2)[:9], "header"),
    (b"\x93NUMPY\x02\0\xff\xff\xff\xff", "header of 4294967295 bytes"), (b"\x80\x04\x95", "pickle"),
    (b"", "no array"),
])
def test_a_lying_header_is_one_line(tmp_path, content, words):
  (tmp_path / "a.npy").write_bytes(content)
  for read in (load_npy, npy_shape):
    with pytest.raises(InputError, match="a.npy") as error:
      read(tmp_path / "a.npy")
    assert words in _one_line(error)
  with zipfile.ZipFile(tmp_path / "a.npz", "w") as file:
    file.writestr("x.npy", content)
  with pytest.raises(InputError, match="a.npz: 'x'") as error:
    load_npz(tmp_path / "a.npz", ("x",))
  assert words in _one_line(error)


@pytest.mark.parametrize("order", "<>")
def test_text_that_python_cannot_hold_is_damaged(order, tmp_path):
  """A number above the largest code point ended the program with a SystemError where the text was printed."""
  with zipfile.ZipFile(tmp_path / "a.npz", "w") as file:
    file.writestr("words.npy", _header(f"{order}U2", "(1,)", np.array([97, 0x110000], f"{order}u4").tobytes()))
  with pytest.raises(InputError, match="a.npz: 'words' holds text that is damaged"):
    load_npz(tmp_path / "a.npz", (), ("words",))


def test_a_bomb_stays_packed(tmp_path):
  """768 MiB of zeros in 0.8 MB: refused by the directory, with no memory taken, whoever reads it, and even where the
  directory says of the packed bytes that they were as many."""
  bomb = bytearray(deflated_bomb(["joints.npy"]))
  (tmp_path / "a.npz").write_bytes(bomb)
  assert len(bomb) < 1 << 20
  packed = bomb.rindex(b"PK\x01\x02") + 20
  bomb[packed:packed + 4] = (3 << 28).to_bytes(4, "little")
  (tmp_path / "lying.npz").write_bytes(bomb)
  set_ = write_archive(tmp_path / "set")
  (set_ / "motions.npz").write_bytes(deflated_bomb(["names.npy", "start.npy", "root.npy", "local.npy"]))
  tracemalloc.start()
  for read in (lambda: export.load(tmp_path / "a.npz"), lambda: load_npz(tmp_path / "lying.npz", ("joints",)),
               lambda: read_archive(set_)):
    with pytest.raises(InputError, match="would unpack to") as error:
      read()
    assert _one_line(error)
  report = doctor.examine(set_)
  assert not report.ok and "would unpack to" in doctor.format_report(report)
  assert tracemalloc.get_traced_memory()[1] < 20e6
  tracemalloc.stop()


def test_only_the_named_members_are_read(tmp_path):
  """An object array beside the joints of a motion does no harm."""
  np.savez(tmp_path / "a.npz", joints=np.zeros((5, 22, 3), np.float32), gender=np.array([{}], object))
  found = load_npz(tmp_path / "a.npz", ("joints",))
  assert list(found) == ["joints"] and found["joints"].shape == (5, 22, 3)


def test_a_flipped_bit_and_an_archive_cut_short_are_noticed(tmp_path):
  np.savez(tmp_path / "a.npz", joints=np.zeros((5, 22, 3), np.float32))
  data = bytearray((tmp_path / "a.npz").read_bytes())
  data[len(data) // 2] ^= 1
  for damaged, words in ((data, "a.npz.*CRC"), (data[:-30], "a.npz"), (data[:9], "a.npz")):
    (tmp_path / "a.npz").write_bytes(damaged)
    with pytest.raises(InputError, match=words) as error:
      load_npz(tmp_path / "a.npz", ("joints",))
    assert _one_line(error)


@pytest.mark.parametrize("text, words", [
    ("{", "line 1: no valid JSON"), ('{"a": 1,\n}', "line 2: no valid JSON"), ("[" * 100_000, "no valid JSON"),
    ('{"a": ' + "9" * 5_000 + "}", "no valid JSON"), ("[]", "a JSON list, expected an object"),
    ("null", "a JSON null"), ("", "no valid JSON"), (b"\xff\xfe\x00\xd8", "no UTF-16"),
    ('{"a": "\\ud800"}', "half of a character")])
def test_bad_json_names_file_and_line(tmp_path, text, words):
  (tmp_path / "a.json").write_bytes(text if isinstance(text, bytes) else text.encode())
  with pytest.raises(InputError, match="a.json") as error:
    read_json(tmp_path / "a.json")
  assert words in _one_line(error)


def test_safetensors(tmp_path):
  save_file({"a": np.ones(3, np.float16), "b": np.zeros(2)}, tmp_path / "a.safetensors")
  found = load_safetensors(tmp_path / "a.safetensors", lambda name: name == "a")
  assert list(found) == ["a"] and found["a"].dtype == np.float32
  data = (tmp_path / "a.safetensors").read_bytes()
  for damaged in (data[:-1], data[:20], b"", data.replace(b"F16", b"BF6"), data.replace(b"F16", b"X16"),
                  b"\xff" * 8 + data[8:]):
    (tmp_path / "a.safetensors").write_bytes(damaged)
    with pytest.raises(InputError, match="a.safetensors") as error:
      load_safetensors(tmp_path / "a.safetensors")
    assert _one_line(error)


def test_shards_of_safetensors_are_one_file(tmp_path):
  save_file({"a": np.ones(3)}, tmp_path / "model-00001-of-00002.safetensors")
  save_file({"b": np.zeros(2)}, tmp_path / "model-00002-of-00002.safetensors")
  index = tmp_path / "model.safetensors.index.json"
  index.write_text('{"weight_map": {"a": "model-00001-of-00002.safetensors", "b": "model-00002-of-00002.safetensors"}}')
  for path in (index, *shards(index)):
    assert {name: len(array) for name, array in load_safetensors(path).items()} == {"a": 3, "b": 2}
  for text in ("{}", '{"weight_map": {}}', '{"weight_map": {"a": "../a"}}', '{"weight_map": {"a": 3}}'):
    index.write_text(text)
    with pytest.raises(InputError, match="model.safetensors.index.json lists no shards: expected weight_map"):
      shards(index)
  save_file({"a": np.ones(3)}, tmp_path / "model-00002-of-00002.safetensors")
  with pytest.raises(InputError, match="a is in model-00002-of-00002.safetensors and in another shard"):
    load_safetensors(shards(tmp_path / "model-00001-of-00002.safetensors")[0])
  (tmp_path / "model-00001-of-00002.safetensors").unlink()
  with pytest.raises(FileNotFoundError, match="of 2 files, of which 1 are missing in .*: model-00001-of-00002.safe"):
    load_safetensors(tmp_path / "model-00002-of-00002.safetensors")


def test_reading_translates_all_but_our_own():
  for foreign in (KeyError("a"), TypeError("b"), OverflowError(), MemoryError(), RecursionError(), UnicodeError("c\nd"),
                  PermissionError(13, "Permission denied")):
    with pytest.raises(InputError, match="^a file ") as error:
      with reading("a file"):
        raise foreign
    assert _one_line(error)
  for ours in (InputError("as it is"), FileNotFoundError("as it is")):
    with pytest.raises(type(ours), match="^as it is$"), reading("a file"):
      raise ours


# --- what archives say about themselves; what the doctor says of it is in tests/data/test_doctor.py ------------------


def _row(**change):
  def damage(folder):
    lines = (folder / "captions.jsonl").read_text().splitlines()
    row = {name: value for name, value in (json.loads(lines[1]) | change).items() if value is not Ellipsis}
    (folder / "captions.jsonl").write_text("\n".join([lines[0], json.dumps(row), *lines[2:]]) + "\n")
  return damage


@pytest.mark.parametrize("damage, words", [
    (_row(end=..., id=...), "captions.jsonl line 2.*lacks id, end"), (_row(start="0"), "line 2.*got start '0'"),
    (_row(end=1e400), "got end 'inf'"), (_row(start=False), "got start 'False'"), (_row(text=["a", None]), "got text"),
    (_row(clip=["x"]), "got clip"), (_row(end=10**30), "lie outside"), (_row(clip="nobody"), "'nobody' is not in")])
def test_what_an_archive_says_wrongly_is_named(tmp_path, damage, words):
  folder = write_archive(tmp_path / "set")
  damage(folder)
  with pytest.raises(InputError, match=words) as error:
    read_archive(folder)
  assert _one_line(error)


def test_a_text_that_is_a_string_is_one_caption(tmp_path):
  folder = write_archive(tmp_path / "set")
  _row(text="a person walks")(folder)
  assert [caption.text for caption in read_archive(folder)[1].captions] == ["a person walks"]
