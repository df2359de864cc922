"""With which settings a run may be resumed."""
import pytest

from motion_jax.training import setup
from tests.conftest import load_config


def test_a_run_is_resumed_only_with_its_own_settings():
  """What may change is how long it lasts, when it cools down, and where the data lies."""
  def check(part="optimizer", **changes):
    config = load_config("cmdm_tokenizer", "tiny")
    config[part].update(changes)
    setup.check_config(config, load_config("cmdm_tokenizer", "tiny"))

  for change in (dict(learning_rate=1.0), dict(beta1=0.5), dict(schedule="cosine"), dict(warmup_steps=9)):
    with pytest.raises(ValueError, match="another optimizer"):
      check(**change)
  check(cooldown_steps=7)
  check("train", num_steps=9)
  check("data", folder="elsewhere")
  with pytest.raises(ValueError, match="another model"):
    check("model", width=8)


def test_a_run_resumes_in_a_version_with_more_fields():
  then = {"loss": {"align": 0.1}}
  assert not list(setup.changes(then, {"loss": {"align": 0.1, "new": 0.0}, "data": {"augment": {"stepping": 0.0}}}))
  assert list(setup.changes(then, {"loss": {"align": 0.1, "new": 0.5}})) == [("loss.new", None, 0.5)]
  assert list(setup.changes(then, {"loss": {}, "data": {"augment": {"stepping": 0.2}}})) == [
      ("data.augment.stepping", None, 0.2), ("loss.align", 0.1, None)]
