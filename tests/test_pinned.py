"""Numbers of our own code that must not move unseen: parameter counts of every config, draws of batches and noise."""
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.data.batches import step_rng
from motion_jax.evaluators import stages as matching
from motion_jax.evaluators.networks import ClipEvaluator, T2MEvaluator
from motion_jax.models import cdamd, cmdm, momask, t2m_gpt
from motion_jax.models.cmdm.streaming import block_noise, make_plan
from motion_jax.models.mdm.stages import denoiser_shapes as mdm_shapes
from motion_jax.models.mld import stages as mld
from motion_jax.models.motionstreamer import stages as motionstreamer
from motion_jax.models.shared import length as lengths
from motion_jax.models.tmr.space import make_teacher, teacher_shapes
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.nets.latent_diffusion import TokenDenoiser, TokenVAE
from motion_jax.nets.length_estimator import LengthEstimator
from motion_jax.nets.motion_denoiser import MotionDenoiser
from motion_jax.nets.token_gpt import CodeGPT
from motion_jax.nets.token_transformers import MaskedCodeTransformer, ResidualCodeTransformer
from motion_jax.text.bert import bert_fields
from motion_jax.utils import config_files
from tests import fixtures
from tests.conftest import load_config, some_of
from tools import pin_motions

COUNTS = {tuple(line.split()[:2]): int(line.split()[2]) for line in fixtures.path("parameter_counts.txt").read_text(
    ).splitlines() if line and not line.startswith("#")}


def _autoencoder(config, size):
  """Of codebooks the codes alone."""
  shapes = cdamd.autoencoder_shapes(Autoencoder(**config.model), config.get("quantizer"))
  return shapes["params"], shapes.get("codebooks", {"codes": ()})["codes"]


def _teacher(config, size):
  """Less its text transformer, whose size is frozen.text's."""
  words = bert_fields(dict(model_type="distilbert", vocab_size=4, dim=768, n_layers=0, n_heads=1, hidden_dim=4))
  return teacher_shapes(make_teacher(config.model, config.data.layout), words, config.data.layout)["motion"]


def _gaussian(config, size):
  """With the decoder that trains it."""
  return jax.eval_shape(lambda: matching.init_gaussian(config.model, 128 if size == "small" else 768,
                                                       jax.random.key(0)))


SHAPES = {  # of (config, size), by stage; small ones take words of MiniLM, the others those of CLIP or GloVe
    "tmr.teacher": _teacher, "evaluator.snapmogen": _gaussian,
    **dict.fromkeys(("cdamd.autoencoder", "cdamd.rvq", "momask.rvq", "t2m_gpt.vq"), _autoencoder),
    "cdamd.generator": lambda config, _: cdamd.generator_shapes(cdamd.make_generator(config.model)),
    "momask.masked": lambda config, _: momask.masked_shapes(MaskedCodeTransformer(**config.model)),
    "momask.residual": lambda config, _: momask.residual_shapes(ResidualCodeTransformer(**config.model)),
    "t2m_gpt.gpt": lambda config, _: t2m_gpt.gpt_shapes(CodeGPT(**config.model)),
    **dict.fromkeys(("cdamd.length", "momask.length"), lambda config, size: lengths.length_shapes(
        LengthEstimator(**config.model), 384 if size == "small" else 512)),
    "evaluator.movement": lambda config, _: jax.eval_shape(
        lambda: matching.init_movement(config.model, jax.random.key(0))),
    "evaluator.matching": lambda config, size: matching.t2m_shapes(
        T2MEvaluator(**config.model), 384 if size == "small" else 300),
    "evaluator.clip": lambda config, _: matching.clip_shapes(ClipEvaluator(**config.model)),
    **dict.fromkeys(("mdm.denoiser", "mdm.dip"), lambda config, _: mdm_shapes(MotionDenoiser(**config.model))),
    "mld.vae": lambda config, _: mld.vae_shapes(TokenVAE(**config.model)),
    **dict.fromkeys(("mld.denoiser", "mld.frames"), lambda config, _: mld.denoiser_shapes(
        TokenDenoiser(**config.model), 1)),
    "motionstreamer.tokenizer": lambda config, _: motionstreamer.tokenizer_shapes(CausalVAE(**config.model)),
    "motionstreamer.generator": lambda config, _: motionstreamer.generator_shapes(
        motionstreamer.make_generator(config.model)),
    "cmdm.tokenizer": lambda config, _: cmdm.frozen_shapes(CausalVAE(**config.model))["tokenizer"]}


def _count(name, size):
  config = load_config(name, size)
  shapes = SHAPES.get(config.stage, lambda config, _: cmdm.denoiser_shapes(CausalDiT(**config.model)))
  return sum(x.size for x in jax.tree.leaves(shapes(config, size)))


NAMES = sorted({name for name, _ in COUNTS})


@pytest.mark.parametrize("name", some_of(NAMES, quick=[
    "cdamd_autoencoder", "cdamd_generator", "cmdm_denoiser", "cmdm_tokenizer", "part_tmr"]))
def test_parameters_of_the_full_size(name):
  """Networks of further methods have recordings of the authors' code as well."""
  assert _count(name, "full") == COUNTS[name, "full"]


@pytest.mark.parametrize("name", some_of([name for name in NAMES if sum(name == one for one, _ in COUNTS) > 1],
                                         slow=["cdamd_generator"]))
def test_parameters_of_other_sizes(name):
  wanted = {size: count for (one, size), count in COUNTS.items() if one == name and size != "full"}
  assert {size: _count(name, size) for size in wanted} == wanted


def test_no_config_is_missing():
  assert {name for name in config_files.names() if "/" not in name} == {name for name, _ in COUNTS}


def test_draws_are_those_of_the_first_release():
  """A resumed run of an older version must meet the same data."""
  assert step_rng(5427, 1, 7).integers(1000, size=4).tolist() == DRAWS


def test_noise_is_that_of_the_first_release():
  """A seed of an older version must give the same motion."""
  noise = block_noise(jax.random.key(3)[None], jnp.asarray(2), make_plan(50, 2, 3, 48), 2)
  assert np.allclose(noise[0].ravel(), NOISE, atol=1e-6)


DRAWS = [927, 247, 17, 289]
NOISE = [-0.587781, -2.455146, 1.394334, 0.530269, 1.238652, -1.130595]


@pytest.mark.parametrize("name", some_of(pin_motions.REDUCED, slow=[
    "cmdm-small/generate/a person walks forward, then sits down", "cdamd-small/generate/a person punches"]))
def test_motions_of_the_shipped_models(name):
  """One pass, pipeline, stream, several prompts, continued, edited, constrained; `tools/pin_motions.py reduce` made the
  recording. Within a millimetre, as processors round differently; on one machine that tool compares to the bit.

  Guidance by constraints amplifies rounding: with the compiler flags of the tests it is 3 cm.
  """
  model, make = next((model, make) for job, model, make in pin_motions.motions(name) if job == name)
  with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    joints = make(model)
  np.testing.assert_allclose(joints[::10], np.load(pin_motions.FIXTURE)[name],
                             atol=0.05 if name.endswith("/control") else 1e-3)


def test_the_recording_is_of_the_motions_that_the_tool_lists():
  assert set(np.load(pin_motions.FIXTURE).files) == set(pin_motions.REDUCED)
