"""Names that have changed go on working, each with a note: every one of them is listed here."""
import argparse
import warnings

import pytest

from motion_jax import fit, loading, runs
from motion_jax.text.encoder import load_text_encoder
from motion_jax.utils import config_files, former_names, overrides
from motion_studio import cli

FAST = dict(num_steps=4, lag=2)

COMMAND_LINES = [  # former, as it is, what the notes say
    ("story x", "multi-prompt x", ["motion-jax story is called motion-jax multi-prompt"]),
    ("generate x --raw --bvh_unit m", "generate x --no-cleanup --bvh-unit m", ["--raw is called --no-cleanup"]),
    ("multi-prompt x --raw", "multi-prompt x --no-cleanup", ["--raw is called --no-cleanup"]),
    ("extend x --text y --raw", "extend x --text y --no-cleanup", ["--raw is called --no-cleanup"]),
    ("edit x --text y --task prefix --raw", "edit x --text y --task prefix --no-cleanup",
     ["--raw is called --no-cleanup"]),
    ("generate x --rounds 4 --revealed-only=false", "generate x --iterations 4 --unmasked-only false",
     ["--rounds is called --iterations", "--revealed-only is called --unmasked-only"]),
    ("evaluate --run a --run=b --data d --repeats 2 --raw --no_multimodality",
     "evaluate --model a --model=b --data d --replications 2 --weights model --no-multimodality",
     ["--run is called --model", "--run is called --model", "--repeats is called --replications",
      "--raw is called --weights=model"]),
    ("evaluate --data d --clip_evaluator none", "evaluate --data d --clip-evaluator none", []),
    ("convert teacher f --stats s --out o --text t", "convert teacher f --stats s --out o --text-encoder t",
     ["--text is called --text-encoder"]),
    ("train --config c --workdir w --max_seconds 3 --noresume",
     "train --config c --workdir w --max-seconds 3 --no-resume",
     ["--noresume is called --no-resume"]),
    ("train -config=c -workdir w --resume=true", "train --config c --workdir w --resume",
     ["--resume=true is called --resume"]),
    ("train --config c --workdir w --resume=False --config.data.batch_size 3",
     "train --config c --workdir w --no-resume --config.data.batch_size 3", ["--resume=False is called --no-resume"]),
]


@pytest.mark.parametrize("former, newer, notes", COMMAND_LINES)
def test_command_lines(former, newer, notes, capsys):
  assert cli.parse(former.split()) == cli.parse(newer.split())
  assert capsys.readouterr().err == "".join(f"note: {one}\n" for one in notes)


def _former_flags(parser):
  """All former flags of a parser and those below it."""
  below = [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]
  return set(parser.former_flags).union(*(_former_flags(one) for action in below for one in action.choices.values()))


def test_every_former_flag_is_among_the_command_lines():
  words = {word for former, _, _ in COMMAND_LINES for word in former.split()}
  shown = words | {word.partition("=")[0] for word in words}
  spellings = {f"--resume={text}" for text in ("true", "True", "1", "false", "False", "0")}
  assert _former_flags(cli._parser()) - spellings <= shown


@pytest.fixture(scope="module")
def model(tiny_run):
  return loading.load(tiny_run)


@pytest.mark.slow
def test_the_keyword_polish(model):
  prompts = [("a person walks", 1.2), ("a person waves", 1.2)]
  makes = {
      "generate": lambda **given: model.generate("a person walks", 24, seeds=[1], **FAST, **given)[0],
      "multi_prompt": lambda **given: model.multi_prompt(prompts, seed=1, **FAST, **given),
      "multi_prompts": lambda **given: model.multi_prompts([prompts], seeds=[1], **FAST, **given)[0],
      "extend": lambda **given: model.extend(walk, "a person waves", 24, seed=1, **FAST, **given),
  }
  walk = makes["generate"](cleanup=False)
  for name, make in makes.items():
    with pytest.warns(FutureWarning, match="polish is called cleanup; the old name goes on working") as notes:
      former = make(polish=False)
    assert {note.filename for note in notes} == {__file__}, name  # the caller's own line
    assert (former.joints == make(cleanup=False).joints).all() and former.meta["cleanup"] is False, name
    assert (former.joints != make(cleanup=True).joints).any(), name
  with pytest.raises(TypeError, match="got both cleanup and polish, which is its former name"):
    model.generate("a person walks", 24, polish=False, cleanup=True)


def test_the_methods_story_and_stories(model):
  prompts = [("a person walks", 1.2), ("a person waves", 1.2)]
  whole = model.multi_prompt(prompts, seed=2, **FAST).joints
  with pytest.warns(FutureWarning, match="story is called multi_prompt; the old name goes on working") as notes:
    assert (model.story(prompts, seed=2, **FAST).joints == whole).all()
  assert {note.filename for note in notes} == {__file__}
  with pytest.warns(FutureWarning, match="stories is called multi_prompts; the old name goes on working"):
    assert (model.stories([prompts], seeds=[2], **FAST)[0].joints == whole).all()


