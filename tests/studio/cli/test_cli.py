"""The command line: files by extension, prompts from files, one line for every error, nothing half-written."""
from types import SimpleNamespace

import numpy as np
import pytest

from motion_jax import export
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.export import bvh
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.cmdm.model import CmdmModel
from motion_studio import cli
from motion_studio.cli import make
from tests.export.test_bvh import bent


@pytest.fixture(scope="module")
def programs(tmp_path_factory):
  """Where the commands of all tests keep their compiled programs."""
  return tmp_path_factory.mktemp("cache")


@pytest.fixture
def generate(tiny_run, programs, monkeypatch):
  monkeypatch.setenv("XDG_CACHE_HOME", str(programs))

  def run(*arguments):
    try:
      return cli.main(["generate", *map(str, arguments), "--model", str(tiny_run)])
    except SystemExit as stopped:  # arguments that are none
      return stopped.code

  return run


def test_generate_writes_what_is_asked(generate, tmp_path, capsys, monkeypatch):
  monkeypatch.setattr(TextToMotionModel, "limits", "It cannot fly.")
  outputs = f"{tmp_path}/a.npz,{tmp_path}/a.npy,{tmp_path}/a.bvh"
  assert generate("a person waves", "--num-frames", 20, "--out", outputs) == 0
  assert np.load(tmp_path / "a.npy", allow_pickle=False).shape == (20, 22, 3)
  with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
    assert file["joints"].shape == (20, 22, 3) and file["features"].shape == (20, 263)
  assert (tmp_path / "a.bvh").read_text().startswith("HIERARCHY")
  printed = capsys.readouterr().out
  assert "parameters on cpu" in printed and printed.splitlines()[-1] == "It cannot fly."
  assert "a.bvh" in printed.splitlines()[-3]


def test_the_same_seed_gives_the_same_file(generate, tmp_path):
  for name in "ab":
    generate("a person waves", "--num-frames", 20, "--seed", 7, "--out", tmp_path / f"{name}.npy")
  assert (tmp_path / "a.npy").read_bytes() == (tmp_path / "b.npy").read_bytes()


@pytest.mark.slow
def test_num_gives_seeds_in_turn(generate, tmp_path):
  generate("a person waves", "--num-frames", 20, "--num-samples", 2, "--seed", 3, "--out", tmp_path / "m.npy")
  generate("a person waves", "--num-frames", 20, "--seed", 4, "--out", tmp_path / "alone.npy")
  assert np.allclose(np.load(tmp_path / "m_1.npy"), np.load(tmp_path / "alone.npy"), atol=1e-5)


def test_bvh_in_the_unit_that_is_asked(tmp_path):
  clip = synthetic_clips(num=1, num_frames=12)[0]
  bvh(clip, tmp_path / "clip.bvh", exact=True)
  for unit, hip_to_knee in (("cm", 37.0), ("m", 0.37)):
    assert cli.main(["render", str(tmp_path / "clip.bvh"), "--out", str(tmp_path / f"{unit}.bvh"),
                     "--bvh-unit", unit, "--exact-joints"]) == 0
    lines = (tmp_path / f"{unit}.bvh").read_text().splitlines()
    knee = next(i for i, line in enumerate(lines) if line.strip() == "JOINT left_knee")
    length = np.linalg.norm([float(number) for number in lines[knee + 2].split()[1:]])
    assert length == pytest.approx(hip_to_knee, rel=0.1)
    assert cli.main(["render", str(tmp_path / f"{unit}.bvh"), "--out", str(tmp_path / f"{unit}.npy")]) == 0
    assert np.abs(np.load(tmp_path / f"{unit}.npy") - clip.joints).max() < 2e-3, "metres again, read from either"


@pytest.mark.slow
def test_many_motions_are_made_in_pieces(generate, tmp_path, monkeypatch):
  generate("a person waves", "--num-frames", 20, "--num-samples", 3, "--max-attempts", 1,
           "--out", tmp_path / "whole.npy")
  monkeypatch.setattr(make, "BATCH_FRAMES", 40)
  seen, one_batch = [], CmdmModel.sample
  monkeypatch.setattr(CmdmModel, "sample", lambda self, prompts, *args, **options: seen.append(
      len(prompts)) or one_batch(self, prompts, *args, **options))
  generate("a person waves", "--num-frames", 20, "--num-samples", 3, "--max-attempts", 1,
           "--out", tmp_path / "parts.npy")
  assert seen == [2, 1]
  for i in range(3):
    assert np.allclose(np.load(tmp_path / f"parts_{i}.npy"), np.load(tmp_path / f"whole_{i}.npy"), atol=1e-5)


