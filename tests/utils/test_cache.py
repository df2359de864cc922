"""What is kept on disk: the same numbers from it as without it, and nothing of it trusted that is not whole."""
import os
from typing import NamedTuple

import jax
import jax.numpy as jnp
import jaxlib
import numpy as np
import pytest

from motion_jax import export, loading
from motion_jax.utils import cache, executables
from motion_jax_studio import cli
from tests.evaluation.small import random_run


@pytest.fixture
def kept(tmp_path, monkeypatch):
  monkeypatch.setattr(cache, "_folder", tmp_path)
  return tmp_path


class State(NamedTuple):
  """What a step gives on to the next."""
  x: jax.Array


def scaled(power, state, keys, weights):
  noise = jax.vmap(lambda key: jax.random.normal(key, state.x.shape[1:]))(keys)
  return State(jnp.tanh(state.x @ weights["w"]) ** power + noise)


ARGUMENTS = (State(jnp.linspace(0, 1, 12).reshape(3, 4)), jax.random.split(jax.random.key(1), 3),
             {"w": jnp.eye(4) * 0.3})


def test_a_kept_program_gives_the_numbers_of_the_function(kept):
  program = cache.Program("scaled", scaled, 1)
  expected = scaled(2, *ARGUMENTS)
  first = program(2, *ARGUMENTS)
  path, = (kept / "programs").iterdir()
  stamp = path.stat().st_mtime_ns
  again = cache.Program("scaled", scaled, 1)(2, *ARGUMENTS)
  np.testing.assert_array_equal(first.x, again.x)
  np.testing.assert_allclose(first.x, expected.x, atol=1e-6)
  assert isinstance(again, State) and path.stat().st_mtime_ns == stamp and path.stat().st_mode & 0o777 == 0o644
  assert program(3, *ARGUMENTS).x.shape == (3, 4) and len(list((kept / "programs").iterdir())) == 2


def test_what_is_damaged_is_not_read(kept):
  """Whichever byte is another, wherever the file ends: the digest says so, and a program is never loaded from it."""
  key = cache.key_of("key")
  cache.write("kind", key, b"content")
  path = kept / "kind" / key
  whole = path.read_bytes()
  assert cache.read("kind", key) == b"content"
  for place in range(len(whole)):
    for damaged in (whole[:place], whole[:place] + bytes([whole[place] ^ 1]) + whole[place + 1:]):
      path.write_bytes(damaged)
      assert cache.read("kind", key) is None


def test_this_jaxlib_has_what_stored_programs_need():
  """Without one of these names every process compiles again, in silence: `Program` falls back on any of `ERRORS`."""
  from jaxlib import xla_client
  client = jax.devices()[0].client
  places = {"jaxlib.xla_client": (xla_client, ("DeviceList",)),
            "the client of a device": (client, ("serialize_executable", "deserialize_executable"))}
  missing = [f"{name} of {place}" for place, (owner, names) in places.items() for name in names
             if not hasattr(owner, name)]
  assert not missing, (f"jaxlib {jaxlib.__version__} has no {', '.join(missing)}: motion_jax/utils/executables.py was "
                       "checked with jaxlib 0.10.2 and 0.12.0; see what jax.experimental.serialize_executable uses now")
  run, stored = executables.compile_and_store(lambda x: (x + 1,), [jnp.arange(3)])
  np.testing.assert_array_equal(executables.load(stored)(jnp.arange(3))[0], run(jnp.arange(3))[0])


def test_jax_keeps_no_program_while_any_thread_makes_one():
  """jax's copy of a program, read back after an upgrade and stored again, would lack functions when it runs."""
  usual = jax.config.jax_persistent_cache_min_compile_time_secs
  one, other = executables.outside_jax_cache(), executables.outside_jax_cache()
  for enters in (one, other):
    enters.__enter__()
  one.__exit__(None, None, None)
  assert jax.config.jax_persistent_cache_min_compile_time_secs == 1e9
  other.__exit__(None, None, None)
  assert jax.config.jax_persistent_cache_min_compile_time_secs == usual


