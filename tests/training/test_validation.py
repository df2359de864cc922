"""Weights of the tokenizer are chosen by what an evaluator sees of held-out motions, there and back."""
import jax
import numpy as np
import pytest

from motion_jax.data import sources
from motion_jax.data.batches import step_rng
from motion_jax.evaluators.validation import reconstruction_fid, with_fid
from motion_jax.models.cmdm import setup as cmdm
from motion_jax.training.setup import untrained
from tests.conftest import load_config

pytestmark = pytest.mark.usefixtures("kept_features")


@pytest.fixture(scope="module")
def config():
  config = load_config("cmdm_tokenizer", "tiny").unlock()
  config.frozen.update(teacher="", evaluator="evaluator-small")
  config.model.update(teacher_dim=0)
  return config


@pytest.mark.slow
def test_fid_is_none_for_what_comes_back_and_grows_with_the_error(config):
  data = sources.load_features(config.data, captioned=False)
  fid = reconstruction_fid("evaluator-small", data.features[:6], data.stats)
  asked = []
  assert fid(lambda x, i: asked.append((x.shape, i)) or x) == pytest.approx(0, abs=1e-4)
  assert asked == [((1, 192, 263), i) for i in range(6)]
  noise = step_rng(0, 1, 2).standard_normal((1, 192, 263)).astype(np.float32)
  little, much = (fid(lambda x, i, size=size: x + size * noise) for size in (0.1, 1.0))
  assert 1e-4 < little < much
  with pytest.raises(ValueError, match="got 1 held-out clips to compare with 'evaluator-small'"):
    reconstruction_fid("evaluator-small", data.features[:1], data.stats)


@pytest.mark.slow
def test_fid_joins_the_validation_of_a_tokenizer_that_names_an_evaluator(config):
  plain = cmdm.tokenizer(config)
  setup = with_fid(plain, config)
  params = untrained(jax.eval_shape(setup.stage.init, setup.next_batch(0), jax.random.key(0)))
  found = setup.evaluate(params)
  assert set(found) == {"held_out_mm", "held_out_fid"} and found["held_out_fid"] > 0
  assert setup.evaluate(params) == found  # the same draws at every save
  assert set(plain.evaluate(params)) == {"held_out_mm"}
  config.frozen.evaluator = ""
  assert with_fid(plain, config) is plain


@pytest.mark.slow
def test_the_denoiser_has_a_loss_on_held_out_clips_that_only_the_parameters_change():
  setup = cmdm.denoiser(load_config("cmdm_denoiser", "tiny"))
  params = untrained(jax.eval_shape(setup.stage.init, setup.next_batch(0), jax.random.key(0)))
  found = setup.evaluate(params)
  assert set(found) == {"held_out_loss"} and found["held_out_loss"] > 0
  setup.next_batch(7)
  assert setup.evaluate(params) == found
  assert setup.evaluate(jax.tree.map(lambda a: 1.5 * a, params)) != found


def test_a_split_without_a_long_clip_is_no_error(capsys):
  config = load_config("cmdm_denoiser", "tiny").unlock()
  data = sources.load_features(config.data)
  short = data.features[0][:10]
  with pytest.MonkeyPatch.context() as patch:
    patch.setattr(cmdm, "held_out", lambda *_, **__: cmdm.batches.CaptionedClips([short], [["a person walks"]]))
    assert cmdm.denoiser(config).evaluate is None
  assert "note: no loss on held-out clips: none of 1 clips has 40 to" in capsys.readouterr().out
