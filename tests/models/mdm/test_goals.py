"""DiP's goals: which constraints of a block become goals, what training draws, and that a goal moves the motion."""
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import motion_jax as mj
from motion_jax.control.compiling import compile
from motion_jax.control.constraints import EffectorTarget, RootPath
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.models.mdm import goals
from motion_jax.models.mdm.goals import GOALS, TRAINED, Stand, goals_of_block
from motion_jax.models.mdm.stages import denoiser_shapes, denoiser_stage, left_out
from motion_jax.motion.representations import get_layout, to_features
from motion_jax.nets.motion_denoiser import MotionDenoiser
from motion_jax.training.setup import untrained
from motion_jax.utils.errors import InputError
from tests.conftest import load_config

LAYOUT = get_layout("full")
GROUND = [1, 0, 1]


def named(row):
  """{goal: its three numbers} of the goals (8, 4) that count."""
  return {goal: wanted[:3] for goal, wanted in zip(GOALS, row) if wanted[3]}


def test_where_blocks_stand_adds_up_to_the_path():
  """Blocks of 8 frames, each from where the one before ended: the same place as the whole path's."""
  features = np.stack([to_features(clip.joints[:41]) for clip in synthetic_clips(num=3, num_frames=60)])
  stand = Stand.beginning(len(features))
  for first in range(0, 32, 8):
    stand = stand.after(features[:, first:first + 8], LAYOUT)
  turned, path = LAYOUT.root_path(features)
  np.testing.assert_allclose(stand.place, path[:, 32, ::2], atol=1e-5)
  np.testing.assert_allclose(np.exp(1j * stand.heading), np.exp(-2j * np.arctan2(turned[:, 32, 2], turned[:, 32, 0])),
                             atol=1e-5)


def test_targets_of_a_block_are_goals_seen_from_its_first_frame():
  """A body that stands at (1, 2) and faces +X: what lies at (1, 1, 5) is 3 m to its right."""
  stand = Stand(np.array([[1.0, 2.0]]), np.array([np.pi / 2]))
  signal = compile([EffectorTarget("right_hand", [5.0, 5.5], [[9, 1, 9], [1, 1, 5]])], 240)
  found = named(goals_of_block(signal, 80, 40, stand, LAYOUT)[0])
  assert found.keys() == {"right_wrist", "heading"}
  np.testing.assert_allclose(found["right_wrist"], [-3, 1, 0], atol=1e-6)
  np.testing.assert_allclose(found["heading"], [-np.pi / 2, 0, 0], atol=1e-6)  # it faces where it goes
  next_block = compile([EffectorTarget("right_hand", [6.0], [[1, 1, 5]])], 240)  # its first frame
  assert named(goals_of_block(next_block, 80, 40, stand, LAYOUT)[0]).keys() == {"path", "heading"}


def test_a_path_is_a_goal_on_the_ground_and_a_later_target_is_approached():
  stand = Stand.beginning(1)
  signal = compile([RootPath([[0, 0], [0, 4]], times=[0, 4], heading=0.5)], 120)
  found = named(goals_of_block(signal, 0, 40, stand, LAYOUT)[0])
  assert found.keys() == {"path", "heading"}
  np.testing.assert_allclose(found["path"], [0, 0, 39 / 20], atol=0.05)
  np.testing.assert_allclose(found["heading"], [0.5, 0, 0], atol=1e-6)
  later = compile([EffectorTarget("left_foot", [119 / 20], [[3, 0.1, 0]])], 120)
  found = named(goals_of_block(later, 0, 40, stand, LAYOUT)[0])
  assert found.keys() == {"path", "heading"}
  np.testing.assert_allclose(found["path"], [1, 0, 0], atol=1e-6)  # a third of the way in a third of the time
  assert named(goals_of_block(later, 80, 40, stand, LAYOUT)[0]).keys() == {"left_foot", "heading"}
  assert not named(goals_of_block(later, 120, 40, stand, LAYOUT)[0])


def test_training_draws_each_kind_of_goal():
  drawn = np.asarray(goals.drawn_goals(jax.random.split(jax.random.key(0), 700)))
  kinds, counts = np.unique(drawn, axis=0, return_counts=True)
  assert {tuple(row) for row in kinds} == {tuple(goal in wanted for goal in GOALS) for wanted in TRAINED}
  assert counts.min() > 60 and counts.max() < 140


