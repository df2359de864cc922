"""Caption folders of motion by kinematics (`analysis.describe`), and write the captions as a table."""
import csv
import pathlib

import tqdm

from motion_jax.analysis.describe import FPS, describe
from motion_jax.data.build import pieces
from motion_jax.data.datasets.registry import find_dataset
from motion_jax.data.mocap.files import READERS, none_read, read_clip, read_mapping
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError


def describe_folder(folder, source_fps=None, mapping=None, faults=None, progress=False):
  """Yields (name, start, end, sentences) for the motions of a folder, start and end in seconds.

  folder: motion-capture files, in sub-folders too, one such file, or a data folder such as an archive, whose own
  captions are ignored. Files longer than ten seconds are described in equal pieces. source_fps: overrides the rate in
  the files. mapping: their joints' names (`rigs.map_joints`), as a dict or a JSON file. faults: a list to which (file,
  fault) of unreadable files is appended; these are omitted; without it the first is raised. Raises FileNotFoundError if
  there is no motion.
  """
  folder = pathlib.Path(folder)
  if not folder.exists():
    raise FileNotFoundError(f"there is no {folder} to describe; give a folder of {' or '.join(READERS)} files")
  dataset = find_dataset(folder) if folder.is_dir() else None
  if dataset is not None:
    for clip in tqdm.tqdm(dataset.clips(folder, faults=[]), desc="clips", unit="clip", disable=not progress):
      if clip.skeleton is HUMANML3D:
        yield clip.id, 0.0, clip.seconds, describe(clip.joints, clip.fps, key=clip.id)
    return
  files = [folder] if folder.suffix.lower() in READERS and folder.is_file() else sorted(
      path for path in folder.rglob("*") if path.suffix.lower() in READERS)
  if not files:
    raise FileNotFoundError(f"{folder} holds no motion to describe: expected a {' or '.join(READERS)} file, a folder "
                            "of them, or a data folder such as an archive (motions.npz, captions.jsonl)")
  mapping = read_mapping(mapping)
  for path in tqdm.tqdm(files, desc="files", unit="file", disable=not progress):
    name, first = path.relative_to(folder).as_posix() if path != folder else path.name, 0
    clip = read_clip(path, name, faults if path != folder else None, fps=FPS, source_fps=source_fps, mapping=mapping)
    if clip is None:
      continue
    for piece in pieces(clip):
      start, first = first / FPS, first + piece.num_frames
      yield name, start, first / FPS, describe(piece.joints, FPS, key=piece.id)
  if faults and len(faults) == len(files):
    raise InputError(none_read(folder, faults))


def check_table(path) -> pathlib.Path:
  """Checks the path of a new table of captions, a .csv file. Raises InputError, or FileExistsError."""
  path = pathlib.Path(path)
  if path.suffix.lower() != ".csv":
    raise InputError(f"got {path.name} to write captions to, expected a .csv file")
  if path.exists():
    raise FileExistsError(f"{path} exists already; choose another name")
  return path


def write_table(rows, path) -> int:
  """Writes rows of `describe_folder` as a table for `motion-jax data build --captions`: file, caption, start, end.
  Returns the number of captions."""
  lines = [(name, sentence, round(start, 3), round(end, 3)) for name, start, end, sentences in rows
           for sentence in sentences]
  with atomic_path(check_table(path)) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
    csv.writer(file).writerows([("file", "caption", "start", "end"), *lines])
  return len(lines)
