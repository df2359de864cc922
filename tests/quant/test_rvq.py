"""The residual quantizer is the reference's, in use and in training, and its codebooks are a checkpoint's."""
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.latents import RvqCodec
from motion_jax.models import cdamd
from motion_jax.models.shared.autoencoder_weights import autoencoder_names, rvq_from_torch
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.quant import rvq, vq
from motion_jax.training import checkpoint
from motion_jax.training import loop as train
from motion_jax.training.metrics import read_metrics
from motion_jax.training.setup import untrained
from tests import fixtures, processes
from tests.conftest import devices_env, load_config
from tests.golden import check, golden, recordings
from tests.nets.test_autoencoder import module


@golden("rvq_eval", bounds={"": (1e-5, 1e-10)})
def run_rvq_eval(fixture, dtype):
  sizes = fixture.meta["arguments"]
  net, num_levels = module(sizes, dtype), sizes["args"]["num_quantizers"]
  variables = rvq_from_torch(fixture.params, num_levels, net.num_halvings, len(net.dilations))
  variables = jax.tree.map(lambda a: jnp.asarray(a, dtype), variables)
  x = jnp.asarray(fixture["in/motion"], dtype)

  @jax.jit
  def run(x):
    latents = net.apply(variables, x, method="encode")
    codec = RvqCodec(net, variables)
    indices, codes = codec.encode(x)
    y = codec.decode(indices)
    residuals = latents - jnp.concatenate([jnp.zeros_like(codes[:1]), jnp.cumsum(codes, axis=0)[:-1]])
    used = [vq.perplexity(vq.usage_counts(level, sizes["nb_code"], float)[1]) for level in indices.reshape(
        -1, indices.shape[-1]).T]
    terms = cdamd.rvq_terms(y, x[:, :y.shape[1]], ((residuals - codes) ** 2).mean())
    turned = lambda a: a.swapaxes(-1, -2)
    return {"encoder": turned(latents), "index": indices, "codes": turned(codes), "sum": turned(codes.sum(0)),
            "decoded": y, "forward": y, "decoded_two_levels": codec.decode(indices, 2),
            "loss": jnp.stack([terms[k] for k in ("loss", "rec", "velocity", "positions", "commitment")]),
            "perplexity": jnp.stack(used).mean()}

  return run(x)


def recorded_noise(step, state, num_rows, dtype):
  """Noise as our functions take it, from the draws in the order in which the reference made them."""
  levels, num_codes, dim = state.codes.shape
  draws = [jnp.asarray(step[f"gumbel{q}"], dtype) if f"gumbel{q}" in step else jnp.zeros((num_rows, num_codes), dtype)
           for q in range(levels)]
  start, replace = np.zeros((2, levels, num_codes, dim), dtype)
  tiles = iter(sorted((name for name in step if name.startswith("tile")), key=lambda name: int(name[4:])))
  for q in range(int(step.get("dropout_start", levels - 1)) + 1 if num_rows < num_codes else 0):
    if not state.initialised[q]:
      start[q] = step[next(tiles)][:num_codes]
    replace[q] = step[next(tiles)][:num_codes]
  return rvq.Noise(jnp.stack(draws), jnp.asarray(start), jnp.asarray(replace))


