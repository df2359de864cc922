"""benchmarks/performance_page.py and all.sh: a page from files of measurements, and what it says of missing ones."""
import pathlib
import subprocess
import sys
import xml.etree.ElementTree

ROOT = pathlib.Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))

import performance_page  # noqa: E402
import results  # noqa: E402
import roofline  # noqa: E402

ABOUT = dict(machine=dict(processor="P", cores=2, memory_gib=24.0, python="3.11"), date="2026-01-01", commit="c",
             jax="0", others=0.0)
COST = dict(seconds=2.0, processor=3.0, fps=60.0, frames=120, working_mb=16.0) | ABOUT


def folder_of_measurements(folder):
  rows = {f"length/m/{seconds}": dict(COST, length=seconds, processor=0.05 * seconds) for seconds in (2, 6, 30)}
  rows |= {f"batch/m/{size}": dict(COST, batch=size, fps=100.0 * size) for size in (1, 8)}
  rows |= {f"streams/m/{count}": dict(COST, streams=count, block_seconds=0.02, others=1.0) for count in (1, 2)}
  rows["endless/m/2"] = dict(minutes=2, by_minute=[[1, 0.02, 500.0], [2, 0.021, 501.0]]) | ABOUT
  rows["batch/m/64"] = dict(error="MemoryError: none left") | ABOUT
  for name, row in rows.items():
    results.write(results.path_of(folder / "rows", name), dict(row, piece=name))
  seconds = {device.name: 1e-3 for device in roofline.DEVICES}
  results.write(results.path_of(folder / "roofline", "stream/M/bfloat16"), dict(
      piece="stream/M/bfloat16", flops=1e9, bytes=1e9, products=10, batch=1, frames=12, steps=25, seconds=seconds))


def test_a_page_holds_tables_plots_and_what_is_missing(tmp_path):
  folder_of_measurements(tmp_path)
  text = performance_page.page(tmp_path, tmp_path / "plots")
  assert "| m | slope |  |  | 50 |" in text  # milliseconds of processor time per second of motion
  assert "| m | 8 | 800 | 8 | 3 | 2 | 2 |" in text and "none left" not in text
  assert "| m | 2 | 60 | 1.5 | 20 | shared: others used 1.0 cores |" in text
  assert "| 2 | 21 | 501 |" in text and "What each program needs at least is *computed*" in text
  assert text.count(performance_page.MISSING) == 3  # time to motion, the plain loop, training
  plots = sorted((tmp_path / "plots").glob("*.svg"))
  assert [path.stem for path in plots] == ["batch", "endless-m", "length", "roofline", "streams"]
  for path in plots:
    root = xml.etree.ElementTree.parse(path).getroot()
    kinds = {element.get("class") for element in root.iter() if element.get("class")}
    assert "line s0" in kinds and "s0" in kinds  # a line, and its name in the legend
    assert f"(PLOTS/{path.name})" in text


def test_the_script_refuses_what_it_does_not_know(tmp_path):
  ran = subprocess.run(["bash", ROOT / "benchmarks/all.sh", "--fast", tmp_path / "out"], capture_output=True, text=True)
  assert ran.returncode == 2 and "got --fast" in ran.stderr and not (tmp_path / "out").exists()
