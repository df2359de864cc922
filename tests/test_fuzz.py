"""A few hundred of the fuzzer's cases, always the same ones; `python -m tests.fuzz --cases 10000` runs many more."""
import gc
import pathlib
import shutil

import numpy as np
import pytest

from motion_jax_studio import cli
from tests import fuzz, fuzz_formats, fuzz_kinds
from tests.conftest import some_of
from tests.fuzz_healthy import healthy


@pytest.mark.parametrize("count", some_of([60, 300], slow=[60]))
def test_damaged_inputs_are_refused_in_one_line(count):
  kinds = set(fuzz_kinds.KINDS) - set(fuzz_formats.FORMATS)
  table, failures = fuzz.run(fuzz.plan(count, seed=1, kinds=kinds), workers=1)
  assert sum(row[result] for row in table.values() for result in fuzz.RESULTS) == count
  assert set(table) == kinds
  told = "\n\n".join(f"{':'.join(map(str, case))} {outcome.result}\n{outcome.told}" for case, outcome in failures)
  assert not failures, f"{fuzz.format_table(table)}\n{told}"
  assert all(sum(row[result] for row in table.values()) for result in ("accepted", "refused"))


@pytest.mark.parametrize("kind", fuzz_formats.FORMATS)
def test_healthy_files_of_other_programs_are_accepted(tmp_path, monkeypatch, kind):
  """What is refused of the damaged ones is refused for its damage."""
  monkeypatch.setattr(fuzz_formats, "damage", lambda rng, name, data: data)
  monkeypatch.setattr(fuzz_formats, "damaged", lambda rng, files: files)
  for number in range(3):
    outcome = fuzz.run_case(kind, 1, number, tmp_path / str(number))
    assert outcome.result == "accepted", outcome


_DEAR = "glb", "vrm", "vrma", "amass"
_STARTED = "c3d", "fbx", "usda", "usdc"  # read in processes of their own, of which each costs half a second
_QUICK = [*((kind, 1, 200) for kind in fuzz_formats.FORMATS if kind not in _DEAR + _STARTED),
          *((kind, seed, 70) for kind in _DEAR for seed in (1, 2, 3)),
          *((kind, 1, 3) for kind in _STARTED if kind in fuzz_formats.FORMATS)]
_MORE = [(kind, 4, 40 if kind in _STARTED else 1000) for kind in fuzz_formats.FORMATS]


@pytest.mark.parametrize("kind, seed, count", some_of([*_QUICK, *_MORE], quick=_QUICK))
def test_damaged_files_of_other_programs_are_refused_in_one_line(tmp_path, monkeypatch, kind, seed, count):
  monkeypatch.setattr(fuzz, "GIGABYTES", 100)  # of this process, with all that the tests before have left
  failures = []
  for number in range(count):
    outcome = fuzz.run_case(kind, seed, number, tmp_path / str(number))
    if outcome.result in fuzz.FAILURES:
      failures.append(f"{kind}:{seed}:{number} {outcome.result}\n{outcome.told}")
    shutil.rmtree(tmp_path / str(number))
  assert not failures, "\n\n".join(failures)


def test_a_case_is_the_same_again(tmp_path):
  for name in "ab":
    fuzz_kinds.KINDS["npz"][1](np.random.default_rng((7, 7)), tmp_path / name)
  (first,), (second,) = (list((tmp_path / name).iterdir()) for name in "ab")
  assert first.read_bytes() == second.read_bytes() != healthy("motion")["a.npz"]
  assert fuzz.plan(50, 3) == fuzz.plan(50, 3) and fuzz.plan(50, 3, ["npz"])[4] == ("npz", 3, 4)


@pytest.mark.parametrize("result, misdeed", [
    ("traceback", lambda: {}["x"]), ("not our words", lambda: int("x")),
    pytest.param("over 2 GB", lambda: np.zeros(500_000_000, np.uint8).fill(1), marks=pytest.mark.slow),
    ("half-written", lambda: (pathlib.Path("out/a.npy").write_bytes(b"1"), cli.main(["render", "nothing.npy"]))),
    ("half-written", lambda: pathlib.Path("out/.a-x1.npy").write_bytes(b"1")),
    ("refused", lambda: cli.main(["render", "nothing.npy"])), ("refused", lambda: cli.main(["render"])),
    ("accepted", lambda: None)])
def test_the_fuzzer_sees_what_it_looks_for(tmp_path, monkeypatch, result, misdeed):
  gc.collect()  # what is given back while the case runs would make room for it
  monkeypatch.setattr(fuzz, "GIGABYTES", 0.25)
  monkeypatch.setitem(fuzz_kinds.KINDS, "bad", (1, lambda rng, folder: fuzz_kinds.Case("bad", misdeed)))
  outcome = fuzz.run_case("bad", 0, 0, tmp_path / "case")
  assert outcome.result == result, outcome
