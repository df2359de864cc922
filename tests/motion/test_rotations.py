"""Rotations agree with scipy and with one another."""
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from motion_jax.motion import rotations as rot

RNG = np.random.default_rng(0)
P, Q = (rot.unit(RNG.normal(size=(200, 4))) for _ in range(2))
V = RNG.normal(size=(200, 3))


def _scipy(q):
  return Rotation.from_quat(np.roll(q, -1, axis=-1))  # scipy puts w last


def test_against_scipy():
  assert np.allclose(rot.rotate(Q, V), _scipy(Q).apply(V))
  assert np.allclose(rot.to_matrix(Q), _scipy(Q).as_matrix())
  assert np.allclose(rot.to_matrix(rot.multiply(P, Q)), (_scipy(P) * _scipy(Q)).as_matrix())
  angle = RNG.normal(size=20)
  for axis in "xyz":
    expected = Rotation.from_euler(axis, angle[:, None]).as_matrix()
    assert np.allclose(rot.to_matrix(rot.about_axis(angle, axis)), expected)


def test_round_trips():
  back = rot.from_matrix(rot.to_matrix(Q))
  assert np.allclose(back, Q * np.sign(Q[:, :1]))
  assert np.allclose(rot.matrix_from_6d(rot.to_6d(Q)), rot.to_matrix(Q))
  assert np.allclose(rot.rotate(rot.conjugate(Q), rot.rotate(Q, V)), V)
  half_turns = rot.unit(np.concatenate([np.zeros((50, 1)), RNG.normal(size=(50, 3))], 1))
  assert np.allclose(rot.to_matrix(rot.from_matrix(rot.to_matrix(half_turns))), rot.to_matrix(half_turns))


def test_between_turns_one_direction_to_the_other_and_w_is_not_negative():
  w = RNG.normal(size=(200, 3))
  q = rot.between(V, w)
  assert np.allclose(rot.rotate(q, rot.unit(V)), rot.unit(w)) and (q[:, 0] >= 0).all()


def test_between_opposite_directions_is_half_a_turn_about_the_vertical():
  axes = np.concatenate([np.eye(3), rot.unit(V)])
  for xp in (np, jnp):
    made = np.asarray(rot.between(xp.asarray(axes), xp.asarray(-axes)))
    assert np.allclose(rot.rotate(made, axes), -axes, atol=1e-5)
    assert np.allclose(made[[0, 2]], [0, 0, 1, 0])
  for angle in (1e-13, 1e-9, 1e-4):  # nearly opposite
    near = np.array([np.sin(angle), 0, -np.cos(angle)])
    assert np.allclose(rot.rotate(rot.between(near, axes[2]), near), axes[2], atol=1e-2)


def test_continuous_never_flips_and_slerp_is_even():
  path = rot.about_axis(np.linspace(0, 4 * np.pi, 100), "y")
  flipped = path * np.where(RNG.random(100) < 0.5, -1, 1)[:, None]
  made = rot.continuous(flipped)
  assert ((made[1:] * made[:-1]).sum(-1) > 0).all()
  middle = rot.slerp(path[:1], path[10:11], np.array([0.5]))
  assert np.allclose(middle, path[5])
