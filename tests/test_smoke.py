"""A newcomer's first minutes work: every config trains two steps, the README says nothing that does not run."""
import ast
import functools
import json
import re
import shlex
import shutil
import tomllib
import types

import chex
import jax
import numpy as np
import pytest
import yaml

from motion_jax import fit as training
from motion_jax.training import checkpoint
from motion_jax.training.metrics import read_metrics
from motion_jax.utils import config_files
from motion_jax_studio import cli
from motion_jax_studio.cli import overrides
from tests.conftest import ROOT, load_config, some_of
from tests.pages import CARDS, LANDING, MORE, PAGES, TYPED, blocks, commands, name_of, shell_lines
from tools.site import notebooks

CONFIGS = [name for name in config_files.names() if "/" not in name]
pytestmark = pytest.mark.usefixtures("kept_features")


# Of every config the loss is traced in configs/test_tiny_sizes.py; here they train. One of each kind: an autoencoder
# that validates, a codebook that changes without a gradient. The two generators train in fixtures of conftest.py.
TRAINED = ("cdamd_autoencoder", "cdamd_rvq")


@pytest.mark.parametrize("name", some_of(CONFIGS, slow=TRAINED))
def test_every_config_trains_two_steps(name, tmp_path):
  """With the network's own initializers and with the evaluation that follows a save."""
  state = training.run(load_config(name, "tiny"), tmp_path)
  assert int(state.step) == 2
  assert np.isfinite([row["loss"] for row in read_metrics(tmp_path) if "loss" in row]).all()
  for file in (checkpoint.CONFIG, checkpoint.PARAMS, "Mean.npy", "Std.npy", "loss.png"):
    assert (tmp_path / file).is_file(), file


@pytest.mark.slow
def test_resume_through_the_stage_is_exact(tmp_path, unjudged, capsys):
  """Data order, noise, optimizer and average all continue: 2 + 2 steps are 4, bit for bit."""
  config = load_config("cdamd_length", "tiny").unlock()

  def train(name, num_steps):
    config.optimizer.ema_decay, config.train.num_steps = 0.5, num_steps
    return training.run(config, tmp_path / name, resume="auto")

  train("parts", 2)
  parts, whole = train("parts", 4), train("whole", 4)
  assert re.findall("--resume=auto: (.*) /", capsys.readouterr().out) == ["starting", "resuming", "starting"]
  chex.assert_trees_all_equal(parts, whole)


@pytest.mark.slow
def test_resume_with_other_frozen_parts_is_refused(tiny_run, tmp_path):
  """Statistics, tokenizer and weights of a run are its own: exchanged or damaged, they are not silently taken over."""
  folder, config = shutil.copytree(tiny_run, tmp_path / "run"), load_config("cmdm_denoiser", "tiny")
  mean, std, words, frozen = (folder / name for name in ("Mean.npy", "Std.npy", checkpoint.TEXT, checkpoint.FROZEN))
  cut = lambda file, size: file.write_bytes(file.read_bytes()[:size])
  moved = jax.tree.map(lambda a: a + 0.1, checkpoint.load_params(folder, name=checkpoint.FROZEN))
  for file, other, match in ((mean, lambda: np.save(mean, np.load(mean) + 1), "other data"),
                             (std, lambda: np.save(std, 1.1 * np.load(std)), "other data"),
                             (words, lambda: words.write_text('{"name": "", "fingerprint": "x"}'), "another text enc"),
                             (mean, lambda: cut(mean, 200), "should hold 1052 bytes .* has 72"),
                             (frozen, lambda: checkpoint.save_params(folder, moved, name=checkpoint.FROZEN),
                              "another tokenizer"), (frozen, lambda: cut(frozen, -10), "no whole safetensors")):
    whole = file.read_bytes()
    other()
    with pytest.raises(ValueError, match=match):
      training.run(config, folder, resume=True)
    file.write_bytes(whole)


@pytest.mark.parametrize("page", PAGES + CARDS + MORE, ids=name_of)
def test_commands_of_the_pages_exist(page, capsys):
  """Every command line of ours in the README, the pages of docs/ and the models' cards parses, and its config has the
  fields it names, by the names that they have."""
  of_scripts = {"launch.py": "train", "eval.py": "evaluate"}
  found = [words for words in commands(page) if words[0] in ("motion-jax", *of_scripts)]
  must = page == ROOT / "README.md" or page.stem in ("command-line", "training", "evaluation", "data") or (
      page in CARDS and page.parent.name != "words")
  assert found or not must
  for program, *words in found:
    args = cli.parse(words, of_scripts.get(program), program) if program in of_scripts else cli.parse(words)
    if args.command == "train":
      config = overrides.applied(args.overrides, config_files.load(args.config))
      assert "passes" in config or config.stage
  for words in commands(page):
    assert words[0] == "motion-jax" or (ROOT / words[0]).is_file(), words
  assert not capsys.readouterr().err


