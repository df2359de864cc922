"""What `motion-jax models` and `--help` say of the models that ship is what they are."""
import pytest

from motion_jax import loading, runs
from motion_jax_studio import cli
from tests.conftest import some_of

MAKERS = [name for name in runs.shipped_names() if runs.about(name)["for"] == "text to motion"]


@pytest.mark.parametrize("name", runs.shipped_names())
def test_what_is_said_of_a_model(name, capsys):
  about = runs.about(name)
  licence = (runs.PRETRAINED / name / "LICENSE.txt").read_text()
  said, _, terms = about["licence"].partition(", ")
  assert said in licence and terms.split()[0] in licence
  assert about["does"] and (about["speed"] or name not in MAKERS)
  assert cli.main(["models"]) == 0
  lines = capsys.readouterr().out.splitlines()
  line = next(line for line in lines if line.strip().startswith(name + " "))
  assert f"{runs.num_params(name) / 1e6:.1f} M parameters; {about['licence']}" in line
  assert lines[1].split()[0] == "cmdm-small"  # the default is the first


@pytest.mark.parametrize("name", some_of(MAKERS, ["cmdm-small"], set(MAKERS) - {"cmdm-small"}))
def test_parameters_are_counted_in_one_way(name, pytestconfig):
  count = runs.num_params(name)
  assert count == loading.load(name).num_params
  said = f"{count / 1e6:.1f} M"
  for page in ("README.md", "docs/models.md"):
    text = (pytestconfig.rootpath / page).read_text()
    places = [line for line in text.splitlines() if f"`{name}` (" in line or f"`{name}` has" in line]
    wrong = [line for line in places if " M" in line and said not in line]
    assert not wrong, (page, wrong)


def test_defaults_of_the_help_are_the_models_own(capsys):
  with pytest.raises(SystemExit):
    cli.main(["generate", "--help-all"])
  text = " ".join(capsys.readouterr().out.split())
  for name in MAKERS:
    sampler = runs.load_run(name).config.sampler
    for field in ("guidance_scale", "num_steps"):
      part = text.split(f"--{field.replace('_', '-')} {field.upper()} ")[-1].partition(" --")[0]
      part = part.replace("cdamd- small", "cdamd-small").replace("cmdm- ", "cmdm-").replace("small- ", "small-")
      group = next(one for one in part.partition("shipped models: ")[2].split(";") if f"{name}," in one or
                   one.rstrip(") ").endswith(name))
      assert group.strip().startswith(f"{sampler[field]:g} for")


def test_hints_name_a_command_that_works_in_a_clone(pytestconfig):
  """The package stands in no index yet: what hints and pages say to install is a folder's."""
  root = pytestconfig.rootpath
  files = [*(root / "motion_jax").rglob("*.py"), *(root / "docs").rglob("*.md"), root / "README.md"]
  assert not [str(path) for path in files if "motion-jax[" in path.read_text(encoding="utf-8")]
