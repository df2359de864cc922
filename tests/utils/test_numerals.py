"""Numbers on the command line: each flag that takes one refuses what is no number, not finite or beyond all bounds."""
import argparse

import pytest

from motion_jax.utils.numerals import NumberError, checked, real, whole
from motion_jax_studio.cli import evaluate
from tests.studio.cli.test_flags import FLAGS

NO_NUMERIC_FLAGS = ("--name", "--without", "--path", "--keyframe", "--target", "--keep-parts", "--size")
NO_NUMBERS = ("nan", "inf", "-inf", "1e400", "-1e400", "٣", "²", "1_000", "0x10", "", "ten", "1,5", "9" * 5000, "--")


def test_every_numeric_flag_has_bounds():
  numeric = [(prog, option, action) for prog, option, action in FLAGS
             if action.type is not None and option not in NO_NUMERIC_FLAGS]
  assert len(numeric) > 30 and ("motion-jax generate", "--num-samples") in [given[:2] for given in numeric]
  for prog, option, action in numeric:
    assert action.type not in (int, float), f"{prog} {option} takes any number"
    for text in (*NO_NUMBERS, "1e308", "-1e300"):
      expected = "expected (a (whole )?number|true or false|steps A:B|three numbers X,Y,Z)"
      with pytest.raises(argparse.ArgumentTypeError, match=expected) as error:
        action.type(text)
      assert len(str(error.value)) < 200
  # A flag whose default is a number has a reader of numbers.
  assert all(action.type for _, _, action in FLAGS if type(action.default) in (int, float))


def test_readers():
  assert whole(1, 9)(" 7 ") == 7 and real()("1e-3") == 1e-3 and real()(".5") == 0.5 and whole()("-3") == -3
  with pytest.raises(NumberError, match="got '0', expected a whole number from 1 to 9"):
    whole(1, 9)("0")
  with pytest.raises(ValueError, match="expected a number"):
    evaluate.options_of(["num_steps=inf"])
  with pytest.raises(NumberError, match="expected a number of seconds over 0, up to 3,600; .* written 1.5"):
    real(above=0, high=3600, unit="seconds")("1,5")
  for text in ("0", "-0.0"):
    with pytest.raises(NumberError, match="over 0"):
      real(above=0)(text)


@pytest.mark.parametrize("value", [10**20, -1, 2.5, float("nan"), float("inf"), "x", None, 10**400])
def test_numbers_from_python(value):
  with pytest.raises(ValueError, match="got num_steps .* expected a whole number from 1 to 1,000"):
    checked(value, 1, 1000, "num_steps")
