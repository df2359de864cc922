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
from typing import NamedTuple

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

ROOT = pathlib.Path(__file__).parents[1]
# A file may import from its own room, from rooms of the lines above it in its list and, without a circle, from
# rooms of its own line. The library never imports the application.
LAYERS = {
    "motion_jax": [
        ("charts", "configs", "draw", "look", "shapes", "utils"),
        ("motion", "nets", "quant", "diffusion", "paper_tables"),
        ("analysis", "rigs", "text"),
        ("data", "metrics", "latents", "control"),
        ("convert", "export", "robots", "runs", "training"),
        ("models",),
        ("evaluators",),
        ("loading", "fit", "pictures", "retrieval"),
        ("evaluation",),
        ("__init__",)],
    "motion_jax_studio": [
        ("language", "step_names"),
        ("checks",),
        ("planning",),
        ("posing",),
        ("batches", "blending", "constraining", "editing", "resampling", "streaming"),
        ("steps",),
        ("pipeline",),
        ("server", "composing"),
        ("client", "cli", "mmcp", "__init__")],
}
CORE = {"absl", "chex", "filelock", "flatbuffers", "flax", "jax", "jinja2", "lazy_loader",
        "ml_collections", "msgspec", "numpy", "optax", "orbax", "PIL", "safetensors", "scipy", "tokenizers", "tqdm"}
# Packages of extras, imported inside the functions that need them.
LAZY = {"torch", "transformers", "imageio_ffmpeg", "huggingface_hub", "tensorflow_datasets", "grain", "tensorboardX",
        "uvicorn", "mujoco", "mink", "ezc3d", "jax2onnx", "onnx", "onnxruntime", "bpy", "mathutils", "ufbx",
        "pxr", "jaxlib", "jaxtyping"}  # jaxlib comes with jax; jaxtyping is of the tests
# Rooms that nobody enters without an extra, whose packages they import at the top.
OF_EXTRAS = {"server": {"anyio", "starlette"}, "mmcp": {"starlette"}, "client": {"websockets"}}
METHODS = ("cmdm", "cdamd", "mdm", "mld", "momask", "t2m_gpt", "motionstreamer")
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


class Imports(NamedTuple):
  at_top: list
  anywhere: list


@pytest.fixture(scope="module")
def imports():
  """{file of the packages: what it imports}"""
  trees = {path: ast.parse(path.read_text()) for path in FILES}
  return {path: Imports(list(_imports(tree, True)), list(_imports(tree))) for path, tree in trees.items()}


def _pointing_down(path, names):
  """Those of a file's imports that point down, or to a room beside its own that it may not know."""
  package, part = _part(path)
  rank = {name: number for number, names in enumerate(LAYERS[package]) for name in names}
  if part not in rank:
    return ["nothing yet: it has no layer; add it to LAYERS and to the style guide"]
  # The rooms of motion and networks know nothing of one another; elsewhere rooms of one line may.
  allowed = rank[part] - (package == "motion_jax" and rank[part] == 1)
  names = [name.split(".") for name in names]
  return [".".join(name) for name in names
          if package == "motion_jax" and name[0] == "motion_jax_studio"
          or name[0] == package and len(name) > 1 and name[1] != part and rank.get(name[1], -1) > allowed]


def test_imports_point_up(imports):
  wrong = [f"{path.relative_to(ROOT)} imports {name}" for path, names in imports.items()
           for name in _pointing_down(path, names.anywhere)]
  assert len(FILES) > 500 and not wrong, "\n".join(wrong)


def test_a_method_imports_no_other(imports):
  """What methods share is below them, except the teachers, which any of them may be aligned with."""
  models = ROOT / "motion_jax" / "models"
  methods = {path.parent.name for path in models.glob("*/__init__.py")} - {"shared"}
  wrong = []
  for path, names in imports.items():
    if path.parent.parent == models and path.parent.name in methods:
      others = {name.split(".")[2] for name in names.anywhere if name.startswith("motion_jax.models.")} & methods
      wrong += [f"{path.relative_to(ROOT)} imports {name}" for name in others - {path.parent.name, "tmr"}]
  assert {"tmr", *METHODS} == methods
  assert not wrong, "\n".join(wrong)


def _circles(arrows):
  """[sorted names] of each set of nodes that lead to one another, from {node: the nodes that it leads to}."""
  number, matrix = {name: i for i, name in enumerate(arrows)}, np.zeros((len(arrows),) * 2)
  for name, others in arrows.items():
    matrix[number[name], [number[other] for other in others]] = 1
  _, labels = connected_components(matrix, directed=True, connection="strong")
  groups = [[name for name, label in zip(arrows, labels) if label == group] for group in set(labels)]
  return [sorted(group) for group in groups if len(group) > 1]


