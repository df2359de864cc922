"""What latents see of constraints, the random ones that training draws, and a denoiser that sees them."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import fit
from motion_jax.control import conditioning
from motion_jax.control import signal as signals
from motion_jax.models.cmdm import streaming
from motion_jax.nets.causal_dit import ADAPTER_RANK, CausalDiT, ControlAdapter
from motion_jax.nets.masks import block_causal_mask
from motion_jax.training.setup import untrained
from tests.conftest import load_config
from tests.models.cmdm.test_streaming import SCALE, assert_close, encode_text, setting, step

T = 240  # frames of all signals here: one program of each function
START = np.zeros((1, 3), np.float32)
features = jax.jit(conditioning.features, static_argnums=1)
reference = jax.jit(conditioning.reference)


def asked(frames=T, **given):
  """A signal of one motion: {frame: {joint: place, with None where a coordinate is not given}}, headings {frame}."""
  positions, flags = np.zeros((1, frames, 22, 3), np.float32), np.zeros((1, frames, 22, 3), bool)
  heading, faces = np.zeros((1, frames), np.float32), np.zeros((1, frames), bool)
  for frame, joints in given.get("at", {}).items():
    for joint, place in joints.items():
      for axis, number in enumerate(place):
        if number is not None:
          positions[0, frame, joint, axis], flags[0, frame, joint, axis] = number, True
  for frame, angle in given.get("faces", {}).items():
    heading[0, frame], faces[0, frame] = angle, True
  return signals.ControlSignal(positions, flags, heading, faces)


def latents(signal, start=START):
  """What each latent gets to see of a signal (T / 4, size)."""
  return np.asarray(features(signal, 4, start))[0]


def test_latents_see_no_goal_behind_the_last_one_and_nothing_of_an_empty_signal():
  nothing, seen = latents(asked()), latents(asked(at={21: {20: (1, 1, 1)}}))
  assert nothing.shape == (60, conditioning.size(4)) and not nothing.any()
  assert seen[:6].any(-1).all() and not seen[6:].any()


def test_the_reference_path_leads_straight_to_what_is_given():
  path = reference(asked(at={20: {0: (2, None, 0)}, 30: {21: (2, 1, 4)}}), START)
  np.testing.assert_allclose(path.place[0, [0, 10, 20, 25, 30, 40]],
                             [[0, 0], [1, 0], [2, 0], [2, 2], [2, 4], [2, 4]], atol=1e-6)
  np.testing.assert_allclose(path.heading[0, [10, 27]], [np.pi / 2, 0], atol=1e-6)  # +X, then +Z
  assert path.known[0, :31].all() and not path.known[0, 31:].any()


def test_a_heading_is_that_which_is_given_or_which_hips_and_shoulders_show():
  body = {2: (0, 1, 0.1), 1: (0, 1, -0.1), 17: (0, 1.4, 0.1), 16: (0, 1.4, -0.1)}  # the right side is at +Z
  path = reference(asked(at={40: body}, faces={20: -1.0}), START)
  np.testing.assert_allclose(path.heading[0, [0, 10, 20, 40]], [0, -0.5, -1, np.pi / 2], atol=1e-6)


def test_where_a_path_leads_in_the_world_shows_in_two_numbers_alone():
  walk = lambda angle: asked(at={i: {0: (0.05 * i * np.sin(angle), None, 0.05 * i * np.cos(angle))} for i in range(T)})
  one, other = latents(walk(0.3)), latents(walk(2.5))
  facing = 1 + 4 * 115
  assert set(np.flatnonzero(np.abs(one - other).max(0) > 1e-4)) <= {facing, facing + 1}
  np.testing.assert_allclose(other[:, facing], np.sin(2.5), atol=1e-5)


def test_goals_ahead_are_seen_before_they_come_and_no_farther_than_the_horizon():
  assert latents(asked(at={100: {20: (1, 1, 1)}}))[0].any()
  seen = latents(asked(at={200: {20: (1, 1, 1)}})).any(-1)
  first = (200 - conditioning.HORIZON) // 4
  assert not seen[:first - 1].any() and seen[first:50].all()


def test_latents_see_of_a_long_motion_what_they_see_of_its_cut():
  """From frame 60 on, with the reference there as the start: what a stream leaves behind plays no part."""
  turns = np.cumsum(np.full(120, 0.05))
  x, z = np.cumsum(0.05 * np.sin(turns)), np.cumsum(0.05 * np.cos(turns))
  whole = asked(at={i: {0: (x[i], None, z[i]), 20: (x[i], 1.2, z[i])} for i in range(0, 120, 3)})
  path = reference(whole, START)
  start = np.concatenate([path.place[:, 60], path.heading[:, 60:61]], -1)
  # At the border the way is looked for over fewer frames.
  np.testing.assert_allclose(latents(whole)[17:], latents(whole.slice_frames(60, 60 + T), start)[2:45], atol=2e-5)


@jax.jit
def drawn(joints, frames, keys, rate):
  return conditioning.draw_constraints(joints, jnp.full(joints.shape[:2], 0.5), frames, keys, rate)


@pytest.mark.slow
def test_random_constraints_are_met_by_the_motion_they_were_drawn_from():
  joints = np.random.default_rng(0).normal(5, 1, (300, 24, 22, 3)).astype(np.float32)
  frames, keys = np.where(np.arange(300) % 2, 24, 9), jax.random.split(jax.random.key(1), 300)
  signal = drawn(joints, frames, keys, 0.8)
  given, faces = np.asarray(signal.given), np.asarray(signal.heading_given)
  np.testing.assert_array_equal(signal.positions, np.where(given, joints, 0))
  np.testing.assert_array_equal(signal.heading, np.where(faces, np.float32(0.5), 0))
  assert not given[::2, 9:].any() and not faces[::2, 9:].any()
  some = given.any((1, 2, 3))
  assert 0.7 < some.mean() < 0.9 and not np.asarray(drawn(joints, frames, keys, 0.0).given).any()
  count = given[1::2].any((2, 3)).sum(1)
  assert {1, 2, 5, 6, 24} <= set(count) and given.all(-1).any((1, 2)).any() and faces.any()
  other = drawn(joints[::-1], frames[::-1], keys[::-1], 0.8)  # a motion's draws depend on its key alone
  np.testing.assert_array_equal(other.given[::-1], given)


@functools.partial(jax.jit, static_argnums=(0, 1, 7))
def sampled(dit, plan, params, constants, text, keys, control, num_blocks):
  tokens = None if control is None else streaming.control_tokens(dit, plan, params, control)
  return streaming.Sampler(dit, plan, params, constants, text, SCALE, keys, tokens).sample(num_blocks)


@pytest.mark.slow
def test_a_network_that_has_not_learned_from_constraints_makes_what_it_made():
  """Bit for bit: with control layers as they begin, whose last one is 0, and without any target."""
  dit, plan, params, constants, *text, keys = setting(4, 2, 3, 12, 3, control=6)
  plain = dit.clone(control=0)
  adapters = {name: leaf for name, leaf in params["params"].items() if name.startswith("adapter")}
  old = {"params": {name: leaf for name, leaf in params["params"].items()
                    if not name.startswith(("control", "adapter"))}}
  begun = {"params": params["params"] | {name: leaf | {"up": jax.tree.map(jnp.zeros_like, leaf["up"])}
                                         for name, leaf in adapters.items()}}
  text = encode_text(plain, old, *text)
  control = jax.random.normal(jax.random.key(3), (2, 9, 6)).at[..., 0].set(1)
  before = sampled(plain, plan, old, constants, text, keys, None, 3)
  np.testing.assert_array_equal(before, sampled(dit, plan, begun, constants, text, keys, control, 3))
  np.testing.assert_array_equal(before, sampled(dit, plan, params, constants, text, keys, 0 * control, 3))
  assert float(jnp.abs(before - sampled(dit, plan, params, constants, text, keys, control, 3)).max()) > 1e-3
  with pytest.raises(ValueError, match="got 6 numbers of control .* takes 0: it was trained without"):
    plain.apply(old, control, method="control_tokens")


@pytest.mark.slow
def test_streaming_is_offline_under_control():
  """Also one by one; and later targets move nothing that was given out before."""
  dit, plan, params, constants, text_emb, text_mask, keys = setting(6, 2, 3, 12, 6, control=6)
  text = encode_text(dit, params, text_emb, text_mask)
  control = jax.random.normal(jax.random.key(3), (2, 18, 6)).at[..., 0].set(1)
  made = sampled(dit, plan, params, constants, text, keys, control, 6)
  assert_close(sampled(dit, plan, params, constants, encode_text(dit, params, text_emb[1:], text_mask[1:]), keys[1:],
                       control[1:], 6), made[1:], 2e-6)

  def streamed(changed_at, other):
    endless = streaming.make_plan(6, 2, 3, 12)
    sampler = streaming.Sampler(dit, endless, params, constants, text, SCALE, keys)
    tokens = [streaming.control_tokens(dit, endless, params, told) for told in (control, other)]
    state, blocks = sampler.init(), []
    for at in range(plan.age + 5):
      # As a live stream has it: from the window's oldest block on.
      base = max(at - plan.age, 0)
      now = jnp.pad(tokens[at >= changed_at], ((0, 0), (0, 60), (0, 0)))[:, 3 * base:3 * base + 24]
      state, block, done = step(sampler.replace(control=now, control_first=base), state)
      blocks += [block] if done else []
    return jnp.concatenate(blocks, axis=1)

  live = streamed(99, control)
  assert_close(live, made, 2e-6)
  changed = streamed(5, -control)  # three blocks are out by then
  np.testing.assert_array_equal(changed[:, :9], live[:, :9])
  assert float(jnp.abs(changed[:, 9:] - live[:, 9:]).max()) > 1e-3


@pytest.fixture(scope="module")
def training():
  """A loss of parameters, and these, of a denoiser that learns from constraints."""
  config = load_config("cmdm_denoiser", "tiny")
  config.data.control, config.loss.control, config.loss.decoded_from = 0.9, 1.0, 0.0
  config, _ = fit.resolve(config)
  assert config.model.control == conditioning.size(4)
  setup = fit.setups()[config.stage](config)
  batch, rng = setup.next_batch(0), jax.random.key(0)
  loss = lambda params: (lambda sums: (sums["loss"], sums))(setup.stage.loss(params, setup.frozen, batch, 0, rng)[0])
  return loss, untrained(jax.eval_shape(setup.stage.init, batch, rng))


def test_training_has_a_loss_of_constraints(training):
  loss, params = training
  (_, sums), gradient = jax.eval_shape(jax.value_and_grad(loss, has_aux=True), params)
  assert "control" in sums and {"control_in", "control_out", "adapter0"} <= set(gradient["params"])


@pytest.mark.exhaustive  # its compiler takes ten seconds
def test_training_learns_from_constraints(training):
  loss, params = training
  (value, sums), gradient = jax.jit(jax.value_and_grad(loss, has_aux=True))(params)
  assert np.isfinite(value) and 0 < sums["control"] < value
  assert all(np.abs(leaf).max() > 0 for name in ("control_in", "control_out", "adapter0")
             for leaf in jax.tree.leaves(gradient["params"][name]))


def test_latents_without_captions_are_moved_as_those_with_them():
  """Where there are half as many rows of control as latents; and what is added depends on the noise level."""
  adapter, draw = ControlAdapter(8, jnp.float32), np.random.default_rng(0)
  x, control = (draw.normal(size=shape).astype(np.float32) for shape in ((2, 3, 8), (2, 3, ADAPTER_RANK)))
  some, t = np.array([[[1.0], [0.0], [1.0]]], np.float32), np.full((1, 3), 0.3, np.float32)
  twice = np.tile(x, (2, 1, 1))
  params = untrained(jax.eval_shape(lambda: adapter.init(jax.random.key(0), twice, control, some, t)))
  assert not np.asarray(jax.jit(adapter.init)(jax.random.key(0), x, control, some, t)["params"]["up"]["kernel"]).any()
  added = jax.jit(lambda x, t: adapter.apply(params, x, control, some, t) - x)
  both = added(twice, t)
  np.testing.assert_allclose(both[2:], both[:2], atol=1e-6)
  np.testing.assert_allclose(both[:2], added(x, t), atol=1e-6)
  assert np.abs(both[:, 0]).min() > 0 and not np.asarray(both[:, 1]).any()
  assert np.abs(both - added(twice, t + np.float32(0.5))).max() > 1e-3


@pytest.mark.slow
def test_each_layer_has_a_control_of_its_own():
  """One loop over the layers is the layers in a row, and what the second gets is not what the first gets."""
  net = CausalDiT(latent_dim=4, width=16, depth=2, num_heads=2, ff_width=32, text_dim=8, block=3, control=5)
  x, t, control = (np.random.default_rng(0).uniform(size=shape).astype(np.float32)
                   for shape in ((1, 6, 4), (1, 6), (1, 6, 5)))
  control[..., 0] = 1.0
  given = (x, t, np.ones((1, 2, 8), np.float32), block_causal_mask(6, 3), np.ones((1, 2), bool))
  params = untrained(jax.eval_shape(lambda: net.init(jax.random.key(0), *given)))
  apply = jax.jit(lambda net, params: net.apply(params, *given, control), static_argnums=0)
  made = apply(net, params)
  np.testing.assert_allclose(apply(net.clone(scan_layers=True), params), made, atol=1e-5)
  kernel = np.asarray(params["params"]["control_out"]["kernel"]) * np.repeat([1, 0], ADAPTER_RANK).astype(np.float32)
  without = {"params": params["params"] | {"control_out": params["params"]["control_out"] | {"kernel": kernel}}}
  assert np.abs(apply(net, without) - made).max() > 1e-4
