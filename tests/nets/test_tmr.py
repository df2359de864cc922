"""TMR is the reference's: Gaussians, decoder, each loss term, what is filtered, retrieval; padding changes nothing."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.metrics import scores
from motion_jax.models.tmr import losses as tmr
from motion_jax.models.tmr.weight_names import tmr_names
from motion_jax.nets.tmr import TMR
from motion_jax.training.setup import untrained
from tests import fixtures
from tests.golden import check, golden, recordings
from tests.nets.naming import by_reference


def network(fixture, dtype):
  sizes = fixture.config
  net = TMR(sizes["nfeats"], sizes["latent"], sizes["layers"], sizes["heads"], sizes["ff"], dtype=dtype)
  params = from_torch(fixture.params, tmr_names(sizes["layers"]))["params"]
  return net, jax.tree.map(lambda a: jnp.asarray(a, dtype), params)


@golden("tmr", bounds={"grad/": (1e-5, 1e-9), "retrieval/": (0, 0), "filtered": (0, 0), "": (1e-5, 1e-10)})
def run_tmr(fixture, dtype):
  (net, params), sizes = network(fixture, dtype), fixture.config
  given = {name: jnp.asarray(array, dtype if array.dtype.kind == "f" else None)
           for name, array in fixture.under("in/").items()}
  batch = dict(features=given["motion"], num_frames=jnp.asarray(sizes["frames"]), text_emb=given["text"],
               text_mask=given["text_mask"], sentence=given["sentence"])
  noise = given["noise_text"], given["noise_motion"]
  apply = lambda params, method, *inputs: net.apply({"params": params}, *inputs, method=method)
  terms = lambda params, batch=batch: tmr.tmr_terms(net, params, batch, noise, sizes["lmd"], sizes["temperature"],
                                                    sizes["threshold_selfsim"])
  names, kinds = tmr_names(sizes["layers"]), ("recons", "kl", "latent", "contrastive", "loss")

  @jax.jit
  def run(params):
    text = apply(params, "text_gaussian", given["text"], given["text_mask"])[:2]
    motion = apply(params, "motion_gaussian", given["motion"], given["motion_mask"])[:2]
    text_z, motion_z = tmr.sample(text, noise[0]), tmr.sample(motion, noise[1])
    # All at once, and gradients too: compiling is what takes the time here.
    decoded = apply(params, "decode", jnp.concatenate([text_z, motion_z, text[0]]),
                    jnp.tile(given["motion_mask"], (3, 1)))
    cosines = lambda a, b: tmr.unit(a) @ tmr.unit(b).T
    made = {"text_mu": text[0], "text_logvar": text[1], "motion_mu": motion[0], "motion_logvar": motion[1],
            "text_latent": text_z, "motion_latent": motion_z,
            "motion_latent_fact": tmr.sample(motion, noise[1], sizes["fact"]),
            "similarity": cosines(text[0], motion[0]), "loss_similarity": cosines(text_z, motion_z),
            "filtered": tmr.near_texts(given["sentence"], sizes["threshold_selfsim"]),
            "loss/contrastive_unfiltered": tmr.info_nce(tmr.unit(text_z), tmr.unit(motion_z),
                                                        1 / sizes["temperature"])[0]}
    made |= dict(zip(("decoded_text", "decoded_motion", "decoded_text_mean"), jnp.split(decoded, 3)))
    made["score"] = made["similarity"] / 2 + 0.5

    def listed(params):
      values = terms(params)
      return jnp.stack([values[name] for name in kinds]), values

    _, pull, values = jax.vjp(listed, params, has_aux=True)
    made |= {f"loss/{name}": values[name] for name in kinds}
    grads = jax.vmap(lambda seed: pull(seed)[0])(jnp.eye(len(kinds), dtype=dtype))
    return made, grads

  made, grads = run(params)
  for i, term in enumerate(kinds):
    prefix = "grad/" if term == "loss" else f"term_grad/{term}/"
    made |= {prefix + name: a for name, a in by_reference(jax.tree.map(lambda a, i=i: a[i], grads), names).items()}
  similarity, sentence = (fixture[f"in/retrieval/{name}"].astype(np.float64) for name in ("sims", "sentence"))
  near = sentence @ sentence.T > 2 * sizes["threshold"] - 1
  for name, same in (("plain", None), ("threshold", near)):
    ways = [scores.mean_ranks(way, same) for way in (similarity, similarity.T)]
    found = scores.retrieval_by_rank(similarity, same)
    made[f"retrieval/{name}_ranks"] = np.stack(ways)
    percent = [value if "rank" in key else round(100 * value, 2) for key, value in found.items()]
    made[f"retrieval/{name}"] = np.array(percent)
  return made


@pytest.mark.slow
@recordings("tmr")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cmdm/{name}.npz"), [precision]).failures


@pytest.fixture(scope="module", params=["token", "real"])
def small(request):
  net = TMR(6, 8, 1, 2, 8, dropout=0.0, pool=request.param)
  draw = lambda *size: np.random.default_rng(len(size)).normal(size=size).astype(np.float32)
  batch = dict(features=draw(3, 12, 6), num_frames=np.array([9, 4, 7]), text_emb=draw(3, 6, 5),
               text_mask=np.arange(6) < np.array([[6], [2], [4]]), sentence=np.eye(3, dtype=np.float32))
  mask = np.arange(12) < batch["num_frames"][:, None]
  params = untrained(jax.eval_shape(net.init, jax.random.key(0), batch["features"], mask, batch["text_emb"],
                                    batch["text_mask"]))["params"]
  noise = tuple(draw(2, 3, 8))
  terms = lambda batch: tmr.tmr_terms(net, params, batch, noise, dict(recons=1, kl=1, latent=1, contrastive=1))
  return net, params, batch, jax.jit(terms)


def test_padding_is_invisible(small):
  """What lies behind a clip or a sentence changes no loss term; a clip's vector is that of its own length."""
  net, params, batch, terms = small
  real = (np.arange(12) < batch["num_frames"][:, None])[..., None]
  other = dict(batch, features=np.where(real, batch["features"], np.float32(7)),
               text_emb=np.where(batch["text_mask"][..., None], batch["text_emb"], np.float32(-5)))
  expected = terms(batch)
  for name, value in terms(other).items():
    assert np.isclose(value, expected[name], rtol=2e-5, atol=1e-6), name
  clip = jax.jit(lambda x, count: net.apply({"params": params}, x, jnp.arange(x.shape[1])[None] < count,
                                            method="motion_vector"))
  x = batch["features"][1:2]
  assert np.allclose(clip(other["features"][1:2], 4), clip(x[:, :4], 4), atol=1e-5)
  assert not np.allclose(clip(x, 12), clip(x, 4), atol=1e-3)