def test_no_files_and_no_rooms_import_each_other(imports):
  """No circle, inside functions neither; of rooms, even where each of its arrows is one that LAYERS allows."""
  modules = {".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path for path in FILES}
  files = {module: {name for name in imports[path].anywhere if name in modules and name != module
                    # `from package import file` reads the package's face for the file alone
                    and not any(other.startswith(name + ".") and other in modules for other in imports[path].anywhere)}
           for module, path in modules.items()}
  rooms = {_part(path): set() for path in FILES}
  for module, others in files.items():
    rooms[_part(modules[module])] |= {_part(modules[other]) for other in others} - {_part(modules[module])}
  assert _circles({"a": "b", "b": "c", "c": "b"}) == [["b", "c"]]
  assert not _circles(files)
  assert not _circles(rooms)


def test_core_needs_no_extra(imports):
  wrong = []
  for path, names in imports.items():
    known = CORE | OF_EXTRAS.get(_part(path)[1], set()) | set(LAYERS) | set(sys.stdlib_module_names)
    at_top, anywhere = ({name.split(".")[0] for name in names} for names in names)
    unknown = at_top - known | anywhere - known - LAZY
    wrong += [f"{path.relative_to(ROOT)} imports {name}" for name in unknown]
  assert not wrong, "\n".join(wrong)


def test_core_dependencies_are_those_of_pyproject():
  project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
  names = {re.split(r"[<>=\[]", requirement)[0] for requirement in project["dependencies"]}
  packages = {"absl-py": "absl", "ml-collections": "ml_collections", "orbax-checkpoint": "orbax", "Pillow": "PIL",
              "Jinja2": "jinja2", "lazy-loader": "lazy_loader"}
  assert {packages.get(name, name) for name in names} == CORE


def test_the_tests_have_what_the_studio_needs():
  """Without its packages tests/studio/server is left out; CI installs the extra `test`, which must bring them."""
  extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
  assert any("studio" in requirement.partition("[")[2] for requirement in extras["test"])
  names = {re.split(r"[<>=\[]", requirement)[0] for extra in ("studio", "test") for requirement in extras[extra]}
  assert {"starlette", "uvicorn", "websockets", "httpx2", "motionmcp-sdk"} <= names


ROOMS = ("nets", "quant", "diffusion", "motion", "rigs", "metrics", "text", "analysis", "data", "control", "evaluation",
         "models.tmr", *(f"models.{method}" for method in METHODS))


@pytest.mark.parametrize("room", ROOMS)
def test_public_names_are_there(room):
  """The names of a stub, which type checkers read, are those that are found at run time, and nothing else is."""
  module = importlib.import_module(f"motion_jax.{room}")
  *_, public = ast.parse(pathlib.Path(module.__file__).with_suffix(".pyi").read_text()).body
  assert sorted(ast.literal_eval(public.value)) == module.__all__ == dir(module)
  for name in module.__all__:
    value = getattr(module, name)
    # A function of the same name as its file would be one or the other, depending on what was imported before.
    is_file = (pathlib.Path(module.__file__).parent / f"{name}.py").is_file()
    assert inspect.ismodule(value) == is_file or name == "representations"
  with pytest.raises(AttributeError, match=f"No motion_jax.{room} attribute nothing"):
    module.nothing  # noqa: B018


COMPONENTS = {"nets": "CausalDiT", "quant": "rvq", "diffusion": "dopri5", "motion": "to_features", "metrics": "fid"}


@pytest.mark.slow
def test_a_component_loads_alone_and_importing_starts_no_device():
  """A researcher who takes one network, sampler or score gets no application with it, nor a device: with one,
  --simulate-devices and --coordinator would come too late. One process imports JAX, its forks our rooms."""
  code = f"""
import importlib, os, sys, jax, flax.linen
for room, name in {COMPONENTS}.items():
  if not os.fork():
    getattr(importlib.import_module("motion_jax." + room), name)
    print(room, *(name for name in sys.modules if name.split(".")[0] == "motion_jax"), flush=True)
    os._exit(0)
  os.wait()
import motion_jax_studio.cli, motion_jax_studio.pipeline, motion_jax.fit, motion_jax.evaluation.run
jax.config.update("jax_num_cpu_devices", 3)
print("devices", jax.device_count())
"""
  env = {name: value for name, value in os.environ.items() if name != "XLA_FLAGS"} | {"JAX_PLATFORMS": "cpu"}
  run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT, env=env)
  loaded = {room: set(names) for room, *names in map(str.split, run.stdout.splitlines())}
  assert loaded.pop("devices") == {"3"} and set(loaded) == set(COMPONENTS)
  for room, names in loaded.items():
    along = names - {"motion_jax", f"motion_jax.{room}", "motion_jax.utils", "motion_jax.utils.lazy",
                     "motion_jax.utils.plugins"}
    assert len(along) <= 15, sorted(along)


WITHOUT_JAX = ("motion", "rigs", "export", "robots", "analysis", "metrics", "data", "utils")
LOAD_JAX = {"motion_jax.motion.rotation_gradients", "motion_jax.export.graphs", "motion_jax.data.store"}


def test_rooms_of_numpy_load_no_jax():
  """Files are converted and robots moved without it; loading it takes longer than that."""
  names = [".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
           for room in WITHOUT_JAX for path in sorted((ROOT / "motion_jax" / room).rglob("*.py"))]
  code = f"""
import importlib, sys
for name in {sorted(set(names) - LOAD_JAX)}:
  importlib.import_module(name)
  assert "jax" not in sys.modules, name
sys.modules["motion_jax.robots.retargeting"]._import_mink()
assert "jax" not in sys.modules, "mink"
"""
  assert len(names) > 150 and set(names) >= LOAD_JAX
  run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, cwd=ROOT)
  assert run.returncode == 0, run.stderr[-600:]
