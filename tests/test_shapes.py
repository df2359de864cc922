"""Arrays that do not belong together are told at the door, where they would broadcast in silence; annotations say what
fits, and tests check them."""
import ast
import tomllib

import jax
import jaxtyping
import numpy as np
import pytest

from motion_jax import shapes
from motion_jax.diffusion import paths
from motion_jax.models import cdamd, cmdm, tmr
from motion_jax.quant import rvq, vq
from tests.conftest import ROOT

ROOMS = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["mypy"]["packages"]
# Of these rooms the functions for their own use state their types, too.
WHOLE_ROOMS = ["motion_jax.nets", "motion_jax.quant", "motion_jax.diffusion", *(
    f"motion_jax.motion.{name}" for name in ("rotations", "skeleton", "pose", "inverse", "transfer", "retarget"))]


def files_of(rooms):
  """The files of packages and modules, "motion_jax.nets" or "motion_jax.runs"."""
  places = [ROOT / room.replace(".", "/") for room in rooms]
  files = sorted(path for place in places for path in ([*place.rglob("*.py")] or [place.with_suffix(".py")]))
  assert all(path.is_file() for path in files)
  return files


PATHS, WHOLE = files_of(ROOMS), files_of(WHOLE_ROOMS)
X, REAL, T = np.ones((2, 6, 4), np.float32), np.ones((2, 6), bool), np.ones((2, 6), np.float32)


@pytest.mark.parametrize("call, told", [
    (lambda: paths.forcing_loss(None, X, REAL[:, :1], T, X), r"latent_mask of shape \(2, 1\)"),
    (lambda: paths.forcing_loss(None, X, REAL, T[0], X), r"t of shape \(6,\).*\(B, L\)"),
    (lambda: paths.forcing_loss(None, X, REAL, T, X[:1]), r"noise of shape \(1, 6, 4\)"),
    (lambda: cmdm.gaussian_nll(X, X[:1]), r"target of shape \(1, 6, 4\), expected \(B, T, F\), B = 2"),
    (lambda: cdamd.l1(X, X[..., :1]), r"target of shape \(2, 6, 1\)"),
    (lambda: cdamd.smooth_l1(X[0], X), r"prediction of shape \(6, 4\)"),
    (lambda: tmr.info_nce(np.ones((3, 4)), np.ones((2, 4)), 1.0), r"motion of shape \(2, 4\).*B = 3, E = 4"),
    (lambda: rvq.encode(np.ones((3, 5, 2)), X), r"x of shape \(2, 6, 4\), expected \(B, L, C\), C = 2")])
def test_what_would_broadcast_is_told(call, told, as_users_run):
  with pytest.raises(ValueError, match=told) as error:
    call()
  assert "\n" not in str(error.value)


def test_shapes_that_fit_pass_also_inside_of_jit(as_users_run):
  shapes.check(x=(X, "BLC"), t=(X[..., 0], "BL"), table=(np.ones((4, 4)), "CC"))
  assert jax.jit(lambda x: cdamd.l1(x, x + 1))(X) == 1
  with pytest.raises(ValueError, match=r"table of shape \(4, 3\)"):
    shapes.check(x=(X, "BLC"), table=(np.ones((4, 3)), "CC"))


def test_annotated_shapes_are_checked_in_tests():
  good, bad = np.ones((3, 4)), np.ones((3, 5))
  vq.nearest(good, good)
  with pytest.raises(jaxtyping.TypeCheckError, match="x"):
    vq.nearest(good, bad)
  with pytest.raises(jaxtyping.TypeCheckError):
    jax.jit(vq.nearest)(good, bad)


def test_functions_state_their_types():
  """The public ones; in the rooms of WHOLE all of them."""
  missing = []
  for path in PATHS:
    for node in _functions(ast.parse(path.read_text())):
      if node.name.startswith("_") and not node.name.endswith("__") and path not in WHOLE:
        continue
      given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
      untyped = [arg.arg for arg in given if arg and not arg.annotation and arg.arg not in ("self", "cls")]
      if untyped or not node.returns:
        missing.append(f"{path.relative_to(ROOT)}:{node.lineno} {node.name}: types of {untyped or 'the result'}")
  assert len(PATHS) > 100 and not missing, "\n".join(missing)


def _functions(tree):
  """Functions and methods, less those inside of another function, whose types a reader sees around them."""
  for node in tree.body:
    if isinstance(node, ast.FunctionDef):
      yield node
    elif isinstance(node, ast.ClassDef):
      yield from _functions(node)
