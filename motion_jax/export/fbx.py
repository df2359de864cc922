"""FBX, by Blender: no library that may be shipped writes it, so a .glb is made and Blender converts it.

Blender is the package `bpy` (extra `fbx`), or what the environment variable MOTION_JAX_BLENDER names: an installed
Blender, or a Python that has bpy; else the `blender` on the PATH. It runs as a process of its own.
"""
import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

from motion_jax.export import blender_script
from motion_jax.export.glb import glb
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError
from motion_jax.utils.install import pip_install

VARIABLE = "MOTION_JAX_BLENDER"
_SECONDS = 600


def fbx(clip, path, exact=False, rig=None, t_pose=False, name=None) -> pathlib.Path:
  """Writes a clip as .fbx: armature, mannequin and one animation, a key per frame, metres, y up.

  rig, exact, t_pose, name: as of `glb`. Raises InputError where there is no Blender, or where it fails.
  """
  command = find_blender()
  with tempfile.TemporaryDirectory() as folder, atomic_path(path) as temporary:
    glb_file = glb(clip, pathlib.Path(folder) / "motion.glb", exact, rig, t_pose, name)
    result = pathlib.Path(folder) / "motion.fbx"
    try:
      done = subprocess.run([*command, str(glb_file), str(result), repr(float(clip.fps))], capture_output=True,
                            text=True, errors="replace", timeout=_SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
      raise InputError(f"{command[0]} did not convert the motion to .fbx: {error}; {VARIABLE} names another Blender"
                       ) from None
    if done.returncode or not result.is_file():
      last = (done.stderr.strip() or done.stdout.strip() or "no message").splitlines()[-1]
      raise InputError(f"Blender ({command[0]}) wrote no .fbx: {last[:200]}; {VARIABLE} names another Blender")
    shutil.copyfile(result, temporary)
  return pathlib.Path(path)


def find_blender() -> list[str]:
  """The command that runs `blender_script` in Blender. Raises InputError where there is none."""
  script, named = blender_script.__file__, os.environ.get(VARIABLE, "")
  if not named and importlib.util.find_spec("bpy") is not None:
    named = sys.executable
  program = shutil.which(named or "blender")
  if program is None:
    raise InputError(
        f"got {VARIABLE}={named}, which is no program; name a Blender or a Python that has bpy" if named else
        f".fbx files are written by Blender: set {VARIABLE} to an installed Blender or to a Python that has bpy, or "
        f"add bpy here, {pip_install('fbx')}; most programs also read .glb")
  if "python" in pathlib.Path(program).name.lower():
    return [program, "-I", script]  # without the current folder and this one, whose files have names of modules
  return [program, "--background", "--factory-startup", "--python-exit-code", "1", "--python", script, "--"]