@golden("rvq_train", bounds={"": (2e-5, 1e-10)})
@golden("rvq_train_small", bounds={"": (2e-5, 1e-10)})
def run_rvq_train(fixture, dtype):
  sizes = fixture.meta["arguments"]
  num_steps = len({name.split("/")[1] for name in fixture.arrays if name.startswith("in/step")})
  steps = [fixture.under(f"in/step{i}/") for i in range(num_steps)]
  net = module(dict(input_width=steps[0]["target"].shape[-1], output_emb_width=sizes["code_dim"],
                    width=sizes["decoder_width"]), dtype)
  names = {theirs: ours for theirs, ours in autoencoder_names().items() if theirs.startswith("decoder")}
  params = jax.tree.map(lambda a: jnp.asarray(a, dtype), from_torch(fixture.params, names))
  state = vq.empty_codebook(sizes["nb_code"], sizes["code_dim"], (sizes["levels"],), dtype)
  made = {}

  @jax.jit
  def run(state, x, target, num_active, noise):
    quantize = lambda x: rvq.train(state, x, num_active, noise, decay=sizes["mu"])
    decoded = lambda q: cdamd.smooth_l1(net.apply(params, q, method="decode"), target)
    result, after = quantize(x)
    grads = (jax.grad(lambda x: decoded(quantize(x)[0].quantized))(x), jax.grad(decoded)(result.quantized),
             jax.grad(lambda x: quantize(x)[0].commitment)(x))
    return result, after, decoded(result.quantized), grads

  for i, step in enumerate(steps):
    x, target = jnp.asarray(step["x"], dtype).swapaxes(1, 2), jnp.asarray(step["target"], dtype)
    num_active = int(step.get("dropout_start", sizes["levels"] - 1)) + 1
    assert (step["dropout_u"] < sizes["quantize_dropout_prob"]) == ("dropout_start" in step)
    noise = recorded_noise(step, state, x.shape[0] * x.shape[1], dtype)
    result, state, loss, grads = run(state, x, target, jnp.asarray(num_active), noise)
    out = {"quantized": result.quantized.swapaxes(1, 2), "index": result.indices, "commit": result.commitment,
           "perplexity": result.perplexity, "loss": loss, "active_levels": num_active,
           "dead": vq.num_dead(state)[state.initialised]}
    out |= {name: g.swapaxes(1, 2) for name, g in zip(("grad_encoder", "grad_quantized", "grad_commit"), grads)}
    for q in range(sizes["levels"]):
      out |= {f"level{q}/codebook": state.codes[q], f"level{q}/code_sum": state.sums[q],
              f"level{q}/code_count": state.counts[q]}
    made |= {f"step{i}/{name}": value for name, value in out.items()}
  return made


@pytest.mark.slow
@recordings("rvq_eval", "rvq_train", "rvq_train_small")
def test_golden(name, precision):
  assert not check(fixtures.path(f"cdamd/{name}.npz"), [precision]).failures


@pytest.mark.parametrize("once", [False, True])
def test_gradient_comes_once_per_active_level_or_once(once):
  """All levels but the last; what a level gets without noise and at temperature 0 is the nearest code."""
  draw = np.random.default_rng(0)
  x, codes = draw.normal(size=(2, 3, 4)).astype(np.float32), draw.normal(size=(3, 5, 4)).astype(np.float32)
  books, noise = vq.codebook_of(codes), rvq.Noise(np.zeros((3, 6, 5)), *np.zeros((2, 3, 5, 4)))

  def total(x):
    made, after = rvq.train(books, x, 2, noise, temperature=0.0, gain_once=once)
    return made.quantized.sum(), (made, after)

  (_, (made, after)), slope = jax.jit(jax.value_and_grad(total, has_aux=True))(x)
  assert np.allclose(slope, 1 if once else 2)
  first = ((x[:, :, None] - codes[0]) ** 2).sum(-1).argmin(-1)
  np.testing.assert_array_equal(made.indices[..., 0], first)
  np.testing.assert_allclose(made.quantized, codes[0][first] + codes[1][made.indices[..., 1]], atol=1e-6)
  np.testing.assert_array_equal(after.codes[2], codes[2])  # left out: it neither quantizes nor learns
  assert (made.indices[..., 2] == -1).all() and not np.allclose(after.codes[:2], codes[:2])


