"""The test items of a data folder as evaluators read them, with what was left out, and whether train has them too.

A folder's format is told by its files: an archive (`data.datasets.archive`), HumanML3D's or KIT-ML's, SnapMoGen's or
BABEL's.
"""
import dataclasses
import hashlib
import pathlib
import warnings

import numpy as np

from motion_jax.data import sources
from motion_jax.data.datasets import archive, babel, humanml3d, snapmogen
from motion_jax.motion.representations import get_layout


@dataclasses.dataclass(frozen=True, eq=False)
class Items:
  """Items of a split: ids, captions and their tokens (None: by rule), and features of each layout that is asked for.

  marks: a hash of each motion as the data hold it. features: {(layout's name, mode): [(T_i, F)]}, in physical units.
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
    """The features that an evaluator reads."""
    return self.features[key_of(evaluator)]

  @property
  def words_hash(self) -> str:
    """sha256 of ids, captions and lengths: all that a model is told of them."""
    rows = [f"{name}\t{count}\t" + "\t".join(said) for name, count, said in zip(self.ids, self.rows, self.captions)]
    return hashlib.sha256("\n".join(rows).encode()).hexdigest()

  @property
  def hash(self) -> str:
    """sha256 of ids, captions and motions as they are stored: the split that a number is about, whoever judges it."""
    rows = ["\t".join([name, mark, *said]) for name, mark, said in zip(self.ids, self.marks, self.captions)]
    return hashlib.sha256("\n".join(rows).encode()).hexdigest()


def key_of(evaluator):
  return evaluator.layout.name, evaluator.mode


def format_of(folder) -> str:
  """"archive", "humanml3d", "snapmogen" or "babel". Raises FileNotFoundError for a folder that is none."""
  return sources.kind_of(folder)


def format_of_all(folders) -> str:
  formats = {str(folder): format_of(folder) for folder in folders}
  if len(set(formats.values())) != 1:
    raise ValueError(f"got data folders of several formats: {formats}; evaluate them one by one" if formats else
                     "got no data folder; give one with --data")
  return next(iter(formats.values()))


def read_items(folders, protocol, evaluators, allow_shared=False) -> Items:
  """The items of a protocol's split in all folders, for every evaluator.

  Clips that hold NaN, miss a file or make no features are left out and named in `excluded`; those out of the
  protocol's range of lengths are no items. Raises ValueError where clips of the split are in train, too (allow_shared
  keeps them and names them in `shared`), or an evaluator reads a representation that the data or the protocol does not
  have.
  """
  data_format = format_of_all(folders)
  if data_format not in protocol.formats:
    raise ValueError(f"protocol {protocol.name!r} takes data of {' or '.join(protocol.formats)}, {folders[0]} is "
                     f"{data_format!r}; name another --protocol")
  main = evaluators[0]
  if protocol.layouts and main.layout.name not in protocol.layouts:
    raise ValueError(f"protocol {protocol.name!r} is judged on {' or '.join(protocol.layouts)} features "
                     f"({get_layout(protocol.layouts[0]).dim} numbers a frame), evaluator {main.name!r} reads "
                     f"{main.layout.name!r} ({main.layout.dim}); give another --evaluator or --protocol")
  shared = check_split(folders, data_format, protocol.split, allow_shared)
  keys, excluded = list(dict.fromkeys(map(key_of, evaluators))), []
  modes = {key: next(e for e in evaluators if key_of(e) == key) for key in keys}
  rows = []
  for folder in folders:
    rows += _READERS[data_format](pathlib.Path(folder), protocol, modes, excluded)
  if not rows and protocol.recorded:
    raise ValueError(f"split {protocol.split!r} of {', '.join(map(str, folders))} has no recording with more than "
                     f"{protocol.recorded} captioned motions in a row")
  if not rows:
    raise ValueError(f"split {protocol.split!r} of {', '.join(map(str, folders))} has no clip of {protocol.min_frames} "
                     f"to {protocol.past_frames - 1} frames with a caption")
  ids, captions, tokens, motions, features = zip(*rows)
  return Items(data_format, list(ids), list(captions), list(tokens), list(map(_mark, motions)),
               {key: [row[key] for row in features] for key in keys}, excluded, shared)


def _mark(motion):
  """sha256 of an array's numbers."""
  return hashlib.sha256(np.ascontiguousarray(motion, np.float32).tobytes()).hexdigest()


def _read_archive(folder, protocol, evaluators, excluded):
  for clip in archive.read_archive(folder, protocol.split, excluded):
    if not clip.captions or not protocol.min_frames <= clip.num_frames - 1 < protocol.past_frames:
      continue
    try:
      features = {key: evaluator.features_of(clip) for key, evaluator in evaluators.items()}
    except ValueError as error:
      excluded.append((clip.id, str(error)))
      continue
    yield clip.id, tuple(c.text for c in clip.captions), (None,) * len(clip.captions), clip.joints, features


