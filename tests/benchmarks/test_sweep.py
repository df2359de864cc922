"""A sweep trains each run once or in turns, continues where it was stopped, and puts all of them in one table."""
import json
import pathlib
import sys

import pytest

from motion_jax.training import saver, setup
from motion_jax.training.metrics import append_metrics
from motion_jax.utils import config_files
from motion_jax.utils.errors import InputError
from motion_jax_studio import cli
from motion_jax_studio.cli import overrides
from tests.conftest import ROOT

sys.path.insert(0, str(ROOT / "benchmarks"))
import sweep  # noqa: E402

STAGES = """def get_sweep(size='tiny'):
  return {'one/all': ('mdm_denoiser:tiny', {}, 1.0),
          'two/part': ('mld_vae:tiny', {}, 0.4),
          'two/whole': ('mld_denoiser:tiny', {'frozen.tokenizer': '{two/part}'}, 0.6)}
"""


@pytest.fixture(autouse=True)
def no_array(monkeypatch):
  monkeypatch.delenv(sweep.TASK, raising=False)


@pytest.fixture
def file(tmp_path):
  path = tmp_path / "two.py"
  path.write_text("def get_sweep(size='tiny'):\n"
                  "  return {n: (f'cmdm_tokenizer:{size}', {'seed': i, 'train.num_steps': 9})\n"
                  "          for i, n in enumerate('ab')}\n")
  return path


@pytest.fixture
def stages(tmp_path):
  (tmp_path / "stages.py").write_text(STAGES)
  return tmp_path / "stages.py"


@pytest.mark.slow
def test_runs_come_one_after_another_and_only_once(file, tmp_path, monkeypatch):
  calls, out = [], tmp_path / "out"

  def call(command):
    calls.append(command)
    folder = pathlib.Path(command[command.index("--workdir") + 1])
    folder.mkdir(parents=True)
    (folder / "config.json").write_text(json.dumps({"train": {"num_steps": 2}}))
    (folder / "params.safetensors").write_bytes(b"")
    append_metrics(folder, {"step": 2, "seconds": 1.5, "loss": len(calls)})
    append_metrics(folder, {"step": 2, "held_out_mm": 7.0})
    return 0

  assert sweep.run(file, out, ["--data", "x"], call) == 0 and len(calls) == 2
  assert calls[1][calls[1].index("train"):] == ["train", "--config", "cmdm_tokenizer:tiny", "--workdir", str(out / "b"),
                                                  "--resume=auto", "--data", "x", "--config.seed=1",
                                                  "--config.train.num_steps=9"]
  monkeypatch.setattr(cli, "main", lambda arguments: len(arguments))
  assert sweep.in_this_process(calls[1]) == 10, "slices run the same command here"
  assert sweep.run(file, out, [], call) == 0 and len(calls) == 2
  table = (out / "sweep.md").read_text().splitlines()
  assert table[0] == "| run | seed | state | loss | held_out_mm | seconds |"
  assert table[3] == "| b | 1 | finished | 2 | 7 | 1.5 |" and table[-1] == "In all runs: train.num_steps 9"


def test_a_failure_leaves_the_others_and_a_stop_ends_the_sweep(file, tmp_path, capsys):
  calls = []
  for status, said, count in ((1, 1, 2), (75, 75, 1), (-15, 143, 1), (130, 130, 1)):
    calls.clear()
    assert sweep.run(file, tmp_path / "out", [], lambda command, status=status: calls.append(command) or status) == said
    assert len(calls) == count
  assert "2 of 2 runs failed: a, b" in capsys.readouterr().err


def test_at_the_command_line(file, monkeypatch, capsys):
  monkeypatch.setattr(sweep, "run", lambda *args, **named: print(args, named) or 3)
  assert sweep.main([str(file), "--workdir", "out", "--data", "x", "y", "--config.seed=7"]) == 3
  assert "['--data', 'x', 'y', '--config.seed=7']" in capsys.readouterr().out
  assert sweep.main([str(file), "--workdir", "out", "--cpu-seconds", "9", "--slice", "2"]) == 3
  assert "{'budget': 9.0, 'slice': 2.0}" in capsys.readouterr().out
  for flags, said in ((["--config", "b"], "got --config, which"),
                      (["--slice", "2"], "got --slice without --cpu-seconds")):
    with pytest.raises(SystemExit):
      sweep.main(["a", "--workdir", "out", *flags])
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("text, said", [
    ("x = 1", "expected Python with a function get_sweep"),
    ("def get_sweep(): return {'a/x': ('c', {}, 0.5), 'a/y': ('c', {}, 0.6)}",
     "got shares of 1.1 .* 'a', expected shares above 0 that add up"),
    ("def get_sweep(): return {'a/x': ('c', {'f': '{a/y}'}, 0.5), 'a/y': ('c', {}, 0.5)}",
     "'a/x' needs 'a/y', which comes later"),
    ("def get_sweep(): return {'a/b/c': ('c', {})}", "one named 'a/b/c'"),
    ("def get_sweep(): return {'a/x': ('c', {}, 'much')}", "is not a sweep")])
def test_what_is_no_sweep_gets_one_sentence(tmp_path, text, said):
  (tmp_path / "bad.py").write_text(text)
  with pytest.raises(InputError, match=said):
    sweep.load(tmp_path / "bad.py")


