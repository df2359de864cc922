"""A data set, a representation, an export and a method of another package, found by its entry points alone."""
import sys

import numpy as np
import pytest

import motion_jax as mj
from motion_jax import fit
from motion_jax.data.datasets.registry import DATASETS, find_dataset
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.models import registry
from motion_jax.motion import representations
from motion_jax.utils import plugins
from tests.configs.test_tiny_sizes import traced_training
from tests.models.tiny_method.config import get_config

FILES = {
    "dataset.py": '''
from motion_jax.data.datasets.base import Dataset
from motion_jax.data.datasets.synthetic import synthetic_clips


class Outside(Dataset):
  name = "outside"
  holds = "a file outside.txt"

  def matches(self, folder):
    return (folder / "outside.txt").is_file()

  def clips(self, folder, split=None, faults=None):
    return [clip.replace(split="train") for clip in synthetic_clips(num=6, num_frames=64)]
''',
    "layout.py": '''
from motion_jax.motion.representations.coordinates import COORDINATES, Coordinates

OTHER = Coordinates("other_coordinates", COORDINATES.skeleton, COORDINATES.parts, COORDINATES.full)
''',
    "points.py": '''
import pathlib


def points(clip, path, digits=3):
  path = pathlib.Path(path)
  path.write_text("\\n".join(" ".join(f"{x:.{digits}f}" for x in frame.ravel()) for frame in clip.joints))
  return path
''',
    "broken.py": "import a_package_that_is_not_there\n",
    "later.py": '''
from motion_jax.data.datasets.registry import DATASETS

DATASETS["later"] = DATASETS["outside"]
''',
}
ENTRY_POINTS = """
[motion_jax.datasets]
outside = outside_of_motion_jax.dataset:Outside
[motion_jax.representations]
other_coordinates = outside_of_motion_jax.layout:OTHER
[motion_jax.exports]
.points = outside_of_motion_jax.points:points
.broken = outside_of_motion_jax.broken:nothing
[motion_jax.methods]
tiny = tests.models.tiny_method
"""


@pytest.fixture
def outside(tmp_path, monkeypatch):
  """The package, as an installer leaves it in a folder of sys.path; it takes itself away again."""
  package, about = tmp_path / "outside_of_motion_jax", tmp_path / "outside_of_motion_jax-1.0.dist-info"
  package.mkdir()
  about.mkdir()
  for name, text in {"__init__.py": "", **FILES}.items():
    (package / name).write_text(text)
  (about / "METADATA").write_text("Metadata-Version: 2.1\nName: outside-of-motion-jax\nVersion: 1.0\n")
  (about / "entry_points.txt").write_text(ENTRY_POINTS)
  monkeypatch.syspath_prepend(tmp_path)
  yield tmp_path
  for table, names in ((DATASETS, ["outside", "later"]), (representations.LAYOUTS, ["other_coordinates"]),
                       (mj.export.WRITERS, [".points"]), (registry.METHODS, ["tiny"])):
    for name in names:
      table.pop(name, None) if name in table else None
  for name in [name for name in sys.modules if name.startswith("outside_of_motion_jax")]:
    del sys.modules[name]


@pytest.mark.slow
def test_another_package_is_found_trained_loaded_and_written(outside):
  folder = outside / "data"
  folder.mkdir()
  (folder / "outside.txt").write_text("")
  assert find_dataset(folder).name == "outside" and "outside" in DATASETS and "outside" in list(DATASETS)

  joints = synthetic_clips(num=2, num_frames=40)[1].joints
  np.testing.assert_array_equal(*(mj.motion.to_features(joints, name) for name in ("other_coordinates", "coordinates")))
  config = get_config().unlock()
  config.data.update(name="outside", folder=str(folder), layout="other_coordinates")
  config.model.features = 66
  assert int(fit.run(config.lock(), outside / "run").step) == 2
  motion = mj.load(outside / "run").generate("a person walks", 24, seeds=[0])[0]
  written = mj.export.save(motion, outside / "motion.points", digits=4)
  np.testing.assert_allclose(np.loadtxt(written[0]).reshape(24, 22, 3), motion.joints, atol=1e-4)


def test_a_module_that_a_config_names_adds_to_the_tables(outside, monkeypatch):
  config = get_config().unlock()
  config.data.module = "outside_of_motion_jax.later"
  (outside / "outside.txt").write_text("")
  config.data.update(name="later", folder=str(outside))
  monkeypatch.setitem(registry.METHODS, "tiny", "tests.models.tiny_method")
  monkeypatch.setattr(fit.loop, "train", traced_training)
  fit.run(config, outside / "run")
  assert DATASETS["later"] is DATASETS["outside"]
  config.data.module = "outside_of_motion_jax.not_there"
  with pytest.raises(ValueError, match="got the module 'outside_of_motion_jax.not_there' in the config.*PYTHONPATH"):
    plugins.import_modules(config)


def test_a_broken_entry_point_is_named_when_it_is_used_and_not_before(outside):
  assert ".broken" in mj.export.WRITERS and ".npz" in mj.export.WRITERS
  with pytest.raises(ImportError, match="outside_of_motion_jax.broken:nothing, the entry point '.broken' of "
                                        "motion_jax.exports; update or uninstall"):
    mj.export.WRITERS[".broken"]