def test_decoding_adds_up_the_codes_that_are_named():
  codes = np.random.default_rng(0).normal(size=(3, 16, 4)).astype(np.float32)
  indices = np.array([[[3, 5, 15], [0, -1, 2]]])
  expected = [codes[0, 3] + codes[1, 5] + codes[2, 15], codes[0, 0] + codes[2, 2]]  # -1 names nothing
  np.testing.assert_allclose(rvq.decode(codes, indices)[0], expected, atol=1e-6)
  with pytest.raises(ValueError, match="num_levels = 4"):
    rvq.decode(codes, indices, 4)


def test_quantize_dropout_keeps_at_least_one_level_and_all_if_it_is_off():
  draw = jax.jit(lambda keys, rate: jax.vmap(lambda key: rvq.draw_active(key, 4, rate))(keys), static_argnums=1)
  keys = jax.random.split(jax.random.key(0), 4000)
  counts = np.bincount(draw(keys, 0.2), minlength=5) / 4000
  assert counts[0] == 0 and np.allclose(counts[1:], [0.05, 0.05, 0.05, 0.85], atol=0.02)
  assert (np.asarray(draw(keys, 0.0)) == 4).all()


# --- as a stage --------------------------------------------------------------------------------------------------


def _config(num_steps, **quantizer):
  config = load_config("cdamd_rvq", "tiny").unlock()
  config.train.update(num_steps=num_steps, log_every=1, save_every=2)
  config.data.batch_size = 4
  config.model.update(dilations=(1,))  # compiles fast
  config.quantizer.update(drop_rate=0.5, **quantizer)
  return config


def _stage(config):
  """Weights that numpy drew: compiling the initializers takes as long as compiling the step."""
  stage = cdamd.rvq_stage(config)
  return stage._replace(init=lambda *inputs: untrained(jax.eval_shape(stage.init, *inputs)))


def _next_batch(step):
  x = np.random.default_rng(step).normal(size=(4, 16, 66)).astype(np.float32)
  return {"features": x, "index": np.arange(4)}


def _equal(a, b):
  return all(np.array_equal(x, y) for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True))


@pytest.mark.slow
def test_codebooks_are_part_of_the_checkpoint_and_of_the_file(tmp_path):
  stage = _stage(_config(4))
  whole = train.train(_config(4), tmp_path / "whole", stage, _next_batch)
  train.train(_config(2), tmp_path / "parts", stage, _next_batch)
  parts = train.train(_config(4), tmp_path / "parts", stage, _next_batch, resume=True)
  assert _equal(whole, parts) and parts.extra["codebooks"]["initialised"].any()
  net = Autoencoder(**_config(2).model)
  file = checkpoint.load_params(tmp_path / "whole", cdamd.autoencoder_shapes(net, _config(2).quantizer))
  assert np.array_equal(file["codebooks"]["codes"], whole.extra["codebooks"]["codes"])
  rows = read_metrics(tmp_path / "whole")
  assert all(1 <= row["perplexity"] <= 8 and 0 < row["usage"] <= 1 for row in rows)


def learned(folder, num_devices):
  """Codebooks and parameters after three steps, each as one list."""
  assert jax.local_device_count() == num_devices
  flat = lambda tree: np.concatenate([np.ravel(a) for a in jax.tree.leaves(tree)]).tolist()
  config = _config(3, num_codes=24, num_levels=2)
  state = train.train(config, folder, _stage(config), _next_batch)
  return [flat(state.extra), flat(state.params)]


_DEVICES = """
import json, sys
from tests.quant.test_rvq import learned
print(json.dumps(learned(sys.argv[1], 2)))
"""


@pytest.mark.slow
def test_two_devices_learn_the_codebook_of_one(tmp_path):
  """With fewer rows on all devices together (16) than codes (24): the noise of the tiling is the same."""
  done = processes.run(["-c", _DEVICES, tmp_path / "two"], devices_env(2))
  assert done.returncode == 0, done.stderr
  alone = learned(tmp_path / "one", 1)
  for one, two in zip(alone, json.loads(done.stdout.splitlines()[-1]), strict=True):
    assert np.abs(np.subtract(one, two)).max() < 1e-5