def test_choices_of_sampling():
  model = loading.load("cdamd-small")
  with pytest.warns(FutureWarning, match="called") as notes:
    former = model.sampling(rounds=3, revealed_only=False)
  assert [str(note.message).partition(";")[0] for note in notes] == [
      "rounds is called num_iterations", "revealed_only is called unmasked_only"]
  assert former == model.sampling(num_iterations=3, unmasked_only=False) != model.sampling()


def test_no_other_keyword_has_a_former_name():
  """repeats, of `evaluate`, is tried in evaluation/test_run.py."""
  assert set(former_names.KEYWORDS) == {"polish", "rounds", "revealed_only", "repeats"}


FIELDS = [  # a config that has it, the former name, the name, a value
    ("cmdm_denoiser:tiny", "data.unit", "data.frames_per_latent", 8),
    ("cdamd_generator:tiny", "sampler.num_rounds", "sampler.num_iterations", 7),
    ("cdamd_generator:tiny", "sampler.revealed_only", "sampler.unmasked_only", False),
]


def test_every_former_field_is_listed():
  assert {old: new for _, old, new, _ in FIELDS} == former_names.FIELDS


@pytest.mark.parametrize("name, old, new, value", FIELDS)
def test_fields_of_configs(name, old, new, value, tmp_path):
  """On the command line, in a config file of one's own, in one that builds on ours, and in the config of a run."""
  today = config_files.load(name)
  changed = today.copy_and_resolve_references().unlock()
  changed.update_from_flattened_dict({new: value})
  changed.lock()
  assert changed != today
  with pytest.warns(FutureWarning, match=f"--config.{old} is called --config.{new}; the old name goes on working"):
    assert overrides.applied([f"--config.{old}={value}"], config_files.load(name)) == changed
  if not isinstance(value, bool):
    with pytest.warns(FutureWarning, match=f"--config.{old} is called"):
      assert overrides.applied([f"--config.{old}", str(value)], config_files.load(name)) == changed

  (section, before), after = old.split("."), new.partition(".")[2]
  told = changed.to_dict()
  told[section] = {before if key == after else key: one for key, one in told[section].items()}
  own, built = tmp_path / "own.py", tmp_path / "built.py"
  own.write_text(f"import ml_collections\n\ndef get_config():\n  return ml_collections.ConfigDict({told!r}).lock()\n")
  built.write_text("from motion_jax.utils import config_files\n\ndef get_config():\n"
                   f"  config = config_files.load({name!r}).unlock()\n  config.{old} = {value}\n"
                   "  return config.lock()\n")
  for path in (own, built):
    with pytest.warns(FutureWarning, match=f"{path.name}: config.{old} is called config.{new}"):
      assert config_files.load(path) == changed

  with warnings.catch_warnings():
    warnings.simplefilter("error")  # what the program wrote itself needs no note
    assert runs.upgrade(type(today)(told)).to_dict() == runs.upgrade(changed).to_dict()


def test_the_value_fresh(tmp_path):
  """Of any field of config.frozen, in a file and on the command line, in a run's config; and as a text encoder."""
  today = config_files.load("cdamd_generator:tiny")
  assert {field: value for field, value in today.frozen.items() if value == "random-init"}.keys() == {
      "tokenizer", "prior", "text"}
  told = today.to_dict()
  told["frozen"] |= dict(tokenizer="fresh", prior="fresh", text="fresh")
  own = tmp_path / "own.py"
  own.write_text(f"import ml_collections\n\ndef get_config():\n  return ml_collections.ConfigDict({told!r}).lock()\n")
  with pytest.warns(FutureWarning, match="own.py: config.frozen.tokenizer 'fresh' is called 'random-init'"):
    assert config_files.load(own) == today
  with pytest.warns(FutureWarning, match="config.frozen.prior 'fresh' is called 'random-init'"):
    changed = overrides.applied(["--config.frozen.prior=fresh"], config_files.load("cdamd_generator:tiny"))
    assert fit.resolve(changed)[0] == fit.resolve(today)[0]
  assert runs.upgrade(type(today)(told)).frozen.to_dict() == today.frozen.to_dict()
  with pytest.warns(FutureWarning, match="'fresh' is called 'random-init'"):
    former = load_text_encoder("fresh")
  assert former.fingerprint == load_text_encoder("random-init").fingerprint


def test_the_method_unfamiliar():
  words = load_text_encoder("words")
  with pytest.warns(FutureWarning, match="unfamiliar is called out_of_vocabulary"):
    assert words.unfamiliar("a person frobnicates") == words.out_of_vocabulary("a person frobnicates") != []


@pytest.mark.parametrize("name", runs.shipped_names())
def test_the_runs_that_ship_have_fields_by_their_names(name):
  config = runs.load_run(name).config
  assert not former_names.rename_fields(config.to_dict())
