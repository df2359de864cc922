"""A run folder, or the name of a model that ships, becomes a model that makes motion: `motion_jax.load`."""
import os
import pathlib

from motion_jax.models.base import Prompted
from motion_jax.models.cdamd.model import CdamdModel
from motion_jax.models.cmdm.model import Model
from motion_jax.runs import PRETRAINED, pretrained_names
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint


def load(name="cmdm-small", text=None, raw=False) -> Prompted:
  """A run folder of a denoiser or generator, or the name of a model that ships.

  text: another folder of the encoder. raw: the last weights of a run, not the average that it kept beside them.
  """
  if not isinstance(name, str | os.PathLike):
    raise TypeError(f"got {name!r} ({type(name).__name__}) to load, expected a run folder or the name of a model that "
                    f"ships: {', '.join(pretrained_names())}")
  folder = pathlib.Path(name)
  if not folder.is_dir() and (PRETRAINED / str(name)).is_dir():
    folder = PRETRAINED / str(name)
  if not folder.is_dir():
    raise FileNotFoundError(f"found neither a run folder {str(name)!r} nor a model of that name; models that ship: "
                            f"{', '.join(pretrained_names()) or 'none'}")
  config = checkpoint.load_config(folder)
  kinds = {"cdamd.generator": (CdamdModel, "sentence"), "cmdm.denoiser": (Model, "words")}
  if config.get("stage") not in kinds:
    raise ValueError(f"{folder} holds a {config.get('stage')!r} run; generating needs the run of a cmdm.denoiser or a "
                     "cdamd.generator")
  kind, level = kinds[config.stage]
  with checkpoint.building(folder):
    level = config.frozen.get("text_level", level)  # older runs do not say
    return kind(folder, config, load_text_encoder(text or config.frozen.text, level=level), raw)
