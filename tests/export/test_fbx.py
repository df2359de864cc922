"""FBX is written by Blender: how it is found and called. What Blender itself writes is in docs/formats.md."""
import pytest

from motion_jax import export
from motion_jax.utils.errors import InputError
from tests.export.test_bvh import walk

# Called as Blender's Python is: -I SCRIPT MOTION.glb MOTION.fbx FPS.
PROGRAMS = {"python-that-copies": 'cp "$3" "$4"', "blender-that-copies": 'shift 7; cp "$1" "$2"',
            "python-that-fails": "echo no codec >&2; exit 3"}


@pytest.fixture
def blender(tmp_path, monkeypatch):
  def use(name):
    program = tmp_path / name
    if name in PROGRAMS:
      program.write_text(f"#!/bin/sh\n{PROGRAMS[name]}\n")
      program.chmod(0o755)
    monkeypatch.setenv("MOTION_JAX_BLENDER", str(program))
  return use


@pytest.mark.parametrize("name", ["python-that-copies", "blender-that-copies"])
def test_blender_converts_the_glb_of_the_rig(name, blender, tmp_path):
  blender(name)
  export.save(walk(4), tmp_path / "walk.fbx", rig="mixamo")
  assert b"mixamorig:LeftUpLeg" in (tmp_path / "walk.fbx").read_bytes()


@pytest.mark.parametrize("name, sentence", [("python-that-fails", "wrote no .fbx: no codec"), ("none", "no program")])
def test_a_blender_that_fails_is_one_sentence_and_no_file(name, sentence, blender, tmp_path):
  blender(name)
  with pytest.raises(InputError, match=sentence):
    export.save(walk(4), tmp_path / "walk.fbx")
  assert not (tmp_path / "walk.fbx").exists()


def test_without_blender_the_sentence_says_how_to_get_it(monkeypatch, tmp_path):
  monkeypatch.delenv("MOTION_JAX_BLENDER", raising=False)
  monkeypatch.setenv("PATH", str(tmp_path))
  with pytest.raises(InputError, match=r"\[fbx\]"):
    export.check_output(tmp_path / "walk.fbx")
