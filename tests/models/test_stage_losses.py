"""What a training step draws and weighs: dropped captions, times of blocks, ramps. Values, not only that it runs."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import fit, latents, runs
from motion_jax.models import cdamd, cmdm
from motion_jax.models.mld import stages as mld
from motion_jax.models.motionstreamer import stages as streamer
from motion_jax.training.setup import untrained
from tests.conftest import light_setups, load_config, some_of

pytestmark = pytest.mark.usefixtures("kept_features")

BATCH, FRAMES, WORDS = 64, 24, 3
FROZEN = {"tokenizer": {}, "latent_mean": 0.0, "latent_std": 1.0, "prior": {}}


def batch_of(features, text_dim=5):
  rng = np.random.default_rng(0)
  normal = lambda *shape: jnp.asarray(rng.normal(size=shape), jnp.float32)
  return {"features": normal(BATCH, FRAMES, features), "num_frames": jnp.full(BATCH, FRAMES),
          "text_emb": normal(BATCH, WORDS, text_dim), "text_mask": jnp.ones((BATCH, WORDS), bool),
          "index": jnp.arange(BATCH)}


def tiny(name, **loss):
  config = load_config(name, "tiny").unlock()
  config.loss.update(loss)
  return config


def latents_are_columns(monkeypatch, count):
  """The tokenizer gives the first columns of every fourth frame, and nothing is drawn."""
  monkeypatch.setattr(latents.VaeCodec, "distribution", lambda self, x: x[:, ::4, :count])
  monkeypatch.setattr(latents.VaeCodec, "drawn", lambda self, known, keys=None: known)


def text_of_the_denoiser(monkeypatch, rate):
  """words(rng) -> text_emb that the denoiser's loss shows its network, whose place this function takes."""
  config = tiny("cmdm_denoiser", drop_rate=rate)
  stage, batch = cmdm.denoiser_stage(config), batch_of(config.tokenizer.features)
  seen = []

  def apply(self, params, x, t, text_emb, attn_mask, text_mask, control, left):
    assert control is None and left is None
    seen.append(text_emb)
    return jnp.zeros_like(x)

  monkeypatch.setattr(cmdm.stages.CausalDiT, "apply", apply)
  latents_are_columns(monkeypatch, config.model.latent_dim)

  return jax.jit(lambda rng: (stage.loss({}, FROZEN, batch, 0, rng), seen[-1])[1]), np.asarray(batch["text_emb"])


def text_of_the_generator(monkeypatch, rate):
  config = tiny("cdamd_generator", drop_rate=rate, prior_levels=0, copies=1)
  stage, batch = cdamd.generator_stage(config), batch_of(config.tokenizer.features)
  for name in ("text_emb", "text_mask"):
    batch[name] = batch[name][:, :1]  # a caption in one vector, which is all the condition that there is here
  seen = []

  def apply(self, params, x=None, text=None, *rest, method=None, **_):
    if method == "mask_token":
      return jnp.zeros((1, 1, config.model.transformer.latent_dim))
    if method == "condition":
      return jnp.broadcast_to(text, (*x.shape[:2], text.shape[-1]))
    seen.append(rest[0][:, :1])  # x, t, condition (B, L, E), one for all copies
    return jnp.zeros_like(x)

  monkeypatch.setattr(cdamd.stages.Generator, "apply", apply)
  monkeypatch.setattr(latents.AutoencoderCodec, "encode", lambda self, x, mask: x[:, ::4, :4])

  params = {"params": {"head": {}}}
  return jax.jit(lambda rng: (stage.loss(params, FROZEN, batch, 0, rng), seen[-1])[1]), np.asarray(batch["text_emb"])


@pytest.mark.parametrize("words_of", [text_of_the_denoiser, text_of_the_generator])
def test_captions_are_dropped_as_often_as_the_config_says(words_of, monkeypatch):
  """A dropped caption is zeros, another as it came; who loses it is another draw for every item and every step."""
  words, given = words_of(monkeypatch, 0.25)
  drawn = []
  for step in range(12):
    shown = np.asarray(words(jax.random.key(step)))
    drawn.append((shown == 0).all((1, 2)))
    np.testing.assert_array_equal(shown, np.where(drawn[-1][:, None, None], 0, given))
  share, deviation = np.mean(drawn), np.sqrt(0.25 * 0.75 / np.size(drawn))
  assert abs(share - 0.25) < 4 * deviation
  # Neither a whole batch at once nor the same ones every time.
  assert np.ptp(np.mean(drawn, 1)) < 0.4 and np.mean(drawn, 0).max() < 1 and np.any(drawn, 0).mean() > 0.8


