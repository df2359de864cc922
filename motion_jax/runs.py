"""Run folders, and where those of the models that ship lie."""
import pathlib

PRETRAINED = pathlib.Path(__file__).parent / "pretrained"


def pretrained_names():
  """Names of the models that ship, less evaluators' tables of words."""
  return sorted(path.parent.name for path in PRETRAINED.glob("*/config.json") if (path.parent / "Mean.npy").is_file())
