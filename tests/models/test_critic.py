"""A critic of decoded motion: what it sees, whose gradients are whose, and runs with a wider decoder."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax import fit, runs
from motion_jax.models import cmdm
from motion_jax.models.shared import critic, motion_errors
from motion_jax.models.shared.critic import seen
from motion_jax.motion.representations import get_layout
from motion_jax.nets.motion_critic import MotionCritic
from motion_jax.training import checkpoint
from tests.conftest import load_config

pytestmark = pytest.mark.usefixtures("kept_features")


def walk(frames=24, batch=2):
  rng = np.random.default_rng(0)
  joints = rng.normal(0, 0.3, (batch, 1, 22, 3)) + 0.02 * rng.normal(0, 1, (batch, frames, 22, 3)).cumsum(1)
  return jnp.asarray(joints, jnp.float32)


def test_it_sees_the_body_wherever_it_goes():
  joints = walk()
  angle = 0.7
  turn = jnp.array([[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]], jnp.float32)
  first, second = seen(joints), seen(joints @ turn.T + jnp.array([3.0, 0.0, -2.0]))
  assert first.shape == (2, 22, 198)
  pelvis = np.zeros(198, bool)
  pelvis.reshape(3, 22, 3)[1:, 0] = True  # velocity and acceleration of the pelvis are those over the ground
  np.testing.assert_allclose(first[..., ~pelvis], second[..., ~pelvis], atol=2e-2)
  assert np.abs(seen(joints + jnp.array([0, 0.2, 0]))[..., 1] - first[..., 1]).max() == pytest.approx(0.4, abs=1e-5)


@pytest.mark.slow
def test_scores_at_every_stride():
  net, x = MotionCritic(width=8), seen(walk(64))
  towers = net.apply(net.init(jax.random.key(0), x), x)
  assert [tower[-1].shape[-1] for tower in towers] == [1, 1, 1]
  lengths = [tower[-1].shape[1] for tower in towers]
  assert lengths[0] > lengths[1] > lengths[2] >= 3
  assert critic.telling(towers, towers) >= 2 and critic.matching(towers, towers) == 0
  assert critic.deceiving(towers) == pytest.approx(-sum(float(tower[-1].mean()) for tower in towers) / 3)


def config_with(**loss):
  config = load_config("cmdm_tokenizer", "tiny").unlock()
  config.frozen.teacher, config.model.teacher_dim = "", 0
  config.loss.update(loss)
  return config.lock()


def gradients(step, **loss):
  config = config_with(critic=0.5, critic_matching=1.0, critic_after=10, critic_width=4, **loss)
  stage = critic.with_critic(cmdm.tokenizer_stage(config), config)
  layout = get_layout("full")
  features = jax.random.normal(jax.random.key(0), (2, 32, layout.dim))
  frozen = {motion_errors.STATS: {"mean": jnp.zeros(layout.dim), "std": jnp.full(layout.dim, 0.1)}}
  batch = {"features": features, "index": jnp.arange(2)}
  params = stage.init(batch, jax.random.key(1))
  of = jax.jit(jax.value_and_grad(lambda params: (lambda sums, weight: sums["loss"] / weight)(
      *stage.loss(params, frozen, batch, step, jax.random.key(2)))))
  return params, *of(params)


@pytest.mark.slow
def test_the_critic_learns_from_the_first_step_and_the_decoder_from_it_later():
  """Before critic_after the network's gradients are those without a critic."""
  config = config_with()
  plain = cmdm.tokenizer_stage(config)
  params, _, early = gradients(0)
  _, _, late = gradients(10)
  batch = {"features": jax.random.normal(jax.random.key(0), (2, 32, 263)), "index": jnp.arange(2)}
  network = {"params": {name: part for name, part in params["params"].items() if name != checkpoint.CRITIC}}
  alone = jax.grad(lambda params: (lambda sums, weight: sums["loss"] / weight)(
      *plain.loss(params, {}, batch, 0, jax.random.key(2))))(network)
  largest = lambda tree: max(float(jnp.abs(leaf).max()) for leaf in jax.tree.leaves(tree))
  size = largest(alone)
  jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-6 * size), alone,
               {"params": {name: early["params"][name] for name in alone["params"]}})
  change = jax.tree.map(lambda a, b: a - b, late["params"]["decoder"], early["params"]["decoder"])
  assert largest(change) > 1e-3 * largest(early["params"]["decoder"])
  assert largest(early["params"][checkpoint.CRITIC]) > 0


@pytest.mark.slow
def test_a_wider_decoder_for_the_generator_of_its_latents(tiny_run, tmp_path):
  """Trained with a critic on the encoder of a generator; the run has no critic, the generator plays with it."""
  tokenizer = runs.load_run(tiny_run).config.tokenizer
  config = config_with(critic=0.5, critic_matching=1.0, critic_width=4).unlock()
  config.model.update(tokenizer.to_dict() | dict(teacher_dim=0, decoder_width=24))
  config.train.update(start=str(tiny_run), start_parts=("encoder",), freeze=("encoder",))
  fit.run(config.lock(), tmp_path / "decoder")
  run = runs.load_run(tmp_path / "decoder")
  assert set(run.params()["params"]) == {"encoder", "decoder"}
  assert checkpoint.CRITIC in checkpoint.load_params(tmp_path / "decoder")["params"]
  runs.exchange_decoder(tiny_run, tmp_path / "decoder", tmp_path / "new")
  import motion_jax as mj
  model = mj.load(tmp_path / "new")
  assert model.vae.decoder_width == 24
  joints = model.generate("a person walks", num_frames=24, seeds=[0])[0].joints
  assert np.isfinite(joints).all()
  config = config.copy_and_resolve_references().unlock()
  config.train.start_parts = ("decodr",)
  with pytest.raises(ValueError, match="got train.start_parts 'decodr', but train.start"):
    fit._started_from(None, config)