def test_goals_are_left_out_apart_from_captions():
  keys = jax.random.split(jax.random.key(0), 4_000)
  no_text, no_goal = map(np.asarray, left_out(keys, 0.1))
  for share, expected in ((no_text, 0.1), (no_goal, 0.1), (no_text & no_goal, 0.01)):
    assert share.mean() == pytest.approx(expected, abs=4 * (expected / 4_000) ** 0.5)
  assert not np.any(left_out(keys, 0.0))


def test_goals_that_are_left_out_add_nothing_to_the_time():
  net = MotionDenoiser(features=6, width=8, depth=1, num_heads=2, mlp_width=8, text_dim=4, num_goals=8, num_steps=4)
  draw = np.random.default_rng(0)
  x, text, given = (draw.standard_normal(shape).astype(np.float32) for shape in ((2, 5, 6), (2, 1, 4), (2, 8, 4)))
  params = untrained(denoiser_shapes(net))
  apply = jax.jit(lambda goals, mask=None: net.apply(params, x, jnp.ones(2, int), text, goals=goals, goals_mask=mask))
  made = apply(given, jnp.array([True, False]))
  np.testing.assert_allclose(made[0], apply(given)[0], atol=1e-5)
  np.testing.assert_allclose(made[1], apply(None)[1], atol=1e-5)
  assert (np.abs(apply(given) - apply(None)).max((1, 2)) > 1e-4).all()


@pytest.mark.slow
def test_the_loss_of_a_motion_without_goals_is_that_of_its_features():
  """Its "goals" is 0 where none was drawn, and it reads the place in the last frame elsewhere."""
  config = load_config("mdm_denoiser", "goals_tiny").unlock()
  stage, net = denoiser_stage(config), MotionDenoiser(**config.model)
  params = untrained(denoiser_shapes(net))
  draw = np.random.default_rng(0)
  batch = {"features": draw.standard_normal((1, 60, 263)).astype(np.float32), "num_frames": np.array([60]),
           "text_emb": draw.standard_normal((1, 3, 32)).astype(np.float32), "text_mask": np.ones((1, 3), bool)}
  frozen = {"stats": {"mean": jnp.zeros(263), "std": jnp.full(263, 0.1)}}
  loss = jax.jit(stage.loss)
  for index in range(12):
    rng = jax.random.key(1)
    sums, _ = loss(params, frozen, batch | {"index": np.array([index])}, 0, rng)
    drawn = goals.drawn_goals(jax.random.fold_in(jax.random.fold_in(rng, index), 3)[None]).any()
    assert (sums["goals"] > 0) == drawn
    np.testing.assert_allclose(sums["loss"], sums["features"] + sums["goals"], rtol=1e-6)
  config.loss.drop_rate = 1.0  # no goal is read, and the loss of goals stays
  goal_out = jax.tree.map(lambda a: a + 1, params["params"]["goal_out"])
  other = {"params": params["params"] | {"goal_out": goal_out}}
  loss, batch = jax.jit(denoiser_stage(config).loss), batch | {"index": np.array([index])}
  (sums, _), (same, _) = (loss(some, frozen, batch, 0, rng) for some in (params, other))
  assert sums == same and (sums["goals"] > 0) == drawn


@pytest.mark.slow
def test_constraints_change_the_block_that_they_lie_in(random_run):
  """And a stream that is constrained gives the motion of the offline pass; a network without goals refuses."""
  model = mj.load(random_run("dip goals"))
  target = [EffectorTarget("left_hand", [3.5], [[1, 1, 1]])]
  free, held = (model.generate("a person waves", 80, seeds=[1], control=control)[0].joints
                for control in (None, target))
  assert np.abs(free - held)[40:].max() > 1e-4  # the second block has it
  stream = model.stream("a person waves", seed=1, num_frames=80)
  assert stream.hold(compile(target, 80)) == 0
  np.testing.assert_allclose(np.concatenate(list(stream)), held, atol=1e-4)
  plain = mj.load(random_run("dip"))
  assert model.takes_control and not plain.takes_control
  with pytest.raises(InputError, match="got control for dip@.*, which samples by prompts alone"):
    plain.generate("a person waves", 80, control=target)
  with pytest.raises(InputError, match="got constraints for a motion of dip@.*, which follows prompts alone"):
    plain.stream("a person waves").hold(compile(target, 80))
