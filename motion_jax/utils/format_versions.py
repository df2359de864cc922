"""Versions of the file formats of motion_jax (docs/stability.md). A file without a version is of version 1."""
from typing import Any

from motion_jax.utils.errors import InputError

KEY = "motion_jax_format"  # in a motion's .npz, in config.json of a run folder and in archive.json of an archive


def check_version(version: Any, what: str, newest: int = 1) -> None:
  """Raises InputError unless the version of `what`, a file or its kind, is a whole number from 1 to the newest."""
  if isinstance(version, bool) or not isinstance(version, int) or not 1 <= version <= newest:
    reads = f"version {newest}" if newest == 1 else f"versions 1 to {newest}"
    raise InputError(f"{what} is of version {str(version)[:20]}, this program reads {reads}; open it with the version "
                     "of motion_jax that wrote it, or a later one")
