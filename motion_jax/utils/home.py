"""Folders of the user."""
import os
import pathlib


def home_folder(variable: str, usual: str) -> pathlib.Path:
  """The folder that an environment variable names, else one of the home folder. Raises OSError where there is none."""
  if folder := os.environ.get(variable):
    return pathlib.Path(folder)
  try:
    return pathlib.Path.home() / usual
  except RuntimeError as error:  # a container's user of no name
    raise OSError(f"this user has no home folder; set {variable}") from error
