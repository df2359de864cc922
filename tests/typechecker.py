"""How annotated types are checked in tests: an int may stand for a float, as it may for mypy."""
import beartype

check = beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))
