"""Losses on how the decoded motion moves: values by hand, padding that does not count, weights of 0 that are off."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import fit
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.models import autoencoders, cdamd, cmdm, motion_errors
from motion_jax.models.autoencoders import with_motion_errors
from motion_jax.models.cmdm.losses import mean_square_nll
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.skeleton import HUMANML3D, KIT
from motion_jax.utils.errors import InputError
from tests.conftest import load_config

TOES = HUMANML3D.left_feet[1]


def standing(frames=24):
  return synthetic_joints("stand", frames, np.random.default_rng(0))[None].astype(np.float32)


def found(made, real, **options):
  return {name: np.asarray(value) for name, value in motion_errors.motion_errors(made, real, **options).items()}


def test_a_body_that_is_carried_along_slides_and_is_as_fast_everywhere():
  """0.6 m/s straight on: no acceleration; wrists and feet too fast by 0.6, velocity and speed; feet, which all stand,
  slide by as much."""
  real = standing()
  errors = found(real + np.arange(24)[:, None, None] * [0, 0, 0.6 / 20], real)
  np.testing.assert_allclose(errors["acceleration"], 0, atol=1e-4)
  np.testing.assert_allclose(errors["extremity_velocity"], 2 * 0.36, rtol=0.05)
  np.testing.assert_allclose(errors["foot_contact"], 0.36, rtol=0.05)  # less what the real feet tremble


def test_one_joint_that_leaps_for_one_frame():
  """10 cm in one frame of 22: second differences of 0.1, -0.2, 0.1 m, so 40, 80, 40 m/s^2, in 22 frames of 22 joints;
  toes are one of six extremities and of four points of the feet, 2 m/s up and down in 2 of 23 steps."""
  real = np.repeat(standing()[:, :1], 24, axis=1)
  made = real.copy()
  made[0, 12, TOES, 1] += 0.1
  errors = found(made, real)
  assert errors["acceleration"] == pytest.approx((40**2 + 80**2 + 40**2) / 22 / 22, rel=1e-4)
  assert errors["extremity_velocity"] == pytest.approx(2 * (2.0**2 + 1.99**2) / 23 / 6, rel=1e-3)
  assert errors["foot_contact"] == pytest.approx(2 * 2.0**2 / 23 / 4, rel=1e-4)


def test_a_foot_that_walks_may_move():
  """Where the real foot does not stand the decoded one is free; the decoded motion itself decides nothing."""
  walk = synthetic_joints("walk", 60, np.random.default_rng(1))[None].astype(np.float32)
  assert found(walk, walk)["foot_contact"] < 0.01 < 0.5 < found(walk + np.cumsum(np.ones(60))[:, None, None] * 0.05,
                                                               walk)["foot_contact"]
  held_up = standing() + np.float32([0, 0.5, 0])  # all of the body, over a floor at 0
  assert found(held_up * 2, held_up)["foot_contact"] == 0


def test_a_foot_that_is_down_for_a_moment_goes_as_the_real_one():
  """A toe on the ground, 0.4 m/s fast, in a body that stands still: what is made 1 m/s faster is off by 1 in all of
  the 23 steps; a toe that flies, or is as fast as in running, may go anyhow."""
  real = np.repeat(standing()[:, :1], 24, axis=1)
  of = lambda speed, height: np.where((np.arange(22) == TOES)[:, None], np.stack(
      [0 * np.arange(24), 0 * np.arange(24) + height, speed / 20 * np.arange(24)], -1)[:, None], 0).astype(np.float32)
  given = lambda speed, height: real + of(speed, height)
  floor = real[0, 0, TOES, 1]
  assert floor < 0.05
  errors = found(given(1.4, 0), given(0.4, 0))
  assert errors["brief_contact"] == pytest.approx(1 / 4, rel=1e-3) and errors["foot_contact"] < 1e-3
  assert found(given(3.0, 0), given(2.0, 0))["brief_contact"] == 0
  assert found(given(1.4, 0.2), given(0.4, 0.2))["brief_contact"] == 0
  assert found(given(0.4, 0), given(0.4, 0))["brief_contact"] == 0


def test_a_foot_that_is_too_short_by_3_cm():
  """One of 21 bones, in all frames; where the bone points, and where the body is, is not asked."""
  real = standing()
  ankle, toe = HUMANML3D.left_feet
  bone = real[:, :, toe] - real[:, :, ankle]
  made, turned = real.copy(), real.copy()
  made[:, :, toe] -= 0.03 * bone / np.linalg.norm(bone, axis=-1, keepdims=True)
  assert found(made, real)["bone_length"] == pytest.approx(0.03**2 / 21, rel=1e-3)
  turned[:, :, toe] = real[:, :, ankle] + bone[..., [1, 2, 0]]
  assert found(turned + 1.0, real)["bone_length"] < 1e-9
  millimetres = np.zeros((1, 10, 21, 3), np.float32)
  millimetres[:, :, KIT.left_feet[-1]] = [30, 0, 0]  # a toe, at whose end no bone begins
  assert found(millimetres, 0 * millimetres, skeleton=KIT)["bone_length"] == pytest.approx(0.03**2 / 20, rel=0.01)


def test_a_foot_that_points_down():
  """Turned by 60 degrees, its end is a unit vector off; of another length, or in another place, it is not."""
  real = standing()
  ankle, toe = HUMANML3D.left_feet
  bone = np.float32([0, 0, 0.14])
  real[:, :, toe] = real[:, :, ankle] + bone
  made = real.copy()
  made[:, :, toe] = real[:, :, ankle] + 1.2 * bone
  assert found(made + 1.0, real)["limb_direction"] < 1e-6
  made[:, :, toe] = real[:, :, ankle] + np.float32([0, -0.14 * np.sqrt(0.75), 0.07])
  assert found(made, real)["limb_direction"] == pytest.approx(1 / 21, rel=1e-3)


def test_dynamics_of_a_body_that_shakes_or_is_too_smooth():
  """Twice and half as far in all directions: a logarithm of 2, of speeds, accelerations and jerks. Which way a joint
  goes does not count, only by how much."""
  real = np.cumsum(np.random.default_rng(0).normal(0, 0.02, (1, 33, 22, 3)), axis=1).astype(np.float32)
  assert found(-real, real)["dynamics"] < 1e-9  # the other way, as fast
  for share in (2.0, 0.5):
    assert found(share * real, real)["dynamics"] == pytest.approx(np.log(2) ** 2, rel=0.1)


def test_units_and_rates_are_the_skeletons():
  """KIT's joints are millimetres at 12.5 frames a second: 100 mm a frame are 1.25 m/s."""
  real = jnp.zeros((1, 10, 21, 3))
  errors = found(real + jnp.arange(10)[:, None, None] * jnp.array([100.0, 0, 0]), real, skeleton=KIT)
  np.testing.assert_allclose(errors["extremity_velocity"], 1.25**2 + 1.24**2, rtol=1e-3)


