"""Guidance through a decoder: its step is the right one, moves nothing without targets, and keeps the past."""
import copy

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import motion_jax as mj
from motion_jax.control import conditioning, guidance
from motion_jax.control import signal as signals
from motion_jax.models import cmdm
from motion_jax.models.cmdm import networks, streaming
from motion_jax.models.cmdm.guiding import Guide
from motion_jax.models.cmdm.loop import SamplingLoop
from motion_jax.models.keys import keys_of
from motion_jax.training.setup import untrained
from tests.conftest import some_of
from tests.control.test_conditioning import asked

SAMPLING = dict(num_steps=4, lag=2)
FRAMES = 48


@pytest.fixture(scope="module")
def model(tiny_run):
  return mj.load(tiny_run)


def hand(frame=40, place=(0.4, 1.2, 0.6), frames=FRAMES):
  return asked(frames, at={frame: {20: place}, frame - 10: {0: (0.1, None, 0.3)}}, faces={frame: 0.4})


def made(model, signal=None, seeds=(1,), **sampling):
  sampling = {"refinements": 0} | sampling
  keys, seeds = keys_of(None, list(seeds), len(seeds))
  found = model.sample(["a person walks"] * len(seeds), [FRAMES] * len(seeds), keys, seeds, False, SAMPLING | sampling,
                       signal)
  return np.stack([motion.joints for motion in found])


def error(signal, joints):
  return float(np.asarray(signals.errors(signal, jnp.asarray(joints))).sum())


def test_a_step_on_a_linear_problem_is_the_closed_form():
  """d = P A' (A P A' + s^2)^-1 (c - A z), motion by motion, with enough conjugate gradients for as many unknowns."""
  with jax.enable_x64(True):
    draw = np.random.default_rng(0)
    a, z, c = draw.normal(size=(2, 3, 8)), draw.normal(size=(2, 4, 2)), draw.normal(size=(2, 3))
    variance = np.array([0.5, 0.0, 1.0, 2.0])[None, :, None]
    residual = lambda z: jnp.einsum("bnk,bk->bn", a, z.reshape(2, 8)) - c
    found = guidance.newton_step(residual, jnp.asarray(z), jnp.asarray(variance), 12, tolerance=0.1)
    spread = np.repeat(variance.ravel(), 2)
    for i in range(2):
      gain = spread[:, None] * a[i].T @ np.linalg.inv(a[i] * spread @ a[i].T + 0.01 * np.eye(3))
      np.testing.assert_allclose(found[i].ravel(), gain @ (c[i] - a[i] @ z[i].ravel()), atol=1e-8)
    assert not np.asarray(found)[:, 1].any()


def test_a_heading_that_is_more_than_a_quarter_turn_off_pulls_with_all_its_force():
  signal = asked(1, faces={0: 0.0})
  off = lambda angle: float(guidance.residual(signal, np.zeros((1, 1, 22, 3)), np.full((1, 1), angle))[1][0, 0])
  assert 0 < off(0.5) < off(1.5) == pytest.approx(off(3.0), rel=0.01) and off(-3.0) == -off(3.0)


def test_the_gradient_through_decoder_and_joints_is_that_of_finite_differences(model):
  guide = Guide.of(model.codec, model.stats, hand(24, frames=36))
  behind = guide.begin()

  def loss(z):
    return sum((part ** 2).sum() for part in guide._residual(behind, 0, z))

  z = 0.3 * jax.random.normal(jax.random.key(0), (1, 9, model.dit.latent_dim))
  way = jax.random.normal(jax.random.key(1), z.shape)
  both, step = jax.jit(jax.value_and_grad(loss)), 1e-3  # kinks of the ReLUs are seldom so near
  slope = (np.asarray(both(z)[1]) * way).sum()
  assert abs(slope - (both(z + step * way)[0] - both(z - step * way)[0]) / (2 * step)) < 0.01 * abs(slope)


@pytest.mark.slow
def test_it_pulls_towards_targets_and_leaves_alone_what_has_none(model):
  plain = made(model)
  signal = asked(FRAMES, at={frame: {20: plain[0, frame, 20] + 0.05} for frame in (20, 40)})
  pulled = made(model, signal)
  assert error(signal, pulled) < 0.5 * error(signal, plain)
  np.testing.assert_array_equal(plain, made(model, signal, control_steps=0))
  np.testing.assert_allclose(plain, made(model, signals.none(1, FRAMES)), atol=1e-5)


@pytest.mark.parametrize("num_steps, lag", some_of([(5, 3), (4, 4), (4, 1)], slow=[(5, 3)]))
def test_it_pulls_whatever_the_lag(model, num_steps, lag):
  """Also where it does not divide the steps: the iteration that finishes a block is among those that are pulled."""
  plain = made(model, num_steps=num_steps, lag=lag)
  signal = asked(FRAMES, at={frame: {20: plain[0, frame, 20] + 0.05} for frame in (20, 40)})
  assert error(signal, made(model, signal, num_steps=num_steps, lag=lag)) < 0.75 * error(signal, plain)


