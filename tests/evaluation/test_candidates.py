"""Which rows models have where choices of sampling vary."""
import pytest

from motion_jax import loading
from motion_jax.evaluation.candidates import Choices, load_candidates


def test_models_of_two_methods_have_rows_of_the_choices_that_they_know(tiny_run, tiny_generator, tmp_path):
  runs = [tiny_run, tiny_generator]
  varied = ({"schedule": "fss"}, {"schedule": "ar"}, {"mask": "bcm"}, {"num_steps": 2})
  candidates, left_out = load_candidates(runs, loading.load, Choices(shared={"seed_offset": 1}, varied=varied,
                                                                     more=("seed_offset",)), tmp_path)
  names = [one.name for one in candidates]
  assert names == [f"{tiny_run.name}, schedule fss", f"{tiny_run.name}, schedule ar", f"{tiny_run.name}, num_steps 2",
                   f"{tiny_generator.name}, mask bcm", f"{tiny_generator.name}, num_steps 2"]
  assert candidates[0].options == {"seed_offset": 1, "schedule": "fss"}
  assert len(left_out) == 3 and left_out[0].startswith(f"No row of {tiny_generator.name} with schedule fss: got the "
                                                       "choice of sampling 'schedule'")


def test_a_model_that_knows_none_of_the_variations_has_one_row(tiny_run, tiny_generator, tmp_path):
  candidates, _ = load_candidates([tiny_run, tiny_generator], loading.load, Choices(varied=({"schedule": "ar"},)),
                                  tmp_path)
  assert [(one.name, one.options) for one in candidates] == [(tiny_run.name, {"schedule": "ar"}),
                                                             (tiny_generator.name, {})]


def test_a_choice_that_no_model_knows_is_refused(tiny_run, tiny_generator, tmp_path):
  with pytest.raises(ValueError, match="got the choice of sampling 'sched'"):
    load_candidates([tiny_run, tiny_generator], loading.load, Choices(varied=({"schedule": "ar"}, {"sched": "ar"})),
                    tmp_path)
