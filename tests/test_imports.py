"""Imports point one way (style guide, "Who imports whom"), and optional packages stay optional."""
import ast
import importlib
import inspect
import os
import pathlib
import re
import subprocess
import sys
import tomllib

import pytest

ROOT = pathlib.Path(__file__).parents[1]
# A file may import from its own room and from rooms of the lines above it in its package's list; the library never
# imports the application.
LAYERS = {
    "motion_jax": [
        ("charts", "configs", "draw", "look", "shapes", "utils"),
        ("motion", "nets", "quant", "diffusion", "paper_tables"),
        ("analysis", "text"),
        ("data", "metrics", "latents", "control"),
        ("convert", "export", "robots", "runs", "training"),
        ("models",),
        ("evaluators",),
        ("loading", "fit", "pictures", "retrieval"),
        ("evaluation",),
        ("__init__",)],
    "motion_studio": [
        ("language",),
        ("checks", "planning"),
        ("blending", "constraining", "editing", "streaming"),
        ("steps",),
        ("pipeline",),
        ("server",),
        ("client", "cli", "__init__")],
}
CORE = {"absl", "chex", "flatbuffers", "flax", "jax", "jaxtyping", "jinja2", "ml_collections", "numpy", "optax",
        "orbax", "PIL", "safetensors", "scipy", "tokenizers", "tqdm"}
# Packages of extras, imported inside the functions that need them.
LAZY = {"torch", "transformers", "imageio_ffmpeg", "huggingface_hub", "tensorflow_datasets", "grain", "tensorboardX",
        "uvicorn", "mujoco", "mink", "ezc3d", "jax2onnx", "onnx", "onnxruntime", "bpy", "mathutils", "ufbx"}
# Rooms that nobody enters without an extra, whose packages they import at the top.
OF_EXTRAS = {"server": {"anyio", "starlette"}, "client": {"websockets"}}
FILES = sorted(path for package in LAYERS for path in (ROOT / package).rglob("*.py"))


def _imports(tree, top_level_only=False):
  for node in (tree.body if top_level_only else ast.walk(tree)):
    if isinstance(node, ast.Import):
      yield from (alias.name for alias in node.names)
    elif isinstance(node, ast.ImportFrom):
      assert not node.level, "imports are absolute"
      yield node.module
      yield from (f"{node.module}.{alias.name}" for alias in node.names)


def _part(path):
  """(package, room) of a file: its folder below the package, or itself."""
  package, *rest = path.relative_to(ROOT).parts
  return package, rest[0] if len(rest) > 1 else path.stem


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_up(path):
  package, part = _part(path)
  rank = {name: number for number, names in enumerate(LAYERS[package]) for name in names}
  assert part in rank, f"{path} has no layer: add it to LAYERS and to the style guide"
  for name in _imports(ast.parse(path.read_text())):
    pieces = name.split(".")
    assert not (package == "motion_jax" and pieces[0] == "motion_studio"), f"the library imports {name}"
    if pieces[0] != package or len(pieces) < 2 or pieces[1] not in rank:  # a name of the package's __init__.py
      continue
    other = pieces[1]
    foundation = package == "motion_jax" and rank[part] == 1
    # The rooms of motion and networks know nothing of one another; below, rooms of one line may.
    assert other == part or (rank[other] < rank[part] if foundation else rank[other] <= rank[part]), (
        f"{part} imports {name}")


