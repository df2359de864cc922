"""What trainings of teachers start from: weights of a vision transformer, words, statistics of their own."""
import hashlib
import pathlib
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from ml_collections import ConfigDict

from motion_jax.convert.state import load_state
from motion_jax.models.tmr import teacher as teacher_lib
from motion_jax.models.tmr.weight_names import vit_from_torch
from motion_jax.motion.representations import Representation, get_layout
from motion_jax.motion.stats import Stats
from motion_jax.nets.motion_patches import MotionPatches
from motion_jax.nets.tmr import TMR
from motion_jax.nets.vit import resize_positions
from motion_jax.text.encoder import TextEncoder, load_text_encoder
from motion_jax.utils.input_files import read_json

WEIGHTS = "model.safetensors"


def reader(config: ConfigDict, space: teacher_lib.Space, encoder: TextEncoder
           ) -> Callable[[Sequence[str], slice], dict[str, np.ndarray]]:
  """(captions, rows) -> the arrays of a batch that the loss wants of these of them.

  config.frozen.sentence names the encoder whose sentence vectors tell which captions of a batch say nearly the same;
  "" leaves no pair out.
  """
  near = None
  if isinstance(space.net, TMR) and config.frozen.sentence:
    near = load_text_encoder(config.frozen.sentence, level="sentence")

  def read(captions, rows=slice(None)):
    found = space.read(encoder, captions, rows)
    return found if near is None else found | {"sentence": near.sentence(captions[rows]).astype(np.float32)}

  return read


def imagenet(folder: str | pathlib.Path, net: MotionPatches) -> tuple[Any, dict[str, Any]]:
  """(parameters of net.vit, what a record says of them) from a folder with the model.safetensors of a ViT.

  Names are timm's (vit_base_patch16_224.augreg_in21k) or Hugging Face's ViT; positions are resized to the image's grid.
  The head and the last norm are left out: no layer of MotionPatches is theirs (docs/papers/cmdm.md#motionpatches).
  Raises FileNotFoundError or ValueError where there is no such file or it is of another size.
  """
  path = pathlib.Path(folder) / WEIGHTS if pathlib.Path(folder).is_dir() else pathlib.Path(folder)
  if path.suffix != ".safetensors" or not path.is_file():
    raise FileNotFoundError(f"found no {path}; frozen.vit is a folder with the {WEIGHTS} of a vision transformer, such "
                            "as timm's vit_base_patch16_224.augreg_in21k, or empty for random weights")
  params, left = vit_from_torch(load_state(path), net.depth)
  table = params["positions"]
  side = int(round((len(table) - 1) ** 0.5))
  with jax.default_matmul_precision("highest"):
    params["positions"] = np.asarray(resize_positions(table, (side, side), net.grid), np.float32)
  width, patch = params["patch_embed"]["kernel"].shape[1], 3 * net.patch ** 2
  if width != net.width or params["patch_embed"]["kernel"].shape[0] != patch:
    raise ValueError(f"{path} is a vision transformer of width {width} on patches of "
                     f"{params['patch_embed']['kernel'].shape[0]} numbers, config.model has width {net.width} on "
                     f"{patch}; set model.width, depth, num_heads and mlp_width to those of the file")
  said = {"weights": "file", "file": f"{path.parent.name}/{path.name}", "left_out": left,
          "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
  if (path.parent / "config.json").is_file():
    told = read_json(path.parent / "config.json")
    said["architecture"] = str(told.get("architecture") or told.get("model_type") or "")
  return params, said


def origin(config: ConfigDict, net: teacher_lib.Teacher) -> tuple[dict[str, Any], dict[str, Any]]:
  """(parameters that replace random ones, what the run's config says about where all of them came from)."""
  said = {"text": config.frozen.text}
  if not isinstance(net, MotionPatches):
    return {}, said
  if not config.frozen.vit:
    return {}, said | {"vit": {"weights": "random"}}
  params, vit = imagenet(config.frozen.vit, net)
  return {"vit": params}, said | {"vit": vit}


def view_of(stats: Stats, own_stats: Stats, folder: str | pathlib.Path) -> dict[str, np.ndarray] | None:
  """Both statistics, by which `teacher.as_seen` turns windows into what a teacher reads; None if they are the same.

  Raises ValueError if the teacher, of that folder, reads other features, or, of the same layout, was trained on other
  data. One with a std for each column is of the same data if its means, and its stds averaged over blocks, are near.
  """
  layout = stats.layout
  teacher_lib.check_readable(layout.name, own_stats.layout.name)
  if own_stats.layout == layout:
    away = (np.abs(own_stats.mean - stats.mean) / stats.std).max()
    if away <= 0.01 and np.allclose(own_stats.std, stats.std, rtol=0.01):
      return None
    grouped, own_grouped = _by_block(stats), _by_block(own_stats)
    moving = own_stats.std != 1
    single = not np.allclose(own_stats.std[moving], own_grouped[moving], rtol=0.01)
    if not single or away > 0.1 or not np.allclose(own_grouped, grouped, rtol=0.1, atol=1e-5):
      raise ValueError(f"the teacher in {folder} was trained on features of other statistics than the data given here; "
                       "train it on the same data")
  return {"mean": stats.mean, "std": stats.std, "own_mean": own_stats.mean, "own_std": own_stats.std}


def _by_block(stats):
  """The std of each column (F,), averaged over its block."""
  std = np.where(stats.std == 1, 0.0, stats.std)  # 1 stands for a column that never moves (`compute_stats`)
  for block in stats.layout.blocks.values():
    std[block] = np.mean(std[block], dtype=np.float64)
  return std


def plain_stats(layout: Representation | str) -> Stats:
  """Mean 0 and std 1, for a teacher that was never trained."""
  layout = get_layout(layout)
  return Stats(np.zeros(layout.dim, np.float32), np.ones(layout.dim, np.float32), layout)
