"""Flags: the same names in all commands, with dashes or underscores, and launch.py and eval.py as doors to them."""
import argparse
import re
import subprocess
import sys
import types

import numpy as np
import pytest

from motion_jax.models import registry
from motion_jax.utils import config_files
from motion_jax_studio import cli, step_names
from motion_jax_studio.cli import control, generation_flags, overrides
from tests.conftest import ROOT, devices_env
from tests.export.test_bvh import bent


def _options(parser):
  """(command, option, action) of a parser and all below it."""
  for action in parser._actions:
    if isinstance(action, argparse._SubParsersAction):
      for one in action.choices.values():
        yield from _options(one)
    for option in action.option_strings:
      yield parser.prog, option, action


FLAGS = [found for found in _options(cli._parser()) if found[1] not in ("-h", "--help")]


def test_each_command_is_read_by_its_module_alone(capsys):
  assert [*cli._commands_of(cli._parser())] == [*cli.MODULES]
  for command, module in cli.MODULES.items():
    assert [*cli._commands_of(cli._parser(command))] == [name for name in cli.MODULES if cli.MODULES[name] == module]
  with pytest.raises(SystemExit):
    cli.parse(["generat", "x"])
  assert "did you mean generate" in capsys.readouterr().err


def test_flags_are_words_joined_by_dashes_and_have_a_help_text():
  assert len(FLAGS) > 100
  strange = [(prog, option) for prog, option, _ in FLAGS if not re.fullmatch(r"--[a-z]+(-[a-z]+)*", option)]
  assert not strange and not [(prog, option) for prog, option, action in FLAGS if not action.help]


@pytest.mark.parametrize("flag", ["--model", "--data", "--seed", "--guidance-scale", "--weights", "--out"])
def test_what_commands_share_is_called_alike(flag):
  """A flag of several commands is of one kind of value, so that what is learned of one holds for all."""
  kinds = {(action.type and getattr(action.type, "__qualname__", type(action.type).__name__),
            tuple(action.choices or ())) for _, option, action in FLAGS if option == flag}
  assert len(kinds) == 1, kinds


@pytest.mark.parametrize("words, shown, hidden", [
    ("generate", "--seconds --path --schedule --contrast-scale (2)", "--keyframe --num-iterations --bvh-unit --ends"),
    ("generate --model=cdamd-small", "--seconds --num-iterations (50)", "--schedule --lag --bvh-unit"),
    ("edit --model cdamd-small", "--change --num-steps --mask (50)", "--part --residual-scale --camera"),
    ("extend --model nothing", "--prompt --model --out", "--guidance-scale --schedule")])
def test_help_shows_what_the_chosen_model_takes_and_help_all_the_rest(words, shown, hidden, capsys):
  printed = {}
  for flag in ("--help", "--help-all"):
    with pytest.raises(SystemExit):
      cli.main([*words.split(), flag])
    printed[flag] = capsys.readouterr().out
  assert all(one in printed["--help"] for one in shown.split())
  assert not any(one in printed["--help"] for one in hidden.split())
  assert len(re.findall(r"^  --", printed["--help"], re.MULTILINE)) <= 23
  assert all(one in printed["--help-all"] for one in f"{shown} {hidden}".split() if "(" not in one)
  assert {f"--{name.replace('_', '-')}" for options in registry.options().values() for name in options.described()
          } & {option for prog, option, _ in FLAGS if prog == f"motion-jax {words.split()[0]}"} <= {
              *re.findall(r"--[a-z-]+", printed["--help-all"])}


def test_dashes_and_underscores_are_the_same_flag():
  parsed = cli.parse("generate x --num-samples 2 --guidance-scale=3 --no-plan --max-attempts 1 --bvh-unit m".split())
  assert parsed == cli.parse("generate x --num_samples 2 --guidance_scale=3 --no_plan --max_attempts 1 --bvh_unit m"
                             .split())


