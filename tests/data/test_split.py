"""Test splits of sentences, and of subjects, that training has not seen."""
import json

import pytest

from motion_jax.data import split
from motion_jax.data.datasets.archive import read_archive
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.data.split import group_of
from motion_jax_studio import cli
from tests.data.test_build import write_archive

SAID = [  # split, subject, sentences
    ("train", "01", ["a person waves the left hand.", "someone bows."]),
    ("train", "02", ["a person walks."]),
    ("val", "02", ["a man walks"]),
    ("test", "01", ["The man waves the right hand", "he bows deeply."]),  # the first is known by its mirror image
    ("test", "03", ["someone walks", "A person bows."]),
    ("test", "03", ["a person kicks."])]


@pytest.fixture
def archive(tmp_path):
  clips = synthetic_clips(0, len(SAID), num_frames=30)
  folder = write_archive(tmp_path / "cmu", clips=clips)
  (folder / "LICENSE").write_text("free")
  path = folder / "captions.jsonl"
  rows = [json.loads(line) | {"split": name, "subject": subject, "text": said}
          for line, (name, subject, said) in zip(path.read_text().splitlines(), SAID)]
  path.write_text("".join(json.dumps(row) + "\n" for row in rows))
  return folder


def test_test_rows_keep_the_sentences_that_training_has_not(archive, tmp_path, capsys):
  assert cli.main(["data", "split", str(archive), "--out", str(tmp_path / "out")]) == 0
  assert "test 2 of 3 rows with 2 sentences" in capsys.readouterr().out
  made, whole = read_archive(tmp_path / "out" / "cmu"), read_archive(archive)
  said = lambda clips, name: [[caption.text for caption in clip.captions] for clip in clips if clip.split == name]
  assert said(made, "test") == [["he bows deeply."], ["a person kicks."]]
  assert all(said(made, name) == said(whole, name) for name in ("train", "val"))
  assert (tmp_path / "out" / "cmu" / "LICENSE").read_text() == "free" and made[0].license == whole[0].license


def test_subjects_are_in_one_split_whatever_the_order_of_rows(archive, tmp_path):
  """The same person of two archives, too; a sentence that train has is in no test row."""
  second = write_archive(tmp_path / "cmu2", clips=synthetic_clips(1, 40, num_frames=30))
  path = second / "captions.jsonl"
  rows = [json.loads(line) | {"subject": f"{i % 10:02}", "text": [f"a person does number {i}."]}
          for i, line in enumerate(path.read_text().splitlines())]
  made = []
  for order in (1, -1):
    path.write_text("".join(json.dumps(row) + "\n" for row in rows[::order]))
    split.split([archive, second], tmp_path / str(order), by="subjects")
    made.append({row["id"]: row for name in ("cmu", "cmu2") for row in map(
        json.loads, (tmp_path / str(order) / name / "captions.jsonl").read_text().splitlines())})
  assert made[0] == made[1]
  splits = {}
  for row in made[0].values():
    splits.setdefault(group_of(row), set()).add(row["split"])
  assert all(len(names) == 1 for names in splits.values())
  assert {name for names in splits.values() for name in names} == {"train", "val", "test"}


@pytest.mark.parametrize("call, message", [
    (lambda folder: split.split([folder / "none"], folder / "out"), "no archive"),
    (lambda folder: split.split([folder, folder], folder / "out"), "two archives of the name 'cmu'"),
    (lambda folder: split.split([folder], folder / "out", by="words"), "captions or subjects"),
    (lambda folder: split.split([folder], folder.parent), "exists; name another --out"),
    (lambda folder: split.split([folder], folder.parent, overwrite=True), "is an archive that is read")])
def test_bad_input(archive, call, message):
  with pytest.raises(ValueError, match=message):
    call(archive)
