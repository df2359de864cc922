"""The command line: files by extension, prompts from files, one line for every error, nothing half-written."""
import contextlib
import io
import resource

import numpy as np
import pytest

from motion_jax import export
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.export import bvh
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.results import Motion
from motion_jax_studio import batches, cli
from motion_jax_studio.pipeline import Pipeline
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
      return cli.main(["generate", "--model", str(tiny_run), *map(str, arguments)])
    except SystemExit as stopped:  # arguments that are none
      return stopped.code

  return run


@pytest.fixture(scope="module")
def generated(tiny_run, programs, tmp_path_factory):
  """The folder and the output of a command that generates, with guidance 0."""
  folder, printed = tmp_path_factory.mktemp("generated"), io.StringIO()
  outputs = ",".join(f"{folder}/a.{kind}" for kind in ("npz", "npy", "bvh"))
  with pytest.MonkeyPatch.context() as patch, contextlib.redirect_stdout(printed):
    patch.setenv("XDG_CACHE_HOME", str(programs))
    patch.setattr(TextToMotionModel, "limits", "It cannot fly.")
    assert cli.main(["generate", "a person waves", "--num-frames", "20", "--num-steps", "4", "--guidance-scale", "0",
                     "--without", "pose", "--explain", "--model", str(tiny_run), "--out", outputs]) == 0
  return folder, printed.getvalue()


@pytest.mark.parametrize("name", ["a.npz", "a.npy", "a.bvh", "a.glb", "a.html", "a.png", "a.gif", "a.vrma", "a.usda",
                                  "a.csv", "a.trc", "a.c3d", "a.jpg"])
def test_a_full_disk_is_one_line(tmp_path, capsys, name):
  """The system lets files hold no more than 100 bytes for a while; ezc3d and Pillow's JPEG do not look at it."""
  export.save(synthetic_clips(seed=0, num=1)[0].cut(0, 2), tmp_path / "in.npz")
  limits = resource.getrlimit(resource.RLIMIT_FSIZE)
  resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
  try:
    status = cli.main(["render", str(tmp_path / "in.npz"), "--out", str(tmp_path / name)])
  finally:
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)
  said = capsys.readouterr().err
  assert status == 1 and "no space left on the disk" in said and len(said.splitlines()) == 1
  assert [path.name for path in tmp_path.iterdir()] == ["in.npz"]


def test_generate_writes_its_files_and_says_what_it_did(generated):
  folder, printed = generated
  assert np.load(folder / "a.npy", allow_pickle=False).shape == (20, 22, 3)
  with np.load(folder / "a.npz", allow_pickle=False) as file:
    assert file["joints"].shape == (20, 22, 3) and file["features"].shape == (20, 263)
  assert (folder / "a.bvh").read_text().startswith("HIERARCHY")
  assert "parameters on cpu" in printed and "guidance 0, seed" in printed
  lines = "plan: one action\nsample: one pass of the network\ncleanup: feet pinned, tremor removed, frames 0 to 19, "
  assert lines in printed and "pose" not in printed
  assert printed.splitlines()[-1] == "It cannot fly." and "a.bvh" in printed.splitlines()[-3]


def test_motions_come_in_pieces_with_a_seed_for_each_sample(generate, tmp_path, monkeypatch):
  calls, joints = [], synthetic_clips(num=1, num_frames=20)[0].joints

  def sample(pipeline, prompts, frames, seeds, **_):
    calls.append((prompts, frames, seeds))
    return [Motion(joints, 20.0, meta={}) for _ in prompts]

  monkeypatch.setattr(Pipeline, "__call__", sample)
  monkeypatch.setattr(batches, "BATCH_FRAMES", 40)
  (tmp_path / "p.txt").write_text("a person walks\n\na person runs\n")
  assert generate(tmp_path / "p.txt", "--num-frames", 20, "--num-samples", 3, "--seed", 7, "--no-plan", "--out",
                  tmp_path / "m.npy") == 0
  walk, run = "a person walks", "a person runs"
  assert calls == [([walk, walk], [20, 20], [7, 8]), ([walk, run], [20, 20], [9, 7]), ([run, run], [20, 20], [8, 9])]
  assert sorted(path.name for path in tmp_path.glob("*.npy")) == [f"m_{i}.npy" for i in range(6)]
  calls.clear()
  assert generate("a person walks, then waves", "--out", tmp_path / "a.npy") == 0
  assert calls[0][1:] == ([None], [0]) and calls[0][0][0].summary == "walks | waves", "the pipeline decides on lengths"


