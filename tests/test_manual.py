"""The examples of the manual do what their page says with the default seed, and print no more than it shows."""
import contextlib
import io
import json
import pathlib
import re
import shlex
import subprocess

import pytest

from motion_jax.text.encoder import load_text_encoder
from motion_jax_studio import cli
from motion_jax_studio.language import parse
from tests.conftest import ROOT
from tests.pages import PAGES, TYPED, blocks, name_of, shell_lines

# Lines about this run and not about the motion: time, progress, where files are, the licence of the weights.
_OF_THE_RUN = re.compile(r"(?:working: |generated in |wrote |see it: |open |These weights ).*\n")
_NOTE = re.compile(r"(?m)^note: (?!.*by its bones it is in centimetres).*")  # said of every BVH file, its own ones too
# What makes or shows a motion; commands that serve, train and evaluate have tests of their own.
_MAKING = ("generate", "multi-prompt", "extend", "edit", "render", "blend", "models")
_PAGES = ("README", *(name.removesuffix(".md") for name in TYPED), "robots", "sampling")  # typed from the top


def consoles(page):
  """[(command line, lines that it prints)] of the console blocks of a page."""
  return [(command, printed) for block in blocks(page, "console")
          for command, printed in re.findall(r"(?m)^\$ (.*)\n((?:(?!\$ ).*\n)*)", block)]


def text_of(name):
  """The text of a page of docs/ by its name."""
  return (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")


def run(words):
  """What a command prints, to both of its outputs in the order of time, without what is of the run alone."""
  printed = io.StringIO()
  with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
    status = cli.main(words)
  assert not status, (words, printed.getvalue())
  return _OF_THE_RUN.sub("", printed.getvalue())


EXAMPLES = [(name_of(page), *example) for page in PAGES for example in consoles(page)]


def test_speeds_of_the_models_are_those_of_the_performance_page():
  """In the README, in docs/models.md and in what `motion-jax models` prints."""
  rows = map(json.loads, (ROOT / "benchmarks/data/performance/rows.jsonl").read_text().splitlines())
  seconds = {row["piece"].split("/")[1]: f"{row['processor']:.2f} s" for row in rows
             if re.fullmatch(r"batch/c.*/1", row["piece"])}
  assert len(seconds) == 3
  for name, shown in seconds.items():
    for page in ("README.md", "docs/models.md"):
      line = re.search(rf"(?m)^\| \[?`{name}`.*", (ROOT / page).read_text())
      assert line and f"| {shown} |" in line[0], (page, name)
    about = json.loads((ROOT / "motion_jax/pretrained" / name / "about.json").read_text())
    assert about["speed"] == f"6 s of motion in {shown} of processor time"


def test_the_manual_has_examples_with_what_they_print():
  assert {"sentences"} <= {name for name, *_ in EXAMPLES}
  assert all(shlex.split(command)[0] == "motion-jax" and printed for _, command, printed in EXAMPLES)


def test_a_sentence_is_understood_as_its_page_says():
  for _, command, printed in EXAMPLES:
    for said in re.findall(r"(?m)^understood as: (.*)", printed):
      sentence = shlex.split(command)[2]
      assert parse(sentence).summary == said and not load_text_encoder("cmdm-small").out_of_vocabulary(sentence)


@pytest.mark.parametrize("command, printed", [
    pytest.param(*example, marks=pytest.mark.exhaustive if "generated as" in example[1] else pytest.mark.slow)
    for _, *example in EXAMPLES])
def test_an_example_prints_what_its_page_says(command, printed, tmp_path, monkeypatch):
  monkeypatch.chdir(tmp_path)
  assert run(shlex.split(command)[1:]) == printed


COMPARING = ["choosing", "coming-from"]  # pages with commands in tables


@pytest.mark.parametrize("name", COMPARING)
def test_commands_in_tables_exist(name, capsys):
  lines = re.findall(r"`(motion-jax [a-z-]+ [^`]*)`", text_of(name).replace("\\|", "|"))
  lines = [line.removesuffix(" FILE --out OTHER") + " a.npz --out b.npz" if "OTHER" in line else line for line in lines]
  for line in lines:
    if "--" in line or len(line.split()) > 3:
      assert cli.parse(shlex.split(line)[1:]).command, line
  assert len(lines) > 4 * (name == "coming-from") and not capsys.readouterr().err


def test_flags_of_other_programs_are_refused_with_ours(capsys):
  """Those of the tables whose right column names another flag of `generate`."""
  rows = re.findall(r"(?m)^\| (`--.*?) \| (`--.*?) \|$", text_of("coming-from"))
  flags = re.compile(r"`--([\w-]+)")
  differing = [(theirs, ours) for row in rows for theirs, ours in zip(*map(flags.findall, row))
               if theirs.replace("_", "-") != ours]
  assert len(differing) > 5
  for theirs, ours in differing:
    if (theirs, ours) not in (("time_steps", "num-iterations"), ("motion_length", "num-frames"), ("bvh", "out")):
      with pytest.raises(SystemExit):
        cli.parse(["generate", "a person waves", f"--{theirs}", "1"])
      assert f"did you mean --{ours}?" in capsys.readouterr().err, theirs


def test_abilities_of_the_methods_are_those_of_their_classes():
  from motion_jax.models.cdamd.model import CdamdModel
  from motion_jax.models.cmdm.model import CmdmModel
  from motion_jax.models.mdm.model import DipModel, MdmModel
  from motion_jax.models.mld.model import MldModel
  from motion_jax.models.momask.model import MomaskModel
  from motion_jax.models.motionstreamer.model import MotionStreamerModel
  from motion_jax.models.t2m_gpt.model import T2mGptModel
  classes = {"CMDM": CmdmModel, "CDAMD, MARDM": CdamdModel, "MDM": MdmModel, "DiP": DipModel, "MLD": MldModel,
             "T2M-GPT": T2mGptModel, "MoMask": MomaskModel, "MotionStreamer": MotionStreamerModel}
  section = text_of("choosing").partition("| streams | edits frames |")[2].partition("\n\n")[0]
  rows = {name: words for name, *words in re.findall(r"(?m)^\| (.*?) \| .*? \| (yes|no) \| (yes|no) \|", section)}
  assert rows == {name: [("no", "yes")[ability in model.abilities] for ability in ("stream", "edit")]
                  for name, model in classes.items()}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", _PAGES)
def test_the_lines_of_a_page_make_motions_that_need_no_note(name, tmp_path, monkeypatch):
  """Each does at its default seed what it says, without a word about what is missing."""
  monkeypatch.chdir(tmp_path)
  page = next(page for page in PAGES if name_of(page) == name)
  said = {}
  for line in shell_lines(page):
    words = shlex.split(line.splitlines()[0], comments=True)
    if "motion-jax" not in line:
      if words[0] in ("printf", "cat", "mkdir", "cp"):
        subprocess.run(["bash", "-c", line], check=True)
      continue
    words = words[[pathlib.Path(word).name for word in words].index("motion-jax") + 1:]
    if words[0] in _MAKING:
      said[line] = _NOTE.findall(run(words))
      made = [one for flag, given in zip(words, words[1:]) if flag == "--out" for one in given.split(",")]
      stems = {path.stem for path in tmp_path.iterdir()}
      assert all(pathlib.Path(one).stem in stems or f"{pathlib.Path(one).stem}_0" in stems for one in made), line
  assert said and not any(said.values()), said