def test_more_than_one_run_holds_is_refused(generate, tmp_path, capsys):
  assert generate("a person waves", "--seconds", 3600, "--num-samples", 6, "--out", tmp_path / "a.npz") == 1
  assert "6 motions of 6 hours together, expected at most 5.6 in one run" in capsys.readouterr().err
  (tmp_path / "p.txt").write_text("walks\nruns\n" * 10)
  assert generate(tmp_path / "p.txt", "--num-samples", 10_000, "--out", tmp_path / "a.npz") == 1
  assert "20 prompts with --num-samples 10,000, 200,000 motions; expected at most 10,000" in capsys.readouterr().err
  (tmp_path / "p.txt").write_text("walks\n" * 10_001)
  assert generate(tmp_path / "p.txt", "--out", tmp_path / "a.npz") == 1
  assert "10,001 prompts, expected 1 to 10,000" in capsys.readouterr().err


def test_prompt_files(generate, tmp_path):
  (tmp_path / "p.csv").write_text('prompt,length\n"a person walks, then runs",24\na person waves,\n')
  assert cli.read_prompts(str(tmp_path / "p.csv")) == [("a person walks, then runs", 24), ("a person waves", None)]
  (tmp_path / "p.txt").write_text("a person walks\n\na person runs\n")
  assert generate(tmp_path / "p.txt", "--num-frames", 16, "--out", tmp_path / "t.npy") == 0
  assert np.load(tmp_path / "t_0.npy").shape == (16, 22, 3)


@pytest.mark.parametrize("arguments, words", [
    (["", "--num-frames", "20"], "say what the person does"),
    (["a person walks", "--num-frames", "0"], "--num-frames: got '0', expected a whole number from 1 to 72,000"),
    (["a person walks", "--num-frames", "2"], "length of 2"),
    (["a person walks", "--seconds", "-3"], "--seconds: got '-3', expected a number of seconds over 0, up to 3,600"),
    (["a person walks", "--seconds", "1e9"], "expected"),
    (["a person walks", "--num-samples", "0"], "--num-samples: got '0'"),
    (["a person walks", "--num-samples", "1000000000"],
     "--num-samples: got '1000000000', expected a whole number from 1 to 10,000"),
    (["a person walks", "--context", "100000000000000000000"], "expected a whole number from 1 to 18,000"),
    (["a person walks", "--num-steps", "4294967295"], "expected a whole number from 1 to 1,000"),
    (["a person walks", "--out", "walk.docx"], "docx"),
    (["a person walks", "--out", "walk"], "walk"),
    (["missing.csv"], "no prompt file"),
])
def test_errors_are_one_line_and_leave_nothing(generate, tmp_path, monkeypatch, capsys, arguments, words):
  monkeypatch.chdir(tmp_path)
  assert generate(*arguments) in (1, 2)
  said = capsys.readouterr().err.strip()
  assert words in said and len(said.splitlines()) == 1
  assert not any(tmp_path.iterdir())


def test_an_output_that_cannot_be_written_is_told_first(generate, tmp_path, capsys):
  (tmp_path / "file").write_text("")
  assert generate("a person walks", "--num-frames", 20, "--out", tmp_path / "file" / "a.npz") == 1
  assert "file" in capsys.readouterr().err


def test_an_unknown_model_is_told(capsys):
  assert cli.main(["generate", "a person walks", "--model", "nobody"]) == 1
  assert "nobody" in capsys.readouterr().err


def test_render_shows_files(generate, tmp_path, capsys):
  generate("a person waves", "--num-frames", 20, "--out", f"{tmp_path}/a.npz,{tmp_path}/a.npy,{tmp_path}/a.bvh")
  for kind in ("npz", "npy", "bvh"):
    assert cli.main(["render", str(tmp_path / f"a.{kind}"), "--out", str(tmp_path / f"{kind}.png")]) == 0
    assert (tmp_path / f"{kind}.png").stat().st_size > 1000
  assert cli.main(["render", str(tmp_path / "none.npz")]) == 1
  np.save(tmp_path / "bad.npy", np.full((5, 22, 3), np.nan, np.float32))
  assert cli.main(["render", str(tmp_path / "bad.npy"), "--out", str(tmp_path / "bad.gif")]) == 1
  assert "NaN" in capsys.readouterr().err and not (tmp_path / "bad.gif").exists()


