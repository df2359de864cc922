"""The known data sets, those of other packages included, and detection of the data set of a folder."""
import pathlib
import shlex

from motion_jax.data.datasets.archive import Archive
from motion_jax.data.datasets.babel import Babel
from motion_jax.data.datasets.base import Dataset
from motion_jax.data.datasets.humanml3d import HumanML3D
from motion_jax.data.datasets.records import Records
from motion_jax.data.datasets.snapmogen import SnapMoGen
from motion_jax.data.datasets.synthetic import Synthetic
from motion_jax.data.mocap.files import READERS
from motion_jax.utils.nearest import did_you_mean
from motion_jax.utils.plugins import Registry

# The first that matches a folder reads it.
DATASETS: Registry[Dataset] = Registry("motion_jax.datasets", {dataset.name: dataset for dataset in (
    Archive(),
    HumanML3D(),
    SnapMoGen(),
    Babel(),
    Records(),
    Synthetic(),
)})


def get_dataset(name) -> Dataset:
  """A data set by its name. Raises ValueError for an unknown name."""
  if name not in DATASETS:
    raise ValueError(f"got data.name {name!r}{did_you_mean(name, DATASETS)}, expected one of {', '.join(DATASETS)}")
  return DATASETS[name]


def find_dataset(folder) -> Dataset | None:
  """The data set whose files a folder holds, or None."""
  folder = pathlib.Path(folder)
  return next((dataset for dataset in DATASETS.values() if dataset.in_folders and dataset.matches(folder)), None)


def dataset_of(folder) -> Dataset:
  """The data set whose files a folder holds. Raises FileNotFoundError if there is none."""
  folder, dataset = pathlib.Path(folder), find_dataset(folder)
  if dataset is not None:
    return dataset
  if not folder.is_dir():
    raise FileNotFoundError(f"there is no folder {folder}; give a data folder, such as one that `motion-jax data "
                            "build` made")
  files = [path for path in folder.rglob("*") if path.suffix.lower() in READERS]
  raise FileNotFoundError(
      f"{folder} holds {len(files)} files of motion capture; make a data folder of them first: motion-jax data build "
      f"{shlex.quote(str(folder))} data/mine" if files else
      f"{folder} is no data folder: expected one of "
      f"{', '.join(known.holds for known in DATASETS.values() if known.in_folders)}; motion-jax data build makes one")
