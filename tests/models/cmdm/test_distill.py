"""A student learns its teacher's steps, on the rows that the sampler visits, and samples them as an ordinary model."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import motion_jax as mj
from motion_jax import fit as training
from motion_jax import runs
from motion_jax.diffusion.schedules import staircase_levels
from motion_jax.models.cmdm import distill
from motion_jax.training.setup import untrained
from tests.conftest import load_config

pytestmark = pytest.mark.usefixtures("kept_features")


def test_rows_are_those_of_the_sampler():
  num_steps, lag, blocks = 8, 2, 5
  keys = jax.random.split(jax.random.key(0), 2000)
  draw = jax.jit(lambda keys: distill.staircase_rows(keys, blocks, num_steps, lag))
  level, moves = map(np.asarray, draw(keys))
  table = staircase_levels(num_steps, blocks, lag)
  drawn, counts = np.unique(level, axis=0, return_counts=True)
  np.testing.assert_array_equal(drawn[np.lexsort(drawn.T[::-1])], table[:-1][np.lexsort(table[:-1].T[::-1])])
  assert counts.max() < 2 * counts.min()
  after = {tuple(now): then for now, then in zip(table[:-1], table[1:])}
  assert all((after[tuple(row)] - row == moving).all() for row, moving in zip(level, moves))


def test_a_step_of_the_student_is_all_of_the_teachers():
  """On a field that is known: dx/dt = x at the levels that move, and nothing at those that do not."""
  x = jnp.ones((1, 3, 2))
  level, moves = jnp.array([[4, 2, 0]]), jnp.array([[False, True, True]])
  made = distill.teacher_step(lambda x, t: x, x, level, moves, 4, 2)
  assert (made[0, 0] == 0).all()
  np.testing.assert_allclose(made[0, 1:], ((1 + 1 / 8) ** 2 - 1) * 4, rtol=1e-6)
  times = []
  distill.teacher_step(lambda x, t: times.append(np.asarray(t)) or x, x, level, moves, 4, 2)
  np.testing.assert_allclose(times, [[[1, 0.5, 0]], [[1, 0.625, 0.125]]])


def student_config(teacher, **fields):
  config = load_config("cmdm_student", "16_tiny").unlock()
  config.distill.update(teacher=str(teacher), **fields)
  return config.lock()


@pytest.mark.slow
def test_a_student_is_trained_and_is_a_model(tiny_run, tmp_path):
  training.run(student_config(tiny_run), tmp_path / "student")
  told = (tmp_path / "student" / "metrics.jsonl").read_text()
  assert '"loss"' in told and "forcing" not in told  # what is not asked for is not computed
  model, first = mj.load(tmp_path / "student"), mj.load(tiny_run)
  assert model.config.sampler.num_steps == 16 and model.config.sampler.guidance_scale == 1.0
  np.testing.assert_array_equal(model.codec.mean, first.codec.mean)  # latents are the teacher's
  assert np.isfinite(model.generate("a person walks", num_frames=24, seeds=[0])[0].joints).all()


@pytest.mark.slow
def test_a_student_that_is_its_teacher_has_nothing_to_learn(tiny_run):
  """One step of an unguided teacher is the student's own: the loss is 0 with its parameters, and guided it is not."""
  def loss(scale):
    config = training.resolve(student_config(tiny_run, guidance_scale=scale, forcing_share=0.5))[0]
    setup = training.setups()[config.stage](config)
    params = untrained(setup.frozen[distill.TEACHER])  # two steps of training leave words without a say
    batch = jax.tree.map(jnp.asarray, setup.next_batch(0))
    frozen = setup.frozen | {distill.TEACHER: params}
    sums, weight = jax.jit(setup.stage.loss)(params, frozen, batch, 0, jax.random.key(1))
    return {name: float(value / weight) for name, value in sums.items()}

  alone, guided = loss(1.0), loss(3.0)
  assert alone["distill"] < 1e-10 < 1e-4 < guided["distill"] and alone["forcing"] > 0.1
  assert guided["loss"] == pytest.approx((guided["distill"] + guided["forcing"]) / 2)


@pytest.mark.slow
def test_a_model_that_ships_is_a_teacher():
  """Its words and sizes are taken from its folder."""
  config = load_config("cmdm_student", "8_small").unlock()
  config.data.update(load_config("cmdm_student", "tiny").data.to_dict() | {"vary_subject": 0.0})
  config.distill.teacher = "cmdm-small"
  found = training.resolve(config)[0]
  assert found.frozen.text == str(runs.load_run("cmdm-small").text)
  assert found.model.width == 256 and found.train.start == "cmdm-small"  # it begins with the teacher's parameters


@pytest.mark.slow
def test_what_cannot_be_a_teacher_is_refused(tmp_path):
  with pytest.raises(ValueError, match="got no config.distill.teacher, expected the denoiser"):
    training.run(student_config(""), tmp_path / "c")
  with pytest.raises(FileNotFoundError, match="nowhere"):
    training.run(student_config("nowhere"), tmp_path / "a")
  with pytest.raises(ValueError, match="part-tmr-small holds a 'tmr.teacher' run, expected one of stage cmdm.den"):
    training.run(student_config("part-tmr-small"), tmp_path / "b")