@pytest.mark.parametrize("page", PAGES + CARDS + MORE, ids=name_of)
def test_a_block_says_its_language(page):
  """So that the tests here find every command; what a program reads can be read."""
  for language, block in re.findall(r"(?ms)^```(\w*)\n(.*?)^```", page.read_text(encoding="utf-8")):
    if not language:
      command = re.search(r"(?m)^(\.venv/bin/)?(motion-jax|python3?|pip) .*", block)
      assert not command, f"write ```bash before {command[0]!r}"
    elif language in ("json", "toml", "yaml"):
      {"json": json.loads, "toml": tomllib.loads, "yaml": lambda text: list(yaml.safe_load_all(text))}[language](block)
    else:
      assert language in ("python", "bash", "console", "sh", "text", "bibtex"), language


def test_pages_that_are_typed_from_the_top_need_no_file_of_ones_own():
  """Every file that their commands read was made by one before."""
  for name in TYPED:
    made = set()
    for line in shell_lines(ROOT / "docs" / name):
      words = shlex.split(line.splitlines()[0], comments=True)
      given = [word.partition(":")[2] if ":" in word and "." in word.partition(":")[2] else word for word in words]
      read = {word.partition("@")[0] for word in given[1:]
              if re.fullmatch(r"[\w./-]+\.(npz|npy|bvh|csv|json)(@\d+)?", word)}
      outs = {part for before, word in zip(words, words[1:]) if before in ("--out", ">") for part in word.split(",")}
      made |= {part for out in outs for part in (out, re.sub(r"(\.\w+)$", r"_0\1", out))}
      assert read <= made, (name, line, read - made)


SCRIPTS = {name_of(page): "\n".join(blocks(page, "python")) for page in reversed(PAGES)} | {
    path.stem: "\n".join(notebooks.blocks(path, "tests")) for path in notebooks.paths()}


@pytest.mark.parametrize("name", [name for name, script in SCRIPTS.items() if script])
def test_python_of_the_pages_and_notebooks_names_what_there_is(name):
  """What it imports, and each attribute of a module or class of ours that it imports."""
  tree, scope = ast.parse(SCRIPTS[name]), {}
  for node in ast.walk(tree):
    if isinstance(node, ast.Import | ast.ImportFrom) and "bpy" not in ast.unparse(node):
      exec(ast.unparse(node), scope)
  of_modules = {name for name, value in scope.items() if isinstance(value, types.ModuleType | type)}
  named = {ast.unparse(node) for node in ast.walk(tree) if isinstance(node, ast.Attribute)
           and re.fullmatch(r"[\w.]+", ast.unparse(node)) and ast.unparse(node).partition(".")[0] in of_modules}
  below = lambda root, *names: functools.reduce(lambda value, name: getattr(value, name, None), names, scope[root])
  assert scope and not [text for text in named if below(*text.split(".")) is None]


OF_PAGES = {name: script for name, script in SCRIPTS.items() if script and name in map(name_of, PAGES)}
OF_LIBRARY, APPLICATION, OF_APPLICATION = OF_PAGES.pop("README").partition("from motion_jax_studio import Pipeline")
OF_PAGES |= {"README, library": OF_LIBRARY, "README, application": APPLICATION + OF_APPLICATION}


@pytest.mark.parametrize("page", some_of(OF_PAGES, slow=["README, library", "README, application", "training"]))
def test_python_of_the_pages_runs_and_prints_what_stands_beside_it(page, tmp_path, monkeypatch, capsys, recwarn):
  """Without an error or a note about the motion; of "print(x)  # value: why" the value, where it is one."""
  monkeypatch.chdir(tmp_path)
  exec(compile(OF_PAGES[page], page, "exec"), {})
  printed = capsys.readouterr().out.splitlines()
  values = [value for value in re.findall(r"(?m)^print\(.*\)  +# (.*)", OF_PAGES[page])
            if not value.startswith(("all ", "what "))]
  assert not [value for value in values if value.partition(": ")[0] not in printed], printed
  assert not [str(one.message) for one in recwarn if "another seed may show it" in str(one.message)]


def test_the_landing_page_says_what_the_readme_says():
  """Its commands and Python are the README's, which the tests above run; comments may be shorter."""
  bare = lambda block: [line.partition("  #")[0].rstrip() for line in block.splitlines()]
  readme = [line for language in ("bash", "python") for block in blocks(ROOT / "README.md", language)
            for line in bare(block)]
  lines = [line for language in ("bash", "python") for block in blocks(LANDING, language) for line in bare(block)]
  assert lines and set(lines) <= set(readme)