def _read_humanml3d(folder, protocol, evaluators, excluded):
  own = humanml3d.dataset_info(folder)["layout"]
  layouts = {key: _folder_layout(folder, get_layout(own), evaluator) for key, evaluator in evaluators.items()}
  with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # what it leaves out is counted here
    clips = humanml3d.read_folder(folder, protocol.split)
  known = {clip.id for clip in clips}
  for name in humanml3d.read_ids(folder, protocol.split):
    if name not in known:
      missing = [part for part, suffix in (("new_joint_vecs", "npy"), ("texts", "txt"))
                 if not (folder / part / f"{name}.{suffix}").is_file()]
      excluded.append((name, f"no file in {missing[0]}" if missing else "NaN"))
  for clip in humanml3d.select_items(clips, protocol.min_frames, protocol.past_frames):
    item = humanml3d.as_item(clip, next(iter(layouts.values())))
    tokens = tuple(" ".join(words) or None for words in item.tokens)
    yield clip.id, item.captions, tokens, clip.features, {key: humanml3d.as_item(clip, layout).features
                                                          for key, layout in layouts.items()}


def _folder_layout(folder, own, evaluator):
  layout = evaluator.layout
  if not own.narrows_to(layout):
    raise ValueError(f"{folder} holds {own.name!r} features ({own.dim} numbers a frame), evaluator {evaluator.name!r} "
                     f"reads {layout.name!r} ({layout.dim}); choose the evaluator of the data's representation")
  return layout


def _read_snapmogen(folder, protocol, evaluators, excluded):
  own = get_layout("snapmogen")
  for evaluator in evaluators.values():
    if not own.narrows_to(evaluator.layout):
      raise ValueError(f"{folder} holds 'snapmogen' features, evaluator {evaluator.name!r} reads "
                       f"{evaluator.layout.name!r}; choose the evaluator of the data's representation")
  if protocol.recorded:
    told = snapmogen.recordings(folder, protocol.split, protocol.recorded, protocol.min_frames, faults=excluded)
    items = [item for pieces in told for item in pieces]
  else:
    items = snapmogen.text_items(folder, protocol.split, min_frames=protocol.min_frames, faults=excluded)
  for item in {item.id: item for item in items}.values():  # a split may name a span twice
    yield item.id, item.captions, (None,) * len(item.captions), item.features, {
        key: own.narrow_to(item.features, evaluator.layout) for key, evaluator in evaluators.items()}


def _read_babel(folder, protocol, evaluators, excluded):
  for evaluator in evaluators.values():
    if not get_layout("babel").narrows_to(evaluator.layout):
      raise ValueError(f"{folder} becomes 'babel' features, evaluator {evaluator.name!r} reads "
                       f"{evaluator.layout.name!r}; choose the evaluator of the data's representation")
  for piece in babel.pieces(folder, protocol.split, "segments", protocol.min_frames, protocol.past_frames - 1,
                            faults=excluded):
    yield (piece.id, piece.captions, (None,) * len(piece.captions), piece.features,
           dict.fromkeys(evaluators, piece.features))


_READERS = {"archive": _read_archive, "humanml3d": _read_humanml3d, "snapmogen": _read_snapmogen, "babel": _read_babel}


# --- train and test apart ----------------------------------------------------------------------------------------


def check_split(folders, data_format, split, allow=False) -> list[str]:
  """The clips of a split that are in train as well: by name, mirrored or not, by motion, or rows of one recording.

  Raises ValueError where there are some and that is not allowed.
  """
  tested, trained = {}, {}
  for folder in map(pathlib.Path, folders):
    tested |= _marks(folder, data_format, split)
    if split != "train":
      trained |= _marks(folder, data_format, "train")
  both = {tested[mark] for mark in tested.keys() & trained.keys()}
  if data_format == "snapmogen" and split != "train":
    both |= set(_overlapping(folders, split))
  if both and not allow:
    raise ValueError(f"{len(both)} clips of split {split!r} are in train, too, such as {', '.join(sorted(both)[:3])}; "
                     "numbers would be too good: take them out of one of the two, `motion-jax data doctor` lists equal "
                     "motions, or say --allow-shared, which names them in the record")
  return sorted(both)


def _overlapping(folders, split):
  """Spans of a split that have rows in common with one of train."""
  for folder in map(pathlib.Path, folders):
    train = {}
    for span in _spans(folder, "train"):
      train.setdefault(span.recording, []).append(span)
    for span in _spans(folder, split):
      if any(span.start < other.end and other.start < span.end for other in train.get(span.recording, ())):
        yield span.id


def _spans(folder, split):
  there = (folder / "data_split_info" / f"{split}_ids.txt").is_file()
  return snapmogen.read_ids(folder, split) if there else []


def _marks(folder, data_format, split):
  """{mark: id}: names and contents by which a clip is known again; a split that is not there has none."""
  marks = {}
  if data_format == "archive":
    for clip in archive.read_archive(folder, split, faults=[]):
      named = (folder.name, clip.meta.get("clip", clip.id))
      marks |= {named: clip.id, hashlib.sha256(clip.joints.tobytes()).digest(): clip.id}
  elif data_format == "humanml3d" and (folder / f"{split}.txt").is_file():
    for name in humanml3d.read_ids(folder, split):
      path = folder / "new_joint_vecs" / f"{name}.npy"
      marks[folder.name, name.removeprefix("M")] = name
      if path.is_file():
        with open(path, "rb") as file:  # the first frames and the size tell motions apart
          marks[hashlib.sha256(file.read(8192)).digest(), path.stat().st_size] = name
  elif data_format == "babel" and (folder / f"{split}.json").is_file():
    marks = {(folder.name, name): name for name in babel.read_annotations(folder, split)}
  return marks
