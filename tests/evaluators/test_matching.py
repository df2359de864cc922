"""Evaluators learn what the papers say: losses against plain numpy, N devices as one."""
import jax
import jax.numpy as jnp
import ml_collections
import numpy as np
import optax
import pytest

from motion_jax.data import sources
from motion_jax.data.datasets.humanml3d import write_folder
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.evaluators import stages as matching
from motion_jax.text.captions import meanings
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import optimizers
from motion_jax.training.setup import untrained
from motion_jax.training.stage import DEVICES
from tests.conftest import load_config


def _numpy_contrast(text, motion, shift, margin, same):
  count = len(text)
  right = [np.sqrt(((text[i] - motion[i] + 1e-6) ** 2).sum()) ** 2 for i in range(count)]
  wrong = [max(0, margin - np.sqrt(((text[i] - motion[(i + shift) % count] + 1e-6) ** 2).sum())) ** 2
           for i in range(count) if not same[i, (i + shift) % count]]
  return np.mean(right), np.mean(wrong) if wrong else 0.0


@pytest.mark.parametrize("shift", [0, 1, 3])
def test_contrast_is_the_formula(shift):
  rng = np.random.default_rng(shift)
  text, motion = 3 * rng.normal(size=(2, 5, 4))
  same = np.eye(5, dtype=bool)
  same[0, 3] = same[3, 0] = True
  for filtered in (np.zeros((5, 5), bool), same):
    positive, negative = _numpy_contrast(text, motion, shift, 10.0, filtered)
    made = jax.jit(matching.contrast)(text, motion, shift, 10.0, filtered)
    assert np.isclose(made["positive"], positive, rtol=1e-5) and np.isclose(made["negative"], negative, rtol=1e-5)
    assert np.isclose(made["loss"], positive + negative, rtol=1e-5)


def _matching_config(first_shift=0):
  config = load_config("evaluator_matching", "tiny").unlock()
  config.model.update(features=5, columns=7)
  config.loss.first_shift = first_shift
  return config


def _matching_batch(count=4, equal=False):
  rng = np.random.default_rng(1)
  batch = {"features": rng.normal(size=(count, 16, 7)), "words": rng.normal(size=(count, 6, 10)),
           "classes": np.eye(15)[rng.integers(15, size=(count, 6))]}
  batch = {name: np.asarray(array, np.float32) for name, array in batch.items()}
  return batch | {"num_frames": np.array([8, 16, 12, 16])[:count], "lengths": np.array([3, 6, 4, 5])[:count],
                  "meaning": np.zeros(count, np.int32) if equal else np.arange(count, dtype=np.int32),
                  "index": np.arange(count)}


@pytest.mark.slow
def test_two_devices_contrast_the_whole_batch():
  """Loss and gradient of two halves, each of which sees what lies on the other, are those of the whole."""
  config, batch = _matching_config(), _matching_batch()
  alone, mapped = matching.matching_stage(config, axis_name=None), matching.matching_stage(config)
  params = untrained(jax.eval_shape(alone.init, batch, jax.random.key(0)))

  def divided(params):
    halves = jax.tree.map(lambda a: a.reshape((2, 2) + a.shape[1:]), batch)
    sums, weight = jax.vmap(lambda half: mapped.loss(params, {}, half, 0, jax.random.key(3)), axis_name=DEVICES,
                            out_axes=0)(halves)
    return (sums["loss"] / weight).mean()

  whole = lambda params: alone.loss(params, {}, batch, 0, jax.random.key(3))[0]["loss"]
  (one, grad), (two, grads) = (jax.jit(jax.value_and_grad(f))(params) for f in (whole, divided))
  assert np.isclose(one, two, rtol=1e-5)
  for a, b in zip(jax.tree.leaves(grad), jax.tree.leaves(grads), strict=True):
    np.testing.assert_allclose(a, b, atol=1e-4 * max(1.0, float(jnp.abs(a).max())))