@pytest.mark.parametrize("words, meant", [
    ("generate x --num 4", "--num-samples"), ("generate x --guidance 3", "--guidance-scale"),
    ("generate x --literal", "--no-plan"), ("generate x --cfg_weight=3", "--guidance-scale"),
    ("generate x --num_sampels 3", "--num-samples"), ("edit x --prompt y --edit 1s:2s", "--change"),
    ("retrieve x --data d --num 3", "--top-k"), ("train --config c --workdir w --max-second=x", "--max-seconds")])
def test_flags_of_other_programs_and_slips_name_the_right_one(words, meant, capsys):
  with pytest.raises(SystemExit):
    cli.parse(words.split())
  error = capsys.readouterr().err
  assert f"did you mean {meant}?" in error and len(error.splitlines()) == 1


@pytest.mark.parametrize("words, says", [
    ("render a.npy --out a.png --size 20000x3", "in --size 20000x3: got a film"),
    ("render a.npy --out b.npy --trim 1:x", "in --trim 1:x: got 'x', expected a whole number"),
    ("make a.npy", "a.npy is a motion file, expected a project (.json) saved in the studio; motion-jax render"),
    ("generate a.npy --num-frames 8", "got 'a.npy' as the prompt, expected a sentence"),
    ("generate story.json", "motion-jax make makes a studio's project")])
def test_a_wrong_value_names_its_flag_and_a_wrong_file_its_command(words, says, tmp_path, monkeypatch, capsys):
  monkeypatch.chdir(tmp_path)
  np.save("a.npy", bent(0).joints)
  assert cli.main(words.split()) == 1 and says in capsys.readouterr().err


@pytest.mark.parametrize("words, says", [
    ("--path circle:0", "argument --path: in circle:0: got 'circle'"), ("--keyframe 0:none.npz", "there is no"),
    ("--keyframe none.npz", "argument --keyframe: got none.npz, expected AT:FILE"),
    ("--keep-parts legs", "argument --keep-parts: got legs, expected PARTS:FILE"),
    ("--target left_hand@2.5:0.3,1.4,x", "argument --target: in left_hand@2.5:0.3,1.4,x: got 'x'"),
    ("--target left_hnad@2.5:0.3,1.4,0", ": got the joint 'left_hnad' (did you mean left_hand?)")])
def test_a_wrong_constraint_names_its_flag(words, says, capsys):
  with pytest.raises((SystemExit, FileNotFoundError)) as error:
    control.constraints_of(cli.parse(["generate", "x", *words.split()]), types.SimpleNamespace(fps=20.0))
  assert says in str(error.value) + capsys.readouterr().err


@pytest.mark.parametrize("words, names", [
    ("generate x", step_names.GENERATE), ("multi-prompt x", step_names.MULTI_PROMPT),
    ("extend x --prompt y", step_names.EXTEND), ("edit x --prompt y", step_names.EDIT)])
def test_steps_are_left_out_by_name_and_an_unknown_one_names_them(words, names, capsys):
  choices = lambda args: generation_flags.choices_of(args, None)[0]
  args = cli.parse([*words.split(), "--without", "Clean-Up,warn"])
  assert choices(args) == {"cleanup", "warn"} and not args.explain
  assert choices(cli.parse([*words.split(), "--no-cleanup"])) == {"cleanup"}
  with pytest.raises(SystemExit):
    cli.parse([*words.split(), "--without", "corect"])
  error = capsys.readouterr().err
  assert f"got the step 'corect' to leave out, expected some of {', '.join(names)};" in error
  assert len(error.splitlines()) == 1


def test_a_sentence_without_quotes_is_shown_how_to_be_given(capsys):
  with pytest.raises(SystemExit):
    cli.parse(["generate", "a", "person", "bows twice", ""])
  assert "arguments: person 'bows twice' ''; a sentence goes in quotes" in capsys.readouterr().err


