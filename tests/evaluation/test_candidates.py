"""Rows of models: their names, and which of the choices of sampling each has."""
import types

import pytest

from motion_jax.evaluation.candidates import Choices, check_options, load_candidates, row_names
from motion_jax.models.abilities import Able
from motion_jax.models.cdamd.options import CdamdSampling
from motion_jax.models.cmdm.options import CmdmSampling


class Model(Able):
  """A model as far as rows go: what it samples by."""
  abilities = ("generate",)

  def __init__(self, folder, options):
    self.folder, self.options, self.config = folder, options, types.SimpleNamespace()

  def sampling(self, **choices):
    return self.options(**{key: value for key, value in choices.items() if value is not None})


@pytest.fixture
def load(tmp_path):
  """Loads runs a, of CMDM, and b, of CDAMD."""
  for name in "ab":
    (tmp_path / name).mkdir()
  return lambda run: Model(run, CmdmSampling if run.name == "a" else CdamdSampling)


def candidates_of(tmp_path, load, choices):
  candidates, left_out = load_candidates([tmp_path / "a", tmp_path / "b"], load, choices, tmp_path)
  return [(one.name, one.options) for one in candidates], left_out


def test_models_of_two_methods_have_rows_of_the_choices_that_they_know(tmp_path, load):
  varied = ({"schedule": "fss"}, {"schedule": "ar"}, {"mask": "bcm"}, {"num_steps": 2})
  rows, left_out = candidates_of(tmp_path, load, Choices(shared={"seed_offset": 1}, varied=varied,
                                                         more=("seed_offset",)))
  assert rows == [(name, {"seed_offset": 1} | one) for name, one in (
      ("a, schedule fss", varied[0]), ("a, schedule ar", varied[1]), ("a, num_steps 2", varied[3]),
      ("b, mask bcm", varied[2]), ("b, num_steps 2", varied[3]))]
  assert len(left_out) == 3 and left_out[0].startswith("No row of b with schedule fss: got the choice of sampling "
                                                       "'schedule'")


def test_a_model_that_knows_none_of_the_variations_has_one_row(tmp_path, load):
  rows, _ = candidates_of(tmp_path, load, Choices(varied=({"schedule": "ar"},)))
  assert rows == [("a", {"schedule": "ar"}), ("b", {})]


def test_choices_that_no_model_knows_are_refused(tmp_path, load):
  with pytest.raises(ValueError, match="got the choice of sampling 'sched'"):
    candidates_of(tmp_path, load, Choices(varied=({"schedule": "ar"}, {"sched": "ar"})))
  model = load(tmp_path / "a")
  check_options("m", model, (), dict(way="chain", num_steps=3), ("way",))  # of the task of long motions alone
  with pytest.raises(ValueError, match="got the choice of sampling 'way', m knows schedule, num_steps"):
    check_options("m", model, (), dict(way="chain"))
  with pytest.raises(ValueError, match="is not sampled"):
    check_options("m", Able(), (2.0,), {})


def test_rows_have_names_of_their_own(tmp_path):
  runs = [str(tmp_path / name) for name in ("real", "a/denoiser", "b/denoiser", "c")]
  for run in runs:
    (tmp_path / run).mkdir(parents=True)
  assert row_names(runs) == [*runs[:3], "c"]
