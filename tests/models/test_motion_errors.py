"""Losses on how the decoded motion moves: values by hand, padding that does not count, weights of 0 that are off."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import fit
from motion_jax.data.datasets.synthetic import synthetic_joints
from motion_jax.models import cdamd, cmdm
from motion_jax.models.cmdm.losses import mean_square_nll
from motion_jax.models.shared import autoencoders, motion_errors
from motion_jax.models.shared.autoencoders import with_motion_errors
from motion_jax.motion.skeleton import HUMANML3D, KIT
from motion_jax.utils.errors import InputError
from tests.conftest import load_config, some_of

pytestmark = pytest.mark.usefixtures("kept_features")

ANKLE, TOES = HUMANML3D.left_feet
FRAMES = np.arange(24)[:, None]
ERRORS = {skeleton: jax.jit(functools.partial(motion_errors.motion_errors, skeleton=skeleton))
          for skeleton in (HUMANML3D, KIT)}


def errors_of(made, real, frame_mask=None, skeleton=HUMANML3D):
  given = (np.asarray(array, np.float32) for array in (made, real))
  mask = np.ones(made.shape[:2], bool) if frame_mask is None else frame_mask
  return {name: np.asarray(value) for name, value in ERRORS[skeleton](*given, mask).items()}


def still():
  """A body that stands, (1, 24, 22, 3)."""
  return np.repeat(synthetic_joints("stand", 1, np.random.default_rng(0))[None], 24, axis=1)


def with_joint(joint, path, body=None):
  """A standing body with one joint moved by path (24, 3)."""
  made = still() if body is None else body.copy()
  made[0, :, joint] += path
  return made


def walk():
  return synthetic_joints("walk", 60, np.random.default_rng(1))[None, 20:44]


def pointing(x, y, z):
  """A body whose left foot is this bone."""
  made = still()
  made[:, :, TOES] = made[:, :, ANKLE] + np.array([x, y, z])
  return made


def touching(speed, height):
  """Toes that go ahead at a speed and a height, in a body that stands still."""
  return with_joint(TOES, FRAMES * [0, 0, speed / 20] + [0, height, 0])


LEAP = (FRAMES == 12) * np.array([0, 0.1, 0])
UP = np.array([0, 0.5, 0])
NOISE = np.cumsum(np.random.default_rng(0).normal(0, 0.02, (1, 24, 22, 3)), axis=1)
# {what happens: (decoded, real, {term: (value, relative tolerance)})}
SCENES = {
    # 0.6 m/s straight on: no acceleration; wrists and feet are off in velocity and in speed; standing feet slide.
    "a body that is carried along": lambda: (still() + FRAMES[:, None] * [0, 0, 0.6 / 20], still(), dict(
        acceleration=(0, 0), extremity_velocity=(2 * 0.36, 0.05), foot_contact=(0.36, 0.05), brief_contact=(0, 0))),
    # Second differences of 0.1, -0.2, 0.1 m, so 40, 80, 40 m/s^2, in 22 frames of 22 joints; toes are one of six
    # extremities and of four points of the feet, 2 m/s up and down in 2 of 23 steps.
    "toes that leap for one frame": lambda: (with_joint(TOES, LEAP), still(), dict(
        acceleration=((40**2 + 80**2 + 40**2) / 22 / 22, 1e-4), extremity_velocity=(2 * (2.0**2 + 1.99**2) / 23 / 6,
                                                                                    1e-3),
        foot_contact=(2 * 2.0**2 / 23 / 4, 1e-4))),
    # Where the real foot does not stand the decoded one is free, wherever that is.
    "a body over a floor at 0": lambda: (2 * (still() + UP), still() + UP, dict(foot_contact=(0, 0))),
    # 1 m/s faster in all steps, one of four points; what flies, or is as fast as in running, may go anyhow.
    "toes that touch the ground": lambda: (touching(1.4, 0), touching(0.4, 0), dict(
        brief_contact=(1 / 4, 1e-3), foot_contact=(0, 0))),
    "toes as fast as in running": lambda: (touching(3.0, 0), touching(2.0, 0), dict(brief_contact=(0, 0))),
    "toes that fly": lambda: (touching(1.4, 0.2), touching(0.4, 0.2), dict(brief_contact=(0, 0))),
    # One of 21 bones; where it points and where the body is do not count.
    "a foot that is 3 cm short": lambda: (pointing(0, 0, 0.11), pointing(0, 0, 0.14), dict(
        bone_length=(0.03**2 / 21, 1e-3))),
    "a foot that points elsewhere": lambda: (pointing(0.14, 0, 0) + 1, pointing(0, 0, 0.14), dict(bone_length=(0, 0))),
    # Turned by 60 degrees its end is a unit vector off; its length and place do not count.
    "a foot that points down": lambda: (pointing(0, -0.14 * np.sqrt(0.75), 0.07), pointing(0, 0, 0.14), dict(
        limb_direction=(1 / 21, 1e-3))),
    "a foot that is long": lambda: (pointing(0, 0, 0.168) + 1, pointing(0, 0, 0.14), dict(limb_direction=(0, 0))),
    # A logarithm of 2 of speeds, accelerations and jerks; which way a joint goes does not count.
    "a body that shakes": lambda: (2 * NOISE, NOISE, dict(dynamics=(np.log(2) ** 2, 0.1))),
    "a body that is too smooth": lambda: (0.5 * NOISE, NOISE, dict(dynamics=(np.log(2) ** 2, 0.1))),
    "a body that goes the other way": lambda: (-NOISE, NOISE, dict(dynamics=(0, 0))),
    # A wrist 2 m/s fast: turned by 90 degrees the velocity is off by twice its square, the speed by nothing.
    "a punch aside": lambda: (with_joint(20, FRAMES * [0.1, 0, 0]), with_joint(20, FRAMES * [0, 0, 0.1]), dict(
        extremity_velocity=(2 * 2.0**2 / 6, 1e-3))),
    "a punch at half the speed": lambda: (with_joint(20, FRAMES * [0, 0, 0.05]), with_joint(20, FRAMES * [0, 0, 0.1]),
                                          dict(extremity_velocity=(2 * 1.0**2 / 6, 1e-3))),
}


@pytest.mark.parametrize("scene", SCENES)
def test_values_by_hand(scene):
  made, real, expected = SCENES[scene]()
  errors = errors_of(made, real)
  for name, (value, tolerance) in expected.items():
    assert errors[name] == pytest.approx(value, rel=tolerance, abs=1e-4), name


def test_a_foot_that_walks_may_move():
  """The decoded motion itself decides nothing."""
  sliding = walk() + FRAMES[:, None] * 0.05
  assert errors_of(walk(), walk())["foot_contact"] < 0.01 < 0.5 < errors_of(sliding, walk())["foot_contact"]


def test_units_and_rates_are_the_skeletons():
  """KIT's joints are millimetres at 12.5 frames a second: 100 mm a frame are 1.25 m/s; 30 mm of one of 20 bones."""
  real, long = np.zeros((2, 1, 10, 21, 3))
  long[:, :, KIT.left_feet[-1]] = [30, 0, 0]  # a toe, at whose end no bone begins
  fast = real + FRAMES[:10, None] * [100.0, 0, 0]
  np.testing.assert_allclose(errors_of(fast, real, skeleton=KIT)["extremity_velocity"], 1.25**2 + 1.24**2, rtol=1e-3)
  assert errors_of(long, real, skeleton=KIT)["bone_length"] == pytest.approx(0.03**2 / 20, rel=0.01)


