"""How annotated types are checked in tests: numpy's numbers stand for Python's, and an int for a float, as for mypy."""
import beartype
import numpy as np

check = beartype.beartype(conf=beartype.BeartypeConf(hint_overrides=beartype.FrozenDict({
    int: int | np.integer, float: float | int | np.number, bool: bool | np.bool_})))
