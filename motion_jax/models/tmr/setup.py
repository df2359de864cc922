"""Training set-ups of the teachers: data, text encoder and initial weights from a config."""
import hashlib
import pathlib
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from ml_collections import ConfigDict

from motion_jax.convert.state import load_state
from motion_jax.data import batches, sources
from motion_jax.metrics.scores import retrieval
from motion_jax.models.tmr.space import Space, Teacher, make_space, make_teacher
from motion_jax.models.tmr.stages import contrastive_stage, tmr_stage
from motion_jax.models.tmr.weight_names import vit_from_torch
from motion_jax.nets.motion_patches import MotionPatches
from motion_jax.nets.tmr import TMR
from motion_jax.nets.vit import resize_positions
from motion_jax.text.bert import bert_fields_of
from motion_jax.text.encoder import TextEncoder, load_text_encoder
from motion_jax.training.setup import TrainingSetup, encoder_files, held_out, one_clip_per_caption
from motion_jax.utils.input_files import read_json

WEIGHTS = "model.safetensors"


def teacher_fields(config: ConfigDict) -> dict[str, Any]:
  """Fields that loading the run needs: the sizes of its text transformer, and the source of its weights."""
  encoder = load_text_encoder(config.frozen.text)
  net = make_teacher(config.model, config.data.layout)
  return {"text": {"width": encoder.dim} if config.model.kind == "tmr" else bert_fields_of(encoder.model),
          "origin": origin(config, net)[1]}


def teacher(config: ConfigDict) -> TrainingSetup:
  """A motion-language teacher. Its text transformer starts as the encoder config.frozen.text and is trained; that of a
  TMR stays frozen.
  """
  encoder = load_text_encoder(config.frozen.text)
  frozen_text = config.model.kind == "tmr"
  space = make_space(config)
  given, _ = origin(config, space.net)
  data = sources.load_features(config.data, captioned=True)
  clips = batches.CaptionedClips(data.features, data.captions, config.data.max_frames)
  encoder.check(caption for captions in data.captions for caption in captions)
  read = reader(config, space, encoder)

  def next_batch(step, rows=batches.ALL):
    batch = clips.batch(config.data.batch_size, config.seed, step, rows)
    return batch | read(batch.pop("caption"), rows)

  stage = tmr_stage(config, space) if frozen_text else contrastive_stage(config)
  predict = jax.jit(lambda params, batch: stage.predict(params, {}, batch, None))
  single = one_clip_per_caption(held_out(config, data.stats, captioned=True), config.data.max_frames)

  def evaluate(params):
    """Recall of held-out clips by their captions, and of captions by their clips (back), one clip for each caption."""
    parts = []
    for rows in np.array_split(single.kept, max(1, len(single) // 64)):
      batch = single.rows(rows, batches.step_rng(config.seed, 4))
      parts.append(predict(params, batch | space.read(encoder, batch.pop("caption"))))
    text, motion = (np.concatenate([part[name] for part in parts]) for name in ("text", "motion"))
    return {name: round(value, 4) for name, value in retrieval(text @ motion.T).items()}

  fresh_init = stage.init

  def init(batch, rng):
    params = fresh_init(batch, rng)
    params["motion"] = {**params["motion"], **given}
    return params if frozen_text else {**params, "text": encoder.params}

  return TrainingSetup(stage._replace(init=init), next_batch, {}, evaluate, data.stats,
                       encoder_files(encoder), len(clips))


def reader(config: ConfigDict, space: Space, encoder: TextEncoder
           ) -> Callable[[Sequence[str], slice], dict[str, np.ndarray]]:
  """(captions, rows) -> the text arrays of a batch, for these rows.

  config.frozen.sentence names the encoder whose sentence vectors identify captions of similar meaning; "" leaves no
  pair out.
  """
  near = None
  if isinstance(space.net, TMR) and config.frozen.sentence:
    near = load_text_encoder(config.frozen.sentence, level="sentence")

  def read(captions, rows=slice(None)):
    text = space.read(encoder, captions, rows)
    return text if near is None else text | {"sentence": near.sentence(captions[rows]).astype(np.float32)}

  return read


def imagenet(folder: str | pathlib.Path, net: MotionPatches) -> tuple[Any, dict[str, Any]]:
  """(parameters of net.vit, their description for the run's config) from a folder with the model.safetensors of a ViT.

  Names are timm's (vit_base_patch16_224.augreg_in21k) or Hugging Face's ViT; positions are resized to the image's grid.
  The head and the last norm are left out: MotionPatches has no such layers (docs/papers/cmdm.md#motionpatches). Raises
  FileNotFoundError or ValueError if there is no such file or its size differs.
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
  record = {"weights": "file", "file": f"{path.parent.name}/{path.name}", "left_out": left,
          "sha256": hashlib.sha256(path.read_bytes()).hexdigest()}
  if (path.parent / "config.json").is_file():
    fields = read_json(path.parent / "config.json")
    record["architecture"] = str(fields.get("architecture") or fields.get("model_type") or "")
  return params, record


def origin(config: ConfigDict, net: Teacher) -> tuple[dict[str, Any], dict[str, Any]]:
  """(parameters that replace random ones, the description of all sources for the run's config)."""
  said = {"text": config.frozen.text}
  if not isinstance(net, MotionPatches):
    return {}, said
  if not config.frozen.vit:
    return {}, said | {"vit": {"weights": "random"}}
  params, vit = imagenet(config.frozen.vit, net)
  return {"vit": params}, said | {"vit": vit}


RESOLVED = {"tmr.teacher": teacher_fields}
SETUPS = {"tmr.teacher": teacher}
