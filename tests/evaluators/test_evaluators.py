"""The evaluators are the references', and see nothing of padding or of batch-mates."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.evaluators import networks as evaluators
from motion_jax.evaluators.weight_names import (
  CLIP_EVALUATOR_IGNORED,
  clip_evaluator_names,
  t2m_evaluator_names,
)
from motion_jax.models.shared.autoencoder_weights import length_estimator_names
from motion_jax.models.shared.length import middle_frames
from motion_jax.models.tmr.losses import symmetric_cross_entropy
from motion_jax.nets.length_estimator import LengthEstimator
from motion_jax.training.setup import untrained
from tests import fixtures
from tests.golden import check, golden, recordings

BY_README = {"": (1e-5, 1e-10)}  # the recorder named tolerances in a table, not in the files


def cast(params, dtype):
  return jax.tree.map(lambda a: jnp.asarray(a, dtype), params)


def part(fixture, prefixes):
  """The fixture's state dict less the networks that the prefixes do not name."""
  return {name: array for name, array in fixture.params.items() if name.startswith(prefixes)}


def clip_evaluator(state, sizes, features, columns, dtype):
  model = evaluators.ClipEvaluator(features, columns, sizes["width"], sizes["layers"], sizes["heads"], sizes["ff"],
                                   state["out.bias"].size, sizes.get("vocab", sizes.get("tokens")), sizes["context"],
                                   dtype=dtype)
  names = clip_evaluator_names(sizes["layers"])
  return model, cast(from_torch(state, names, CLIP_EVALUATOR_IGNORED), dtype)


def contrast(model, params, tokens, motion, frames):
  """-> text and motion, both as unit vectors, logits (motion rows), loss, cosines of matched pairs."""
  text, motion = jax.jit(lambda params: (model.apply(params, tokens, method="text"),
                                         model.apply(params, motion, frames, method="motion")))(params)
  units = evaluators.unit_vectors(text), evaluators.unit_vectors(motion)
  logits = model.apply(params, method="scale") * units[1] @ units[0].T
  return text, motion, *units, logits, symmetric_cross_entropy(logits), (units[0] * units[1]).sum(-1)


# The references return a batch by falling length; the rows are the same.
@golden("evaluators_259", leave_out=("order", "co/text", "co/motion"))
@golden("evaluators_67", leave_out=("order", "co/text", "co/motion"))
def run_evaluators(fixture, dtype):
  c = fixture.config
  model = evaluators.T2MEvaluator(c["feature_dim"], c["columns"], c["hidden"], c["movement"], c["hidden"],
                                  c["text_hidden"], c["coemb"], dtype=dtype)
  state = part(fixture, ("movement_encoder/", "motion_encoder/", "text_encoder/"))
  params = cast(from_torch(state, t2m_evaluator_names()), dtype)
  words, classes, motion, lengths, frames = fixture.inputs(dtype, "words", "pos", "motions", "cap_lens", "m_lens")
  text, moved = jax.jit(model.apply)(params, words, classes, lengths, motion, frames)
  made = {"plain/text": text, "plain/motion": moved,
          "plain/movements": jax.jit(lambda p, x: model.apply(p, x, method="movements"))(params, motion)}

  state = {name[15:]: array for name, array in part(fixture, "contrast_model/").items()}
  first = state["motion_encoder.embed_motion.weight"].shape[1]
  model, params = clip_evaluator(state, c["clip"], first, motion.shape[-1], dtype)
  tokens = fixture.inputs(dtype, "tokens")
  text, moved, unit_text, unit_moved, logits, loss, cosines = contrast(model, params, tokens, motion, frames)
  return made | {"plain/clip_text": text, "plain/clip_motion": moved, "co/clip_text": unit_text,
                 "co/clip_motion": unit_moved, "logits": logits, "loss": loss, "score": cosines.mean()}