@pytest.mark.slow
def test_a_stream_is_the_offline_motion_and_never_moves_what_was_given_out(model):
  """With targets from the start on; then with another place for the hand, given when three blocks are out."""
  signal, plan = hand(), model.plan_of(**SAMPLING)[0]
  keys, _ = keys_of(None, [1], 1)
  text_emb, text_mask = model.encode_words(["a person walks"])
  guide = Guide.of(model.codec, model.stats, signal)

  def streamed(*asked):
    stream, parts = model.stream("a person walks", seed=1, num_frames=FRAMES, cleanup=False, **SAMPLING), []
    for at in range(6):
      for when, what in asked:
        if at == when:
          stream.hold(what)
      parts += [joints for joints in [stream.step()] if len(joints)]
    return np.concatenate(parts)[:FRAMES]

  def offline(signal):
    made = streaming.bind(model.dit, plan, model.params, text_emb=text_emb, text_mask=text_mask,
                          scale=model.sampling().guidance_scale, keys=keys)
    guided = made.replace(guide=guide.replace(signal=signal).over(20 * 12))
    return model.codec.decode(guided.sample(4))

  expected = model.stats.layout.to_joints(model.stats.denormalize(np.asarray(jax.jit(offline)(signal))))[0]
  live = streamed((0, signal))
  np.testing.assert_allclose(live, expected, atol=2e-3)
  moved = streamed((0, signal), (4, hand(place=(-0.4, 0.8, 0.2))))
  np.testing.assert_array_equal(moved[:36], live[:36])
  assert np.abs(moved[40] - live[40]).max() > 1e-3


@pytest.mark.slow
def test_a_stream_whose_cleanup_moves_the_body_reaches_its_targets_where_it_is_seen(model):
  """A cleanup that sets the body aside: what is decoded heads for the targets less that, and is seen at them."""
  by = np.array([0.3, 0.0, -0.2], np.float32)

  class Aside:
    def push(self, joints, contacts):
      return joints + by

  def streamed(signal, cleaner=None):
    stream = model.stream("a person walks", seed=1, cleanup=False, **SAMPLING)
    stream.hold(signal)
    if cleaner:
      stream._cleaner, stream._drift = cleaner, by[::2].astype(float)
    return np.concatenate([stream.step() for _ in range(5)])

  signal = hand()
  less = signals.ControlSignal(jnp.where(signal.given, signal.positions - by, 0.0), signal.given, signal.heading,
                               signal.heading_given)
  np.testing.assert_allclose(streamed(signal, Aside()), streamed(less) + by, atol=1e-4)
  assert np.abs(streamed(less) - streamed(signal)).max() > 1e-3


def _conditioned(model):
  """A model that takes constraints as a condition, untrained."""
  conditioned = copy.copy(model)
  conditioned.dit = model.dit.clone(control=conditioning.size(4))
  conditioned.params = untrained(cmdm.denoiser_shapes(conditioned.dit))
  conditioned.compiled = networks._compile(conditioned.dit)
  return conditioned


@pytest.mark.slow
def test_a_stream_sees_the_targets_of_its_window_from_where_its_body_stands(model):
  conditioned, signal = _conditioned(model), hand(frame=130, frames=160)
  plan = conditioned.plan_of(**SAMPLING)[0]
  emb, mask = conditioned.encode_words(["a person walks"] * 4)
  loop = SamplingLoop(conditioned, plan, np.ones(1), keys_of(None, [1], 1)[0])
  loop.say(emb[None], mask[None])
  run = lambda: loop.step(np.zeros((1, plan.width), int))
  while loop.base < 2:
    run()
  first, size, start = loop.base * 12, plan.block, np.array([[0.5, 0.2, 0.1]], np.float32)
  loop.hold(signal, 0, start)
  ahead = conditioning.features(signal.slice_frames(first, first + 200), 4, start)
  tokens = conditioned.dit.apply(conditioned.params, ahead, method="control_tokens")
  for passed in range(3):
    np.testing.assert_allclose(loop.control, tokens[:, passed * size:(passed + plan.width) * size], atol=1e-5)
    run()


@pytest.mark.slow
def test_finished_latents_of_cdamd_are_pulled(tiny_generator):
  """Nearer to places that are a little off; with no steps, and without targets, the motion that it was."""
  model = mj.load(tiny_generator)
  keys, seeds = keys_of(None, [1], 1)
  given = ["a person walks"], [FRAMES], keys, seeds, False
  plain = model.sample(*given, {})[0].joints
  signal = asked(FRAMES, at={frame: {20: plain[frame, 20] + 0.05} for frame in (20, 40)})
  pulled = model.sample(*given, {}, signal)[0].joints
  assert error(signal, pulled[None]) < 0.5 * error(signal, plain[None])
  np.testing.assert_array_equal(plain, model.sample(*given, {"control_steps": 0}, signal)[0].joints)
  np.testing.assert_allclose(plain, model.sample(*given, {}, signals.none(1, FRAMES))[0].joints, atol=1e-5)
