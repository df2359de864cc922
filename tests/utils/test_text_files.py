"""Text files as Excel, Windows and editors write them: what is in them comes out, or file and line are named."""
import numpy as np
import pytest

from motion_jax.data import build, timelines
from motion_jax.data.datasets import caption_lines, humanml3d
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.data.mocap.bvh import bvh_clip
from motion_jax.data.mocap.files import read_mapping
from motion_jax.export import bvh
from motion_jax.utils import text_files
from motion_jax_studio.cli.prompts import read_lines

SENTENCE = "eine Übung – “langsam”"


def read_prompts(path, fps=20.0):
  return [(line.prompt, line.frames(fps)) for line in read_lines(path)]


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "utf-32"])
@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_encodings(tmp_path, encoding, end):
  (tmp_path / "a.txt").write_bytes(end.join(["a person walks", SENTENCE, ""]).encode(encoding))
  assert read_prompts(str(tmp_path / "a.txt")) == [("a person walks", None), (SENTENCE, None)]


def test_prompts_of_momask(tmp_path):
  """text#80 is four seconds, whatever the model's rate; text#NA says nothing; any other # is the sentence's own."""
  path = tmp_path / "p.txt"
  path.write_text("a person walks forward#80\na person waves#NA\na man stands on spot #3\nhe counts to #\n#12\n")
  rows = [("a person walks forward", 80), ("a person waves", None), ("a man stands on spot #3", None),
          ("he counts to #", None), ("#12", None)]
  assert read_prompts(str(path)) == rows
  assert read_prompts(str(path), fps=12.5)[0] == ("a person walks forward", 50)
  assert read_prompts("a person walks#80") == [("a person walks#80", None)]
  path.write_text("a person walks#80000\n")
  with pytest.raises(ValueError, match="p.txt line 1: in the length after #: got .*80000"):
    read_prompts(str(path))


def test_windows_1252_is_a_guess_with_a_warning(tmp_path):
  (tmp_path / "a.txt").write_bytes(f"a person walks\r\n{SENTENCE}".encode("cp1252"))
  with pytest.warns(UserWarning, match="a.txt is not UTF-8 .line 2., read as Windows-1252"):
    assert read_prompts(str(tmp_path / "a.txt"))[1] == (SENTENCE, None)


@pytest.mark.parametrize("text", ["café", "x,y;Ä", "ü", "naïve", "un homme s’assoit à côté d’une chaise"])
def test_short_texts_in_windows_1252(tmp_path, text):
  """Too short to guess by letters: charset-normalizer reads the first two as Chinese."""
  (tmp_path / "a.txt").write_bytes(text.encode("cp1252"))
  with pytest.warns(UserWarning, match="a.txt is not UTF-8 .line 1., read as Windows-1252"):
    assert text_files.read_text(tmp_path / "a.txt") == text


@pytest.mark.parametrize("name", ["x" * 241, "ü" * 121, "a/b", "..\\a", "a\0b", ""])
def test_names_that_no_file_has(tmp_path, name):
  with pytest.raises(ValueError, match="train.txt line 1: got the name .*expected that of a file"):
    text_files.file_stem(name, "train.txt line 1")
  if name and "\0" not in name:
    (tmp_path / "train.txt").write_text(f"000001\n{name}\n", encoding="utf-8")
    with pytest.raises(ValueError, match="train.txt line 2: got the name"):
      humanml3d.read_ids(tmp_path, "train")


@pytest.mark.parametrize("data, message", [
    (b"a person walks\n\xed\xa0\x80 half", "a.txt line 2: byte 0xed is no UTF-8"),
    (b"\xff\xfea\x00\n\x00\x00\xd8b\x00", "a.txt line 2: byte 0x00 is no UTF-16"),
    (b"walks\nru\x00ns\n", "a.txt line 2: character 0x00 is no text"),
    (b"", "holds no prompt"), (b"\xef\xbb\xbf", "holds no prompt"), (b"\r\n \r\n", "holds no prompt"),
])
def test_what_is_no_text(tmp_path, data, message):
  (tmp_path / "a.txt").write_bytes(data)
  with pytest.raises(ValueError, match=message) as error:
    read_prompts(str(tmp_path / "a.txt"))
  assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", [
    'prompt;length\r\n"a person walks; then, runs";24\r\nwalks, then sits;\r\n;;\r\n',
    'sep=;\r\nprompt;length\r\n"a person walks; then, runs";24\r\nwalks, then sits\r\n',
    'Prompt,Frames\n"a person walks; then, runs",24\n"walks, then sits",\n\n\n',
    '"a person walks;\nthen, runs",24\n"walks, then sits"\n',
])
def test_tables_of_prompts(tmp_path, text):
  (tmp_path / "p.csv").write_bytes(text.encode("utf-8-sig"))
  assert read_prompts(str(tmp_path / "p.csv")) == [("a person walks; then, runs", 24), ("walks, then sits", None)]


