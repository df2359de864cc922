"""What a release states in several places is the same everywhere: versions, licences, ranges of dependencies."""
import json
import re
import tomllib

import pytest
import yaml

import motion_jax
from tests.conftest import ROOT
from tools import release

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def text_of(path):
  return (ROOT / path).read_text(encoding="utf-8")


def table_row(page, name):
  """The cells of the row of a Markdown table that begins with a name."""
  return re.search(rf"(?m)^\| {re.escape(name)} \|(.*)\|$", text_of(page))[1]


def test_versions_of_the_stability_page_are_those_of_the_project_and_of_ci():
  page = "docs/stability.md"
  ranges = dict(re.match(r"([\w.-]+)(.*)", dependency).groups() for dependency in PROJECT["dependencies"])
  for name in ("jax", "flax"):
    assert f"`{ranges[name]}`" in table_row(page, name)
    locked = re.findall(rf"(?m)^{name}==(\S+)", text_of(".ci/constraints.txt"))
    assert len(locked) == 2 and re.findall(r"with (?:Python )?3\.1[12]: ([\d.]+\d)", table_row(page, name)) == locked
    lowest = re.match(r">=([\d.]+)", ranges[name])[1]
    assert lowest == locked[0]  # CI tests the lower bound
  python = PROJECT["requires-python"].removeprefix(">=")
  assert f"{python} or newer" in table_row(page, "Python") and f"Python {python} or newer" in text_of("README.md")
  tested = re.findall(r'python: \[(.*)\]', text_of(".github/workflows/library.yml"))[0].replace('"', "")
  assert tested.replace(", ", " and ") in table_row(page, "Python")


def test_the_stability_page_speaks_of_this_version():
  assert f"Version {motion_jax.__version__} is not released yet" in text_of("docs/stability.md")
  assert re.search(r"(?m)^## (\S+)", text_of("CHANGELOG.md"))[1] == motion_jax.__version__


def test_all_files_state_one_version():
  assert set(release.versions().values()) == {motion_jax.__version__}


CHANGES = [  # file, text in it, text of a release that is not ready, what the check says
    ("CITATION.cff", "version: 0.2.0", "version: 0.1.0", "CITATION.cff states version 0.1.0, the tag is v0.2.0"),
    (".zenodo.json", '"version"', '"edition"', ".zenodo.json states version nothing"),
    ("CHANGELOG.md", "## 0.2.0 (2026-12-01)", "## 0.2.0 (unreleased)", "write the date"),
    ("docs/stability.md", "Version 0.2.0", "Version 0.2.0 is not released yet", "not released yet")]


@pytest.fixture
def ready(tmp_path):
  """The files of a version that is ready for its tag."""
  texts = {"motion_jax/__init__.py": '__version__ = "0.2.0"\n', "CITATION.cff": "type: software\nversion: 0.2.0\n",
           ".zenodo.json": '{\n "version": "0.2.0",\n "title": ""\n}\n', "CHANGELOG.md": "## 0.2.0 (2026-12-01)\n",
           "docs/stability.md": "Version 0.2.0\n"}
  for path, text in texts.items():
    (tmp_path / path).parent.mkdir(exist_ok=True)
    (tmp_path / path).write_text(text)
  return tmp_path


@pytest.mark.parametrize("path, before, after, fault", CHANGES, ids=[path for path, *_ in CHANGES])
def test_a_release_that_is_not_ready_is_refused(ready, path, before, after, fault):
  assert release.faults("v0.2.0", ready) == [] and len(release.faults("v0.3.0", ready)) == 4
  (ready / path).write_text((ready / path).read_text().replace(before, after))
  (line,) = release.faults("v0.2.0", ready)
  assert fault in line


def test_a_prepared_tree_names_the_repository(ready):
  (ready / "pyproject.toml").write_text(text_of("pyproject.toml"))
  (ready / "README.md").write_text("![a](docs/a.png) [b](docs/b.md#c) [d](#d) [e](https://e.org)\n```\n[f](g)\n```\n"
                                   "[h [i]](../j) ![k](https://k.org/k.png)\n")
  release.prepare("https://host/owner/name/", "v1", ready)
  blob = "https://host/owner/name/blob/v1/"
  assert (ready / "README.md").read_text() == (
      f"![a](https://host/owner/name/raw/v1/docs/a.png) [b]({blob}docs/b.md#c) [d](#d) [e](https://e.org)\n"
      f"```\n[f](g)\n```\n[h [i]]({blob}../j) ![k](https://k.org/k.png)\n")
  urls = tomllib.loads((ready / "pyproject.toml").read_text())["project"]["urls"]
  assert urls["Repository"] == "https://host/owner/name" and urls["Changelog"] == blob + "CHANGELOG.md"
  assert yaml.safe_load((ready / "CITATION.cff").read_text())["repository-code"] == urls["Repository"]
  with pytest.raises(SystemExit, match="fresh checkout"):
    release.prepare("https://host/owner/name", "v1", ready)


