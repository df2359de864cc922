"""Formats with a version: files of today state it, files without it are of version 1, later ones are refused."""
import json

import numpy as np
import pytest

from motion_jax import control, export
from motion_jax.data import store
from motion_jax.data.clip import Clip
from motion_jax.data.datasets import archive
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.training import checkpoint
from motion_jax.utils.errors import InputError
from motion_jax.utils.format_versions import KEY, check_version
from motion_jax_studio.server import project
from motion_jax_studio.server.limits import Limits
from tests.conftest import load_config


def motion(path, version):
  """A motion's file of this version, None: without one."""
  export.npz(Clip(joints=np.repeat(HUMANML3D.offsets.cumsum(0)[None], 2, 0), fps=20.0), path)
  with np.load(path) as file:
    arrays = dict(file)
  assert arrays.pop(KEY) == 1
  np.savez(path, **arrays, **({} if version is None else {KEY: np.int64(version)}))
  return lambda: export.load(path, check=False)


def run(folder, version):
  folder.mkdir()
  checkpoint.save_config(folder, load_config("cmdm_denoiser", "tiny"))
  path = folder / checkpoint.CONFIG
  fields = json.loads(path.read_text())
  assert fields.pop(KEY) == 1
  path.write_text(json.dumps(fields | ({} if version is None else {KEY: version})))
  return lambda: checkpoint.load_config(folder)


def data_archive(folder, version):
  folder.mkdir()
  np.savez(folder / "motions.npz", names=np.array(["a"]), start=np.array([0, 0]), root=np.zeros((0, 3)),
           local=np.zeros((0, 22, 3)))
  (folder / "captions.jsonl").write_text("")
  (folder / archive.ABOUT).write_text(json.dumps({"license": "CC0 1.0"} | ({} if version is None else {KEY: version})))
  return lambda: archive.read_archive(folder)


KINDS = {"walk.npz": motion, "run": run, "archive": data_archive}


@pytest.mark.parametrize("name", KINDS)
def test_a_file_without_a_version_is_of_the_first(name, tmp_path):
  read_old, read_now = (KINDS[name](tmp_path / f"{version}_{name}", version) for version in (None, 1))
  old, now = read_old(), read_now()
  assert np.array_equal(old.joints, now.joints) if name == "walk.npz" else old == now


@pytest.mark.parametrize("name", KINDS)
def test_a_later_version_is_refused_in_one_sentence(name, tmp_path):
  with pytest.raises(InputError) as error:
    KINDS[name](tmp_path / name, 2)()
  assert str(error.value).endswith(f"{name} is of version 2, this program reads version 1; open it with the version of "
                                   "motion_jax that wrote it, or a later one")


def test_formats_that_always_had_a_version(tmp_path):
  (tmp_path / store.ABOUT).write_text(json.dumps({"format": 2, "identity": {}, "tables": {}}))
  for read in (lambda: store.Store(tmp_path), lambda: control.from_json({"version": 2, "constraints": []}),
               lambda: project.validate({"format": project.FORMAT, "version": 2}, Limits())):
    with pytest.raises(InputError, match="is of version 2, this program reads version 1"):
      read()


@pytest.mark.parametrize("version", [0, -1, True, 1.0, "1", None, [1]])
def test_what_is_no_version(version):
  with pytest.raises(InputError, match="is of version"):
    check_version(version, "a file")