@pytest.mark.parametrize("text, message", [
    ("prompt,length\nwalks,24\nwalks, then sits,30\n", "line 3: .*got 'then sits', expected a whole number of frames"),
    ("walks,24\nruns,٣\n", "p.csv line 2: in the length: got '٣'"),
    ('walks,24\n"runs,25\nsits,26\n', "p.csv line 2: .*quote"), ("walks,24\n,25\n", "line 2: no prompt"),
    ("walks,24\n" + "x" * 200_000 + ",5\n", "p.csv line 2: field larger"),
])
def test_lines_that_are_no_prompts(tmp_path, text, message):
  (tmp_path / "p.csv").write_text(text)
  with pytest.raises(ValueError, match=message):
    read_prompts(str(tmp_path / "p.csv"))


def test_captions_as_excel_writes_them(tmp_path):
  for end, encoding in ((".csv", "cp1252"), (".csv", "utf-16"), (".tsv", "utf-16")):
    mark = "\t" if end == ".tsv" else ";"
    rows = ["File;Caption;Start;End;Split", "walk.bvh;geht über die Straße, langsam;0,5;2,25;test", ";;;;"]
    (tmp_path / f"c{end}").write_bytes("\r\n".join(row.replace(";", mark) for row in rows).encode(encoding))
    row, = build.read_captions(tmp_path / f"c{end}")
    assert (row["file"], row["caption"]) == ("walk.bvh", "geht über die Straße, langsam")
    assert (row["start"], row["end"], row["split"]) == (0.5, 2.25, "test")


def test_other_readers_of_texts(tmp_path):
  """Captions, timelines, mappings and motions may be UTF-16; their numbers are plain ones."""
  (tmp_path / "a.txt").write_bytes(f"{SENTENCE}#eine/DET#0.0#0.0".encode("utf-16"))
  assert caption_lines.read_texts(tmp_path / "a.txt")[0].caption == SENTENCE
  (tmp_path / "t.txt").write_bytes(f"{SENTENCE} # 0.0 # 2.0\r\n".encode("utf-16"))
  assert timelines.read_timelines(tmp_path / "t.txt")[0][0].text == SENTENCE
  (tmp_path / "m.json").write_bytes('{"pelvis": "Hüfte"}'.encode("utf-16"))
  assert read_mapping(str(tmp_path / "m.json")) == {"pelvis": "Hüfte"}
  bvh(synthetic_clips(num=1, num_frames=12)[0], tmp_path / "a.bvh")
  (tmp_path / "b.bvh").write_bytes((tmp_path / "a.bvh").read_text().encode("utf-16"))
  np.testing.assert_array_equal(bvh_clip(tmp_path / "b.bvh").joints, bvh_clip(tmp_path / "a.bvh").joints)
  (tmp_path / "a.txt").write_text("walks#walk/VERB#0.0#1e308\n")
  with pytest.raises(ValueError, match="a.txt line 1: in a time tag: got '1e308'"):
    caption_lines.read_texts(tmp_path / "a.txt")


@pytest.mark.slow
def test_a_table_without_end_is_refused(tmp_path):
  """A million rows are the most, of which each takes memory."""
  rows = 1_000_000
  (tmp_path / "a.csv").write_text("sep=,\n" + "a\n" * (rows + 1))
  with pytest.raises(ValueError, match="a.csv has more than 1,000,000 rows; cut it in parts"):
    text_files.read_table(tmp_path / "a.csv")


def test_a_text_of_too_many_bytes_is_not_read(tmp_path):
  (tmp_path / "a.txt").write_text("walks")
  assert text_files.read_lines(tmp_path / "a.txt", largest=5) == ["walks"]
  with pytest.raises(ValueError, match="a.txt has 0 MiB, expected a story of at most 0"):
    text_files.read_text(tmp_path / "a.txt", "story", largest=4)


def test_lines_end_where_files_say(tmp_path):
  (tmp_path / "a.txt").write_text("walks\u2028on\x0band\x85on\nruns", encoding="utf-8")
  assert text_files.read_lines(tmp_path / "a.txt") == ["walks\u2028on\x0band\x85on", "runs"]