def test_sweeps_that_ship_name_fields_of_their_configs():
  for name in ("learning_rate", "motion_prior:tiny", "same_data", "same_data:tiny"):
    for config, fields, _ in sweep.load(name).values():
      overrides.check([f"--config.{field}={value}" for field, value in fields.items()], config_files.load(config))
  with_prior, without = (config_files.load(run.config) for run in sweep.load("motion_prior").values())
  changed = {path for path, *_ in setup.changes(with_prior.to_dict(), without.to_dict())}
  assert changed == {"loss.prior_levels"}, "the runs of CDAMD's figure 7 differ in the prior alone"
  runs = sweep.load("same_data:gpu")
  assert {sum(runs[one].fields["train.num_steps"] for one in names) for names in sweep.methods_of(runs).values()} == {
      4000}, "steps instead of a budget"


def test_generators_of_the_same_data_fit_their_tokenizers():
  runs, configs = sweep.load("same_data"), {}
  for name, run in runs.items():
    configs[name] = config_files.load(run.config)
    with configs[name].unlocked():
      configs[name].update_from_flattened_dict(run.fields)
    if (tokenizer := run.fields.get("frozen.tokenizer", "").strip("{}")):
      described = configs[name].tokenizer.to_dict()
      given = configs[tokenizer].model.to_dict()
      assert {field: described.get(field, given[field]) for field in given if field != "teacher_dim"} == {
          field: value for field, value in given.items() if field != "teacher_dim"}, name


class Machine:
  """Trains a sweep's runs by writing what a run leaves, without a network: a step costs a tenth of a second.

  turns: (name, limit) in order; ends: the number of turns after which it is killed.
  """

  def __init__(self, out, cost=0.1, ends=None):
    self.out, self.turns, self._cost, self._ends = out, [], cost, ends

  def __call__(self, command):
    folder = pathlib.Path(command[command.index("--workdir") + 1])
    limit = float(next(one for one in command if "cpu_seconds" in one).partition("=")[2])
    self.turns.append((str(folder.relative_to(self.out)), limit))
    if folder.name == "whole":
      assert f"--config.frozen.tokenizer={folder.with_name('part')}" in command
    if len(self.turns) == self._ends:
      return -9
    step, spent = saver.progress(folder)
    step += round((limit - spent) / self._cost)
    (folder / "checkpoints" / str(step)).mkdir(parents=True)
    saver.write_record(folder / "checkpoints" / str(step), {"memory": {"cpu_seconds": limit}})
    (folder / "config.json").write_text(json.dumps({"train": {"num_steps": 10**6}}))
    return 0


def test_methods_take_turns_and_a_stage_waits_for_what_it_is_made_of(stages, tmp_path):
  machine = Machine(tmp_path)
  assert sweep.run(stages, tmp_path, [], machine, budget=10, slice=3) == 0
  assert machine.turns == [("one/all", 3), ("two/part", 4), ("one/all", 6), ("two/whole", 3), ("one/all", 10),
                           ("two/whole", 6)]  # a rest of less than half a slice is no turn of its own
  assert sweep.run(stages, tmp_path, [], machine, budget=10, slice=3) == 0 and len(machine.turns) == 6
  assert "| two/whole | {two/part} | step 60 of 1000000 |" in (tmp_path / "sweep.md").read_text()


@pytest.mark.parametrize("ends", [1, 4])
def test_a_sweep_that_is_killed_takes_the_same_turns(stages, tmp_path, ends):
  killed, rest, whole = Machine(tmp_path / "a", ends=ends), Machine(tmp_path / "a"), Machine(tmp_path / "b")
  for machine, status in ((killed, 137), (rest, 0), (whole, 0)):
    assert sweep.run(stages, machine.out, [], machine, budget=10, slice=3) == status
  assert killed.turns[:-1] + rest.turns == whole.turns


def test_a_larger_budget_starts_again_what_is_made_of_a_stage_that_was_trained_further(stages, tmp_path):
  sweep.run(stages, tmp_path, [], Machine(tmp_path), budget=10)
  assert saver.progress(tmp_path / "two/whole") == (60, 6.0)
  machine = Machine(tmp_path)
  assert sweep.run(stages, tmp_path, [], machine, budget=20, slice=20) == 0
  assert machine.turns == [("one/all", 20), ("two/part", 8), ("two/whole", 12)]
  assert saver.progress(tmp_path / "two/whole") == (120, 12.0)
  assert saver.progress(tmp_path / "two/whole.6s") == (60, 6.0)


def test_a_method_that_fails_or_stands_still_leaves_the_others(stages, tmp_path, capsys):
  machine = Machine(tmp_path)
  call = lambda command: 1 if "two/part" in " ".join(command) else machine(command)
  assert sweep.run(stages, tmp_path, [], call, budget=10, slice=5) == 1
  assert [name for name, _ in machine.turns] == ["one/all"] * 2
  assert "1 of 3 runs failed: two/part" in capsys.readouterr().err
  assert sweep.run(stages, tmp_path / "still", [], lambda command: 0, budget=10) == 1


def test_a_task_of_an_array_has_the_stages_of_a_method(stages, tmp_path, monkeypatch):
  monkeypatch.setenv(sweep.TASK, "1")
  trained, machine = [], Machine(tmp_path)
  assert sweep.run(stages, tmp_path, [], lambda command: trained.append(command) or 0) == 0
  assert [command[command.index("--workdir") + 1] for command in trained] == [
      str(tmp_path / "two/part"), str(tmp_path / "two/whole")]
  sweep.run(stages, tmp_path, [], machine, budget=10)
  assert machine.turns == [("two/part", 4), ("two/whole", 6)]
  monkeypatch.setenv(sweep.TASK, "2")
  with pytest.raises(InputError, match="got SLURM_ARRAY_TASK_ID=2, expected a number from 0 to 1"):
    sweep.run(stages, tmp_path, [], None)
