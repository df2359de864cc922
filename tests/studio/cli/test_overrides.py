"""The arguments of train and evaluate: every mistake is one line that names the nearest right word."""
import sys

import pytest

from motion_jax.utils import config_files
from motion_jax_studio import cli
from motion_jax_studio.cli import overrides
from tests.conftest import ROOT

TINY = f"{ROOT}/configs/cmdm_tokenizer.py:tiny"


@pytest.mark.parametrize("argument, words", [
    ("--config.data.bacth_size=3", "did you mean --config.data.batch_size?"),
    ("--config.batch_size=3", "did you mean --config.data.batch_size?"),          # the right word in no section
    ("--config.train.learning_rte=3", "did you mean --config.optimizer.learning_rate?"),
    ("--config.data.batch_size=abc", "expected a whole number such as 4"),
    ("--config.optimizer.learning_rate=fast", "expected a number such as"),
    ("--config.model.causal=maybe", "expected True or False"),
    ("--config.model=3", "set its fields, such as --config.model.causal"),
])
def test_a_mistyped_override(argument, words):
  config = config_files.load(TINY)
  with pytest.raises(ValueError) as error:
    overrides.check([argument], config)
  assert words in str(error.value) and argument.partition("=")[0] in str(error.value)
  if "=" in argument:
    with pytest.raises(ValueError):
      overrides.check(argument.split("=", 1), config)  # --config.key value


@pytest.mark.parametrize("name, words", [
    (f"{ROOT}/configs/cmdm_tokeniser.py", "did you mean cmdm_tokenizer?"), ("nowhere/x.py", "there is no config"),
    ("common", "there is no config"), (f"{ROOT}/README.md", "expected Python"),
    (f"{ROOT}/configs/cmdm_tokenizer.py:huge", "got size 'huge'"), (f"{ROOT}/tests/__init__.py", "is no config file"),
])
def test_a_config_that_is_none(name, words):
  with pytest.raises((ValueError, FileNotFoundError), match=words):
    config_files.load(name)


@pytest.mark.parametrize("arguments, words", [
    (["train", "--config", TINY, "--workdir=w", "--config.data.bacth_size=3"], "mean --config.data.batch_size?"),
    (["train", "--config", TINY], "--workdir"), (["evaluate", "--model", "x"], "give --data")])
def test_the_command_line_says_it_in_one_line(tmp_path, monkeypatch, capsys, arguments, words):
  monkeypatch.chdir(tmp_path)
  with pytest.raises(SystemExit):
    sys.exit(cli.main(arguments))
  printed = capsys.readouterr().err
  assert words in printed and len(printed.splitlines()) == 1 and not any(tmp_path.iterdir())
