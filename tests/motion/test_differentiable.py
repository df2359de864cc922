"""Joints to features on jax arrays: numpy's numbers, inside jit, vmap and grad, finite at degenerate poses."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.motion import representations as F
from motion_jax.motion.skeleton import HUMANML3D, body_axes, facing
from tests.conftest import some_of

STAND, WALK, CURVE, TURN = 0, 1, 3, 5
# The other representations are columns of these, or joints recovered from them. XLA compiles one in 5 to 15 s.
CASES = some_of([("full", "benchmark"), ("snapmogen", "corrected"), ("full", "corrected"), ("full_kit", "benchmark"),
                 ("motionstreamer", "corrected"), ("babel", "corrected")],
                slow=[("full", "benchmark"), ("snapmogen", "corrected")])


@functools.cache
def clip(name, number, frames=40):
  """Joints (T, J, 3), float64, made once: read only."""
  return synthetic_clips(0, 6, skeleton=F.get_layout(name).skeleton)[number].joints[:frames].astype(np.float64)


def largest(a, b):
  return np.abs(np.asarray(a, np.float64) - np.asarray(b, np.float64)).max()


def degenerate(skeleton):
  """{name: joints (T, J, 3)}: directions that are undefined, roots and arc cosines with an infinite derivative."""
  joints = synthetic_clips(0, 2, skeleton=skeleton)[WALK].joints[:12].astype(np.float64)
  still = np.repeat(joints[:1], 12, axis=0)
  no_bone = joints.copy()
  for joint in (skeleton.leg_bones[1], skeleton.chains[3][2]):
    no_bone[:, joint] = no_bone[:, skeleton.parents[joint]]
  no_width = joints.copy()
  for pair in (skeleton.hips, skeleton.shoulders):
    no_width[:, pair[0]] = no_width[:, pair[1]]
  half_turn = joints.copy()
  half_turn[6:] *= [-1, 1, -1]
  rest, opposite = still.copy(), still.copy()
  for joint in skeleton.order[1:]:
    parent = skeleton.parents[joint]
    rest[:, joint] = rest[:, parent] + skeleton.offsets[joint]
    opposite[:, joint] = opposite[:, parent] - skeleton.offsets[joint]
  line = still.copy()
  line[..., [0, 2]] = 0
  return {"still": still, "no bone": no_bone, "no width": no_width, "half turn": half_turn, "rest": rest,
          "opposite": opposite, "a line": line, "a point": still * 0}


@pytest.mark.parametrize("name, mode", CASES)
def test_a_batch_has_numpys_numbers_and_gradients_that_are_finite_at_degenerate_poses(name, mode):
  """Numbers in float64 to 1e-6 of a unit (a metre, a centimetre), the rounding of numpy's result to float32; of KIT,
  whose millimetres are numbers in the thousands, to float32's last digits. Gradients are those of finite differences,
  through rotations too, least-squares fits of pelvis and chest among them. One program for all."""
  layout = F.get_layout(name)
  rng = np.random.default_rng(0)
  cases = degenerate(layout.skeleton)
  sound = np.stack([clip(name, number, 12) for number in (STAND, WALK, CURVE, TURN)])
  with jax.enable_x64(True):
    weights = rng.normal(size=layout.dim)
    if "contacts" in layout.blocks:
      weights[layout["contacts"]] = 0

    def weighted(joints):
      features = layout.from_joints(joints, mode)
      return (features * weights).sum(), features

    run = jax.jit(jax.value_and_grad(weighted, has_aux=True))
    (value, made), _ = run(np.concatenate([sound, sound]))
    assert made.dtype == jnp.float64
    np.testing.assert_allclose(made[:4], np.stack([layout.from_joints(one, mode) for one in sound]), rtol=2e-7,
                               atol=1e-6 if layout.skeleton.unit > 0.001 else 1e-3)
    unit = layout.skeleton.unit
    joints = np.concatenate([sound, sound]) + rng.normal(0, 0.01 / unit, (8, *sound.shape[1:]))
    grad = np.asarray(run(joints)[1])
    for _ in range(3):
      way = rng.normal(size=joints.shape)
      size = 1e-6 / unit
      expected = (run(joints + size * way)[0][0] - run(joints - size * way)[0][0]) / (2 * size)
      np.testing.assert_allclose((grad * way).sum(), expected, rtol=1e-4, atol=1e-4)
    (_, made), grad = run(np.stack(list(cases.values())))
    for number, what in enumerate(cases):
      assert np.isfinite(made[number]).all() and np.isfinite(grad[number]).all(), what


@pytest.mark.parametrize("name", some_of(("full", "snapmogen", "motionstreamer", "babel"), slow=["full", "babel"]))
def test_recovery_has_gradients_too(name):
  """Back from features, of zeros as well, by positions and by rotations."""
  layout = F.get_layout(name)
  features = layout.from_joints(clip(name, CURVE, 12), "corrected")
  grad = jax.jit(jax.grad(lambda f: (layout.to_joints(f) ** 2).sum() + (layout.rotations_to_joints(f) ** 2).sum()))
  assert np.abs(grad(features)).max() > 0
  for case in (features, np.zeros_like(features)):
    assert np.isfinite(grad(case)).all()


def test_axes_and_facing_are_those_of_numpy():
  """Also where hips have no width, in all frames or in some."""
  thin, late = clip("full", CURVE, 28).copy(), clip("full", CURVE, 28).copy()
  thin[:, HUMANML3D.hips[0]] = thin[:, HUMANML3D.hips[1]]
  late[:3, HUMANML3D.hips[0]] = late[:3, HUMANML3D.hips[1]]
  cases = np.stack([clip("full", CURVE, 28), thin, late])
  with jax.enable_x64(True):
    for part, made in enumerate(jax.jit(body_axes, static_argnums=1)(jnp.asarray(cases), HUMANML3D)):
      assert largest(made, np.stack([body_axes(case, HUMANML3D)[part] for case in cases])) < 1e-9
    assert largest(facing(jnp.asarray(cases[0]), HUMANML3D, 5.0), facing(cases[0], HUMANML3D, 5.0)) < 1e-9


def test_shapes_are_checked():
  with pytest.raises(ValueError, match="at least 2 frames"):
    F.to_features(jnp.zeros((4, 1, 22, 3)))
  batch = jax.eval_shape(F.to_features, jax.ShapeDtypeStruct((2, 4, 5, HUMANML3D.num_joints, 3), jnp.float32))
  assert batch.shape == (2, 4, 4, 263)
