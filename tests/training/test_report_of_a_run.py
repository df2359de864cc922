"""A run's report.html shows what metrics.jsonl holds, loads nothing, and trusts no text; rates count what they say."""
import io
import json
import re
import sys
import time

import ml_collections
import pytest
from PIL import Image

from motion_jax.training import loop, metrics, report
from motion_jax.training.metrics import append_metrics
from tests.training.test_train import _config, _next_batch, _stage


def test_the_page_holds_curves_speed_environment_and_config(tmp_path):
  for step in range(10, 60, 10):
    append_metrics(tmp_path, {"step": step, "seconds": step / 2, "loss": 10 / step, "grad_norm": 1.0, "kl": 0.5,
                              "learning_rate": 1e-3, "samples_per_second": 40.0, "data_wait": 0.25, "memory_mb": 512.0,
                              "skipped": 0.1})
  append_metrics(tmp_path, {"step": 50, "held_out_mm": 21.5})
  (tmp_path / "samples").mkdir()
  Image.new("RGB", (8, 8)).save(tmp_path / "samples/step50.png")
  config = ml_collections.FrozenConfigDict({"stage": "cmdm.denoiser", "train": {"num_steps": 100},
                                            "note": "<script>alert(1)</script>"})
  page = report.write_report(tmp_path, config, {"device": "cpu & <b>"}).read_text()
  assert "step 50 of 100" in page and "25.0 %" in page and "21.5" in page and "data:image/png" in page
  # loss, kl; held out; gradient, rate, left out; samples, waiting, memory
  assert page.count('<svg class="chart"') == 9
  assert re.search(r"skipped steps</span><b>5</b>", page)
  assert "<script>" not in page and "cpu &amp; &lt;b&gt;" in page
  assert not re.findall(r"(?:src|href)=\"(?!data:)", page)


def test_rates_count_steps_since_the_last_row(monkeypatch):
  now = [100.0]
  monkeypatch.setattr(time, "perf_counter", lambda: now[0])
  monkeypatch.setattr(metrics, "peak_flops", lambda: 1e6)
  meter = metrics.Rates(8, lambda step: 0.1 * step, flops=1e5)
  meter.step(waited=0.25)  # the first, which compiles
  for at in range(4):
    now[0] += 0.5
    meter.step(waited=0.25 + 0.125 * (at + 1))
  row = meter.row(step=5)
  assert row["samples_per_second"] == pytest.approx(16) and row["data_wait"] == pytest.approx(0.25)
  assert row["mfu"] == pytest.approx(0.2) and row["learning_rate"] == pytest.approx(0.4) and row["memory_mb"] > 1
  meter.restart()
  now[0] += 50.0  # a save
  meter.step(waited=0.75)
  now[0] += 1.0
  meter.step(waited=1.0)
  row = meter.row(step=7)
  assert row["samples_per_second"] == pytest.approx(8) and row["data_wait"] == pytest.approx(0.25)
  assert json.dumps(row) and "samples_per_second" not in meter.row(step=7)


class _Terminal(io.StringIO):
  def isatty(self):
    return True


def test_on_a_terminal_there_is_a_bar_and_elsewhere_lines(tmp_path, monkeypatch, capsys):
  monkeypatch.setattr(metrics, "peak_flops", lambda: 1e6)
  train = lambda folder: loop.train(_config(6), tmp_path / folder, _stage(), _next_batch,
                                    evaluate=lambda params: {"held_out_loss": 0.25})
  train("lines")
  said = capsys.readouterr()
  assert "step 6 of 6: loss" in said.out and "step 6: held_out_loss 0.25\n" in said.out and "it/s" not in said.err
  screen = _Terminal()
  monkeypatch.setattr(sys, "stderr", screen)
  train("bar")
  last = screen.getvalue().rpartition("\r")[2]
  assert "6/6" in last and all(name in last for name in ("loss=", "samples/s=", "MFU=", "held_out_loss=0.25"))
  assert "step 6 of 6: loss" not in capsys.readouterr().out