def test_frames_are_touched_by_the_contrast_only_where_the_pool_says_so_and_decoded_padding_is_zero(small):
  """In TMR as published nothing but the two tokens reaches a loss (docs/papers/cmdm.md#frame-features)."""
  net, params, batch, _ = small
  frame_mask = np.arange(12) < batch["num_frames"][:, None]
  x = batch["features"]
  apply = lambda method: jax.jit(lambda *inputs: net.apply({"params": params}, *inputs, method=method))
  _, _, rows = apply("motion_gaussian")(x, frame_mask)
  vector = apply("motion_vector")(x, frame_mask)
  mean = (np.asarray(rows) * frame_mask[..., None]).sum(1) / batch["num_frames"][:, None]
  assert np.allclose(vector, mean, atol=1e-5) == (net.pool == "real")
  assert jax.eval_shape(apply("frames"), x).shape == (3, 12, net.dim)
  made = np.asarray(apply("decode")(jnp.ones((3, 8)), frame_mask))
  assert not made[~frame_mask].any() and (np.abs(made).sum(-1)[frame_mask] > 0).all()


def test_a_wrong_pool_is_refused():
  with pytest.raises(ValueError, match="expected token or real"):
    TMR(pool="all").init(jax.random.key(0), jnp.zeros((1, 4, 263)), None, jnp.zeros((1, 1, 4)), None)
