"""benchmarks/accelerator.py and gpu.sh, at tiny sizes on the CPU, so that they run where there is an accelerator."""
import functools
import json
import pathlib
import subprocess
import sys

import pytest

ABOUT = dict(device="x", jax="y")
BENCHMARKS = pathlib.Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def accelerator(monkeypatch):
  monkeypatch.syspath_prepend(str(BENCHMARKS))
  import accelerator
  return accelerator


@pytest.fixture
def results(monkeypatch):
  monkeypatch.syspath_prepend(str(BENCHMARKS))
  import results
  return results


def test_pieces_are_kept_and_what_failed_leaves_the_others(accelerator, results, tmp_path):
  calls = []

  def fine():
    calls.append("fine")
    return dict(seconds=0.5, flops=1e9)

  def broken():
    calls.append("broken")
    raise MemoryError("none left")

  wanted = {"train/a/float32": broken, "train/b/float32": fine}
  assert results.measure(tmp_path, wanted, 100, ABOUT)
  assert results.measure(tmp_path, wanted, 100, ABOUT) and calls == ["broken", "fine"]
  assert json.loads((tmp_path / "train-a-float32.json").read_text())["error"] == "MemoryError: none left"
  assert not results.measure(tmp_path, {"train/c/float32": fine}, -1, ABOUT)
  results.write(tmp_path / "matmul-float32.json", dict(piece="matmul/float32", tflops=0.004, **ABOUT))
  accelerator.table(tmp_path)
  text = (tmp_path / "README.md").read_text()
  assert "MemoryError: none left" in text
  row = next(line for line in text.splitlines() if line.startswith("| b/float32"))
  assert [cell.strip() for cell in row.split("|")[2:4]] == ["500", "50"]  # ms; 1e9 FLOPs in 0.5 s of 4e9 a second


def test_a_piece_of_each_kind_gives_its_numbers(accelerator):
  pieces = accelerator.pieces(tiny=True)
  kinds = {name.partition("/")[0] for name in pieces}
  assert kinds == {name.partition("/")[0] for name in accelerator.pieces(tiny=False)}
  assert pieces["matmul/float32"]()["tflops"] > 0
  made = pieces["decode/cmdm/batch1"]()
  assert made["fps"] == pytest.approx(24 / made["seconds"]) and made["flops"] > 0


def test_processes_share_what_is_compiled(accelerator, capsys):
  calls = []
  wanted = {name: functools.partial(calls.append, name) for name in "abcde"}
  accelerator.compile_only(wanted, (1, 2))
  assert calls == ["b", "d"]
  accelerator.compile_only(dict(f=functools.partial(int, "x")), (0, 1))
  assert ", ValueError" in capsys.readouterr().out


@pytest.mark.exhaustive
def test_every_piece_runs(accelerator, results, tmp_path):
  assert results.measure(tmp_path, accelerator.pieces(tiny=True), 10_000, ABOUT)
  rows = [json.loads(path.read_text()) for path in tmp_path.glob("*.json")]
  assert len(rows) == len(accelerator.pieces(tiny=True)) and not [row for row in rows if "error" in row]


@pytest.mark.slow
def test_the_script_refuses_a_machine_without_an_accelerator(tmp_path):
  script = BENCHMARKS / "gpu.sh"
  env = dict(PATH=f"{pathlib.Path(sys.executable).parent}:/usr/bin:/bin", JAX_PLATFORMS="cpu")
  refused = subprocess.run(["bash", script, tmp_path / "none"], env=env, capture_output=True, text=True)
  assert refused.returncode == 2 and "no accelerator" in refused.stderr
  ran = subprocess.run(["bash", script, tmp_path / "out", "200", "--tiny", "--only", "matmul"], env=env,
                       capture_output=True, text=True)
  assert ran.returncode == 0, ran.stderr
  assert "0.0" in (tmp_path / "out/README.md").read_text()
