"""Motions that meet constraints: no constraint changes nothing, and each motion of a batch meets its own alone."""
import warnings

import numpy as np
import pytest

from motion_jax import load
from motion_jax.control.compiling import compile
from motion_jax.control.constraints import EffectorTarget, InPlace, KeepParts, Keyframe, Loop, RootPath
from motion_jax.control.signal import none
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.errors import InputError
from motion_jax_studio import Pipeline, cli
from motion_jax_studio.constraining import implied_frames, target_frames
from motion_jax_studio.planning.planner import Planner
from tests.studio.planning.test_sequencing import Recorded


@pytest.fixture(scope="module")
def model(tiny_run):
  return load(tiny_run)


@pytest.fixture(scope="module")
def pipeline(model):
  return Pipeline(model)


class Refusing(Recorded):
  """A model that must not sample."""

  def sample(self, *_):
    pytest.fail("a motion was sampled")


pytestmark = pytest.mark.filterwarnings("ignore:the model does not know", "ignore:.*misses")
FAST = dict(max_attempts=1, num_steps=3, lag=2)
ASKED = dict(prompts=["a person walks", "a person waves"], num_frames=36, seeds=[3, 4], **FAST)


@pytest.fixture(scope="module")
def plain(pipeline):
  return pipeline(**ASKED)


def test_no_constraint_is_the_same_motion_bit_for_bit(pipeline, plain):
  for control in ([None, []], none(2, 36)):
    made = pipeline(**ASKED, control=control)
    assert np.array_equal(made.joints, plain.joints) and np.array_equal(made.features, plain.features)
    assert made[0].meta == plain[0].meta


def test_a_path_that_is_too_long_is_refused_before_anything_is_sampled_unless_it_is_not_projected(model):
  pipeline, path = Pipeline(Refusing(model)), [RootPath([[0, 0], [0, 1]])]
  for options, error in ((dict(control=[InPlace()]), pytest.fail.Exception), (dict(control=path), InputError),
                         (dict(control=path, exact=False), pytest.fail.Exception)):
    with pytest.raises(error, match="was sampled" if error is pytest.fail.Exception else "got 2,401 frames"):
      pipeline("a person walks", 2401, seed=0, max_attempts=1, **options)


@pytest.mark.slow
def test_each_motion_of_a_batch_meets_its_own_constraints(pipeline, plain):
  path = [RootPath([[1, 0], [1.5, 0.5], [2.5, 0.5]])]
  made = pipeline(**ASKED, control=[path, None])
  assert np.array_equal(made.joints[1], plain.joints[1])
  way = compile(path, 36).positions[0, :, 0]
  assert np.abs(made.joints[0, :, 0] - way)[:, [0, 2]].max() < 1e-3
  one = ASKED | dict(prompts=ASKED["prompts"][0], seeds=[3], control=path)
  alone = pipeline(**one)
  np.testing.assert_allclose(alone.joints, made.joints[0], atol=1e-5)
  assert made[0].meta["control"] == ["root_path"] and made[0].features.shape == plain[0].features.shape
  raw = pipeline(**one, exact=False)
  assert np.abs(raw.joints[0, 0, [0, 2]] - [1, 0]).max() < 0.05  # laid where its path begins, and no more
  assert np.abs(raw.joints[:, 0] - way)[:, [0, 2]].max() > 1e-3


def test_constraints_imply_a_length(model, plain):
  for asked, frames in (([RootPath([[0, 0], [0, 1]], [0, 1.5])], 31), ([RootPath([[0, 0], [0, 1.2]])], 21),
                        ([RootPath([[0, 0], [0, 1]], speed=2.0)], 11), ([Loop()], None), (none(1, 44), 44),
                        ([KeepParts(plain[0].joints, ("legs",), 10.0)], 72)):
    assert implied_frames(Planner(model), asked) == frames


def test_a_path_that_leaves_little_time_for_several_actions_gets_a_warning(model):
  planner, path = Planner(model), [RootPath([[0, 0], [0, 1.0]])]
  frames = lambda prompt: target_frames(planner, prompt, planner.plan(prompt), path)
  with pytest.warns(UserWarning, match="0.[89] s, the time that the constraints imply, are shared by 2 actions that"):
    assert frames("a person walks, then runs") == 18
  with warnings.catch_warnings():
    warnings.simplefilter("error")
    assert frames("a person walks") == 18


def test_parts_of_a_motion_stay_and_the_others_are_made(pipeline, plain):
  given = plain[1].joints
  kept = pipeline("a person walks", seeds=[3], control=[KeepParts(given, ("legs", "torso", "head"))], **FAST).joints
  arms = [joint for chain in HUMANML3D.chains[3:] for joint in chain[1:]]
  others = [joint for joint in range(22) if joint not in arms]
  assert np.abs(kept[:, others] - given[:, others]).max() < 1e-5 and np.abs(kept[:, arms] - given[:, arms]).max() > 0.01


@pytest.mark.slow
def test_loops_and_motions_in_place(pipeline):
  made = pipeline("a person walks", 40, seeds=[3], control=[Loop(), InPlace()])
  assert made.num_frames == 41 and np.abs(made.joints[:, 0, [0, 2]]).max() < 1e-5
  assert np.abs(made.joints[-1] - made.joints[0]).max() < 1e-4, "the closing frame is the first again"
  assert made.meta["control"] == ["loop", "in_place"] and made.meta["velocity"][1] == 0


def test_what_cannot_be_constrained(pipeline):
  with pytest.raises(InputError, match="control for 3 motions and 2 prompts"):
    pipeline(**ASKED, control=[[], [], []])
  with pytest.raises(InputError, match="ends at 1.75 s"):
    pipeline(**ASKED, control=[EffectorTarget("head", [5], [[0, 1, 0]])])
  with pytest.raises(InputError, match="signal of 1 motions for 2"):
    pipeline(**ASKED, control=none(1, 36))


@pytest.mark.slow
def test_the_command_line_asks_the_same(tiny_run, tmp_path, plain, capsys):
  plain[1].save(tmp_path / "other.npz")
  out = tmp_path / "made.npz"
  assert cli.main(["generate", "a person walks", "--model", str(tiny_run), "--seed", "3", "--num-frames", "36",
                   "--num-steps", "3", "--path", "0,0 0,1 1,1", "--keyframe", f"20:{tmp_path / 'other.npz'}@7",
                   "--target", "left_hand@0.5:0.3,1.2,0.3:root", "--out", str(out)]) == 0
  made = np.load(out)["joints"]
  asked = [RootPath([[0, 0], [0, 1], [1, 1]]), Keyframe(plain[1].joints[7], 1.0),
           EffectorTarget("left_hand", [0.5], [[0.3, 1.2, 0.3]], "root")]
  signal = compile(asked, 36, 20.0, made)
  assert signal.given[0, 10, 20].all() and signal.given[0, 20].all()
  for wrong, message in ((["--path", "0,0 1"], "got '1', expected X,Z"),
                      (["--target", "left_hnad@1:0,1,0"], "did you mean left_hand?")):
    with pytest.raises(SystemExit):
      cli.main(["generate", "a person walks", "--model", str(tiny_run), *wrong, "--out", str(out)])
    assert message in capsys.readouterr().err
  for wrong in (["--control", str(tmp_path / "no.json")],):
    assert cli.main(["generate", "a person walks", "--model", str(tiny_run), *wrong, "--out", str(out)]) == 1
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith("motion-jax generate: ")