@pytest.mark.parametrize("method", ["tmr", "cmdm", "cdamd", "momask", "t2m_gpt"])
def test_a_method_imports_no_other(method):
  """What methods share is below them, but for the teachers, which any of them may be aligned with."""
  for path in (ROOT / "motion_jax" / "models" / method).glob("*.py"):
    for name in _imports(ast.parse(path.read_text())):
      other = re.match(r"motion_jax\.models\.(tmr|cmdm|cdamd|momask|t2m_gpt)\b", name)
      assert not other or other[1] in (method, "tmr"), f"{path} imports {name}"


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_core_needs_no_extra(path):
  tree, more = ast.parse(path.read_text()), OF_EXTRAS.get(_part(path)[1], set())
  for name in _imports(tree, top_level_only=True):
    top = name.split(".")[0]
    assert top in CORE | more or top in LAYERS or top in sys.stdlib_module_names, f"{path} imports {name}"
  for name in _imports(tree):
    top = name.split(".")[0]
    assert top in CORE | LAZY | more or top in LAYERS or top in sys.stdlib_module_names, f"{path} imports {name}"


def test_core_dependencies_are_those_of_pyproject():
  project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
  names = {re.split(r"[<>=\[]", requirement)[0] for requirement in project["dependencies"]}
  packages = {"absl-py": "absl", "ml-collections": "ml_collections", "orbax-checkpoint": "orbax", "Pillow": "PIL",
              "Jinja2": "jinja2"}
  assert {packages.get(name, name) for name in names} == CORE


def test_the_tests_have_what_the_studio_needs():
  """Without its packages tests/studio/server is left out; CI installs the extra `test`, which must bring them."""
  extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
  assert any("studio" in requirement.partition("[")[2] for requirement in extras["test"])
  names = {re.split(r"[<>=\[]", requirement)[0] for extra in ("studio", "test") for requirement in extras[extra]}
  assert {"starlette", "uvicorn", "websockets", "httpx2", "motionmcp-sdk"} <= names


def test_importing_starts_no_device():
  """Otherwise --simulate-devices and --coordinator would come too late."""
  code = ("import motion_studio.cli, motion_studio.pipeline, motion_jax.fit, motion_jax.evaluation.run, jax; "
          "jax.config.update('jax_num_cpu_devices', 3); assert jax.device_count() == 3")
  env = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"} | {"JAX_PLATFORMS": "cpu"}
  subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, env=env)


ROOMS = ("nets", "quant", "diffusion", "motion", "metrics", "text", "analysis", "data", "control", "evaluation",
         "models.tmr", "models.cmdm", "models.cdamd", "models.momask", "models.t2m_gpt")


@pytest.mark.parametrize("room", ROOMS)
def test_public_names_are_there(room):
  """What type checkers read under TYPE_CHECKING, `__all__` and what is found at run time are the same names."""
  module = importlib.import_module(f"motion_jax.{room}")
  blocks = [node for node in ast.parse(inspect.getsource(module)).body if isinstance(node, ast.If)]
  typed = {alias.name for node in blocks[0].body for alias in node.names}
  assert typed == set(module.__all__) and set(module.__all__) <= set(dir(module))
  for name in module.__all__:
    value = getattr(module, name)
    # A function of the same name as its file would be one or the other, depending on what was imported before.
    is_file = (pathlib.Path(module.__file__).parent / f"{name}.py").is_file()
    assert inspect.ismodule(value) == is_file or name == "representations"
  with pytest.raises(AttributeError, match=f"motion_jax.{room} has no 'nothing'; it has "):
    module.nothing  # noqa: B018


@pytest.mark.parametrize("room, name", [("nets", "CausalDiT"), ("nets", "MaskedTransformer"), ("quant", "rvq"),
                                        ("diffusion", "dopri5"), ("motion", "to_features"), ("metrics", "fid")])
def test_a_component_loads_alone(room, name):
  """A researcher who takes one network, sampler or score does not get the application with it."""
  code = f"import sys; from motion_jax.{room} import {name}; print(*sys.modules)"
  run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
  loaded = {one for one in run.stdout.split() if one.split(".")[0] == "motion_jax"}
  along = loaded - {"motion_jax", f"motion_jax.{room}", "motion_jax.utils", "motion_jax.utils.lazy",
                    "motion_jax.utils.plugins"}
  assert len(along) <= 15, sorted(along)
