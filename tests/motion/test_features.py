"""Features are the benchmark's in benchmark mode, and come back to joints."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.motion import inverse
from motion_jax.motion import representations as F
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D
from tests.fixtures import load

CASES = [("humanml3d", "full", clip) for clip in range(3)] + [("kit", "full_kit", 0)]


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]}{case[2]}")
def case(request):
  name, layout, clip = request.param
  fixture = load(f"motion/features_{name}.npz")
  layout = F.get_layout(layout)
  arrays = {key.split("/")[-1]: fixture[key] for key in fixture.files if f"clip{clip}/" in key}
  # Tolerances are the README's: metres, or millimetres and tenths of them for KIT.
  metric = name == "humanml3d"
  return fixture["in/offsets"], layout, arrays, metric


def test_canonical_joints_are_the_references(case):
  offsets, layout, arrays, metric = case
  made = F.canonicalize(arrays["joints"], layout.skeleton.with_offsets(offsets))
  assert np.abs(made - arrays["canonical"]).max() < (2e-5 if metric else 1e-2)


def test_benchmark_features_are_the_references(case):
  offsets, layout, arrays, metric = case
  skeleton = layout.skeleton.with_offsets(offsets)
  made = F.extract(F.canonicalize(arrays["joints"], skeleton), skeleton)
  for name, block in layout.blocks.items():
    tolerance = {"contacts": 0, "turn": 2e-5, "rotations": 1e-4 if metric else 5e-4}.get(name, 2e-5 if metric else 1e-2)
    assert np.abs(made[:, block] - arrays["features"][:, block]).max() <= tolerance, name


def test_recovered_joints_are_the_references(case):
  offsets, layout, arrays, metric = case
  tolerance = 1e-6 if metric else 1e-2
  assert np.abs(F.to_joints(arrays["features"], layout) - arrays["recovered"]).max() < tolerance
  by_rotations = F.rotations_to_joints(arrays["features"], layout, offsets)
  assert np.abs(by_rotations - arrays["recovered_rotations"]).max() < tolerance


def test_cmdm_recovery_in_float64():
  fixture = load("motion/joints.npz")
  with jax.enable_x64(True):
    features = jnp.asarray(fixture["in/features"], jnp.float64)
    made = jax.jit(F.to_joints)(features)
    assert np.abs(made - fixture["out64/joints"]).max() < 1e-10
    assert np.abs(F.root_path(features)[1] - fixture["out64/root"]).max() < 1e-10


def test_corrected_mode_survives_a_full_turn_where_the_benchmark_does_not():
  angle = np.linspace(0, 2 * np.pi, 120)
  standing = HUMANML3D.offsets.copy()
  for joint in inverse.order(HUMANML3D)[1:]:
    standing[joint] += standing[HUMANML3D.parents[joint]]
  standing[:, 1] -= standing[:, 1].min()
  turning = rot.rotate(rot.about_axis(angle, "y")[:, None], standing[None])
  for mode, bound in (("corrected", 1e-5), ("benchmark", np.inf)):
    canonical = F.canonicalize(turning, mode=mode)
    error = np.abs(F.to_joints(F.to_features(turning, mode=mode)) - canonical[:-1]).max()
    assert error < bound
  assert error > 0.01  # the known fault of the benchmark's features


@pytest.mark.parametrize("mode", F.MODES)
def test_a_body_that_faces_exactly_backwards_or_raises_its_arms_has_features(mode):
  standing = HUMANML3D.offsets.copy()
  for joint in inverse.order(HUMANML3D)[1:]:
    standing[joint] += standing[HUMANML3D.parents[joint]]
  expected = F.to_features(np.stack([standing] * 9), mode=mode)
  backwards = F.to_features(np.stack([standing * [-1, 1, -1]] * 9), mode=mode)
  assert np.abs(backwards - expected).max() < 1e-5
  standing[[18, 19, 20, 21], 1] = standing[16, 1] + [0.25, 0.25, 0.5, 0.5]  # opposite to the arms' rest direction
  raised = F.to_features(np.stack([standing] * 9), mode=mode)
  assert np.isfinite(raised).all()


@pytest.mark.parametrize("call, words", [
    (lambda: F.to_features(np.zeros((10, 21, 3))), "expected .*22"),
    (lambda: F.to_features(np.full((10, 22, 3), np.nan)), "NaN"),
    (lambda: F.to_features(np.zeros((1, 22, 3))), "at least 2 frames"),
    (lambda: F.to_features(np.zeros((10, 22, 3))), "no features in row 0"),
    (lambda: F.to_features(np.zeros((10, 22, 3)), mode="right"), "benchmark, corrected"),
    (lambda: F.to_features(np.zeros((10, 22, 3)), "264"), "expected one of full"),
    (lambda: F.to_joints(np.zeros((10, 67))), "67 features per frame.*263"),
    (lambda: F.layout_for(100), "known sizes"),
])
def test_bad_input_is_told(call, words):
  with pytest.raises(ValueError, match=words):
    call()