def test_padding_is_no_key_of_the_denoiser(monkeypatch):
  """The mask that the loss shows its network: block-causal, less the latents behind a motion's end."""
  config = tiny("cmdm_denoiser")
  stage, batch = cmdm.denoiser_stage(config), batch_of(config.tokenizer.features)
  batch["num_frames"] = jnp.asarray([24, 16, 8, 12] * (BATCH // 4))
  seen = []
  monkeypatch.setattr(cmdm.stages.CausalDiT, "apply",
                      lambda self, params, x, t, text, mask, words, control, left: seen.append(mask) or x)
  latents_are_columns(monkeypatch, 4)
  stage.loss({}, FROZEN, batch, 0, jax.random.key(0))
  place = np.arange(6)
  causal = place[None] // 3 <= place[:, None] // 3
  assert seen[-1].shape == (BATCH, 1, 6, 6)  # a mask that all shared would hide no clip's padding
  for mask, frames in zip(np.asarray(seen[-1])[:4, 0], (24, 16, 8, 12)):
    np.testing.assert_array_equal(mask, causal & (place < frames // 4))


def test_latents_are_scaled_by_the_runs_own_statistics(monkeypatch):
  """A draw of the encoder, less latent_mean, over latent_std: (2 - 0.5) / 0.25 where the variance is e^-30."""
  gaussian = jnp.full((2, 3, 4), 2.0), jnp.full((2, 3, 4), -30.0)
  monkeypatch.setattr(cmdm.stages.CausalVAE, "apply", lambda *_, method: gaussian)
  frozen = {"tokenizer": {}, "latent_mean": jnp.full(4, 0.5), "latent_std": jnp.full(4, 0.25)}
  codec = latents.VaeCodec.of(cmdm.stages.CausalVAE(), frozen)
  made = codec.sample(None, jax.random.split(jax.random.key(0), 2))
  np.testing.assert_allclose(made, 6.0, atol=1e-3)


def test_the_prior_is_dropped_as_often_as_the_config_says(monkeypatch):
  rate = 0.7
  config = tiny("cdamd_generator", prior_levels=1, prior_drop="item", prior_drop_rate=rate, copies=1)
  stage, batch, seen = cdamd.generator_stage(config), batch_of(config.tokenizer.features), []

  def apply(self, params, x=None, text=None, mask=None, codes=None, prior_mask=None, *rest, method=None, **_):
    if method == "mask_token":
      return jnp.zeros((1, 1, 4))
    if method == "condition":
      return jnp.zeros((*x.shape[:2], 1)) + prior_mask[:, None, None]
    seen.append(mask[:, 0, 0])  # x, t, condition (B, L, E): whether an item kept its codes
    return jnp.zeros_like(x)

  monkeypatch.setattr(cdamd.stages.Generator, "apply", apply)
  monkeypatch.setattr(latents.AutoencoderCodec, "encode", lambda self, x, mask: x[:, ::4, :4])
  monkeypatch.setattr(cdamd.stages, "prior_codes", lambda *_: jnp.zeros((BATCH, 6), int))
  params = {"params": {"head": {}}}
  keep = jax.jit(lambda rng: (stage.loss(params, FROZEN, batch, 0, rng), seen[-1])[1])
  share = np.mean([np.asarray(keep(jax.random.key(step))) for step in range(8)])
  assert abs(share - (1 - rate)) <= 4 * np.sqrt(rate * (1 - rate) / (8 * BATCH))


@pytest.mark.parametrize("level_block, blocks", [(None, [0, 0, 0, 1, 1, 1]), (2, [0, 0, 1, 1, 2, 2]),
                                                 (0, [0] * 6)])
def test_latents_of_a_level_block_share_their_time(level_block, blocks, monkeypatch):
  """Of one motion all blocks differ, and all motions differ; in a config that is older than the field it is the
  network's own block of 3."""
  config = tiny("cmdm_denoiser")
  del config.loss["level_block"]
  if level_block is not None:
    config.loss.level_block = level_block
  config = runs.with_defaults(config)
  stage, batch = cmdm.denoiser_stage(config), batch_of(config.tokenizer.features)
  latents_are_columns(monkeypatch, 4)
  # The network is told one time for neighbours where it can be, and spreads it.
  monkeypatch.setattr(cmdm.stages.CausalDiT, "apply",
                      lambda self, params, x, t, *rest: jnp.repeat(t, 6 // t.shape[1], axis=1))
  seen = lambda velocity, x1, latent_mask, t, *_: ({"loss": 0.0, "t": t, "told": velocity(x1, t)}, 1.0)
  monkeypatch.setattr(cmdm.stages.paths, "forcing_loss", seen)
  sums, _ = stage.loss({}, FROZEN, batch, 0, jax.random.key(0))
  np.testing.assert_array_equal(sums["told"], sums["t"])
  t = np.asarray(sums["t"])
  np.testing.assert_array_equal(t, t[:, [blocks.index(block) for block in blocks]])
  assert len(np.unique(t)) == BATCH * len(set(blocks))


def tokenizer_weights(monkeypatch, num_steps=0, **loss):
  """-> weights(step): those that the tokenizer's loss gives KL, root and alignment, beside its one micro-batch."""
  config = tiny("cmdm_tokenizer", micro_batch=4, **loss)
  config.train.num_steps = num_steps
  stage, batch = cmdm.tokenizer_stage(config), {"features": jnp.zeros((4, 8, 263)), "index": jnp.arange(4)}

  def terms(vae, params, x, noise, kl_weight, root_weight, root_columns, teacher, align_weight, adaptive, **choices):
    return {"loss": 0.0, "kl": kl_weight, "root": root_weight, "align": align_weight, "adaptive": adaptive}

  monkeypatch.setattr(cmdm.stages, "tokenizer_terms", terms)
  monkeypatch.setattr(cmdm.stages, "frame_features", lambda teacher, params, x: x)
  return lambda step: stage.loss({}, {"teacher": {}}, batch, jnp.asarray(step), jax.random.key(0))[0]


@pytest.mark.parametrize("kl_ramp, shares", [(100, {0: 0, 25: 0.25, 99: 0.99, 100: 1, 5000: 1}), (0, {0: 1, 9: 1})])
def test_the_kl_term_comes_in_along_its_ramp(kl_ramp, shares, monkeypatch):
  weights = tokenizer_weights(monkeypatch, kl_weight=0.7, kl_ramp=kl_ramp, root_weight=0.3)
  for step, share in shares.items():
    found = weights(step)
    assert float(found["kl"]) == pytest.approx(0.7 * share, rel=1e-6) and found["root"] == 0.3


def test_alignment_falls_to_a_tenth_after_the_ramp(monkeypatch):
  """Whole while the KL term comes in, then linearly, at the end a tenth; never less."""
  weights = tokenizer_weights(monkeypatch, 12_000, align=0.4, kl_ramp=2_000)
  for step, share in ((0, 1), (2_000, 1), (4_500, 0.775), (7_000, 0.55), (12_000, 0.1), (20_000, 0.1)):
    assert float(weights(step)["align"]) == pytest.approx(0.4 * share, rel=1e-6), step
  assert weights(0)["adaptive"] and not tokenizer_weights(monkeypatch, adaptive_align=False)(0)["adaptive"]


@pytest.mark.slow
@pytest.mark.parametrize("ramp, shares", [(40, {0: 0, 20: 0.5, 40: 1, 90: 1}), (0, {0: 0, 100: 0.5, 200: 1})])
def test_latents_of_its_own_take_the_place_of_true_ones_along_the_ramp(ramp, shares, monkeypatch):
  config = tiny("motionstreamer_generator", replace_ramp=ramp, mean_latents=True)
  config.train.num_steps = 200
  stage, batch = streamer.generator_stage(config), batch_of(config.tokenizer.features)
  monkeypatch.setattr(latents.VaeCodec, "encode", lambda self, x: x[:, ::4, :config.model.transformer.latent_dim])
  seen = []
  monkeypatch.setattr(streamer, "two_forward_loss", lambda *given: seen.append(given[-2]))
  frozen = FROZEN | {streamer.END: 0.0, streamer.NO_CAPTION: jnp.zeros((1, 5))}
  for step, share in shares.items():
    stage.loss({}, frozen, batch, step, jax.random.key(step))
    assert np.isclose(float(seen[-1].mean()), share, atol=0.02), step


@pytest.mark.parametrize("crop_rate", [0.0, 1.0])
def test_the_latent_that_ends_a_motion_follows_its_last_and_a_cropped_motion_lacks_one(crop_rate, monkeypatch):
  """Half of the cropped ones lose their first latent, the others the end; behind the end all is 0."""
  config = tiny("motionstreamer_generator", crop_rate=crop_rate, mean_latents=True)
  batch = batch_of(config.tokenizer.features)
  batch["num_frames"] = jnp.asarray([24, 16, 8, 12] * (BATCH // 4))
  monkeypatch.setattr(latents.VaeCodec, "encode", lambda self, x: x[:, ::4, :config.model.transformer.latent_dim])
  made = streamer.generator_stage(config).predict({}, FROZEN | {streamer.END: 9.0}, batch, jax.random.key(0))
  heads = 0
  for x, frames, z, count in zip(*(np.asarray(a) for a in (batch["features"], batch["num_frames"], *made.values()))):
    whole = np.concatenate([x[:frames:4, :z.shape[-1]], np.full((1, z.shape[-1]), 9.0)])
    heads += (headless := bool(crop_rate) and (z[0] == whole[1]).all())
    wanted = whole[1:] if headless else whole
    assert count == len(whole) - crop_rate
    np.testing.assert_array_equal(z[:len(wanted)], wanted)
    assert not z[len(wanted):].any()
  assert abs(heads - crop_rate * BATCH / 2) < 4 * np.sqrt(BATCH / 4) and bool(heads) == bool(crop_rate)


@pytest.mark.slow
def test_mlds_joints_are_metres(monkeypatch):
  """Of KIT's millimetres, too: a body that is 100 mm too high, in one of three coordinates."""
  config = load_config("mld_vae", "kit_tiny")
  x = np.random.default_rng(0).normal(size=(2, 8, 251)).astype(np.float32)
  higher = x + 100 * np.isin(np.arange(251), range(5, 64, 3)) + 100 * (np.arange(251) == 3)  # of joints, of the root
  gaussian = jnp.zeros((2, 2, 1, 4))
  monkeypatch.setattr(mld.TokenVAE, "apply", lambda *_, **__: (jnp.asarray(higher), *gaussian))
  batch = {"features": x, "num_frames": np.full(2, 8), "index": np.arange(2)}
  sums, weight = mld.vae_stage(config).loss({}, {"stats": {"mean": 0.0, "std": 1.0}}, batch, 0, jax.random.key(0))
  assert weight == 2 and float(sums["joints"]) == pytest.approx(2 * 0.1**2 / 2 / 3, rel=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("name, size", some_of(
    [("mdm_denoiser", "tiny"), ("mdm_denoiser", "dip_tiny"), ("mld_denoiser", "tiny"), ("momask_masked", "tiny"),
     ("t2m_gpt_gpt", "tiny"), ("motionstreamer_generator", "tiny")],
    slow=[("mdm_denoiser", "dip_tiny"), ("mld_denoiser", "tiny"), ("momask_masked", "tiny"),
          ("motionstreamer_generator", "tiny")]))
def test_dropped_captions_padding_and_devices_make_no_difference_to_a_loss(name, size):
  """What lies behind a motion's end counts for nothing where a method masks it, and an item's terms are the same on
  whichever device it lies: those of the halves of a batch add up to those of the batch."""
  config = load_config(name, size).unlock()
  if "drop_rate" in config.loss:
    config.loss.drop_rate = 1.0
  if name == "mdm_denoiser":
    config.loss.mask_frames = True
  config, _ = fit.resolve(config)
  stage, next_batch, frozen, *_ = light_setups()[config.stage](config)
  batch = {part: np.array(array) for part, array in next_batch(0).items()}
  params, frozen = jax.device_put(stage.init(batch, jax.random.key(0))), jax.device_put(frozen)
  losses = jax.jit(lambda batch: stage.loss(params, frozen, batch, 3, jax.random.key(1)))
  loss = lambda **other: float(losses(batch | other)[0]["loss"])
  if "num_frames" in batch:
    batch["num_frames"] = np.minimum(batch["num_frames"], 40)
  whole = loss()
  halves = [losses({part: array[rows] for part, array in batch.items()}) for rows in (slice(2), slice(2, None))]
  assert sum(sums["loss"] for sums, _ in halves) == pytest.approx(whole, rel=1e-5)
  assert sum(weight for _, weight in halves) == pytest.approx(losses(batch)[1])
  assert whole == loss(text_emb=batch["text_emb"] + 1) or name == "t2m_gpt_gpt"
  if name not in ("momask_masked", "t2m_gpt_gpt"):
    x = batch["features"]
    behind = (np.arange(x.shape[1]) >= batch["num_frames"][:, None])[..., None]
    assert loss(features=np.where(behind, np.float32(50), x)) == pytest.approx(whole, rel=1e-6)
    assert loss(features=x + 1) != pytest.approx(whole, rel=1e-5)


def loss_and_params(name, size="tiny", **train):
  """(loss(params), params) of what a config trains, with other fields of its section `train`."""
  config = load_config(name, size).copy_and_resolve_references().unlock()
  config.train.update(train)
  if "teacher" in config.frozen:
    config.frozen.teacher = ""
  config, _ = fit.resolve(config)
  stage, next_batch, frozen, *_ = fit.setups()[config.stage](config)
  batch = next_batch(0)

  def loss(params):
    sums, weight = stage.loss(params, frozen, batch, 3, jax.random.key(1))
    return sums["loss"] / weight

  return loss, untrained(jax.eval_shape(lambda batch: stage.init(batch, jax.random.key(0)), batch))


@functools.cache
def compiled_gradients(name, size, **train):
  """(the gradients' program as text, params, (loss, gradients)) of what a config trains."""
  loss, params = loss_and_params(name, size, **train)
  traced = jax.jit(jax.value_and_grad(loss)).trace(params)
  return str(traced.jaxpr), params, traced.lower().compile()(params)


def norm(tree):
  return np.sqrt(sum(float((leaf ** 2).sum()) for leaf in jax.tree.leaves(tree)))


@pytest.mark.parametrize("name", some_of(
    ["cmdm_denoiser", "cdamd_generator", "cmdm_tokenizer"], slow=["cmdm_denoiser"]))
def test_a_network_computes_in_bfloat16_and_numbers_stay_float32(name):
  """The loss is near that of float32 and another; loss, gradients and parameters are float32."""
  (one, grads), (other, rough) = (compiled_gradients(name, "tiny", **train)[2] for train in ({}, {"dtype": "bfloat16"}))
  assert other.dtype == jnp.float32 and all(leaf.dtype == jnp.float32 for leaf in jax.tree.leaves(rough))
  assert one != other and abs(one - other) < 0.03 * abs(one)
  assert norm(jax.tree.map(jnp.subtract, grads, rough)) < 0.1 * norm(grads)


@pytest.mark.parametrize("name, size", some_of(
    [("cmdm_denoiser", "tiny"), ("cdamd_generator", "tiny"), ("cdamd_generator", "mardm_tiny")],
    slow=[("cmdm_denoiser", "tiny")]))
def test_what_is_computed_once_more_changes_no_loss_no_gradient_and_no_name(name, size):
  """So a run goes on, and its weights open, with train.remat or without; dropout falls on the same numbers."""
  plain, params, (one, grads) = compiled_gradients(name, size)
  again, same_params, (other, others) = compiled_gradients(name, size, remat=True)
  assert ["remat" in jaxpr or "checkpoint" in jaxpr for jaxpr in (plain, again)] == [False, True]
  assert jax.tree.map(jnp.shape, params) == jax.tree.map(jnp.shape, same_params)
  assert abs(one - other) < 1e-6 * abs(one)
  assert norm(jax.tree.map(jnp.subtract, grads, others)) < 1e-5 * norm(grads)
