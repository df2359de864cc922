"""Where the papers say other than their code: each option is its formula, in numbers."""
import runpy

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.models import cmdm
from motion_jax.models.shared import mask_schedule as masking
from motion_jax.nets.causal_vae import CausalVAE, sample_latent
from motion_jax.quant import rvq
from motion_jax.training.setup import untrained
from tests.conftest import ROOT, load_config, some_of, traced_loss_shape

RNG = np.random.default_rng(0)
pytestmark = pytest.mark.usefixtures("kept_features")


def _cosine(a, b):
  return a @ b / np.linalg.norm(a) / np.linalg.norm(b)


def test_the_tokenizers_terms_are_the_papers():
  """SmoothL1 summed over a window; equation 6 as it is written: latents of all windows as they are, N^2 pairs."""
  y, x = RNG.normal(size=(2, 3, 8, 5)).astype(np.float32) * 2
  away = np.abs(y - x)
  expected = np.where(away < 1, away ** 2 / 2, away - 0.5).sum((1, 2)).mean()
  np.testing.assert_allclose(cmdm.smooth_l1(jnp.asarray(y), jnp.asarray(x)), expected, rtol=1e-6)
  z, teacher = RNG.normal(size=(2, 3, 4)).astype(np.float32), RNG.normal(size=(2, 3, 6)).astype(np.float32)
  rows, guides = z.reshape(6, 4), teacher.reshape(6, 6)
  pairs = [max(abs(_cosine(rows[i], rows[j]) - _cosine(guides[i], guides[j])) - 0.25, 0)
           for i in range(6) for j in range(6)]
  np.testing.assert_allclose(cmdm.set_distances(jnp.asarray(z), jnp.asarray(teacher)), sum(pairs) / 36, rtol=1e-5)


@pytest.mark.slow
def test_the_tokenizers_loss_is_put_together_as_the_config_says():
  """lambda at the linear layer: norms of what reaches the matrix that gives mean and log-variance."""
  vae = CausalVAE(features=7, latent_dim=3, width=8, dilations=(1,), teacher_dim=5)
  x, noise, teacher = (np.float32(RNG.normal(size=size)) for size in ((2, 8, 7), (2, 2, 3), (2, 2, 5)))
  params = untrained(jax.eval_shape(vae.init, jax.random.key(0), x, noise))
  encoder = params["params"]["encoder"]

  def at_the_layer(kernel):
    changed = {"params": params["params"] | {"encoder": encoder | {"head": encoder["head"] | {"kernel": kernel}}}}
    y, mean, logvar = vae.apply(changed, x, noise)
    z = sample_latent(mean, logvar, noise)
    mcos = cmdm.align_terms(vae.apply(changed, z, method="project"), teacher)[0]
    mdms = cmdm.set_distances(z, teacher)
    return dict(rec=cmdm.smooth_l1(y, x), mdms=mdms, mcos=mcos, align=mcos + mdms)

  @jax.jit
  def both(params):
    kernel = params["params"]["encoder"]["head"]["kernel"]
    terms = cmdm.tokenizer_terms(vae, params, x, noise, 1.0, 0.0, root_columns=slice(0, 4), teacher=teacher,
                                 align_weight=1.0, reconstruction="smooth_l1", distance_pairs="set",
                                 last_layer="linear")
    return terms, at_the_layer(kernel), jax.jacrev(at_the_layer)(kernel)

  terms, expected, slopes = both(params)
  for name, value in expected.items():
    np.testing.assert_allclose(terms[name], value, rtol=1e-5)
  ratio = np.linalg.norm(slopes["rec"]) / np.linalg.norm(slopes["align"])
  np.testing.assert_allclose(terms["align_weight"], ratio, rtol=1e-4)
  np.testing.assert_allclose(terms["loss"], terms["rec"] + terms["kl"] + ratio * terms["align"], rtol=1e-5)
  with pytest.raises(ValueError, match="'sets', expected one of window, set"):
    cmdm.align_loss(vae, params, noise, teacher, "sets")


@pytest.mark.slow
def test_latents_of_training_may_be_means():
  config = load_config("cmdm_denoiser", "tiny").unlock()
  batch = {"features": np.float32(RNG.normal(size=(2, 24, 263))), "num_frames": np.array([24, 16]),
           "text_emb": np.zeros((2, 3, 32), np.float32), "text_mask": np.ones((2, 3), bool), "index": np.arange(2)}
  vae, rng = CausalVAE(**config.tokenizer), jax.random.key(3)
  encoder = untrained(jax.eval_shape(vae.init, jax.random.key(1), batch["features"][:1], np.zeros((1, 6, 4))))
  frozen = {"tokenizer": encoder, "latent_mean": np.full(4, 0.5), "latent_std": np.full(4, 2.0)}
  targets = []
  for means in (True, False):
    config.loss.mean_latents = means
    stage = cmdm.denoiser_stage(config)
    params = untrained(jax.eval_shape(stage.init, batch, jax.random.key(2)))
    targets.append(jax.jit(stage.predict)(params, frozen, batch, rng)["target"][0])
  noise = jax.random.normal(jax.random.fold_in(jax.random.split(rng, 4)[2], 0), (6, 4))
  mean, _ = jax.jit(lambda params, x: vae.apply(params, x, method="encode"))(encoder, batch["features"])
  np.testing.assert_allclose(targets[0] + noise, (mean[0] - 0.5) / 2, atol=1e-5)
  assert np.abs(targets[1] - targets[0]).max() > 1e-3