def test_a_punch_in_another_direction_is_as_fast():
  """Turned by 90 degrees: the velocity is wrong by twice its square, the speed right. At half the speed it is not."""
  punch = np.repeat(standing()[:, :1], 5, axis=1)
  ahead, aside, slow = (punch.copy() for _ in range(3))
  for made, step in ((ahead, [0, 0, 0.1]), (aside, [0.1, 0, 0]), (slow, [0, 0, 0.05])):
    made[0, :, 20] += np.arange(5)[:, None] * np.float32(step)
  assert found(aside, ahead)["extremity_velocity"] == pytest.approx(2 * 2.0**2 / 6, rel=1e-3)
  assert found(slow, ahead)["extremity_velocity"] == pytest.approx(2 * 1.0**2 / 6, rel=1e-3)


@pytest.mark.slow
def test_padding_counts_for_nothing():
  """The same with other numbers there, even none; and the mean is over the real frames alone."""
  rng = np.random.default_rng(0)
  real = np.concatenate([standing(), standing()])
  made = real + rng.normal(0, 0.01, real.shape).astype(np.float32)
  frame_mask = np.arange(24) < np.array([[24], [16]])
  first = found(made, real, frame_mask=frame_mask)
  for value in (7.0, np.nan):
    made[1, 16:] = real[1, 16:] = value
    errors = found(made, real, frame_mask=frame_mask)
    jax.tree.map(np.testing.assert_array_equal, errors, first)
  cut = found(made[1:, :16], real[1:, :16])
  for name in ("acceleration", "extremity_velocity"):
    np.testing.assert_allclose(first[name][1], cut[name][0], rtol=1e-5)

  total = lambda made: sum(value.sum() for value in motion_errors.motion_errors(made, real, frame_mask).values())
  gradient = np.asarray(jax.jit(jax.grad(total))(made))
  assert np.isfinite(gradient).all() and (gradient[1, 16:] == 0).all() and (gradient[1, :15] != 0).any((1, 2)).all()
  assert np.isfinite(jax.grad(lambda made: sum(
      value.sum() for value in motion_errors.motion_errors(made, real[:1]).values()))(real[:1])).all()


def test_who_stands_is_the_same_in_jax():
  walk = synthetic_joints("walk", 60, np.random.default_rng(1)).astype(np.float32)
  for fps in (12.5, 20.0, 60.0):
    there = np.asarray(jax.jit(lambda joints, fps=fps: feet_stand(joints, fps, floor=0.0))(walk))
    np.testing.assert_array_equal(there, feet_stand(walk, fps, floor=0.0))
    assert 0.1 < there.mean() < 0.9