@golden("evaluator", leave_out=("sorted_",), bounds=BY_README)
def run_evaluator(fixture, dtype):
  sizes = fixture.meta["arguments"]
  pose = sizes["dim_pose"]
  model = evaluators.T2MEvaluator(pose, pose, sizes["movement_hidden"], sizes["movement_latent"],
                                  sizes["motion_hidden"], sizes["text_hidden"], sizes["coembedding"], dtype=dtype)
  names = t2m_evaluator_names("movement.", "motion.", "text.")
  params = cast(from_torch(part(fixture, ("movement.", "motion.", "text.")), names), dtype)
  decoder = evaluators.MovementDecoder(pose, sizes["movement_hidden"], dtype=dtype)
  names = {"decoder.main.0": ("conv0", "conv_transpose"), "decoder.main.2": ("conv1", "conv_transpose"),
           "decoder.out_net": ("out", "dense")}
  decoder_params = cast(from_torch(part(fixture, "decoder."), names), dtype)
  words, classes, motion, lengths, frames = fixture.inputs(dtype, "words", "tags", "motion", "sentence", "frames")
  movement = jax.jit(lambda p: model.apply(p, motion, method="movements"))(params)
  text, moved = jax.jit(model.apply)(params, words, classes, lengths, motion, frames)
  return {"movement": movement, "decoded": jax.jit(decoder.apply)(decoder_params, movement), "text": text,
          "motion": moved}


@golden("evaluator_clip", bounds=BY_README)
def run_evaluator_clip(fixture, dtype):
  sizes = fixture.meta["arguments"]
  model, params = clip_evaluator(fixture.params, sizes, sizes["in_dim"], sizes["in_dim"], dtype)
  motion, frames, tokens = fixture.inputs(dtype, "motion", "frames", "tokens")
  text, moved, _, _, logits, loss, cosines = contrast(model, params, tokens, motion, frames)
  return {"motion": moved, "text": text, "logits_per_motion": logits, "loss": loss, "clip_score_sum": cosines.sum()}


@golden("length_estimator", bounds=BY_README)
def run_length_estimator(fixture, dtype):
  model = LengthEstimator(fixture.meta["arguments"]["output_size"], len(fixture.params["output.0.bias"]), dtype=dtype)
  params = cast(from_torch(fixture.params, length_estimator_names()), dtype)
  logits = jax.jit(model.apply)(params, fixture.inputs(dtype, "text"))
  return {"logits": logits, "probabilities": jax.nn.softmax(logits)}


@recordings("cdamd/evaluator", "cdamd/evaluator_clip", "cdamd/length_estimator")
def test_golden(name, precision):
  assert not check(fixtures.path(f"{name}.npz"), [precision]).failures


@pytest.mark.slow
@pytest.mark.parametrize("columns, precision", [(259, "float32"), (67, "float64")])
def test_golden_of_both_networks_together(columns, precision):
  assert not check(fixtures.path(f"cmdm/evaluators_{columns}.npz"), [precision]).failures


@pytest.mark.slow
def test_the_tables_of_words_have_no_gradient():
  """They are CLIP's own, which come frozen."""
  model = evaluators.ClipEvaluator(features=5, columns=5, width=8, depth=1, num_heads=2, mlp_width=8, dim=6,
                                   vocab_size=9, max_words=4)
  tokens, frames = np.array([[7, 1, 8, 0], [7, 8, 0, 0]]), np.array([12, 8])
  motion = np.random.default_rng(0).normal(size=(2, 12, 5)).astype(np.float32)
  params = untrained(jax.eval_shape(model.init, jax.random.key(0), tokens, motion, frames))

  def loss(params, motion):
    text, moved = model.apply(params, tokens, motion, frames)
    return symmetric_cross_entropy(model.apply(params, method="scale") * moved @ text.T)

  grads = jax.jit(jax.grad(loss))(params, motion)["params"]
  still = {name for name, part in grads.items() if not any(np.any(g) for g in jax.tree.leaves(part))}
  assert still == {"tokens", "positions"}


def test_lengths_are_whole_latents():
  logits = 5 * np.random.default_rng(0).normal(size=(500, 50)).astype(np.float32)
  logits[:100, 0] = 50  # the estimator's class 0 is no length
  frames = np.asarray(middle_frames(logits))
  assert (frames % 4 == 0).all() and frames.min() == 4 and frames.max() <= 196
