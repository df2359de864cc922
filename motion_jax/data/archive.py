"""Archives: one `motions.npz` with the joints of many clips and one `captions.jsonl` with sentences about them.

motions.npz: names (N,), start (N + 1,) frame offsets, root (frames, 3) metres, local (frames, 22, 3) joints less the
pelvis; 20 frames a second, 22 joints in HumanML3D's order. captions.jsonl, a row per piece of a clip: id, clip, start,
end (frames in the clip), text (a list of sentences), split, and optionally content, style, label.
"""
import json
import pathlib

import numpy as np

from motion_jax.data.clip import Caption, Clip

FPS = 20.0
_LICENSES = {"cmu": "CMU: free for all uses, not to be resold; mocap.cs.cmu.edu, funded by NSF EIA-0196217",
             "bandai": "CC BY-NC 4.0, (c) 2022 Bandai Namco Research Inc."}
_TAGS = ("clip", "content", "style", "label", "subject", "whole", "spikes")


def is_archive(folder) -> bool:
  return all((pathlib.Path(folder) / name).is_file() for name in ("motions.npz", "captions.jsonl"))


def read_archive(folder, split=None, faults=None) -> list[Clip]:
  """Every captioned piece of an archive as a Clip, in the order of the captions; split keeps one split only.

  faults: a list that takes (id, what is wrong) of pieces with NaN, which are then left out. Raises FileNotFoundError
  for a missing file, ValueError for rows that name no clip or frames outside it, or, without faults, hold NaN.
  """
  folder = pathlib.Path(folder)
  if not is_archive(folder):
    raise FileNotFoundError(f"{folder} is no archive: expected motions.npz and captions.jsonl in it")
  with np.load(folder / "motions.npz", allow_pickle=False) as arrays:
    missing = {"names", "start", "root", "local"} - set(arrays.files)
    if missing:
      raise ValueError(f"{folder / 'motions.npz'} lacks {', '.join(sorted(missing))}")
    names, start, root, local = (arrays[key] for key in ("names", "start", "root", "local"))
  index = {str(name): i for i, name in enumerate(names)}
  clips = []
  with open(folder / "captions.jsonl", encoding="utf-8") as lines:
    for number, line in enumerate(lines, 1):
      row = json.loads(line)
      if split and row["split"] != split:
        continue
      if row["clip"] not in index:
        raise ValueError(f"captions.jsonl line {number}: clip {row['clip']!r} is not in motions.npz")
      first, end = int(start[index[row["clip"]]]), int(start[index[row["clip"]] + 1])
      if not 0 <= row["start"] < row["end"] <= end - first:
        raise ValueError(f"captions.jsonl line {number}: frames {row['start']}:{row['end']} lie outside clip "
                         f"{row['clip']!r} of {end - first} frames")
      piece = slice(first + row["start"], first + row["end"])
      joints = root[piece, None].astype(np.float32) + local[piece].astype(np.float32)
      if faults is not None and not np.isfinite(joints).all():
        faults.append((row["id"], "NaN"))
        continue
      clips.append(Clip(
          joints=joints, fps=FPS,
          captions=tuple(Caption(text) for text in row["text"]), id=row["id"], split=row["split"],
          source=folder.name, license=_LICENSES.get(folder.name, ""),
          meta={tag: row[tag] for tag in _TAGS if tag in row}))
  return clips
