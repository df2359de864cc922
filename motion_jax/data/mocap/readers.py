"""Files of motion capture become clips, by the ending of their names."""
from motion_jax.data.mocap.asf import amc_clip
from motion_jax.data.mocap.bvh import bvh_clip

READERS = {".bvh": bvh_clip, ".amc": amc_clip}


def read_clip(path, name, faults=None, **options):
  """The Clip of a file of motion capture, with the options of its reader.

  faults: a list that takes (name, what is wrong) of a file that cannot be read, for which None comes back; without it
  the error is raised.
  """
  try:
    return READERS[path.suffix.lower()](path, **options)
  except (ValueError, OSError) as error:
    if faults is None:
      raise
    faults.append((name, str(error).removeprefix(str(path)).lstrip(":/ ")))
    return None


def none_read(folder, faults) -> str:
  """What to say where `read_clip` could read no file of a folder."""
  name, what = faults[0]
  return f"{folder}: none of {len(faults)} files can be read; of the first, {name}: {what}" if len(faults) > 1 else (
      f"{folder}/{name}: {what}")
