"""Captions that contradict a motion cost more: which they are, the loss by hand, and what a run learns from it."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax import fit, runs
from motion_jax.data.contradictions import contradict, contradictions
from motion_jax.diffusion import paths
from motion_jax.models.cdamd.draws import draw_step
from motion_jax.models.cdamd.losses import generator_loss
from motion_jax.models.shared import mask_schedule
from motion_jax.models.shared.captioned_batches import contradictions_of
from motion_jax.training.metrics import read_metrics
from motion_jax.utils.errors import InputError
from tests.conftest import light_training, load_config, some_of

pytestmark = pytest.mark.usefixtures("kept_features")


@pytest.mark.parametrize("caption, expected", [
    ("a person walks forward slowly.", {"a person walks forward quickly.", "a person walks backward slowly."}),
    ("kicks with the left leg twice", {"kicks with the right leg twice", "kicks with the left leg once",
                                       "kicks with the left leg three times", "kicks with the left leg four times"}),
    ("takes four steps", {"takes two steps"}),
    ("turns clockwise", {"turns counterclockwise"}),
    ("waves with the left and the right hand", set()),  # exchanged, it says the same
    ("steps forward and backward", set()),
    ("two people sit upright", set()),
])
def test_contradictions_change_one_kind_of_word(caption, expected):
  assert {text for kind in contradictions(caption) for text in kind} == expected
  drawn = {contradict(caption, chance) for chance in np.linspace(0, 1, 40, endpoint=False)}
  assert drawn == (expected or {caption})


def test_the_term_of_the_forcing_loss_by_hand():
  """Clip 0 is off by 0 with its caption and by 0.04 with the other one, clip 1 by 0.25 and 0, clip 2 has no other."""
  x1, noise = np.zeros((2, 3, 4, 2), np.float32)
  own, other = (jnp.broadcast_to(jnp.array(value)[:, None, None], x1.shape) for value in ((0, .5, .5), (.2, 0, 0)))
  counts = jnp.array([[1, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 0]], bool)
  real = jnp.ones((3, 4), bool)
  loss = lambda contrast: paths.forcing_loss(lambda x, t: own, x1, real, jnp.full((3, 4), 0.25), noise,
                                             contrast=contrast)
  (plain, weight), (sums, same) = loss(None), loss(paths.Contrast(lambda x, t: other, counts, 2.0, 0.1))
  assert weight == same == 12 and "contrast" not in plain
  # 2 * (0.1 + 0 - 0.04) and 2 * (0.1 + 0.25 - 0), each times the four latents of the clip.
  np.testing.assert_allclose(sums["contrast"], 4 * (2 * 0.06 + 2 * 0.35), rtol=1e-6)
  np.testing.assert_allclose(sums["loss"] - plain["loss"], sums["contrast"], rtol=1e-6)
  np.testing.assert_allclose(plain["loss"], 4 * 2 * 0.25, rtol=1e-6)


class _Net:
  """A generator whose condition is the caption's number and whose head returns it, whatever the noise."""

  def apply(self, params, x=None, text=None, *rest, method=None, **_):
    if method == "mask_token":
      return jnp.zeros((1, 1, 2))
    if method == "condition":
      return jnp.broadcast_to(text[:, :1], (*x.shape[:2], text.shape[-1]))
    return jnp.broadcast_to(rest[0], x.shape)


def test_the_term_of_the_generators_loss_by_hand():
  """Without a clean or a noisy latent to predict, errors are squares of the caption's numbers."""
  config = ConfigDict(dict(mask="dccm", noise_rate=0.1, mask_rate=0.88, drop_rate=0.0, mask_draw="count", copies=1,
                           prior_drop_rate=0.0, prior_drop="item", diffusion="flow", contrast=2.0, contrast_margin=0.1,
                           contrast_until=0.5))
  keys = jax.random.split(jax.random.key(0), 3)
  draws = draw_step(jax.random.key(1), keys, 6, 2, config)
  draws = draws._replace(diffusion_noise=jnp.zeros_like(draws.diffusion_noise))
  z1, real = jnp.zeros((3, 6, 2)), jnp.ones((3, 6), bool)
  own, other = (jnp.broadcast_to(jnp.array(value)[:, None, None], (3, 1, 2)) for value in ((0, .5, .5), (.2, 0, 0)))
  loss = jax.jit(lambda false: generator_loss(_Net(), {"params": {"head": {}}}, z1, real, own, None, draws, config,
                                              false=false))
  (plain, weight), (sums, same) = loss(None), loss((other, None, jnp.array([True, True, False])))
  masked = np.asarray(plain["loss"])
  assert weight == same and masked > 0
  made = mask_schedule.corruption(draws.time_u, draws.order_u, draws.noise_u, draws.keep_u, real, 0.1, 0.88, "count")
  early = np.asarray(made.masked & (draws.t[0] < 0.5)).sum(1)
  assert early[:2].min() > 0
  np.testing.assert_allclose(sums["loss"] - plain["loss"], 2 * (0.06 * early[0] + 0.35 * early[1]), rtol=1e-5)


def test_both_captions_of_a_batch_are_padded_to_one_width():
  own = {"text_emb": np.ones((2, 3, 4)), "text_mask": np.ones((2, 5, 3), bool)}
  false = {"text_emb": np.ones((2, 2, 4)), "text_mask": np.ones((2, 5, 2), bool)}
  made = contradictions_of(own, false, [True, False])
  assert made["text_emb"].shape == made["false_emb"].shape == (2, 3, 4)
  assert made["false_mask"].shape == (2, 5, 3) and not made["false_mask"][..., 2].any()
  np.testing.assert_array_equal(made["has_false"], [True, False])


@pytest.mark.slow
@pytest.mark.parametrize("name", some_of(["cmdm_denoiser", "cdamd_generator"], slow=["cmdm_denoiser"]))
def test_a_run_with_contradicting_captions(name, tmp_path):
  """The term is part of its loss, and it records how it was trained."""
  config = load_config(name, "tiny").unlock()
  config.loss.update(contrast=3.0, contrast_until=1.0)
  with light_training():
    fit.run(config, tmp_path)
  assert runs.load_run(tmp_path).config.loss.contrast == 3.0
  assert [row["contrast"] for row in read_metrics(tmp_path) if "contrast" in row]


@pytest.mark.slow
def test_the_other_path_is_refused(tmp_path):
  config = load_config("cdamd_generator", "tiny").unlock()
  config.loss.update(contrast=1.0, diffusion="ddpm")
  with light_training(), pytest.raises(InputError, match="loss.contrast and loss.diffusion='ddpm'"):
    fit.run(config, tmp_path / "run")
