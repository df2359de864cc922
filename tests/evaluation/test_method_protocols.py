"""Each further method under each protocol: rows of numbers, or one sentence that says why not."""
import math
import types

import pytest

from motion_jax.control.signal import none
from motion_jax.evaluation import samples
from motion_jax.evaluation.tasks import control, long_horizon
from motion_jax.evaluators.evaluator import fresh_evaluator
from motion_jax.models.abilities import Able
from tests.conftest import some_of
from tests.evaluation.small import judged, small, two_captions

PROTOCOLS = {
    "archives-66": dict(multimodality_motions=2, multimodality_pairs=1, multimodality_replications=1),
    "editing": {}, "reconstruction": {}, "mtt": dict(released_slips=False, layouts=()),
    "long-horizon": dict(sequences=2, segments=2, transition_frames=16), "control": {}}
ROWS = {  # a metric of every row; what a name of a row says behind the model's
    "archives-66": ("fid", [""]), "reconstruction": ("mpjpe", [""]), "mtt": ("tmr_m2t", [""]),
    "long-horizon": ("peak_jerk", [""]),
    "editing": ("fid", ["inpainting", "outpainting", "prefix", "suffix"])}
METHODS = {  # the protocols of each; all others refuse it
    "mdm": ["archives-66", "editing"], "dip": ["archives-66", "long-horizon", "mtt"],
    "mld": ["archives-66", "reconstruction"], "mld frames": ["archives-66"],
    "momask": ["archives-66", "editing", "reconstruction"],
    "t2m_gpt": ["archives-66", "reconstruction"],
    "motionstreamer": ["archives-66", "reconstruction", "long-horizon", "mtt"],
    "mld vae": ["reconstruction"], "momask rvq": ["reconstruction"], "t2m_gpt vq": ["reconstruction"],
    "motionstreamer tae": ["reconstruction"]}
REFUSALS = ("holds a '.*' run, expected one of", "has no '(edit|multi_prompt)' .*; this protocol needs the run of a",
            "holds a '.*' run, which has no tokenizer; give the run of a tokenizer",
            "samples by prompts alone; --sampling exact=true projects its motions")


@pytest.fixture(scope="module")
def data(archive, tmp_path_factory):
  """{protocol: data}: an archive, for timelines with a file of them."""
  path = tmp_path_factory.mktemp("data") / "timelines.txt"
  path.write_text("{} # 0.0 # 3.0\n{} # 3.0 # 6.0\n".format(*two_captions()))
  return {name: [path, archive] if name == "mtt" else [archive] for name in PROTOCOLS}


@pytest.fixture(scope="module")
def judges(evaluator):
  return {name: fresh_evaluator("tmr") if name == "mtt" else evaluator for name in PROTOCOLS}


@pytest.mark.parametrize("method, protocol", some_of(
    [(method, one) for method, all_ in METHODS.items() for one in all_],
    slow=[("mdm", "archives-66"), ("mld vae", "reconstruction")]))
def test_a_method_is_judged(method, protocol, random_run, data, judges, tmp_path):
  folder = random_run(method)
  result = judged([folder], data[protocol], small(protocol, **PROTOCOLS[protocol]), judges[protocol], tmp_path)
  metric, parts = ROWS[protocol]
  rows = [f"{part}: {folder.name}" if part else folder.name for part in parts]
  assert result.row_order == ["real", *rows]
  assert all(math.isfinite(result.rows[row][metric]["mean"]) for row in rows)


@pytest.mark.parametrize("method, protocol", some_of(
    [(method, one) for method, all_ in METHODS.items() for one in PROTOCOLS if one not in all_],
    quick=[("mdm", "mtt"), ("mdm", "reconstruction")], slow=[("mld vae", "archives-66"), ("mld vae", "editing")]))
def test_a_method_is_refused_in_a_sentence(method, protocol, random_run, data, judges, tmp_path):
  with pytest.raises(ValueError, match="|".join(REFUSALS)) as error:
    judged([random_run(method)], data[protocol], small(protocol, **PROTOCOLS[protocol]), judges[protocol], tmp_path)
  assert "\n" not in str(error.value)


def test_a_way_that_a_model_does_not_have_is_refused():
  one = types.SimpleNamespace(name="dip", options=dict(way="chain"), model=types.SimpleNamespace(ways=()))
  with pytest.raises(ValueError, match="got the choice of sampling way 'chain', dip knows stream"):
    long_horizon.ways_of(one)


def test_control_of_a_model_of_prompts_alone_is_refused():
  config = types.SimpleNamespace(stage="mdm.denoiser")
  model = types.SimpleNamespace(can=lambda ability: True, takes_control=False, config=config)
  with pytest.raises(ValueError, match=REFUSALS[-1]):
    control.Control.score(None, types.SimpleNamespace(name="mdm", options={}, model=model), 0)


def test_only_a_guided_network_is_given_the_constraints():
  """The others sample by prompts alone, and what they sample is projected."""
  class Model(Able):
    def generate(self, prompts, frames, **given):
      seen.append((self.takes_control, "control" in given))
      return []

  seen, model = [], Model()
  for model.takes_control in (True, False):
    candidate = types.SimpleNamespace(model=model, options={}, guidance_scale=None)
    control.controlled_generator(candidate, [none(1, 4)], {}, exact=True)(samples.Jobs(["a"], [4], [0], [0]))
  assert seen == [(True, True), (False, False)]
