"""Training states on disk: whole or not at all, damage is found, what is kept."""
import json
import pathlib
import shutil

import jax
import numpy as np
import pytest

from motion_jax.data import sources
from motion_jax.training import checkpoint, report, setup
from motion_jax.training import loop as train
from motion_jax.training.metrics import read_metrics, without_clock
from motion_jax.training.saver import Saver, copy_of, fields_of
from motion_jax.utils.atomic import atomic_path, remove_strays
from motion_jax.utils.errors import InputError
from tests.conftest import load_config
from tests.training.test_train import _config, _equal, _killed, _next_batch, _stage


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
  """The folder of a run of six steps, and its last state."""
  folder = tmp_path_factory.mktemp("ended")
  return folder, train.train(_config(6), folder, _stage(), _next_batch)


def _files(folder):
  return sorted(path for path in folder.rglob("*") if path.is_file())


def _flip(path, bit):
  content = bytearray(path.read_bytes())
  content[bit // 8 % len(content)] ^= 1 << bit % 8
  path.write_bytes(content)


def test_a_damaged_state_is_passed_over(ended, tmp_path, capsys):
  """The one before it is taken, with a line, and the end is the same."""
  folder = shutil.copytree(ended[0], tmp_path / "run")
  _flip(max(_files(folder / "checkpoints" / "6" / "state"), key=lambda path: path.stat().st_size), 801)
  again = train.train(_config(6), folder, _stage(), _next_batch, resume=True)
  assert _equal(again, ended[1]) and Saver(folder).steps == [4, 6]
  assert "note: checkpoints/6 is damaged (" in (said := capsys.readouterr().out) and "continuing from step 4" in said
  assert [row["step"] for row in read_metrics(folder)] == [1, 2, 3, 4, 5, 6]
  assert checkpoint.load_params(folder)["w"].tolist() == checkpoint.load_params(ended[0])["w"].tolist()


@pytest.mark.parametrize("damage", [
    lambda folder: _files(folder / "state")[2].write_bytes(b""),
    lambda folder: [shutil.rmtree(folder), folder.mkdir()],
    lambda folder: (folder / "state" / "stranger").write_text("x"),
    lambda folder: (folder / "record.json").write_text("[]"),
])
def test_what_is_missing_empty_or_strange_is_damage(ended, tmp_path, damage):
  folder = shutil.copytree(ended[0], tmp_path / "run")
  assert Saver(folder).newest_whole({}) == 6
  damage(folder / "checkpoints" / "6")
  assert Saver(folder).newest_whole({}) == 4


def test_every_flipped_bit_is_found(ended, tmp_path):
  """A random one in each file, ten times."""
  folder = shutil.copytree(ended[0], tmp_path / "run") / "checkpoints" / "6"
  draw = np.random.default_rng(0)
  for path in _files(folder):
    whole = path.read_bytes()
    for bit in draw.integers(0, 8 * len(whole), 10):
      _flip(path, int(bit))
      assert Saver(tmp_path / "run").newest_whole({}) == 4, (path, bit)
      path.write_bytes(whole)
  assert Saver(tmp_path / "run").newest_whole({}) == 6


def test_where_nothing_is_whole_the_run_is_told_so(ended, tmp_path):
  folder = shutil.copytree(ended[0], tmp_path / "run")
  for step in (4, 6):
    _flip(_files(folder / "checkpoints" / str(step) / "state")[0], 9)
  with pytest.raises(InputError, match=r"is whole \(6: .* is not as it was written; 4: .*start a new run"):
    train.train(_config(6), folder, _stage(), _next_batch, resume=True)
  assert Saver(folder).steps == [4, 6]  # nothing was moved


def test_what_a_kill_left_half_written_is_cleaned_away(ended, tmp_path):
  folder = shutil.copytree(ended[0], tmp_path / "run")
  shutil.copytree(folder / "checkpoints" / "6", folder / "checkpoints" / ".saving-8")
  (folder / "checkpoints" / "8.orbax-checkpoint-tmp-12").mkdir()
  train.train(_config(6), folder, _stage(), _next_batch, resume=True)
  assert sorted(path.name for path in (folder / "checkpoints").iterdir()) == ["4", "6"]
  with pytest.raises(MemoryError), atomic_path(folder / "params.safetensors") as path:
    shutil.copy(path, tmp_path / "stray")
    raise MemoryError
  stray = shutil.copy(tmp_path / "stray", folder / path.name)
  other = folder / ".notes-part-abcdefgh.txt"  # not ours
  other.write_text("x")
  remove_strays(folder, report.FILES)
  assert not pathlib.Path(stray).exists() and other.exists() and (folder / "params.safetensors").exists()


def test_a_state_is_saved_as_it_was_when_the_save_began(tmp_path):
  """Its buffers are given to the next step and written to while the save goes on."""
  state = train.train(_config(2), tmp_path / "a", _stage(), _next_batch)
  before = jax.tree.map(lambda leaf: np.array(leaf), fields_of(state))
  copy = copy_of(state)
  assert not any(jax.tree.leaves(jax.tree.map(lambda a, b: np.shares_memory(np.asarray(a), b), fields_of(state), copy)))
  saver = Saver(tmp_path / "b")
  saver.save(2, copy)
  bump = jax.jit(lambda state: jax.tree.map(lambda leaf: leaf + 1, state), donate_argnums=0)
  for _ in range(20):
    state = bump(state)
  assert saver.wait() is None
  assert _equal(fields_of(saver.restore(state)[0]), before)


def test_the_newest_and_the_best_states_are_kept_whole(tmp_path):
  config = _config(10)
  config.train.update(best="min error", keep_last=3)
  errors = iter([3.0, 1.0, 2.0, 4.0, 5.0])
  train.train(config, tmp_path, _stage(), _next_batch, evaluate=lambda params: {"error": next(errors)})
  assert Saver(tmp_path).steps == [4, 6, 8, 10]
  config.train.num_steps = 14
  train.train(config, tmp_path, _stage(), _next_batch, resume=True, evaluate=lambda params: {"error": 6.0})
  assert Saver(tmp_path).steps == [4, 10, 12, 14]


@pytest.mark.slow
def test_a_kill_between_a_save_and_its_evaluation_changes_nothing(tmp_path):
  """The state is saved first; the resumed run evaluates it, appends its row and keeps the best weights."""
  config = _config(6)
  config.train.best = "min error"

  def run(name, *errors, **options):
    errors = iter(errors)
    return train.train(config, tmp_path / name, _stage(), _next_batch, evaluate=lambda params: {
        "error": next(errors, None) or _killed(0)}, **options)

  whole = run("whole", 3.0, 1.0, 2.0)
  with pytest.raises(MemoryError):
    run("parts", 3.0)
  assert Saver(tmp_path / "parts").latest == 4
  assert _equal(whole, run("parts", 1.0, 2.0, resume=True))
  assert without_clock(read_metrics(tmp_path / "whole")) == without_clock(read_metrics(tmp_path / "parts"))
  for name in (checkpoint.PARAMS, checkpoint.RAW, checkpoint.LAST):
    assert (tmp_path / "whole" / name).read_bytes() == (tmp_path / "parts" / name).read_bytes(), name
  assert Saver(tmp_path / "whole").steps == Saver(tmp_path / "parts").steps


def test_another_environment_is_told(ended, tmp_path, monkeypatch, capsys):
  folder = shutil.copytree(ended[0], tmp_path / "run")
  train.train(_config(6), folder, _stage(), _next_batch, resume=True)
  assert "environment" not in capsys.readouterr().out
  monkeypatch.setenv("XLA_FLAGS", "--xla_other=1")
  train.train(_config(6), folder, _stage(), _next_batch, resume=True)
  said = capsys.readouterr().out
  assert "note: saved in another environment (XLA_FLAGS " in said and "up to rounding" in said


def test_changed_settings_are_named_one_by_one():
  """What may change is how long a run lasts, when it cools down, and where the data lies."""
  before, now = (load_config("cmdm_tokenizer", "tiny").unlock() for _ in range(2))
  now.optimizer.learning_rate, now.train.save_every, now.data.folder, now.train.num_steps = 1.0, 7, "elsewhere", 99
  told = f"optimizer.learning_rate was {before.optimizer.learning_rate!r}, is 1.0; train.save_every was 2, is 7"
  with pytest.raises(InputError, match=f"--resume with another optimizer: {told}; .*--allow-changes"):
    setup.check_config(now, before)
  said = []
  setup.check_config(now, before, allow=True, report=said.append)
  assert said == [f"note: the run continues with other settings: {told}"]
  before.train.num_steps, before.optimizer.cooldown_steps, before.data.folder = 3, 7, "there"
  setup.check_config(before, load_config("cmdm_tokenizer", "tiny"))
  before.model.width = 8
  with pytest.raises(InputError, match="another model"):
    setup.check_config(before, load_config("cmdm_tokenizer", "tiny"))


def test_a_run_resumes_in_a_version_with_more_fields():
  then = {"loss": {"align": 0.1}}
  assert not list(setup.changes(then, {"loss": {"align": 0.1, "new": 0.0}, "data": {"augment": {"stepping": 0.0}}}))
  assert list(setup.changes(then, {"loss": {"align": 0.1, "new": 0.5}})) == [("loss.new", None, 0.5)]
  assert list(setup.changes(then, {"loss": {}, "data": {"augment": {"stepping": 0.2}}})) == [
      ("data.augment.stepping", None, 0.2), ("loss.align", 0.1, None)]


def test_data_are_compared_byte_for_byte(tmp_path):
  """Wherever a copy lies; one changed byte is other data, though the statistics may be the same."""
  config = load_config("cmdm_tokenizer", "tiny").unlock()
  for name in ("a", "b"):
    (tmp_path / name).mkdir()
    for file in ("motions.npz", "captions.jsonl"):
      (tmp_path / name / file).write_text("content")
  config.data.update(name="archive", folder=str(tmp_path / "a"))
  (tmp_path / checkpoint.DATA).write_text(setup.digests(tmp_path, config, resumes=False))
  config.data.folder = str(tmp_path / "b")
  assert json.loads(setup.digests(tmp_path, config, resumes=True))["digests"] == sources.digests(config.data)
  (tmp_path / "b" / "captions.jsonl").write_text("contenu")
  with pytest.raises(InputError, match="--resume with other data: the files in .*b are not .*--allow-changes"):
    setup.digests(tmp_path, config, resumes=True)
  said = []
  assert setup.digests(tmp_path, config, resumes=True, allow=True, report=said.append) and "are not those" in said[0]
