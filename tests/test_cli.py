"""The command line: files by extension, prompts from files, one line for every error, nothing half-written."""
import numpy as np
import pytest

from motion_jax import cli
from motion_jax.data.synthetic import synthetic_clips
from motion_jax.export import bvh


@pytest.fixture()
def generate(tiny_run, tmp_path, monkeypatch):
  monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))

  def run(*arguments):
    return cli.main(["generate", *map(str, arguments), "--model", str(tiny_run)])

  return run


def test_generate_writes_what_is_asked(generate, tmp_path, capsys):
  assert generate("a person waves", "--frames", 20, "--out", f"{tmp_path}/a.npz,{tmp_path}/a.npy,{tmp_path}/a.bvh") == 0
  assert np.load(tmp_path / "a.npy", allow_pickle=False).shape == (20, 22, 3)
  with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
    assert file["joints"].shape == (20, 22, 3) and file["features"].shape == (20, 263)
  assert (tmp_path / "a.bvh").read_text().startswith("HIERARCHY")
  printed = capsys.readouterr().out
  assert "parameters on cpu" in printed and "a.bvh" in printed.splitlines()[-2]


def test_the_same_seed_gives_the_same_file(generate, tmp_path):
  for name in "ab":
    generate("a person waves", "--frames", 20, "--seed", 7, "--out", tmp_path / f"{name}.npy")
  assert (tmp_path / "a.npy").read_bytes() == (tmp_path / "b.npy").read_bytes()


def test_num_gives_seeds_in_turn(generate, tmp_path):
  generate("a person waves", "--frames", 20, "--num", 2, "--seed", 3, "--out", tmp_path / "m.npy")
  generate("a person waves", "--frames", 20, "--seed", 4, "--out", tmp_path / "alone.npy")
  assert np.allclose(np.load(tmp_path / "m_1.npy"), np.load(tmp_path / "alone.npy"), atol=1e-5)


def test_prompt_files(generate, tmp_path):
  (tmp_path / "p.csv").write_text('prompt,length\n"a person walks, then runs",24\na person waves,\n')
  assert cli.read_prompts(str(tmp_path / "p.csv")) == [("a person walks, then runs", 24), ("a person waves", None)]
  (tmp_path / "p.txt").write_text("a person walks\n\na person runs\n")
  assert generate(tmp_path / "p.txt", "--frames", 16, "--out", tmp_path / "t.npy") == 0
  assert np.load(tmp_path / "t_0.npy").shape == (16, 22, 3)


@pytest.mark.parametrize("arguments, words", [
    (["", "--frames", "20"], "say what the person does"),
    (["a person walks", "--frames", "0"], "length of 0"),
    (["a person walks", "--seconds", "-3"], "length of -60"),
    (["a person walks", "--seconds", "1e9"], "expected"),
    (["a person walks", "--num", "0"], "--num 0"),
    (["a person walks", "--out", "walk.docx"], "docx"),
    (["a person walks", "--out", "walk"], "walk"),
    (["missing.csv"], "no prompt file"),
])
def test_errors_are_one_line_and_leave_nothing(generate, tmp_path, monkeypatch, capsys, arguments, words):
  monkeypatch.chdir(tmp_path)
  assert generate(*arguments) == 1
  said = capsys.readouterr().err.strip()
  assert words in said and len(said.splitlines()) == 1
  assert [path.name for path in tmp_path.iterdir() if path.name != "cache"] == []


def test_an_output_that_cannot_be_written_is_told_first(generate, tmp_path, capsys):
  (tmp_path / "file").write_text("")
  assert generate("a person walks", "--frames", 20, "--out", tmp_path / "file" / "a.npz") == 1
  assert "file" in capsys.readouterr().err


def test_an_unknown_model_is_told(capsys):
  assert cli.main(["generate", "a person walks", "--model", "nobody"]) == 1
  assert "nobody" in capsys.readouterr().err


def test_render_shows_files(generate, tmp_path, capsys):
  generate("a person waves", "--frames", 20, "--out", f"{tmp_path}/a.npz,{tmp_path}/a.npy,{tmp_path}/a.bvh")
  for kind in ("npz", "npy", "bvh"):
    assert cli.main(["render", str(tmp_path / f"a.{kind}"), "--out", str(tmp_path / f"{kind}.png")]) == 0
    assert (tmp_path / f"{kind}.png").stat().st_size > 1000
  assert cli.main(["render", str(tmp_path / "none.npz")]) == 1
  np.save(tmp_path / "bad.npy", np.full((5, 22, 3), np.nan, np.float32))
  assert cli.main(["render", str(tmp_path / "bad.npy"), "--out", str(tmp_path / "bad.gif")]) == 1
  assert "NaN" in capsys.readouterr().err and not (tmp_path / "bad.gif").exists()


def test_data_build_and_doctor(tmp_path, capsys):
  """From joints on disk to a training folder that the doctor finds healthy, and to one that it does not."""
  source = tmp_path / "bvh"
  source.mkdir()
  rows = ["file,caption,split"]
  for i, clip in enumerate(synthetic_clips(0, 5, num_frames=60)):
    bvh(clip, source / f"c{i}.bvh")
    rows.append(f'c{i}.bvh,"{clip.captions[0].text}",{clip.split}')
  (tmp_path / "captions.csv").write_text("\n".join(rows))
  out = tmp_path / "data"
  assert cli.main(["data", "build", str(source), str(out), "--captions", str(tmp_path / "captions.csv")]) == 0
  assert cli.main(["data", "doctor", str(out)]) == 0
  broken = next((out / "new_joint_vecs").glob("*.npy"))
  np.save(broken, np.full_like(np.load(broken), np.nan))
  assert cli.main(["data", "doctor", str(out)]) == 1
  assert "NaN" in capsys.readouterr().out
  assert cli.main(["data", "build", str(source), str(out), "--captions", str(tmp_path / "captions.csv")]) == 1