@pytest.mark.slow
def test_padding_counts_for_nothing():
  """The same with other numbers there, even none; and the mean is over the real frames alone."""
  real = np.concatenate([still(), still()])
  made = real + np.random.default_rng(0).normal(0, 0.01, real.shape)
  frame_mask = FRAMES[:, 0] < np.array([[24], [16]])
  first = errors_of(made, real, frame_mask)
  for value in (7.0, np.nan):
    made[1, 16:] = real[1, 16:] = value
    jax.tree.map(np.testing.assert_array_equal, errors_of(made, real, frame_mask), first)
  cut = errors_of(made[1:, :16], real[1:, :16])
  for name in ("acceleration", "extremity_velocity"):
    np.testing.assert_allclose(first[name][1], cut[name][0], rtol=1e-5)
  total = lambda made: sum(value.sum() for value in ERRORS[HUMANML3D](made, real, frame_mask).values())
  gradient = np.asarray(jax.jit(jax.grad(total))(made.astype(np.float32)))
  assert np.isfinite(gradient).all() and (gradient[1, 16:] == 0).all() and (gradient[1, :15] != 0).any((1, 2)).all()


def test_weights_of_both_methods():
  """CMDM: a likelihood with its best sigma, N (1 / 2 + log sigma); CDAMD: the mean itself."""
  assert float(mean_square_nll(jnp.float32(0.25), 1000)) == pytest.approx(1000 * (0.5 + np.log(0.5)), rel=2e-3)
  terms = with_motion_errors({"loss": jnp.ones(())}, {"acceleration": jnp.array([2.0, 4.0])}, {"acceleration": 0.1})
  assert float(terms["loss"]) == pytest.approx(1.3) and float(terms["acceleration"]) == 3.0


