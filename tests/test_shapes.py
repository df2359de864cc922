"""Arrays that do not belong together are told at the door, where they would broadcast in silence."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import shapes
from motion_jax.diffusion import paths
from motion_jax.models import cdamd, cmdm
from motion_jax.models.cmdm import teacher
from motion_jax.quant import rvq

X, REAL, T = jnp.ones((2, 6, 4)), jnp.ones((2, 6), bool), jnp.ones((2, 6))


@pytest.mark.parametrize("call, told", [
    (lambda: paths.forcing_loss(None, X, REAL[:, :1], T, X), r"latent_mask of shape \(2, 1\)"),
    (lambda: paths.forcing_loss(None, X, REAL, T[0], X), r"t of shape \(6,\).*\(B, L\)"),
    (lambda: paths.forcing_loss(None, X, REAL, T, X[:1]), r"noise of shape \(1, 6, 4\)"),
    (lambda: cmdm.gaussian_nll(X, X[:1]), r"target of shape \(1, 6, 4\), expected \(B, T, F\), B = 2"),
    (lambda: cdamd.l1(X, X[..., :1]), r"target of shape \(2, 6, 1\)"),
    (lambda: cdamd.smooth_l1(X[0], X), r"prediction of shape \(6, 4\)"),
    (lambda: teacher.info_nce(jnp.ones((3, 4)), jnp.ones((2, 4)), 1.0), r"motion of shape \(2, 4\).*B = 3, E = 4"),
    (lambda: rvq.encode(jnp.ones((3, 5, 2)), X), r"x of shape \(2, 6, 4\), expected \(B, L, C\), C = 2")])
def test_what_would_broadcast_is_told(call, told):
  with pytest.raises(ValueError, match=told) as error:
    call()
  assert "\n" not in str(error.value)


def test_shapes_that_fit_pass_also_inside_of_jit():
  shapes.check(x=(X, "BLC"), t=(X[..., 0], "BL"), table=(np.ones((4, 4)), "CC"))
  assert jax.jit(lambda x: cdamd.l1(x, x + 1))(X) == 1
  with pytest.raises(ValueError, match=r"table of shape \(4, 3\)"):
    shapes.check(x=(X, "BLC"), table=(np.ones((4, 3)), "CC"))
