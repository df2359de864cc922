"""The table of actions that archives show, and of those that no clip shows."""
from motion_jax.data.datasets.synthetic import synthetic_clips
from tests.evaluation.test_run import write_archive
from tools import shown_actions


def test_actions_are_counted_by_archive(tmp_path):
  """Of train clips, by their captions and what kinematics add to these."""
  clips = synthetic_clips(0, 11, 70)
  write_archive(tmp_path / "one", [clip.replace(split="train") for clip in clips])
  write_archive(tmp_path / "two", [clip.replace(split="train" if index else "test") for index, clip in
                                   enumerate(clips[7:9])])
  found = shown_actions.counts([tmp_path / "one", tmp_path / "two"])
  assert found["wave"] == {"one": 2, "two": 1} and found["squat"]["one"] == 1 and not found["crawl"].total()
  said = shown_actions.table(found)
  assert "| wave | 3 | 2 | 1 |" in said and "No clip shows: " in said and "crawl" in said.splitlines()[-1]
