"""Records: features of any data set in the files of tensorflow-datasets, read one at a time on demand.

`motion-jax data records` makes such a folder (`data.records`). It is for data that does not fit in memory, or is on
slow storage: only a row per clip is in memory, and features are read from array_record files when a batch is drawn.

  index.json            the layout, and for each split one row per clip: id, frames, captions, tokens, group
  Mean.npy, Std.npy     the statistics of the training split
  motions/1.0.0/        the data set as tensorflow-datasets has it: id, captions, group, features (T, F)

Other programs read the last folder by `tfds.builder_from_directory(...).as_data_source()`; TensorFlow is not needed.
"""
import functools
import pathlib

import numpy as np

from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets.base import Dataset, TextItem
from motion_jax.motion.representations import get_layout
from motion_jax.motion.stats import compute_stats, load_stats
from motion_jax.utils.errors import InputError, reading
from motion_jax.utils.input_files import read_json
from motion_jax.utils.install import pip_install

INDEX, BUILDER = "index.json", "motions/1.0.0"
WHOLE = "_whole"  # suffix of a split's name: its whole clips, if captions describe parts of them


def tensorflow_datasets():
  """The package; raises InputError that says what to install."""
  try:
    import tensorflow_datasets
    return tensorflow_datasets
  except ImportError as error:
    raise InputError(f"records are read and written by tensorflow-datasets: {pip_install('data')}") from error


class RecordedFeatures:
  """Features (T, F) in a record, read on demand by slicing; normalized if stats are given."""

  def __init__(self, folder, split, place, shape, stats=None, columns=None):
    self.folder, self.split, self.place, self.shape = str(folder), split, place, tuple(shape)
    self.stats, self.columns = stats, columns

  def __len__(self):
    return self.shape[0]

  def __getitem__(self, frames):
    return self.__array__()[frames]

  def __array__(self, dtype=None, copy=None):
    features = source(self.folder, self.split)[self.place]["features"]
    if features.shape[0] != self.shape[0]:
      raise InputError(f"{self.folder}: record {self.place} of {self.split} has {len(features)} frames, {INDEX} says "
                       f"{self.shape[0]}; make the records again")
    features = features if self.columns is None else features[:, self.columns]
    features = features if self.stats is None else self.stats.normalize(features)
    return np.asarray(features, dtype or np.float32)

  def normalized(self, stats):
    return RecordedFeatures(self.folder, self.split, self.place, self.shape, stats, self.columns)


@functools.lru_cache(maxsize=16)
def source(folder, split):
  """The records of a split: source[i] is the dict of clip i in tensorflow-datasets."""
  place = pathlib.Path(folder) / BUILDER
  with reading(place, "make the records again"):
    return tensorflow_datasets().builder_from_directory(str(place)).as_data_source(split=split)


class Records(Dataset):
  """What `motion-jax data records` makes."""
  name, holds = "records", "records (index.json, motions/1.0.0)"
  fields = ("captioned",)
  files = ("*.json", "*.npy", "motions/*/*")

  def matches(self, folder):
    return (pathlib.Path(folder) / INDEX).is_file() and (pathlib.Path(folder) / BUILDER).is_dir()

  def index(self, folder) -> dict:
    """index.json of a folder."""
    folder = pathlib.Path(folder)
    if not (folder / INDEX).is_file():
      raise FileNotFoundError(f"{folder} has no {INDEX}: it holds no records; motion-jax data records makes them")
    return _index(str(folder), (folder / INDEX).stat().st_mtime_ns)

  def configure(self, data, folder):
    """Configures reading the folder's features as they are; no mirrored copies are added."""
    data.update(name=self.name, folder=str(folder), folders=(), mode=self.index(folder)["mode"], mirror=False)
    return f"data: {folder}, {self.holds} ({data.mode} features)"

  def pieces(self, folder, config):
    """All clips, without the folder's mirrored copies if config.mirror makes new ones."""
    clips = self.clips(folder)
    ids = {clip.id for clip in clips}
    copy = lambda clip: clip.id.startswith("M") and clip.id[1:] in ids
    return [clip for clip in clips if not (config.get("mirror", False) and copy(clip))]

  def items(self, config, split, layout, captioned=True):
    index = self.index(config.folder)
    held, columns = get_layout(index["layout"]), None
    if held is not layout:
      columns = held.columns_of(layout)
      if columns is None:
        raise InputError(f"{config.folder} holds {held.name!r} features, this config reads {layout.name!r}; make the "
                         f"records again with --layout {layout.name}")
    split = split if captioned or split + WHOLE not in index["splits"] else split + WHOLE
    items = []
    for place, row in enumerate(index["splits"].get(split, ())):
      features = RecordedFeatures(config.folder, split, place, (row["frames"], layout.dim), None, columns)
      items.append(TextItem(row["id"], features, tuple(row["captions"]), tuple(map(tuple, row["tokens"])),
                            row["group"]))
    return items

  def stats(self, config, layout, features):
    if config.get("per_axis", False):
      return compute_stats([np.asarray(x) for x in features], layout, True)
    stats = load_stats(config.folder, self.index(config.folder)["layout"])
    return stats if stats.layout is layout else type(stats)(
        *(values[stats.layout.columns_of(layout)] for values in (stats.mean, stats.std)), layout)

  def clips(self, folder, split=None, faults=None):
    index = self.index(folder)
    layout = get_layout(index["layout"])
    clips = []
    for name in [split] if split else [name for name in index["splits"] if not name.endswith(WHOLE)]:
      for place, row in enumerate(index["splits"].get(name, ())):
        features = np.asarray(RecordedFeatures(folder, name, place, (row["frames"], layout.dim)))
        if np.isfinite(features).all():
          clips.append(Clip(layout.to_joints(features), layout.skeleton.fps, tuple(map(Caption, row["captions"])),
                            row["id"], name, pathlib.Path(folder).name, index["license"], layout.skeleton,
                            features=features))
        elif faults is not None:
          faults.append((row["id"], "NaN"))
    return clips


@functools.lru_cache(maxsize=4)
def _index(folder, _):
  return read_json(pathlib.Path(folder) / INDEX, dict, advice="make the records again")