def terms_of(name, given=None, **loss):
  """(terms, frozen parts) of a step of a tiny config; given: what the network has learned, else shapes alone."""
  config, _ = fit.resolve(load_config(name, "tiny"))
  config = config.copy_and_resolve_references().unlock()
  config.loss.update(loss)
  if "teacher" in config.frozen:
    config.frozen.teacher = ""
  setup = fit.setups()[config.stage](config)
  batch, key = setup.next_batch(0), jax.random.key(0)
  params = jax.eval_shape(setup.stage.init, batch, key) if given is None else given
  sums, weight = setup.stage.loss(params, setup.frozen, batch, 0, key)
  return {term: float(value / weight) for term, value in sums.items()}, setup.frozen


@pytest.mark.parametrize("name", some_of(["cmdm_tokenizer", "cdamd_autoencoder"], slow=["cdamd_autoencoder"]))
def test_a_weight_is_felt_and_none_is_off(name, monkeypatch):
  """Of a network that gives back half of what it is given."""
  half = lambda self, params, x, noise, *_, **__: (x / 2, jnp.zeros_like(noise), jnp.zeros_like(noise))
  monkeypatch.setattr(cmdm.stages.CausalVAE, "apply", half)
  monkeypatch.setattr(cdamd.stages.Autoencoder, "apply", lambda self, params, x, *_, **__: x / 2)
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
  latents = (np.random.default_rng(0).normal(size=(2, 32, 64, 3)) * scales + 5).astype(np.float32)
  blur = jax.jit(jax.vmap(lambda z, i: autoencoders._blurred(z, 0.2, jax.random.key(0), {"index": i}, "devices"),
                          axis_name="devices"))
  noise = np.asarray(blur(latents, np.arange(64).reshape(2, 32))) - latents
  np.testing.assert_allclose(noise.std((0, 1, 2)), 0.2 * scales, rtol=0.05, atol=1e-6)
  assert len(np.unique(noise[..., 0].round(4))) > 2500  # of 64 items, 64 latents each


@pytest.mark.slow
def test_a_denoiser_is_held_to_how_the_decoded_motion_moves(monkeypatch):
  """The weight times the error, beside the loss of the latents; of no frame where no latent is clean enough. Its
  network means that every latent is 0 once it is clean."""
  to_zero = lambda self, params, x, t, *_: -x / (1 - jnp.repeat(t, x.shape[1] // t.shape[1], axis=1))[..., None]
  monkeypatch.setattr(cmdm.stages.CausalDiT, "apply", to_zero)
  terms = lambda **loss: terms_of("cmdm_denoiser", {}, **loss)[0]
  off, on = terms(decoded_from=0.5), terms(decoded_from=0.5, foot_contact=2.0)
  assert "foot_contact" not in off and on["foot_contact"] > 0
  assert on["loss"] == pytest.approx(off["loss"] + on["foot_contact"], rel=1e-5)
  assert terms(decoded_from=1.0, foot_contact=2.0)["foot_contact"] == 0
  config, _ = fit.resolve(load_config("cmdm_denoiser", "tiny"))
  config = config.copy_and_resolve_references().unlock()
  config.loss.foot_contact, config.data.store = 1.0, "a-store"
  with pytest.raises(InputError, match="loss.foot_contact and data.store"):
    fit.setups()[config.stage](config)
