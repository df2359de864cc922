"""The test items of data folders in the features of the evaluators, with clips that were excluded or are in train, too.

The data set of the folder defines how items are read and which clips count as the same.
"""
import dataclasses
import hashlib
import pathlib

import numpy as np

from motion_jax.data.datasets.base import Dataset
from motion_jax.data.datasets.registry import dataset_of
from motion_jax.motion.representations import get_layout


@dataclasses.dataclass(frozen=True, eq=False)
class TestSet:
  """The items of a split: ids, captions with their tokens (None: by rule), features in each required layout.

  marks: a hash of each motion as the data holds it. features: {(layout's name, mode): [(T_i, F)]}, in physical units.
  excluded: [(id, why)] of clips that cannot be used. shared: ids that train has, too, where that was allowed.
  """
  format: str
  ids: list[str]
  captions: list[tuple[str, ...]]
  tokens: list[tuple]
  marks: list[str]
  features: dict[tuple[str, str], list[np.ndarray]]
  excluded: list[tuple[str, str]]
  shared: list[str] = dataclasses.field(default_factory=list)

  def __len__(self):
    return len(self.ids)

  @property
  def rows(self):
    """Frames of each item (N,)."""
    return np.array([len(x) for x in next(iter(self.features.values()))])

  def of(self, evaluator):
    """The features for an evaluator or another reader."""
    return self.features[key_of(evaluator)]

  @property
  def words_hash(self) -> str:
    """sha256 of ids, captions and lengths: the whole input of a text-to-motion model."""
    rows = [f"{name}\t{count}\t" + "\t".join(said) for name, count, said in zip(self.ids, self.rows, self.captions)]
    return hashlib.sha256("\n".join(rows).encode()).hexdigest()

  @property
  def hash(self) -> str:
    """sha256 of ids, captions and motions as they are stored: identifies the split, whichever evaluator is used."""
    rows = ["\t".join([name, mark, *said]) for name, mark, said in zip(self.ids, self.marks, self.captions)]
    return hashlib.sha256("\n".join(rows).encode()).hexdigest()


def key_of(evaluator):
  return evaluator.layout.name, evaluator.mode


def dataset_of_all(folders) -> Dataset:
  """The data set of all folders. Raises FileNotFoundError for a folder without one, ValueError for several kinds."""
  datasets = {str(folder): dataset_of(folder) for folder in folders}
  if len(set(datasets.values())) != 1:
    formats = {folder: dataset.name for folder, dataset in datasets.items()}
    raise ValueError(f"got data folders of several formats: {formats}; evaluate them one by one" if formats else
                     "got no data folder; give one with --data")
  return next(iter(datasets.values()))


def read_test_set(folders, protocol, evaluators, allow_shared=False) -> TestSet:
  """Reads the items of a protocol's split from all folders, in the features of every reader.

  Clips that hold NaN, lack a file or give no features are excluded and listed in `excluded`; clips outside the
  protocol's range of lengths are not items. Raises ValueError if clips of the split are in train, too (allow_shared
  keeps them and lists them in `shared`), or if an evaluator needs a representation that the data or the protocol does
  not have.
  """
  dataset = dataset_of_all(folders)
  if dataset.judged_as not in protocol.formats:
    raise ValueError(f"protocol {protocol.name!r} takes data of {' or '.join(protocol.formats)}, {folders[0]} is "
                     f"{dataset.name!r}; name another --protocol")
  main = evaluators[0]
  if protocol.layouts and main.layout.name not in protocol.layouts:
    raise ValueError(f"protocol {protocol.name!r} is judged on {' or '.join(protocol.layouts)} features "
                     f"({get_layout(protocol.layouts[0]).dim} numbers a frame), evaluator {main.name!r} reads "
                     f"{main.layout.name!r} ({main.layout.dim}); give another --evaluator or --protocol")
  shared = check_split(folders, dataset, protocol.split, allow_shared)
  keys, excluded = list(dict.fromkeys(map(key_of, evaluators))), []
  modes = {key: next(e for e in evaluators if key_of(e) == key) for key in keys}
  rows = [item for folder in folders for item in dataset.test_items(pathlib.Path(folder), protocol, modes, excluded)]
  if not rows and protocol.recorded:
    raise ValueError(f"split {protocol.split!r} of {', '.join(map(str, folders))} has no recording with more than "
                     f"{protocol.recorded} captioned motions in a row")
  if not rows:
    raise ValueError(f"split {protocol.split!r} of {', '.join(map(str, folders))} has no clip of {protocol.min_frames} "
                     f"to {protocol.past_frames - 1} frames with a caption")
  ids, captions, tokens, motions, features = zip(*rows)
  return TestSet(dataset.name, list(ids), list(captions), list(tokens), list(map(_mark, motions)),
               {key: [row[key] for row in features] for key in keys}, excluded, shared)


def _mark(motion):
  """sha256 of an array's numbers."""
  return hashlib.sha256(np.ascontiguousarray(motion, np.float32).tobytes()).hexdigest()


# --- train and test apart ----------------------------------------------------------------------------------------


def check_split(folders, dataset, split, allow=False) -> list[str]:
  """The clips of a split that are in train as well: by name, mirrored or not, by motion, or by recording.

  Raises ValueError for any, unless that is allowed.
  """
  tested, trained, both = {}, {}, set()
  for folder in map(pathlib.Path, folders):
    tested |= dataset.marks(folder, split)
    if split != "train":
      trained |= dataset.marks(folder, "train")
      both |= set(dataset.overlaps(folder, split))
  both |= {tested[mark] for mark in tested.keys() & trained.keys()}
  if both and not allow:
    raise ValueError(f"{len(both)} clips of split {split!r} are in train, too, such as {', '.join(sorted(both)[:3])}; "
                     "numbers would be too good: take them out of one of the two, `motion-jax data doctor` lists equal "
                     "motions, or say --allow-shared, which names them in the provenance")
  return sorted(both)