@pytest.mark.parametrize("command, ability", [("multi-prompt", "multi_prompt"), ("extend", "extend"), ("edit", "edit")])
def test_commands_have_the_flags_of_the_methods_that_can_run_them(command, ability):
  able = {stage.partition(".")[0] for stage in registry.model_stages(ability)}
  assert set(registry.METHODS) - able == set(generation_flags.WITHOUT[command])
  shown = {option for prog, option, _ in FLAGS if prog == f"motion-jax {command}"}
  names = {method: set(options.described()) for method, options in registry.options().items()}
  for method, choices in names.items():
    foreign = choices - set().union(*(names[one] for one in able))
    assert not shown & {f"--{name.replace('_', '-')}" for name in foreign}
    assert method not in able or {f"--{name.replace('_', '-')}" for name in choices} <= shown


@pytest.mark.parametrize("command", [
    ["generate", "a person walks"], ["make", "story.json"], ["blend", "a.bvh", "b.bvh"]])
def test_files_to_write_add_up(command):
  def read(*given):
    return cli.parse([*command, *given]).out

  assert read("--out", "a.html", "--out", "b.npz,c.bvh", "--out=d.png") == "a.html,b.npz,c.bvh,d.png"
  assert read("--out", "a.html") == "a.html" and read().endswith(".html")
  usual = "".join(list(read()))  # as a command line gives it: equal to the default, and not it
  assert read("--out", usual, "--out", "b.mp4") == f"{usual},b.mp4"


def test_a_config_has_a_name_wherever_one_is(tmp_path, monkeypatch):
  """By name, by the path that the repository has, by the path of a file of one's own, which comes first."""
  monkeypatch.chdir(tmp_path)
  assert config_files.load("configs/cmdm_denoiser.py:tiny").to_dict() == config_files.load(
      "cmdm_denoiser:tiny").to_dict()
  (tmp_path / "mine.py").write_text("from motion_jax.configs import cmdm_denoiser\n\n\ndef get_config(size='tiny'):\n"
                                    "  config = cmdm_denoiser.get_config(size).unlock()\n  config.seed = 8\n"
                                    "  return config.lock()\n")
  assert config_files.load("mine.py").seed == 8
  assert {"cmdm_denoiser", "ablations/cdamd"} < set(config_files.names()) and "__init__" not in config_files.names()


def test_overrides_are_set_and_nothing_else():
  config = config_files.load("cmdm_denoiser:tiny")
  made = overrides.applied(["--config.data.lengths=(64,192)", "--config.optimizer.learning_rate", "1e-3",
                            "--config.data.mirror", "--config.frozen.text=words"], config)
  assert made.data.lengths == (64, 192) and made.optimizer.learning_rate == 1e-3 and made.data.mirror is True
  assert made.frozen.text == "words" and made.model == config_files.load("cmdm_denoiser:tiny").model and made.is_locked
  with pytest.raises(ValueError, match="stray arguments more"):
    overrides.applied(["--config.seed=3", "more"], config)


def test_data_is_short_for_the_configs_folders(tmp_path, capsys):
  words = ["train", "--config", "cmdm_denoiser:small", "--workdir", str(tmp_path / "w"), "--data", "nowhere", "here"]
  assert cli.main(words) == 1
  assert "nowhere" in capsys.readouterr().err
  assert cli.main([*words, "--config.data.folder=there"]) == 1
  assert "give one of them" in capsys.readouterr().err and not any(tmp_path.iterdir())


def test_the_scripts_at_the_top_are_the_commands(tmp_path):
  for script, words, told in (("launch.py", ["--help"], "--max-seconds"),
                              ("eval.py", ["--paper-tables", "cdamd", "6"], "| CDAMD")):
    done = subprocess.run([sys.executable, str(ROOT / script), *words], env=devices_env(1), cwd=tmp_path,
                          capture_output=True, text=True, check=False)
    assert done.returncode == 0 and told in done.stdout and (words != ["--help"] or f"usage: {script} " in done.stdout)


def test_values_that_begin_with_a_dash_are_values():
  args = cli.parse(["render", "a.npy", "--up", "-z", "--out", "b.npz"])
  assert args.up == "-z" and args.out == "b.npz"
  with pytest.raises(SystemExit):
    cli.parse(["render", "a.npy", "--up", "--out", "b.npz"])
