"""A path is done before what its sentence does at a place; where that cannot be, a note says so."""
import numpy as np
import pytest

from motion_jax import load
from motion_jax.control.constraints import InPlace, RootPath
from motion_jax_studio import Pipeline, constraining
from motion_jax_studio.language import parse
from motion_jax_studio.posing import path_ends
from tests.studio.planning.test_sequencing import Lengths
from tests.studio.test_constraining import Refusing

PATH = RootPath([[0, 0], [0, 1.5], [0, 3.0]])  # 2.5 s at walking pace


@pytest.fixture(scope="module")
def model(tiny_run):
  return load(tiny_run)


def test_which_actions_lead_along_a_path():
  for prompt, going in (
      ("a person walks forward, then sits down", 1), ("someone runs, then bows and waves", 1),
      ("a person walks forward, then turns left and sits down", 2), ("he walks, stops and waves the right hand", 1),
      ("a person walks, then waves, then walks", 3), ("a person sits down, then waves", 2),
      ("she walks while waving, then kneels", 1), ("a person jumps, then runs", 2)):
    assert path_ends.moving_segments(parse(prompt)) == going, prompt


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the model does not know", "ignore:. attempts", "ignore:.*has (not )?learned",
                            "ignore:.*misses", "ignore:.*cannot")
def test_sitting_down_after_a_walk_is_done_at_the_end_of_the_path(model):
  pipeline = Pipeline(model)
  pipeline.planner = planner = Lengths(model, lambda prompt: 60)
  plan = planner.plan("a person walks, then sits down")
  frames = lambda *plan: constraining.implied_frames(planner, [PATH], *plan)
  assert frames(plan) == 51 + 60 == frames() + 60
  made = pipeline(plan, seed=0, control=PATH, max_attempts=1, num_steps=3, lag=2)
  border = round(made.captions[0].end * model.fps)
  there = np.linalg.norm(made.joints[:, 0, [0, 2]] - [0, 3.0], axis=-1)
  arrives = int(np.argmin(there))
  assert made.num_frames == 111 and 36 <= border <= 72 and border <= arrives <= border + 30
  assert there[arrives] < 0.02 and there[border - 24] > 0.5 and "note" not in made.meta


def test_what_is_done_on_the_way_has_a_note():
  for prompt, control, noted in (
      ("a person sits down", PATH, True), ("a man kneels while waving", PATH, True),
      ("a person walks forward, then sits down", PATH, False), ("a person walks forward", PATH, False),
      ("a person sits down", RootPath([[0, 0], [0, 0.2]]), False), ("a person sits down", InPlace(), False),
      ("a person sits down", RootPath([[0, 0], [0, 2]], [0, 3]), False)):
    note = path_ends.path_note(parse(prompt), [control])
    assert ("is done on the way" in note) == noted == bool(note), prompt


def test_the_note_is_a_warning_before_anything_is_sampled(model):
  with pytest.warns(UserWarning, match="so 'sits down' is done on the way"), pytest.raises(pytest.fail.Exception):
    Pipeline(Refusing(model))("a person sits down", seed=0, control=PATH)
