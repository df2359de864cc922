"""Timelines are read line by line, and overlapping intervals become captions that follow each other."""
import pytest

from motion_jax.data.timelines import Interval, is_timeline, read_timelines, single_track

TEXT = """walking in a circle # 0.0 # 6.0 # legs
raising both hands in the air # 2.0 # 5.0 # right hand # left arm

sitting down # 3.5 # 5.5 # legs # torso
"""


def test_timelines_are_read(tmp_path):
  (tmp_path / "t.txt").write_text(TEXT)
  first, second = read_timelines(tmp_path / "t.txt")
  assert first == [Interval("walking in a circle", 0, 6, ("legs",)),
                   Interval("raising both hands in the air", 2, 5, ("right arm", "left arm"))]
  assert second == [Interval("sitting down", 0, 2, ("legs", "spine"))]  # each begins at 0
  assert is_timeline(TEXT) and not is_timeline("a person walks\na person runs")


def test_overlaps_become_one_caption():
  walk, raise_ = Interval("walking", 0, 6), Interval("raising hands.", 2, 5)
  assert single_track([raise_, walk]) == [("walking", 2), ("walking and raising hands", 3), ("walking", 1)]
  assert single_track([walk]) == [("walking", 6)]


def test_gaps_and_crumbs_go_to_a_neighbour():
  assert single_track([Interval("walk", 0, 2), Interval("sit", 3, 5)]) == [("walk", 3), ("sit", 2)]
  track = single_track([Interval("walk", 0, 2.2), Interval("sit", 2, 5)])  # 0.2 s of both
  assert [caption for caption, _ in track] == ["walk", "sit"] and track[1][1] == pytest.approx(3)
  assert single_track([Interval("walk", 0, 2), Interval("walk", 2, 4)]) == [("walk", 4)]


@pytest.mark.parametrize("line, words", [
    ("walking", "caption # start # end"), ("walk # 0 # x # legs", "expected a number of seconds"),
    ("walk # 3 # 2", "after its"), ("walk # 0 # 2 # tail", "'tail'"), ("# 0 # 2", "caption"), ("", "no timeline"),
    ("walk # 0 # inf", "got 'inf'")])
def test_wrong_lines_are_told(tmp_path, line, words):
  (tmp_path / "t.txt").write_text(line + "\n")
  with pytest.raises(ValueError, match=words):
    read_timelines(tmp_path / "t.txt")