@pytest.mark.slow
def test_matching_is_the_contrast_by_falling_length_and_holds_the_movement_encoder_still():
  config, batch = _matching_config(first_shift=1), _matching_batch()
  stage = matching.matching_stage(config, axis_name=None)
  params = untrained(jax.eval_shape(stage.init, batch, jax.random.key(0)))
  loss = lambda params, batch: stage.loss(params, {}, batch, 0, jax.random.key(5))[0]["loss"]
  value, grads = jax.jit(jax.value_and_grad(loss))(params, batch)
  made = jax.jit(lambda params: stage.predict(params, {}, batch, None))(params)
  order = [1, 3, 2, 0]
  text, motion = np.asarray(made["text"])[order], np.asarray(made["motion"])[order]
  found = [sum(_numpy_contrast(text, motion, shift, 10.0, np.eye(4, dtype=bool))) for shift in (1, 2, 3)]
  assert np.isclose(found, value, rtol=1e-4).any()
  moves = {name for name, part in grads["params"].items() if any(np.abs(g).max() > 0 for g in jax.tree.leaves(part))}
  assert moves == {"motion_encoder", "text_encoder"}
  nothing_wrong = jax.jit(loss)(params, _matching_batch(equal=True))
  assert np.isclose(nothing_wrong, ((text - motion + 1e-6) ** 2).sum(-1).mean(), rtol=1e-4)


def test_movement_loss_is_the_formula():
  config = load_config("evaluator_movement", "tiny").unlock()
  config.model.update(features=5, columns=7, dropout=0.0)
  stage = matching.movement_stage(config)
  x = np.random.default_rng(0).normal(size=(3, 16, 7)).astype(np.float32)
  batch = {"features": x, "index": np.arange(3)}
  params = untrained(jax.eval_shape(stage.init, batch, jax.random.key(0)))
  (sums, weight) = jax.jit(lambda p: stage.loss(p, {}, batch, 0, jax.random.key(0)))(params)
  encoder, decoder = matching.movement_networks(config.model)
  tokens = np.asarray(jax.jit(encoder.apply)({"params": params["encoder"]}, x[..., :5]), np.float64)
  made = np.asarray(jax.jit(decoder.apply)({"params": params["decoder"]}, tokens.astype(np.float32)), np.float64)
  expected = (np.abs(made - x[..., :5]).mean() + 0.001 * np.abs(tokens).mean()
              + 0.001 * np.abs(tokens[:, 1:] - tokens[:, :-1]).mean())
  assert weight == 1 and np.isclose(sums["loss"], expected, rtol=1e-5)


@pytest.mark.slow
def test_the_loss_of_snapmogens_evaluator_is_the_formula():
  """TMR's: drawn latents rebuild the motion, Gaussians of a pair are alike and near the unit one, pairs contrast."""
  config = load_config("evaluator_snapmogen", "tiny").unlock()
  config.model.update(features=5, columns=7, dropout=0.0)
  rng = np.random.default_rng(3)
  batch = {"features": rng.normal(size=(4, 12, 7)), "text_emb": rng.normal(size=(4, 5, 6))}
  batch = {name: np.asarray(array, np.float32) for name, array in batch.items()}
  batch |= {"num_frames": np.array([12, 8, 4, 12]), "text_mask": np.arange(5) < np.array([5, 3, 2, 4])[:, None],
            "meaning": np.array([0, 1, 2, 0], np.int32), "index": np.arange(4)}
  stage = matching.gaussian_stage(config, axis_name=None)
  net, decoder = matching.gaussian_networks(config.model)

  @jax.jit
  def parts(params):
    gaussian = lambda method, *given: net.apply({"params": params["params"]}, *given, method=method)[1:]
    text = gaussian("text_gaussian", batch["text_emb"], batch["text_mask"])
    motion = gaussian("motion_gaussian", batch["features"], batch["num_frames"])
    keys = jax.random.split(jax.random.fold_in(jax.random.key(5), 0), 6)[2:4]
    latents = [mean + jnp.exp(logvar / 2) * jax.random.normal(key, mean.shape)
               for (mean, logvar), key in zip((text, motion), keys)]
    real = np.arange(12) < batch["num_frames"][:, None]
    rebuilt = [decoder.apply({"params": params["decoder"]}, z, real) for z in latents]
    unit = [jnp.zeros_like(latents[0])] * 2
    apart = [matching.divergence(*pair) for pair in ((text, unit), (motion, unit), (text, motion), (motion, text))]
    return latents, rebuilt, sum(apart), stage.loss(params, {}, batch, 0, jax.random.key(5))[0]

  latents, rebuilt, apart, sums = parts(untrained(jax.eval_shape(stage.init, batch, jax.random.key(0))))
  huber = lambda away: np.where(np.abs(away) < 1, np.square(away) / 2, np.abs(away) - 0.5).mean()
  expected = {"reconstruction": sum(huber(x - batch["features"][..., :5]) for x in rebuilt), "divergence": apart,
              "latent": huber(np.subtract(*latents)), "contrast": sums["contrast"]}
  for name, value in (expected | {"loss": sum(config.loss[name] * one for name, one in expected.items())}).items():
    assert np.isclose(sums[name], value, rtol=1e-4), name


