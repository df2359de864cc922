"""The evaluators are the references', see nothing of padding or of batch-mates, and tell wrong input."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import convert
from motion_jax.metrics import evaluators
from motion_jax.nets.length_estimator import LengthEstimator
from tests import fixtures
from tests.golden import check, golden

BY_README = {"": (1e-5, 1e-10)}  # golden/cdamd names its tolerances in a table


def cast(params, dtype):
  return jax.tree.map(lambda a: jnp.asarray(a, dtype), params)


def given(fixture, dtype, *names):
  arrays = (fixture[f"in/{name}"] for name in names)
  return [jnp.asarray(a, dtype if np.issubdtype(a.dtype, np.floating) else jnp.int32) for a in arrays]


def part(fixture, prefixes):
  """The fixture's state dict less the networks that the prefixes do not name."""
  return {name: array for name, array in fixture.params.items() if name.startswith(prefixes)}


def clip_evaluator(state, sizes, features, columns, dtype):
  model = evaluators.ClipEvaluator(features, columns, sizes["width"], sizes["layers"], sizes["heads"], sizes["ff"],
                                   state["out.bias"].size, sizes.get("vocab", sizes.get("tokens")), sizes["context"],
                                   dtype=dtype)
  names = convert.clip_evaluator_names(sizes["layers"])
  return model, cast(convert.from_torch(state, names, convert.CLIP_EVALUATOR_IGNORED), dtype)


def contrast(model, params, text, motion):
  """-> unit text and motion, logits (motion rows), loss, cosines of matched pairs."""
  text, motion = evaluators.unit(text), evaluators.unit(motion)
  logits = evaluators.pair_logits(text, motion, model.apply(params, method="scale"))
  return text, motion, logits, evaluators.symmetric_cross_entropy(logits), (text * motion).sum(-1)


@golden("evaluators_259")
@golden("evaluators_67")
def run_evaluators(fixture, dtype):
  c = fixture.config
  model = evaluators.T2MEvaluator(c["feature_dim"], c["columns"], c["hidden"], c["movement"], c["hidden"],
                                  c["text_hidden"], c["coemb"], dtype=dtype)
  state = part(fixture, ("movement_encoder/", "motion_encoder/", "text_encoder/"))
  params = cast(convert.from_torch(state, convert.t2m_evaluator_names()), dtype)
  words, classes, motion, lengths, frames = given(fixture, dtype, "words", "pos", "motions", "cap_lens", "m_lens")
  apply = jax.jit(model.apply)
  text, moved = evaluators.co_embeddings(apply, params, words, classes, lengths, motion, frames)
  made = {"co/text": text, "co/motion": moved, "order": evaluators.falling_length(frames)}
  text, moved = evaluators.co_embeddings(apply, params, words, classes, lengths, motion, frames, sort=False)
  made |= {"plain/text": text, "plain/motion": moved,
           "plain/movements": jax.jit(lambda p, x: model.apply(p, x, method="movements"))(params, motion)}

  state = {name[15:]: array for name, array in part(fixture, "contrast_model/").items()}
  first = state["motion_encoder.embed_motion.weight"].shape[1]
  model, params = clip_evaluator(state, c["clip"], first, motion.shape[-1], dtype)
  (tokens,) = given(fixture, dtype, "tokens")
  text, moved = jax.jit(lambda p: (model.apply(p, tokens, method="text"),
                                   model.apply(p, motion, frames, method="motion")))(params)
  made |= {"plain/clip_text": text, "plain/clip_motion": moved}
  text, moved, logits, loss, cosines = contrast(model, params, text, moved)
  return made | {"co/clip_text": text, "co/clip_motion": moved, "logits": logits, "loss": loss, "score": cosines.mean()}


@golden("evaluator", bounds=BY_README)
def run_evaluator(fixture, dtype):
  sizes = fixture.meta["arguments"]
  pose = sizes["dim_pose"]
  model = evaluators.T2MEvaluator(pose, pose, sizes["movement_hidden"], sizes["movement_latent"],
                                  sizes["motion_hidden"], sizes["text_hidden"], sizes["coembedding"], dtype=dtype)
  names = convert.t2m_evaluator_names("movement.", "motion.", "text.")
  params = cast(convert.from_torch(part(fixture, ("movement.", "motion.", "text.")), names), dtype)
  decoder = evaluators.MovementDecoder(pose, sizes["movement_hidden"], dtype=dtype)
  names = convert.movement_decoder_names("decoder.")
  decoder_params = cast(convert.from_torch(part(fixture, "decoder."), names), dtype)
  words, classes, motion, lengths, frames = given(fixture, dtype, "words", "tags", "motion", "sentence", "frames")
  movement = jax.jit(lambda p: model.apply(p, motion, method="movements"))(params)
  made = {"movement": movement, "decoded": jax.jit(decoder.apply)(decoder_params, movement),
          "sorted_order": evaluators.falling_length(frames)}
  for sort, prefix in ((False, ""), (True, "sorted_")):
    text, moved = evaluators.co_embeddings(jax.jit(model.apply), params, words, classes, lengths, motion, frames, sort)
    made |= {f"{prefix}text": text, f"{prefix}motion": moved}
  return made


@golden("evaluator_clip", bounds=BY_README)
def run_evaluator_clip(fixture, dtype):
  sizes = fixture.meta["arguments"]
  model, params = clip_evaluator(fixture.params, sizes, sizes["in_dim"], sizes["in_dim"], dtype)
  motion, frames, tokens = given(fixture, dtype, "motion", "frames", "tokens")
  text, moved = jax.jit(lambda p: (model.apply(p, tokens, method="text"),
                                   model.apply(p, motion, frames, method="motion")))(params)
  _, _, logits, loss, cosines = contrast(model, params, text, moved)
  return {"motion": moved, "text": text, "logits_per_motion": logits, "loss": loss, "clip_score_sum": cosines.sum()}


@golden("length_estimator", bounds=BY_README)
def run_length_estimator(fixture, dtype):
  model = LengthEstimator(fixture.meta["arguments"]["output_size"], len(fixture.params["output.0.bias"]), dtype=dtype)
  params = cast(convert.from_torch(fixture.params, convert.length_estimator_names()), dtype)
  logits = jax.jit(model.apply)(params, *given(fixture, dtype, "text"))
  return {"logits": logits, "probabilities": jax.nn.softmax(logits)}


@pytest.mark.parametrize("name", ["cmdm/evaluators_259", "cmdm/evaluators_67", "cdamd/evaluator",
                                  "cdamd/evaluator_clip", "cdamd/length_estimator"])
def test_golden(name):
  assert not check(fixtures.path(f"{name}.npz")).failures
