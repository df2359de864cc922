"""Long work says what it does: within a second, and after every two seconds of silence."""
import threading

from motion_jax.utils import progress


def test_parts_are_reported_inside_one_another_and_to_their_own_thread():
  work = progress.Work()
  with progress.part("nobody follows"):
    pass
  with progress.follow(work):
    with progress.part("making motions"):
      progress.count(1, 4, "motion")
      assert str(work) == "making motions, motion 2 of 4"
      with progress.part("compiling"):
        assert str(work) == "compiling"
      assert work.state()["done"] == 1 and work.state()["of"] == 4
    for item in progress.each("abc", "drawing", unit="frame"):
      assert str(work) == f"drawing, frame {'abc'.index(item) + 1} of 3"
    other = threading.Thread(target=lambda: progress.count(9, 9, "of another thread"))
    other.start()
    other.join()
  assert work.state()["doing"] == "" and work.done == 0


def test_the_first_line_comes_within_a_second_and_later_ones_after_silence(monkeypatch):
  monkeypatch.setattr(progress, "FIRST", 0.8)
  work = progress.Work()
  work.began = 100.0
  lines = progress.Lines(work)
  assert lines.due(101.0) is None  # nothing runs
  work.doing = "reading the model"
  assert lines.due(100.5) is None and lines.due(100.9) == "working: reading the model (1 s)"
  work.doing = "compiling"
  assert lines.due(102.0) is None and lines.due(103.0) == "working: compiling (3 s)"
  assert lines.due(105.5) is None  # the same part says less often that it still runs
  assert lines.due(108.1) == "working: compiling (8 s)"
