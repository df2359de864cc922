"""Make unseen test splits of archives (`data.datasets.archive`), by sentences or by subjects.

Different recordings may share captions, as template captions repeat, and all subjects may be in train. Sentences are
compared without their subject, and mirrored as well, as training uses them.
"""
import collections
import hashlib
import json
import pathlib
import shutil

from motion_jax.data.datasets.archive import is_archive, read_motions, read_row
from motion_jax.data.mirror import mirror_caption
from motion_jax.text.captions import without_subject
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import read_json_lines

WAYS = ("captions", "subjects")
GROUPS = ("subject", "actor", "style", "clip")  # the first of these keys of a row defines its group
SHARES = (("test", 0.15), ("val", 0.05))        # of an archive's rows, in whole groups


def split(folders, out, by="captions", overwrite=False) -> str:
  """Writes a copy of each archive, with another split, to a folder of its name in `out`; returns a summary.

  by "captions": train and val rows stay, test rows keep the sentences that no train row of any folder has, and rows
  without any are omitted; for evaluating models that were trained on the archives. by "subjects": whole subjects (or
  actors, styles, clips, if an archive names no subjects) are assigned to splits first, in an order that depends only on
  their names; for models that are trained on this split. Raises InputError for folders that are no archives.
  """
  if by not in WAYS:
    raise InputError(f"got by {by!r}, expected {' or '.join(WAYS)}")
  archives = {}
  for folder in map(pathlib.Path, folders):
    if not is_archive(folder):
      raise InputError(f"{folder} is no archive: expected motions.npz and captions.jsonl in it")
    if folder.name in archives:
      raise InputError(f"got two archives of the name {folder.name!r}; expected each once")
    motions, path = read_motions(folder), folder / "captions.jsonl"
    archives[folder.name] = folder, [read_row(row, motions, f"{path} line {n}") for n, row in read_json_lines(path)]
  places = [pathlib.Path(out) / name for name in archives]
  if existing := next((place for place in places if place.exists()), None):
    if not overwrite:
      raise InputError(f"{existing} exists; name another --out, or replace it with --overwrite")
    if any(place.resolve() == folder.resolve() for place, (folder, _) in zip(places, archives.values())):
      raise InputError(f"{existing} is an archive that is read; name another --out")
  if by == "subjects":
    chosen: dict[str, str] = {}
    for _, rows in archives.values():
      _assign(rows, chosen)
  seen = {without_subject(said(text)) for _, rows in archives.values() for row in rows if row["split"] == "train"
          for text in row["text"] for said in (str, mirror_caption)}
  lines = []
  for place, (folder, rows) in zip(places, archives.values()):
    before = sum(row["split"] == "test" for row in rows)
    rows = [row for row in (_unseen(row, seen) for row in rows) if row]
    _write(place, folder, rows)
    count = collections.Counter(row["split"] for row in rows)
    lines.append(f"{place}: train {count['train']}, val {count['val']}, test {count['test']} of {before} rows with "
                 f"{sum(len(row['text']) for row in rows if row['split'] == 'test')} sentences")
  return "\n".join(lines)


def group_of(row) -> str:
  """The group of a row, such as "subject 14"; a group is in one split as a whole."""
  return next(f"{key} {row[key]}" for key in GROUPS if row.get(key))


def _assign(rows, chosen):
  """Sets the split of rows by groups, and adds to chosen, the {group: split} of all archives so far."""
  sizes = collections.Counter(map(group_of, rows))
  order = sorted(sizes, key=lambda group: hashlib.sha256(group.encode()).hexdigest())
  for name, share in SHARES:
    count = sum(size for group, size in sizes.items() if chosen.get(group) == name)
    for group in order:
      if count >= share * len(rows):
        break
      if group not in chosen and sizes[group] <= 2 * share * len(rows):
        chosen[group] = name
        count += sizes[group]
  for row in rows:
    row["split"] = chosen.setdefault(group_of(row), "train")


def _unseen(row, seen):
  """A row without sentences that training has seen, if it is in test; None for a test row without any left."""
  if row["split"] != "test":
    return row
  text = [text for text in row["text"] if without_subject(text) not in seen]
  return row | {"text": text} if text else None


def _write(place, folder, rows):
  place.mkdir(parents=True, exist_ok=True)
  for path in sorted(folder.iterdir()):  # with licence and description
    if path.is_file() and path.name != "captions.jsonl":
      with atomic_path(place / path.name) as copy:
        shutil.copyfile(path, copy)
  with atomic_path(place / "captions.jsonl") as path:
    path.write_text("".join(json.dumps(row, ensure_ascii=False) + "\n" for row in rows), encoding="utf-8")