def test_the_licence_of_the_code_is_the_same_everywhere():
  parts = PROJECT["license"].split(" AND ")
  citation, zenodo = yaml.safe_load(text_of("CITATION.cff")), json.loads(text_of(".zenodo.json"))
  assert parts[0] == citation["license"] == zenodo["license"] == "Apache-2.0"
  assert "Apache License" in text_of("LICENSE").splitlines()[0] + text_of("LICENSE").splitlines()[1]
  assert "[Apache-2.0](LICENSE)" in text_of("README.md") and "Apache License, Version 2.0" in text_of("NOTICE")


@pytest.mark.parametrize("folder", sorted((ROOT / "motion_jax" / "pretrained").glob("*/about.json")),
                         ids=lambda path: path.parent.name)
def test_a_models_licence_is_the_same_everywhere(folder):
  name, licence = folder.parent.name, json.loads(folder.read_text())["licence"].partition(",")[0]
  assert licence.replace("CC BY", "CC-BY").replace(" ", "-") in PROJECT["license"].split(" AND ")
  assert licence in text_of("NOTICE") and licence in text_of(f"motion_jax/pretrained/{name}/README.md")
  for page in ("README.md", "docs/models.md"):
    for row in re.findall(rf"(?m)^\| \[?`{name}`.*\d M .*$", text_of(page)):
      assert licence in row, page


def test_licences_of_parts_are_in_the_package_and_named():
  files = {path.relative_to(ROOT).as_posix() for pattern in PROJECT["license-files"] for path in ROOT.glob(pattern)}
  licences = {path.relative_to(ROOT).as_posix() for path in (ROOT / "motion_jax").rglob("LICENSE*")}
  assert licences | {"LICENSE", "NOTICE"} == files and len(licences) > 5
  assert {"MIT", "BSD-3-Clause", "LicenseRef-WordNet"} <= set(PROJECT["license"].split(" AND "))


def test_what_describes_the_project_is_the_same_everywhere():
  citation, zenodo = yaml.safe_load(text_of("CITATION.cff")), json.loads(text_of(".zenodo.json"))
  assert PROJECT["keywords"] == citation["keywords"] == zenodo["keywords"] and citation["title"] == zenodo["title"]
  assert PROJECT["authors"] == citation["authors"] == zenodo["creators"]
  tested = re.findall(r'python: \[(.*)\]', text_of(".github/workflows/library.yml"))[0].replace('"', "").split(", ")
  assert [name.rpartition(" ")[2] for name in PROJECT["classifiers"] if ":: 3." in name] == tested


def test_the_release_workflow_builds_once_and_publishes_to_the_test_index_first():
  jobs = yaml.safe_load(text_of(".github/workflows/release.yml"))["jobs"]
  publish = {name: step for name, job in jobs.items() for step in job["steps"]
             if "pypi-publish" in step.get("uses", "")}
  assert [step.get("with", {}).get("repository-url", "") for step in publish.values()] == [
      "https://test.pypi.org/legacy/", ""]
  first, second = publish
  assert jobs[first]["needs"] == "attest" and jobs["attest"]["needs"] == "build" and jobs[second]["needs"] == first
  assert all(jobs[name]["permissions"] == {"id-token": "write"} for name in publish)
  assert sum("python -m build" in step.get("run", "") for job in jobs.values() for step in job["steps"]) == 1


def stages():
  """{stage of the Dockerfile: [its base, its instructions (name, arguments)]}."""
  lines = re.sub(r"\\\n", " ", re.sub(r"(?m)^#.*\n", "", text_of("Dockerfile"))).splitlines()
  by_name, name = {}, ""
  for word, rest in (line.split(None, 1) for line in lines if line.strip()):
    if word == "FROM":
      base, _, name = rest.split()
      by_name[name] = [base, []]
    else:
      by_name[name][1].append((word, rest))
  return by_name


def test_images_run_as_a_user_without_rights():
  images = stages()
  assert list(images)[-1] == "cpu"  # the default target
  for target in ("cpu", "cuda"):
    base, instructions = images[target]
    assert base == "base" and instructions[-1] == ("USER", "motion")
  assert "useradd --uid 1000" in dict(images["base"][1])["RUN"]


def test_images_are_made_of_files_that_exist_and_of_this_python():
  images = stages()
  kept = {line.removeprefix("!") for line in text_of(".dockerignore").splitlines() if line.startswith("!")}
  copied = {source for word, rest in images["source"][1] if word == "COPY" for source in rest.split()[:-1]}
  assert copied == kept and all((ROOT / source).exists() for source in copied)
  packages = tomllib.loads(text_of("pyproject.toml"))["tool"]["setuptools"]["package-dir"].values()
  assert {"motion_jax", "motion_jax_studio", *packages, PROJECT["readme"]} <= copied
  pythons = {base for base, _ in images.values() if ":" in base}
  development = json.loads(text_of(".devcontainer/devcontainer.json"))
  assert pythons == {"python:3.11-slim"} and development["image"].endswith(":3.11")
  installs = [rest for _, instructions in images.values() for _, rest in instructions if "pip install" in rest]
  extras = {extra for line in installs for extra in re.search(r"\.\[(.*)\]", line)[1].split(",")}
  assert len(installs) == 2 and extras <= set(PROJECT["optional-dependencies"])
