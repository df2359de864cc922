"""A run that begins with the parameters of another, all of them learning or some held still."""
import chex
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from ml_collections import ConfigDict

from motion_jax import fit, runs
from motion_jax.models import cdamd, cmdm
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.training import checkpoint
from motion_jax.training import loop as train
from motion_jax.training.stage import Stage
from tests.conftest import load_config
from tests.training.test_train import _config, _next_batch, _stage


def tokenizer_config(name, start, size="small", **train):
  """The size that ships, on two procedural clips."""
  config = load_config(name, size).unlock()
  if "teacher" in config.frozen:
    config.frozen.teacher, config.model.teacher_dim = "", 0
  config.data.update(name="synthetic", num_clips=2)
  config.train.update(start=start, **train)
  return fit.resolve(config)[0]


@pytest.mark.parametrize("name, size, model", [
    ("cmdm_tokenizer", "small", "cmdm-small"), ("cdamd_autoencoder", "steps_small", "cdamd-small")])
def test_a_tokenizer_begins_as_that_inside_a_model_that_ships(name, size, model):
  """With its parameters; a part that is held still also keeps the statistics that it knows."""
  config = tokenizer_config(name, model, size, freeze=("encoder",))
  net = (CausalVAE if name.startswith("cmdm") else Autoencoder)(**config.model)
  shapes = (cmdm.frozen_shapes(net)["tokenizer"] if name.startswith("cmdm") else cdamd.autoencoder_shapes(net))
  zeros = lambda *_: jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), shapes)
  stage = fit.setups()[config.stage](config)
  begun = fit._started_from(stage.stage._replace(init=zeros), config)
  run = runs.load_run(model)
  chex.assert_trees_all_equal(begun.init(None, None), run.frozen({"tokenizer": shapes})["tokenizer"])
  np.testing.assert_array_equal(stage.stats.mean, run.stats.mean)


@pytest.mark.parametrize("name, size, model, changes, refused, other, stages", [
    ("cmdm_denoiser", "small", "cmdm-small", {}, "the tokenizer in cmdm-small has .*width 192.* config.tokenizer says",
     "cdamd-small", "holds a 'cdamd.generator' run, expected one of stage cmdm.tokenizer or cmdm.d"),
    pytest.param("cdamd_generator", "steps_small", "cdamd-small", {
        "frozen.prior": "", "frozen.length": "cdamd-small", "loss.prior_levels": 0, "data.lengths": (196,)},
        "the autoencoder in cdamd-small has .*width 192.*this config says .*width 8", "cmdm-small",
        "holds a 'cmdm.denoiser' run, expected one of stage cdamd.autoencoder or cd", marks=pytest.mark.slow)])
def test_a_generator_goes_on_from_a_model_that_ships(name, size, model, changes, refused, other, stages, tmp_path):
  """On its tokenizer, with the scale of latents that it knows, its length estimator, its statistics, its words and its
  parameters; a tokenizer of other sizes than the config says is refused, and a model of another method."""
  config = load_config(name, size).unlock()
  config.update_from_flattened_dict({"frozen.tokenizer": model, "frozen.text": model, "data.name": "synthetic",
                                     "data.num_clips": 4, "data.mirror": False, "train.start": model} | changes)
  config = fit.resolve(config)[0]
  set_up = fit.setups()[config.stage]
  run, setup = runs.load_run(model), set_up(config)
  for part, params in run.frozen().items():
    chex.assert_trees_all_equal(params, setup.frozen[part])
  np.testing.assert_array_equal(setup.stats.std, run.stats.std)
  assert "text_encoder/model.safetensors" in setup.files
  if name == "cdamd_generator":
    assert config.length.to_dict() == run.config.length.to_dict()
    assert set(setup.frozen) == {"tokenizer", "latent_mean", "latent_std", "length"}
    shapes = jax.eval_shape(setup.stage.init, setup.next_batch(0), jax.random.key(0))
    begun = fit._started_from(setup.stage._replace(init=lambda *_: shapes), config).init(None, None)
    chex.assert_trees_all_equal(begun, run.params())
    config.loss.unit_latents = False
    with pytest.raises(ValueError, match="own scale .loss.unit_latents = True., config.loss.unit_latents is False"):
      set_up(config)
    checkpoint.save_config(tmp_path, ConfigDict(run.config.to_dict() | {"length": {}}))
    config.frozen.length = str(tmp_path)
    with pytest.raises(ValueError, match="has no length estimator; train one with --config cdamd_length"):
      fit.resolve(config)
    config.frozen.length = model
  config.tokenizer.width = 8
  with pytest.raises(ValueError, match=refused):
    set_up(config)
  config.frozen.tokenizer = other
  with pytest.raises(ValueError, match=stages):
    set_up(config)


