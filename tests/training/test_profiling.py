"""--profile-steps traces just the steps that it names; what training cannot do is refused before data are read."""
import gzip
import json

import pytest

from motion_jax import fit
from motion_jax.training import loop
from motion_jax.utils.errors import InputError
from motion_jax_studio.cli import main
from tests.conftest import load_config
from tests.training.test_train import _config, _next_batch, _stage


def _traced(folder):
  """The numbers of the steps in the one trace of a run."""
  (path,) = (folder / "profile").rglob("*.trace.json.gz")
  events = json.loads(gzip.decompress(path.read_bytes()))["traceEvents"]
  return sorted(int(event["args"]["step_num"]) for event in events if "step_num" in event.get("args", {}))


@pytest.mark.slow
def test_a_run_that_goes_on_traces_what_it_has_before_it(tmp_path, capsys):
  loop.train(_config(4), tmp_path, _stage(), _next_batch)
  loop.train(_config(6), tmp_path, _stage(), _next_batch, resume=True, profile_steps=(2, 4))
  assert "steps 2 to 4 are not traced: the run is at step 4 already" in capsys.readouterr().out
  assert not (tmp_path / "profile").exists()
  loop.train(_config(9), tmp_path, _stage(), _next_batch, resume=True, profile_steps=(2, 8))
  assert _traced(tmp_path) == [7, 8] and f"steps 7 to 8 are traced in {tmp_path}/profile" in capsys.readouterr().out


def test_a_run_that_is_stopped_writes_its_trace(tmp_path, capsys):
  loop.train(_config(50), tmp_path, _stage(), _next_batch, max_seconds=1e-6, profile_steps=(1, 50))
  assert _traced(tmp_path) == [1]
  assert "the run from step 1 on is traced" in capsys.readouterr().out


@pytest.mark.parametrize("steps", ["5", "20:10", "0:3", "a:b", "1:2:3", ":"])
def test_what_are_no_steps(steps, capsys, tmp_path):
  with pytest.raises(SystemExit) as end:
    main(["train", "--config", "cmdm_denoiser:tiny", "--workdir", str(tmp_path), "--profile_steps", steps])
  said = capsys.readouterr().err
  assert end.value.code == 2 and said.count("\n") == 1 and repr(steps) in said and "A:B" in said


def test_steps_behind_the_last_are_refused_before_data_are_read(tmp_path):
  with pytest.raises(InputError, match="got --profile-steps 2:9, expected A:B with 1 <= A <= B <= 2"):
    fit.run(load_config("cmdm_denoiser", "tiny"), tmp_path / "run", profile_steps=(2, 9))
  assert not (tmp_path / "run").exists()


def test_a_type_that_networks_cannot_compute_in_is_told_before_data_are_read(tmp_path):
  config = load_config("cmdm_denoiser", "tiny").unlock()
  config.train.dtype = "float7"
  with pytest.raises(InputError, match="got train.dtype .float7., expected float32 or bfloat16"):
    fit.run(config, tmp_path / "run")