# --- CDAMD ---------------------------------------------------------------------------------------------------------


def test_each_latent_may_be_masked_by_itself():
  """With the probability that the schedule gives the motion, whatever its neighbours and its length."""
  rng = np.random.default_rng(0)
  time_u, order_u = rng.random(4000).astype(np.float32), rng.random((4000, 8)).astype(np.float32)
  real = np.arange(8) < np.where(np.arange(4000) % 2, 8, 3)[:, None]
  masked = np.asarray(masking.choose_masked(time_u, order_u, real, "latent"))
  np.testing.assert_array_equal(masked, (order_u < np.cos(time_u * np.pi / 2)[:, None]) & real)
  assert not (np.asarray(masking.choose_masked(time_u, order_u, real)) == masked).all()
  with pytest.raises(ValueError, match="'each', expected one of count, latent"):
    masking.choose_masked(time_u, order_u, real, "each")


def test_codes_may_learn_by_equation_10():
  codes = RNG.normal(size=(2, 4, 3)).astype(np.float32)
  x = RNG.normal(size=(2, 5, 3)).astype(np.float32)
  rows, residual, total, losses, picked = x.reshape(-1, 3), x.reshape(-1, 3), 0, [], []
  for book in codes:
    chosen = ((residual[:, None] - book) ** 2).sum(-1).argmin(1)
    losses.append(((residual - book[chosen]) ** 2).mean())
    picked.append((residual, chosen))
    residual, total = residual - book[chosen], total + book[chosen]
  learn = jax.jit(rvq.learn, static_argnums=2)
  made, codebook = learn(jnp.asarray(codes), jnp.asarray(x), 2)
  np.testing.assert_allclose(made.quantized.reshape(-1, 3), total, atol=1e-6)
  np.testing.assert_array_equal(made.indices.reshape(-1, 2).T, [chosen for _, chosen in picked])
  np.testing.assert_allclose([made.commitment, codebook], np.mean(losses), rtol=1e-5)
  # To codes: their way to the mean of what chose them; to latents: once straight through, and the commitment.
  grad = jax.jit(jax.grad(lambda codes: rvq.learn(codes, jnp.asarray(x), 2)[1]))(jnp.asarray(codes))
  expected = np.zeros_like(codes)
  for level, (left, chosen) in enumerate(picked):
    np.add.at(expected[level], chosen, 2 * (codes[level][chosen] - left) / rows.size / 2)
  np.testing.assert_allclose(grad, expected, atol=1e-6)
  through = jax.jit(jax.grad(lambda x: (3 * rvq.learn(jnp.asarray(codes), x, 2)[0].quantized).sum()))(jnp.asarray(x))
  np.testing.assert_allclose(through, 3.0)
  one, _ = learn(jnp.asarray(codes), jnp.asarray(x), 1)
  assert (one.indices[..., 1] == -1).all()
  np.testing.assert_allclose(one.commitment, losses[0], rtol=1e-5)


# --- configs -------------------------------------------------------------------------------------------------------

PAPERS = {name: runpy.run_path(str(ROOT / "configs" / "ablations" / f"{name}_paper.py")) for name in ("cmdm", "cdamd")}
CASES = {"-".join((paper, row, stage)): (paper, row, stage) for paper, config in PAPERS.items()
         for row, stages in config["ROWS"].items() for stage, changes in stages.items() if changes}
TRACED = ("cmdm-paper-denoiser", "cmdm-paper-ar-denoiser", "cmdm-paper-kl-tokenizer", "cmdm-paper-teacher-teacher",
          "cdamd-paper-mask-generator", "cdamd-paper-reconstruction-autoencoder", "cdamd-paper-codes-rvq")


@pytest.mark.parametrize("case", some_of(CASES, slow=TRACED))
def test_each_difference_is_in_its_config_and_has_a_loss(case):
  """All of a paper at once, and each alone: as launch.py finds it, by the file of the paper's tables."""
  paper, row, stage = CASES[case]
  config = runpy.run_path(str(ROOT / "configs" / "ablations" / f"{paper}.py"))["get_config"](f"{row}/{stage}/tiny")
  for path, value in PAPERS[paper]["ROWS"][row][stage].items():
    section, field = path.split(".")
    if path not in PAPERS[paper].get("OF_FULL", ()) and section != "transformer":
      assert config[section][field] == value, path
  assert traced_loss_shape(config) == ()