def test_what_cannot_be_held_still_is_told(tmp_path):
  with pytest.raises(ValueError, match="got train.freeze .'encoder',. without train.start"):
    fit.run(tokenizer_config("cmdm_tokenizer", "", freeze=("encoder",)), tmp_path)
  config = tokenizer_config("cmdm_tokenizer", "cmdm-small", freeze=("encodr",))
  with pytest.raises(ValueError, match="got train.freeze 'encodr', but train.start cmdm-small has no .* decoder, enc"):
    fit._started_from(None, config)


def test_a_new_decoder_goes_to_the_generator_of_its_latents(tmp_path):
  """All else of the generator's folder stays; another encoder is refused."""
  run = runs.load_run("cmdm-small")
  params = run.frozen()["tokenizer"]
  params["params"]["decoder"] = jax.tree.map(lambda leaf: leaf + 1, params["params"]["decoder"])
  config = tokenizer_config("cmdm_tokenizer", "cmdm-small", freeze=("encoder",))
  folder = tmp_path / "decoder"
  folder.mkdir()
  checkpoint.save_config(folder, config)
  checkpoint.save_params(folder, params)
  runs.exchange_decoder("cmdm-small", folder, tmp_path / "new")
  made = runs.load_run(tmp_path / "new")
  chex.assert_trees_all_equal(made.frozen(), {**run.frozen(), "tokenizer": params})
  chex.assert_trees_all_equal(made.params(), run.params())
  with pytest.raises(ValueError, match="is there already"):
    runs.exchange_decoder("cmdm-small", folder, tmp_path / "new")
  params["params"]["encoder"]["head"]["bias"] += 1
  checkpoint.save_params(folder, params)
  with pytest.raises(ValueError, match="the encoder in .* differs from that in cmdm-small"):
    runs.exchange_decoder("cmdm-small", folder, tmp_path / "other")


@pytest.mark.slow
def test_what_is_frozen_stays_to_the_bit(tmp_path):
  """Beside parameters that learn, with weight decay and an average; its gradient is 0 and takes no part in the norm."""
  line = _stage()
  stage = Stage(lambda batch, rng: {"held": {"w": jnp.ones(3)}, "free": line.init(batch, rng)},
                lambda params, *rest: line.loss({"w": params["free"]["w"] * params["held"]["w"]}, *rest), None)
  config = _config(4, weight_decay=0.1)
  before = stage.init(_next_batch(0), jax.random.fold_in(jax.random.key(config.seed), 2**31 - 1))
  config.train.freeze = ("held",)
  state = train.train(config, tmp_path / "frozen", stage, _next_batch)
  for tree in (state.params, state.ema_params):
    np.testing.assert_array_equal(tree["held"]["w"], np.ones(3))
    assert (np.abs(tree["free"]["w"] - before["free"]["w"]) > 1e-3).any()
  alone = train.train(_config(4, weight_decay=0.1), tmp_path / "alone", line._replace(
      init=lambda batch, rng: before["free"]), _next_batch)
  np.testing.assert_array_equal(state.params["free"]["w"], alone.params["w"])
