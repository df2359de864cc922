"""Optimizers and schedules by name and fields: they train, resume to the bit, and wrong ones are one-line errors."""
import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from motion_jax.training import checkpoint, optimizers
from motion_jax.training import loop as train
from motion_jax.utils.errors import InputError
from tests.conftest import some_of
from tests.training.test_train import _config, _equal, _next_batch, _stage

NAMES = ["adamw", "lion", "adafactor", "muon", "schedule_free", "sgd"]


def _stage_of_a_matrix():
  """The line of test_train.py with weights (3, 1): muon orthogonalizes matrices only."""
  stage = _stage()
  line = lambda params: {"w": params["w"][:, 0]}
  return stage._replace(init=lambda batch, rng: {"w": jax.random.normal(rng, (3, 1))},
                        loss=lambda params, *given: stage.loss(line(params), *given))


def _with(name, num_steps, **fields):
  return _config(num_steps, name=name, learning_rate=0.05, ema_decay=0.0, **fields)


@pytest.mark.parametrize("name", some_of(NAMES, slow=["schedule_free", "muon"]))
def test_it_learns_and_a_resumed_run_ends_the_same(name, tmp_path):
  whole = train.train(_with(name, 30), tmp_path / "whole", _stage_of_a_matrix(), _next_batch)
  start = _stage_of_a_matrix().init(None, jax.random.fold_in(jax.random.key(0), 2**31 - 1))
  found = checkpoint.load_params(tmp_path / "whole")
  distance = lambda params: np.linalg.norm(params["w"][:, 0] - np.array([1.0, -2, 3]))
  assert distance(found) < 0.9 * distance(start)
  train.train(_with(name, 14), tmp_path / "parts", _stage_of_a_matrix(), _next_batch)
  parts = train.train(_with(name, 30), tmp_path / "parts", _stage_of_a_matrix(), _next_batch, resume=True)
  assert _equal(whole, parts)
  assert _equal(checkpoint.load_params(tmp_path / "whole"), checkpoint.load_params(tmp_path / "parts"))


def test_a_schedule_free_run_is_used_and_evaluated_with_its_average(tmp_path):
  seen = []
  state = train.train(_with("schedule_free", 4), tmp_path, _stage(), _next_batch,
                      evaluate=lambda params: seen.append(np.asarray(params["w"])) or {"held_out_loss": 0.0})
  average = optimizers.parameters_to_use(state.opt_state, state.params)["w"]
  assert not np.array_equal(average, state.params["w"])
  np.testing.assert_array_equal(checkpoint.load_params(tmp_path)["w"], average)
  np.testing.assert_array_equal(seen[-1], average)


def test_fields_reach_the_optimizer_and_shared_ones_apply_where_it_has_them():
  params, grads = {"w": jnp.ones((4, 4))}, {"w": jnp.full((4, 4), 0.5)}

  def update(tx):
    state, found = tx.init(params), None
    for _ in range(3):
      found, state = tx.update(grads, state, params)
    return found["w"]

  config = _config(10, name="lion", clip_norm=0.0, warmup_steps=0, weight_decay=0.3, beta1=0.8, fields={"b2": 0.5})
  np.testing.assert_array_equal(update(optimizers.make_optimizer(config.optimizer, 10)),
                                update(optax.lion(1e-2, b1=0.8, b2=0.5, weight_decay=0.3)))


@pytest.mark.parametrize("fields, words", [
    (dict(name="adamww"), r"got optimizer.name 'adamww' \(did you mean adamw?\), expected adamw, adafactor, "),
    (dict(name="lion", fields={"b3": 1.0}), "got optimizer.fields.b3, which optax.lion does not have, expected b1, "),
    (dict(name="muon", fields={"ns_coeffs": "x"}), "optimizer.fields do not fit optax.muon"),
    (dict(schedule="cosin"), r"got optimizer.schedule 'cosin' \(did you mean cosine?\), expected constant, "),
    (dict(schedule="exponential_decay", schedule_fields={"rate": 1.0}), "got optimizer.schedule_fields.rate, which "),
    (dict(schedule="polynomial"), "optimizer.schedule_fields do not fit optax.polynomial_schedule .*missing"),
    (dict(name="schedule_free"), "got optimizer.ema_decay with optimizer.name 'schedule_free'"),
])
def test_what_is_wrong_is_named_in_one_sentence(fields, words):
  with pytest.raises(InputError, match=words.replace("?", r"\?")) as error:
    optimizers.make_optimizer(_config(10, **fields).optimizer, 10)
  assert "\n" not in str(error.value)


@pytest.mark.parametrize("fields, expected", [
    (dict(schedule="linear", final_rate=0.2), [0.5, 1, 1 - 0.8 / 3, 1 - 1.6 / 3]),
    (dict(schedule="step", boundaries=(0.5, 3), gamma=0.1), [0.5, 1, 0.1, 0.01]),
    (dict(schedule="wsd", cooldown_steps=2), [0.5, 1, 1, 0.5]),
    # From the warm-up's end at step 1 to a fifth at step 4; a quarter turn, to a half at step 4.
    (dict(schedule="cosine", final_rate=0.2), [0.5, 1, 0.2 + 0.8 * 0.75, 0.2 + 0.8 * 0.25]),
    (dict(schedule="half_cosine"), [0.5, *(0.5 + 0.5 * np.cos(np.pi * step / 8) for step in (1, 2, 3))]),
    (dict(schedule="exponential_decay", schedule_fields=dict(decay_rate=0.25, transition_steps=2)),
     [0.5, 0.5, 0.25, 0.125]),
    (dict(warmup="released", warmup_steps=3), [0.5, 0.75, 0.75, 0.75]),
    (dict(schedule="polynomial", schedule_fields=dict(end_value=0.0, power=2)), [0.5, 0.5625, 0.25, 0.0625]),
])
def test_schedules_by_name(fields, expected):
  """With a warm-up of one step: the rate of update 0 is half of what the schedule gives. The released loops begin with
  the second step of it and end before the last."""
  config = _config(4, **{"learning_rate": 1.0} | fields).optimizer
  values = [float(optimizers.make_schedule(config, 4)(jnp.asarray(step))) for step in range(4)]
  np.testing.assert_allclose(values, expected, rtol=1e-6)


def test_parts_are_clipped_and_rated_by_name():
  """A gradient of norm 4 is clipped to 1 where its part is named; below "slow" updates are half as large."""
  config = _config(1, name="sgd", learning_rate=1.0, warmup_steps=0, clip_parts=("a",), rates={"slow": 0.5}).optimizer
  grads = {"a": {"w": jnp.full((4,), 2.0)}, "b": {"w": jnp.full((4,), 2.0)}, "slow": {"w": jnp.ones(4)}}
  tx = optimizers.make_optimizer(config, 1)
  updates, _ = tx.update(grads, tx.init(grads), grads)
  assert {name: float(part["w"][0]) for name, part in updates.items()} == {"a": -0.5, "b": -2.0, "slow": -0.5}