def test_another_function_size_option_or_code_is_another_program(kept, monkeypatch):
  make = lambda name="a", about=(), count=3: cache.Program(name, scaled, 1, about)(
      2, State(ARGUMENTS[0].x[:count]), ARGUMENTS[1][:count], ARGUMENTS[2])
  for given in ({}, dict(name="b"), dict(about=("wide",)), dict(count=2)):
    make(**given)
  with jax.default_matmul_precision("highest"):
    make()
  monkeypatch.setattr(cache, "code_version", lambda: "tomorrow")
  make()
  assert len(list((kept / "programs").iterdir())) == 6


def test_arrays_and_shapes_come_back_as_they_were(kept):
  numbers = np.random.default_rng(0).normal(size=(3, 5)).astype(np.float32)
  key = cache.key_of("numbers", b"bytes", "words")
  assert key == cache.key_of("numbers", b"bytes", "words") != cache.key_of("numbers", b"byte", "swords")
  for make in (lambda: numbers, lambda: pytest.fail("it is kept")):
    np.testing.assert_array_equal(cache.kept_array("arrays", key, make), numbers)
  shapes = {"net": {"w": jax.ShapeDtypeStruct((2, 3), jnp.float32), "n": jax.ShapeDtypeStruct((), jnp.int32)}}
  for make in (lambda: shapes, lambda: pytest.fail("it is kept")):
    assert cache.kept_shapes("net", "about", make) == shapes


def test_answers_are_computed_once(kept, monkeypatch):
  monkeypatch.setattr(cache, "SLOW", 0.0)
  ask = lambda answers, question: answers(question, lambda: [question, computed.append(question)])
  computed = []
  first = cache.Answers("captions", "a")
  for question in ("one", "two", "one"):
    assert ask(first, question) == [question, None]
  assert ask(cache.Answers("captions", "a"), "two") == ["two", None] and computed == ["one", "two"]
  ask(cache.Answers("captions", "b"), "two")
  assert computed == ["one", "two", "two"], "of other captions"
  for path in (kept / "captions").iterdir():
    path.write_bytes(path.read_bytes()[:-1])
  assert ask(cache.Answers("captions", "a"), "one") == ["one", None] and len(computed) == 4, "a damaged file"


@pytest.mark.parametrize("most", [dict(MOST_FILES=3), dict(MOST_BYTES=200)])
def test_the_oldest_files_go(kept, monkeypatch, most):
  """By their number, or by their bytes together: three of 60 fit 200."""
  for name, limit in most.items():
    monkeypatch.setattr(cache, name, limit)
  for number in range(6):
    cache.write("kind", cache.key_of(number), bytes(15))
    os.utime(kept / "kind" / cache.key_of(number), (number, number))
  assert [cache.read("kind", cache.key_of(number)) is not None for number in range(6)] == 3 * [False] + 3 * [True]


def test_without_a_folder_that_can_be_written_nothing_is_kept(tmp_path, monkeypatch):
  monkeypatch.chdir(tmp_path)
  cache.Program("scaled", scaled, 1)(2, *ARGUMENTS)
  cache.write("kind", "key", b"content")
  assert not list(tmp_path.iterdir()) and cache.read("kind", "key") is None
  (tmp_path / "file").write_text("no folder")
  monkeypatch.setattr(cache, "_folder", tmp_path / "file")
  np.testing.assert_array_equal(cache.kept_array("arrays", "abc", lambda: np.ones(3)), np.ones(3))


@pytest.mark.slow
def test_generating_from_the_cache_gives_the_same_bits(tmp_path, monkeypatch, capsys):
  """Without a cache, making it, and from it: one motion, bit for bit."""
  run = random_run(tmp_path / "run", "cmdm_denoiser")
  plain = loading.load(run).generate("a person walks", 20, seeds=[5], cleanup=True)[0]
  monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
  for name in ("first", "second"):
    assert cli.main(["generate", "a person walks", "--num-frames", "20", "--seed", "5", "--model", str(run),
                     "--out", str(tmp_path / f"{name}.npz"), "--timings"]) == 0
    clip = export.load(tmp_path / f"{name}.npz")
    np.testing.assert_array_equal(clip.joints, plain.joints)
    np.testing.assert_array_equal(clip.features, plain.features)
    if name == "first":  # the second finds everything: nothing is traced
      monkeypatch.setattr(executables, "compile_and_store", lambda *_: pytest.fail("compiled again"))
    line = capsys.readouterr().out.splitlines()[-1]
    assert all(part in line for part in ("imports", "model", "text", "program", "sample", "cleanup", "files", "in all"))
