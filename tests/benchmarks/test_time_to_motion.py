"""benchmarks/time_to_motion.py and machine.py: what they read from logs and how they print it; nothing is timed."""
import pathlib
import subprocess
import sys

import pytest

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))

import machine  # noqa: E402
import time_to_motion  # noqa: E402

LOG = """Finished tracing call for jit in 0.065 sec
Finished XLA compilation of jit(call) in 1.5 sec
Persistent compilation cache hit for 'jit_add' with key 'jit_add-34'
Finished XLA compilation of jit(add) in 0.25 sec
Finished XLA compilation of jit(step) in 3 sec
"""


def measured(processor, cold=True, others=0.0):
  row = dict(wall=2 * processor, processor=processor, others=others, **time_to_motion.compiled(LOG))
  return dict(warm=[row, row], **(dict(cold=row) if cold else {}))


def test_a_program_that_was_read_from_the_cache_is_not_counted_as_compiled():
  found = time_to_motion.compiled(LOG)
  assert (found["programs"], found["read"], found["compile_seconds"]) == (2, 1, 4.75)
  assert found["longest"][0] == ("jit(step)", 3.0)


def test_tables_name_the_machine_and_mark_shared_rows():
  about = dict(processor="P", cores=2, memory_gib=24.0, python="3.11")
  found = dict(machine=about, commit="c", date="2026-01-01",
               rows={"--help": measured(0.1, cold=False), "plain": measured(3.0), "path": measured(4.0, others=1.5)})
  lines = time_to_motion.table(found).splitlines()
  assert lines[0].startswith("2 cores of P, 24 GiB")
  cells = [cell.strip() for cell in lines[-2].split("|")[1:-1]]
  assert cells == ["plain", "3.0", "6.0", "2", "4.8", "3.00", "6.00", ""]
  assert "others used 1.5 cores" in lines[-1] and lines[-3].startswith("| --help |  |  |  |  | 0.10 | 0.20 |")
  both = time_to_motion.comparison(found, dict(found, commit="d", rows={"plain": measured(1.5)}))
  assert "| plain | 3.0 → 1.5 | 6.0 → 3.0 | 2 → 2 | 3.00 → 1.50 | 6.00 → 3.00 |" in both


def test_the_command_is_that_of_the_checkout():
  ran = subprocess.run([*time_to_motion.command(ROOT), "--version"], capture_output=True, text=True)
  assert ran.returncode == 0 and ran.stdout.strip()


def test_a_block_of_own_work_is_not_others():
  with machine.cost() as cost:
    sum(range(3_000_000))
  assert cost.wall > 0 and cost.processor > 0 and (cost.others is None or cost.others >= 0)
  assert machine.mark(None) == machine.mark(0.1) == "" and "0.9 cores" in machine.mark(0.9)
  with pytest.raises(ValueError), machine.cost() as failed:
    raise ValueError
  assert failed.wall > 0


def test_a_studio_that_is_still_busy_is_called_again():
  class Busy:
    calls = 0

    def stream(self, prompt, **fields):
      self.calls += 1
      if self.calls < 3:
        raise TimeoutError
      return "live"

  assert time_to_motion.connected(Busy()) == "live"
  with pytest.raises(TimeoutError):
    time_to_motion.connected(Busy(), attempts=2)
