"""What tests of utilities share."""
from tests.evaluation.conftest import forks  # noqa: F401