def test_weights_of_both_methods():
  """CMDM: a likelihood with its best sigma, N (1 / 2 + log sigma); CDAMD: the mean itself."""
  assert float(mean_square_nll(jnp.float32(0.25), 1000)) == pytest.approx(1000 * (0.5 + np.log(0.5)), rel=2e-3)
  terms = with_motion_errors({"loss": jnp.ones(())}, {"acceleration": jnp.array([2.0, 4.0])}, {"acceleration": 0.1})
  assert float(terms["loss"]) == pytest.approx(1.3) and float(terms["acceleration"]) == 3.0


def terms_of(name, **loss):
  """(sums, frozen parts) of a step of a tiny tokenizer, whose network gives back what it is given, less a half."""
  config = load_config(name, "tiny").unlock()
  config.loss.update(loss)
  if "teacher" in config.frozen:
    config.frozen.teacher = ""
  config, _ = fit.resolve(config)
  setup = fit.setups()[config.stage](config)
  params = jax.eval_shape(setup.stage.init, setup.next_batch(0), jax.random.key(0))
  args = (params, setup.frozen, setup.next_batch(0), 0, jax.random.key(0))
  sums, weight, *_ = setup.stage.loss(*args) if setup.stage.init_extra is None else (None, None)
  return {term: float(value / weight) for term, value in sums.items()}, setup.frozen


@pytest.fixture
def half(monkeypatch):
  def vae(self, params, x, noise, *rest, **_):
    return x / 2, jnp.zeros_like(noise), jnp.zeros_like(noise)

  monkeypatch.setattr(cmdm.stages.CausalVAE, "apply", vae)
  monkeypatch.setattr(cdamd.stages.Autoencoder, "apply", lambda self, params, x, *_, **__: x / 2)


@pytest.mark.parametrize("name", ["cmdm_tokenizer", pytest.param("cdamd_autoencoder", marks=pytest.mark.slow)])
def test_a_weight_is_felt_and_none_is_off(name, half):
  off, frozen = terms_of(name)
  assert not frozen and not set(motion_errors.NAMES) & off.keys()
  on, frozen = terms_of(name, acceleration=0.5)
  assert set(frozen["stats"]) == {"mean", "std"} and on["acceleration"] > 0
  assert on.keys() - off.keys() == {"acceleration"} and on["loss"] != off["loss"]
  if name == "cdamd_autoencoder":
    assert on["loss"] == pytest.approx(off["loss"] + 0.5 * on["acceleration"], rel=1e-5)


def test_latents_are_off_by_a_share_of_what_they_vary():
  """Noise of 0.2 standard deviations of each channel over the batches of both devices; other noise for each item."""
  scales = np.array([1.0, 10.0, 0.0], np.float32)
  latents = jnp.asarray(np.random.default_rng(0).normal(size=(2, 32, 64, 3)) * scales + 5, jnp.float32)
  index = jnp.arange(64).reshape(2, 32)
  blur = jax.vmap(lambda z, i: autoencoders._blurred(z, 0.2, jax.random.key(0), {"index": i}, "devices"),
                  axis_name="devices")
  noise = np.asarray(blur(latents, index) - latents)
  np.testing.assert_allclose(noise.std((0, 1, 2)), 0.2 * scales, rtol=0.05, atol=1e-6)
  assert len(np.unique(noise[..., 0].round(4))) > 2500  # of 64 items, 64 latents each


def denoiser_terms(decoded_from, **loss):
  """Sums of a step of the tiny denoiser, whose network means that every latent is 0 once it is clean."""
  config, _ = fit.resolve(load_config("cmdm_denoiser", "tiny"))
  config = config.copy_and_resolve_references().unlock()
  config.loss.update(loss, decoded_from=decoded_from)
  setup = fit.setups()[config.stage](config)
  sums, weight = setup.stage.loss({}, setup.frozen, setup.next_batch(0), 0, jax.random.key(0))
  return {term: float(value / weight) for term, value in sums.items()}


@pytest.mark.slow
def test_a_denoiser_is_held_to_how_the_decoded_motion_moves(monkeypatch):
  """The weight times the error, beside the loss of the latents; of no frame where no latent is clean enough."""
  to_zero = lambda self, params, x, t, *_: -x / (1 - jnp.repeat(t, x.shape[1] // t.shape[1], axis=1))[..., None]
  monkeypatch.setattr(cmdm.stages.CausalDiT, "apply", to_zero)
  off, on = denoiser_terms(0.5), denoiser_terms(0.5, foot_contact=2.0)
  assert "foot_contact" not in off and on["foot_contact"] > 0
  assert on["loss"] == pytest.approx(off["loss"] + on["foot_contact"], rel=1e-5)
  assert denoiser_terms(1.0, foot_contact=2.0)["foot_contact"] == 0
  with pytest.raises(InputError, match="loss.foot_contact and data.store"):
    config, _ = fit.resolve(load_config("cmdm_denoiser", "tiny"))
    config = config.copy_and_resolve_references().unlock()
    config.loss.foot_contact, config.data.store = 1.0, "a-store"
    fit.setups()[config.stage](config)