def test_a_mapping_in_every_command_that_reads_motion(tmp_path, capsys):
  """The file that an error asks for is enough to render, describe and build; other commands take the same option."""
  (tmp_path / "mocap").mkdir()
  path = tmp_path / "mocap" / "a.bvh"
  text = bvh(synthetic_clips(num=2, num_frames=60)[1], path).read_text()
  path.write_text(text.replace("left_knee", "Knie links").replace("right_knee", "Knie rechts"))
  out = tmp_path / "a.npz"
  assert cli.main(["render", str(path), "--out", str(out)]) == 1
  error = capsys.readouterr().err
  template = error[error.index("{"):error.index("}") + 1]
  assert template == '{"left_knee": "...", "right_knee": "..."}'
  mapping = tmp_path / "names.json"
  mapping.write_text(template.replace("...", "Knie links", 1).replace("...", "Knie rechts"))
  assert cli.main(["render", str(path), "--out", str(out), "--mapping", str(mapping)]) == 0
  (tmp_path / "mocap" / "captions.csv").write_text("file,caption\na,a person walks\n")
  assert cli.main(["data", "describe", str(path.parent), "--mapping", str(mapping)]) == 0
  assert cli.main(["data", "build", str(path.parent), str(tmp_path / "out"), "--mapping", str(mapping)]) == 0
  capsys.readouterr()
  for command in ("generate", "extend", "edit", "blend", "retrieve"):
    with pytest.raises(SystemExit):
      cli.main([command, "--help"])
    assert "--mapping FILE.json" in capsys.readouterr().out


def test_render_writes_a_list_of_files_and_says_what_rotations_cost(tmp_path, capsys):
  clip = bent(0)
  np.save(tmp_path / "a.npy", clip.joints)
  outputs = f"{tmp_path}/a.npz,{tmp_path}/b.bvh"
  assert cli.main(["render", str(tmp_path / "a.npy"), "--out", outputs, "--out", str(tmp_path / "c.glb")]) == 0
  assert all((tmp_path / name).is_file() for name in ("a.npz", "b.bvh", "c.glb"))
  mean, worst, joint = export.rig_error(clip)
  assert f".bvh and .glb: the skeleton only rotates; joints are {mean:.1f} mm" in (said := capsys.readouterr().out)
  assert f"{worst:.0f} mm at most ({joint}); --exact-joints" in said
  assert cli.main(["render", str(tmp_path / "a.npy"), "--out", f"{tmp_path}/d.bvh", "--exact-joints"]) == 0
  assert "only rotates" not in capsys.readouterr().out
  assert np.abs(export.load(tmp_path / "d.bvh").joints - clip.joints).max() < 5e-4


class _Collection(SimpleNamespace):
  def __len__(self):
    return len(self.ids)


def test_retrieve_writes_a_list_of_files(tmp_path, monkeypatch):
  from motion_jax import retrieval
  collection = _Collection(ids=["a"], seconds=[1.0], captions=[["a person walks"]],
                               nearest_clips=lambda vector, num: [(0.9, 0)])
  monkeypatch.setattr(retrieval, "load", lambda name: SimpleNamespace(embed_text=lambda texts: [None]))
  monkeypatch.setattr(retrieval, "read_collection", lambda *args: collection)
  monkeypatch.setattr(retrieval, "read_clips", lambda *args: [bent(0)])
  assert cli.main(["retrieve", "a person walks", "--data", str(tmp_path), "--out",
                   f"{tmp_path}/n.npz,{tmp_path}/n.bvh"]) == 0
  assert (tmp_path / "n.npz").is_file() and (tmp_path / "n.bvh").is_file()


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


@pytest.mark.parametrize("error, told", [
    (ValueError("a sentence of ours"), "a sentence of ours"), (OSError("no place"), "no place"),
    (MemoryError("Unable to allocate"), "more memory than there is"),
    (RuntimeError("RESOURCE_EXHAUSTED: Out of memory"), "more memory than there is")])
def test_what_the_user_can_mend_is_one_line(monkeypatch, capsys, error, told):
  monkeypatch.setattr("motion_jax.export.load", lambda *_, **__: (_ for _ in ()).throw(error))
  assert cli.main(["render", "a.npy", "--out", "a.npz"]) == 1
  said = capsys.readouterr().err
  assert told in said and len(said.strip().splitlines()) == 1


@pytest.mark.parametrize("error", [KeyError("x"), TypeError("x"), RuntimeError("x"), ZeroDivisionError()])
def test_what_is_the_programs_fault_keeps_its_traceback(monkeypatch, error):
  monkeypatch.setattr("motion_jax.export.load", lambda *_, **__: (_ for _ in ()).throw(error))
  with pytest.raises(type(error)):
    cli.main(["render", "a.npy", "--out", "a.npz"])


@pytest.mark.parametrize("words", [
    ["render", "a" * 300 + ".npz"], ["train", "--config", "a" * 300, "--workdir", "x"], ["data", "doctor", "a" * 300],
    ["render", "in.npz", "--out", "a" * 300 + ".npz"], ["generate", "a" * 300 + ".txt"]])
def test_a_name_longer_than_any_files(words, tmp_path, monkeypatch, capsys):
  monkeypatch.chdir(tmp_path)
  assert cli.main(words) == 1
  said = capsys.readouterr().err.strip().splitlines()[-1]
  assert "longer than a file's may be; give a shorter one" in said or "there is no file in.npz" in said
