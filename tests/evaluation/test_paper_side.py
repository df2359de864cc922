"""Where the papers say other than their code: each option is its formula, in numbers."""
import runpy

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import motion_jax as mj
from motion_jax import fit as training
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.models import cmdm
from motion_jax.models import mask_schedule as masking
from motion_jax.nets.causal_vae import CausalVAE, sample_latent
from motion_jax.quant import rvq
from motion_jax.training.metrics import read_metrics
from motion_jax.training.setup import untrained
from motion_jax.training.stage import DEVICES
from tests.conftest import ROOT, load_config

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
  inside = [pairs[6 * i + j] for i in range(6) for j in range(6) if i // 3 == j // 3]
  assert abs(sum(inside) / 18 - sum(pairs) / 36) > 1e-3  # not what a window alone gives


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
  share = masked[real].mean()
  assert abs(share - 2 / np.pi) < 0.02
  late = (time_u > 0.6) & (time_u < 0.7)  # a binomial number of a share of about 0.52, not one number for all
  counts = masked[late & real.all(1)].sum(1)
  assert len(set(counts.tolist())) > 5
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
LAST = {"cmdm": "denoiser", "cdamd": "generator"}  # the stages that make motion
ROWS = [(paper, row, stage) for paper, config in PAPERS.items() for row, stages in config["ROWS"].items()
        for stage, changes in stages.items() if changes]


def _name(case):
  return "-".join(case)


def _config(paper, row, stage, size="tiny"):
  """As launch.py finds it, by the file of the paper's tables."""
  path = ROOT / "configs" / "ablations" / f"{paper}.py"
  return runpy.run_path(str(path))["get_config"](f"{row}/{stage}/{size}")


def _made(paper, folder):
  """Motions of a run that makes them."""
  model = mj.load(folder)
  if paper == "cmdm":
    return [model.generate("a person walks", num_frames=24, seeds=[1], num_steps=4, lag=2)[0].joints]
  clip = synthetic_clips(0, 1, num_frames=60)[0]
  return [model.edit(clip, "a person waves", "prefix", seed=1, num_iterations=2, num_steps=2).joints]


def _cases(cases, slow):
  """One of each kind of stage is slow, the others are exhaustive."""
  return pytest.mark.parametrize("case", [pytest.param(
      case, id=_name(case), marks=pytest.mark.slow if _name(case) in slow else pytest.mark.exhaustive)
      for case in cases])


@_cases([case for case in ROWS if case[1] == "paper" and case[2] != "teacher"],
        slow=("cmdm-paper-denoiser",))
def test_the_papers_own_side_trains_and_makes_motion(case, tmp_path, unjudged):
  """All differences at once; the frozen parts are untrained."""
  paper, row, stage = case
  assert int(training.run(_config(*case), tmp_path).step) == 2
  assert np.isfinite([line["loss"] for line in read_metrics(tmp_path) if "loss" in line]).all()
  if stage == LAST[paper]:
    assert all(np.isfinite(joints).all() for joints in _made(paper, tmp_path))


@_cases([case for case in ROWS if case[1] != "paper"], slow=(
    "cmdm-paper-ar-denoiser", "cmdm-paper-kl-tokenizer", "cmdm-paper-teacher-teacher", "cdamd-paper-mask-generator",
    "cdamd-paper-reconstruction-autoencoder", "cdamd-paper-codes-rvq"))
def test_each_difference_is_in_its_config_and_has_a_gradient(case):
  """Traced, not compiled, which is what takes time."""
  paper, row, stage = case
  config, changes = _config(*case), PAPERS[paper]["ROWS"][row][stage]
  for path, value in changes.items():
    section, field = path.split(".")
    if path not in PAPERS[paper].get("OF_FULL", ()) and section != "transformer":
      assert config[section][field] == value, path
  if all(path.startswith(("sampler.", "optimizer.")) or path in PAPERS[paper].get("OF_FULL", ()) for path in changes):
    return  # learns as the default
  setup = training.setups()[config.stage](training.resolve(config)[0])
  batch, key = setup.next_batch(0), jax.random.key(0)
  params = jax.eval_shape(setup.stage.init, batch, key)
  extra = [] if setup.stage.init_extra is None else [jax.eval_shape(setup.stage.init_extra, batch, key)]
  loss = lambda params: setup.stage.loss(params, setup.frozen, batch, 0, key, *extra)[0]["loss"]
  grads = jax.eval_shape(jax.vmap(jax.grad(loss), None, axis_size=1, axis_name=DEVICES), params)
  assert jax.tree.map(lambda a: a.shape[1:], grads) == jax.tree.map(jnp.shape, params)
