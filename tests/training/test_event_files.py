"""The event file of a run holds the numbers of metrics.jsonl, each step once, whatever the run went through."""
import struct
import sys

import numpy as np
import pytest

from motion_jax import fit
from motion_jax.training import loop
from motion_jax.training.metrics import read_metrics
from motion_jax.utils.errors import InputError
from tests.conftest import load_config
from tests.training.test_train import _config, _killed, _next_batch, _stage


def _with_events(config):
  config.train.tensorboard = True
  return config


def _events(folder):
  """The events of the one file of a folder: records of a length (8 bytes), its check sum (4), the event, its sum."""
  from tensorboardX.proto.event_pb2 import Event
  (path,) = folder.glob("*.tfevents.*")
  data, at, found = path.read_bytes(), 0, []
  while at < len(data):
    (length,) = struct.unpack_from("<Q", data, at)
    found.append(Event.FromString(data[at + 12:at + 12 + length]))
    at += length + 16
  return found


def _scalars(folder):
  return [(event.step, value.tag, value.simple_value) for event in _events(folder) for value in event.summary.value]


def _of_metrics(folder):
  return [(row["step"], name, np.float32(value)) for row in read_metrics(folder) for name, value in row.items()
          if name not in ("step", "seconds")]


def test_a_run_that_is_killed_and_goes_on_has_each_number_once(tmp_path):
  evaluate = lambda params: {"held_out_loss": float(abs(params["w"]).sum())}
  kill = lambda step: _killed(step) if step == 3 else _next_batch(step)
  with pytest.raises(MemoryError):
    loop.train(_with_events(_config(6)), tmp_path, _stage(), kill, evaluate=evaluate)
  assert {step for step, *_ in _scalars(tmp_path)} >= {1, 2}
  loop.train(_with_events(_config(6)), tmp_path, _stage(), _next_batch, resume=True, evaluate=evaluate)
  assert _scalars(tmp_path) == _of_metrics(tmp_path)
  assert {"loss", "held_out_loss", "learning_rate"} <= {tag for _, tag, _ in _scalars(tmp_path)}
  events = _events(tmp_path)
  assert events[0].file_version == "brain.Event:2" and events[1].session_log.status == 1  # START
  assert all(a.wall_time <= b.wall_time for a, b in zip(events[2:], events[3:]))


def test_an_absent_extra_is_told_before_data_are_read(tmp_path, monkeypatch):
  monkeypatch.setitem(sys.modules, "tensorboardX", None)
  config = load_config("cmdm_denoiser", "tiny")
  config.train.tensorboard = True
  with pytest.raises(InputError, match=r'pip install -q "\.\[tensorboard\]"'):
    fit.run(config, tmp_path / "run")
  assert not (tmp_path / "run").exists()