def test_divergence_of_gaussians():
  """Closed form: equal ones are 0 apart, a shift of 2 at width 1 is 2, both ways alike."""
  normal = lambda mean, variance: (np.full((3, 2), mean), np.full((3, 2), np.log(variance)))
  for one, other, apart in (((0, 1), (0, 1), 0), ((0, 1), (2, 1), 2), ((2, 1), (0, 1), 2),
                            ((0, 4), (0, 1), 0.5 * (4 - 1 - np.log(4)))):
    assert np.isclose(matching.divergence(normal(*one), normal(*other)), apart)


def test_each_network_is_clipped_alone():
  config = load_config("evaluator_matching", "full").optimizer
  config = ml_collections.ConfigDict(config.to_dict() | {"beta1": 0.0, "beta2": 0.0})
  tree = {"params": {"motion_encoder": {"w": jnp.full(4, 100.0)}, "text_encoder": {"w": jnp.full(4, 0.1)}}}
  clipped, _ = optimizers.clipping(config).update(tree, optimizers.clipping(config).init(tree))
  assert np.isclose(optax.tree.norm(clipped["params"]["motion_encoder"]), 0.5)
  np.testing.assert_array_equal(clipped["params"]["text_encoder"]["w"], np.full(4, np.float32(0.1)))


def test_sentences_that_clips_link_mean_the_same():
  found = meanings([["a", "b"], ["b", "c"], ["d"], ["e", "d"]])
  assert found["a"] == found["b"] == found["c"] != found["d"] == found["e"]


def test_tokens_are_those_of_the_files(tmp_path):
  """A data set's own lemmas and parts of speech go before those that our tagger makes."""
  folder = tmp_path / "data"
  write_folder(synthetic_clips(0, 6), folder, mirror=False)
  for text in (folder / "texts").glob("*.txt"):
    rows = [line.split("#") for line in text.read_text().splitlines()]
    text.write_text("\n".join("#".join([caption, "odd/NOUN", *times]) for caption, _, *times in rows) + "\n")
  config = load_config("evaluator_matching", "66").unlock()
  config.data.folder = str(folder)
  assert set(sources.load_features(config.data, "train").tokens.values()) == {("odd/NOUN",)}


def test_word_pieces_end_at_the_largest_id():
  encoder = load_text_encoder("random-init")
  tokens, positions = matching.piece_tables(encoder)
  pieces = matching.piece_ids(encoder, ["a person walks", "walks " * 20], 8)
  assert pieces.shape == (2, 8) and (pieces.max(1) == len(tokens) - 1).all()
  assert pieces[0].argmax() == 4 and (pieces[0, 5:] == 0).all() and pieces[1].argmax() == 7
  assert tokens.shape[1] == positions.shape[1] == encoder.dim
  np.testing.assert_array_equal(tokens[-1], tokens[3])  # [SEP]
