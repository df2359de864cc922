"""The diffusion head, its flow solvers and its DDPM steps are the reference's."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.diffusion import ddpm, guidance, ode, paths, samplers
from motion_jax.models.cdamd.weight_names import diffusion_mlp_names
from motion_jax.nets.diffusion_mlp import DiffusionMLP
from motion_jax.nets.layers import timestep_embedding
from tests import fixtures
from tests.golden import check, golden


def network(fixture, dtype):
  """-> predict(x, t, condition) of a recorded head, compiled."""
  sizes = fixture.meta["arguments"]
  net = DiffusionMLP(latent_dim=sizes["target_channels"], width=sizes["width"], depth=sizes["depth"], dtype=dtype)
  params = jax.tree.map(lambda a: jnp.asarray(a, dtype), from_torch(fixture.params, diffusion_mlp_names(net.depth)))
  return jax.jit(functools.partial(net.apply, params))


def guided(predict, conditions, scale):
  """The guided velocity or noise of the first half of the rows; conditions: those with text, then those without."""
  return guidance.guided(lambda x, t, drop: predict(x, jnp.broadcast_to(t, x.shape[:1]), conditions), scale)


@golden("diffusion_sit", leave_out=("dopri5_guided_times", "dopri5_plain_times", "dopri5_hard_times"),
        bounds={"dopri5_hard": (1e-4, 1e-10), "dopri5": (1e-3, 1e-10), "sample": (1e-3, 1e-10),
                "evaluations": (0, 0), "": (1e-5, 1e-10)})
def run_diffusion_sit(fixture, dtype):
  given = {name: jnp.asarray(array, dtype) for name, array in fixture.under("in/").items()}
  predict, c = network(fixture, dtype), given["c"]
  both = lambda scale: guided(predict, c, scale)
  half = len(c) // 2
  made = {"velocity": predict(given["x"], given["t"], c), "time_features": timestep_embedding(given["t"])}
  scale = lambda name: fixture.stated(r"scale ([\d.]+)", f"out/{name}")
  made["guided"] = np.tile(jax.jit(both(scale("guided")))(given["x"][:half], given["t"]), (2, 1))

  @jax.jit
  def loss_rows(data, noise, t):
    return ((predict(paths.add_noise(data, noise, t), t, c) - (data - noise)) ** 2).mean(-1)

  made["loss_rows"] = loss_rows(given["data"], given["loss_noise"], given["loss_t"])
  made["loss"] = np.mean(made["loss_rows"])
  for name in fixture.under("out/ode_"):
    solver, steps = split_solver(name)
    calls, guided_velocity = [], both(scale(f"ode_{name}"))

    def velocity(x, t, calls=calls, guided_velocity=guided_velocity):
      jax.debug.callback(lambda: calls.append(1))  # counts what runs, not what is traced
      return guided_velocity(x, t)

    made[f"ode_{name}"] = jax.jit(lambda x, velocity=velocity, method=samplers.METHODS[solver], steps=steps:
                                  samplers.runge_kutta(velocity, x, method, steps))(given["start"])
    jax.block_until_ready(made[f"ode_{name}"])
    jax.effects_barrier()
    made[f"evaluations_{name}"] = len(calls)
  plain = lambda x, t: predict(x, jnp.broadcast_to(t, x.shape[:1]), c[:half])
  for name, velocity in (("guided", both(scale("dopri5_guided"))), ("plain", plain),
                         ("hard", both(scale("dopri5_hard")))):
    made[f"dopri5_{name}"], made[f"dopri5_{name}_evaluations"] = jax.jit(
        lambda x, velocity=velocity: ode.dopri5(velocity, x))(given["start"])
  made["sample"] = np.tile(jax.jit(lambda x: ode.dopri5(both(scale("guided")), x).value)(given["sample_noise"]), (2, 1))
  return made


def split_solver(name):
  """euler10 -> euler, 10; heun210 and rk425 end in torchdiffeq's own digit of the name."""
  for theirs, ours in (("heun2", "heun"), ("rk4", "rk4"), ("midpoint", "midpoint"), ("euler", "euler")):
    if name.startswith(theirs):
      return ours, int(name[len(theirs):])
  raise ValueError(f"got solver {name!r}")


@golden("diffusion_ddpm", bounds={
    **{name: (1e-12, 1e-12) for name in ddpm.Schedule._fields}, "": (1e-5, 1e-10)})
def run_diffusion_ddpm(fixture, dtype):
  given = {name: jnp.asarray(array, None if name == "t" else dtype) for name, array in fixture.under("in/").items()}
  predict, c = network(fixture, dtype), given["c"]
  schedule = ddpm.cosine_schedule(int(fixture.meta["arguments"]["num_sampling_steps"]))
  made = {name: table for name, table in schedule._asdict().items() if name != "steps"}
  made["prediction"] = predict(given["x"], given["t"], c)
  made["loss_rows"] = ddpm.loss_rows(lambda x, t: predict(x, t, c), schedule, given["data"], given["t"],
                                     given["loss_noise"])
  half, last = len(c) // 2, len(schedule.betas) - 1
  for name in ("guided", "cool"):
    scale, temperature = (fixture.stated(rf"{word} ([\d.]+)", f"out/{name}_path") for word in ("scale", "temperature"))
    noise_of = guided(predict, c, scale)
    fresh = jnp.stack([given[f"{name}_step_noise/{m}"][:half] for m in range(last + 1)])
    made[f"{name}_sample"] = jax.jit(lambda x, fresh=fresh, temperature=temperature, noise_of=noise_of: ddpm.ancestral(
        noise_of, schedule, x, fresh.__getitem__, temperature))(given[f"{name}_start"])
    step = jax.jit(lambda x, m, fresh=fresh, temperature=temperature, noise_of=noise_of: ddpm.step_back(
        schedule, x, ddpm.x1_of_noise(schedule, x, noise_of(x, last - m), last - m), last - m, fresh[m], temperature))
    path = [given[f"{name}_start"]]
    for m in range(last + 1):
      path.append(step(path[-1], m))
    made[f"{name}_path"] = np.stack(path[1:])
  return made


@pytest.mark.parametrize("name, precision", [
    pytest.param("diffusion_ddpm", "float32", marks=pytest.mark.slow), *(pytest.param(
        *one, marks=pytest.mark.exhaustive) for one in (("diffusion_ddpm", "float64"), ("diffusion_sit", "float64")))])
def test_golden(name, precision):
  assert not check(fixtures.path(f"cdamd/{name}.npz"), [precision]).failures


@pytest.mark.slow
def test_a_random_init_head_is_silent():
  """Its loss at the start is mean(v^2)."""
  net = DiffusionMLP(latent_dim=5, width=16, depth=2)
  draw = np.random.default_rng(2)
  x, t, c = draw.standard_normal((4, 5), np.float32), np.array([0.0, 0.2, 0.6, 1.0], np.float32), np.ones((4, 7))
  params = jax.jit(net.init)(jax.random.key(1), x, t, c)  # the network's own: its gates are closed
  assert not jax.jit(net.apply)(params, x, t, c).any()