def test_more_than_one_run_holds_is_refused(generate, tmp_path, capsys):
  assert generate("a person waves", "--seconds", 3600, "--num-samples", 6, "--out", tmp_path / "a.npz") == 1
  assert "6 motions of 6 hours together, expected at most 5.6 in one run" in capsys.readouterr().err
  (tmp_path / "p.txt").write_text("walks\nruns\n" * 10)
  assert generate(tmp_path / "p.txt", "--num-samples", 10_000, "--out", tmp_path / "a.npz") == 1
  assert "20 prompts with --num-samples 10,000, 200,000 motions; expected at most 10,000" in capsys.readouterr().err


@pytest.mark.parametrize("arguments, words", [
    (["", "--num-frames", "20"], "say what the person does"),
    (["a person walks", "--num-frames", "0"], "--num-frames: got '0', expected a whole number from 1 to 72,000"),
    (["a person walks", "--num-frames", "2"], "length of 2"),
    (["a person walks", "--seconds", "-3"], "--seconds: got '-3', expected a number of seconds over 0, up to 3,600"),
    (["a person walks", "--num-samples", "1000000000"], "expected a whole number from 1 to 10,000"),
    (["a person walks", "--out", "walk.docx"], "docx"),
    (["a person walks", "--out", "walk"], "walk"),
    (["missing.csv"], "no prompt file"), (["a person walks", "--out", "/dev/null/a.npz"], "/dev/null"),
    (["a person walks", "--model", "nobody"], "nobody"),
])
def test_errors_are_one_line_and_leave_nothing(generate, tmp_path, monkeypatch, capsys, arguments, words):
  monkeypatch.chdir(tmp_path)
  assert generate(*arguments) in (1, 2)
  said = capsys.readouterr().err.strip()
  assert words in said and len(said.splitlines()) == 1
  assert not any(tmp_path.iterdir())


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
  assert cli.main(["data", "doctor", str(tmp_path / "out")]) == 0
  capsys.readouterr()
  for command in ("generate", "extend", "edit", "blend", "retrieve"):
    with pytest.raises(SystemExit):
      cli.main([command, "--help-all" if command in ("generate", "extend", "edit") else "--help"])
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
  assert cli.main(["render", str(tmp_path / "d.bvh"), "--out", f"{tmp_path}/e.bvh", "--bvh-unit", "m",
                   "--exact-joints"]) == 0
  assert np.abs(export.load(tmp_path / "e.bvh").joints - clip.joints).max() < 2e-3, "metres again, read from either"


@pytest.mark.parametrize("error, told", [
    (ValueError("a sentence of ours"), "a sentence of ours"), (OSError("no place"), "no place"),
    (MemoryError("Unable to allocate"), "more memory than there is"),
    (RuntimeError("RESOURCE_EXHAUSTED: Out of memory"), "more memory than there is"), (RuntimeError("x"), "")])
def test_what_the_user_can_mend_is_one_line_and_a_fault_of_the_program_keeps_its_traceback(monkeypatch, capsys, error,
                                                                                        told):
  monkeypatch.setattr("motion_jax.export.load", lambda *_, **__: (_ for _ in ()).throw(error))
  if not told:
    with pytest.raises(type(error)):
      cli.main(["render", "a.npy", "--out", "a.npz"])
    return
  assert cli.main(["render", "a.npy", "--out", "a.npz"]) == 1
  said = capsys.readouterr().err
  assert told in said and len(said.strip().splitlines()) == 1


@pytest.mark.parametrize("words", [
    ["render", "a" * 300 + ".npz"], ["data", "doctor", "a" * 300], ["generate", "a" * 300 + ".txt"]])
def test_a_name_longer_than_any_files(words, tmp_path, monkeypatch, capsys):
  monkeypatch.chdir(tmp_path)
  assert cli.main(words) == 1
  assert "longer than a file's may be; give a shorter one" in capsys.readouterr().err.strip().splitlines()[-1]
