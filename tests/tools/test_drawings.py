"""The drawings of docs/papers are those of the code."""
from tools import drawings


def test_the_drawings_are_up_to_date():
  made = drawings.drawings()
  there = {path.name: path.read_text(encoding="utf-8") for path in drawings.OUT.glob("*.svg")}
  assert made == there, "run python tools/drawings.py"
