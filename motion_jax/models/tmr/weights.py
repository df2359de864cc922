"""Released weights of motion-language teachers: Part-TMR, TMR, MotionPatches (docs/papers/cmdm.md#checkpoint-names)."""
import math
import pathlib
import re
from collections.abc import Mapping
from typing import Any

from motion_jax.convert.parts import Network, NetworkState, check_free, heads_of, network, read_part, text_files, write
from motion_jax.models.tmr.space import make_teacher, teacher_shapes
from motion_jax.models.tmr.weight_names import TEXT, motion_patches_from_torch, part_tmr_from_torch, tmr_names
from motion_jax.motion.stats import load_stats
from motion_jax.text.bert import bert_fields_of
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint
from motion_jax.training.setup import text_identity

DISTILBERT = "distilbert-base-uncased"
TMR_FILES = ("motion_encoder", "text_encoder", "motion_decoder")  # its extracted weights, a file each
LIGHTNING = ("lr_schedulers", "loops", "callbacks")               # what its whole checkpoint holds besides state_dict


def read_teacher(path: str | pathlib.Path) -> NetworkState:
  """The tensors of a teacher: a file, or TMR's folder with motion_encoder, text_encoder and motion_decoder.pt."""
  path = pathlib.Path(path)
  if not path.is_dir():
    return read_part(path, choices=("state_dict",), others=LIGHTNING)
  state: dict[str, Any] = {}
  digests = []
  for name in TMR_FILES:
    file = next((path / f"{name}{end}" for end in (".pt", ".safetensors") if (path / f"{name}{end}").is_file()), None)
    if file is None:
      raise FileNotFoundError(f"{path} has no {name}.pt; TMR's extracted weights are {', '.join(TMR_FILES)}, each .pt "
                              "or .safetensors; or give one checkpoint file")
    part = read_part(file)
    state |= {f"{name}.{key}": array for key, array in part.state.items()}
    digests.append(part.source["sha256"])
  return NetworkState(state, dict(file=path.name, part=", ".join(TMR_FILES), sha256=digests), ())


def teacher(path: str | pathlib.Path, layout: str, num_heads: int | None = None,
            text_fields: Mapping[str, Any] | None = None) -> Network:
  """A released teacher, its kind recognized by its tensors; params are as in a teacher's run.

  text_fields: of the `Bert` that was trained with it; by default DistilBERT's sizes. Raises ValueError for a file of
  none of the kinds.
  """
  part = read_teacher(path)
  for name, make in (("motion_encoder.skel_embedding_Root.weight", _part_tmr),
                     ("motion_encoder.model.patch_embed.proj.weight", _motion_patches),
                     ("motion_decoder.final_layer.weight", _tmr)):
    if name in part.state:
      return make(part, layout, num_heads, text_fields)
  raise ValueError(f"{part.source['file']} is no Part-TMR, TMR or MotionPatches; it holds "
                   f"{', '.join(sorted(part.state)[:4])}, ...")


def _part_tmr(part, layout, num_heads, text_fields):
  what = "teacher"
  stack = "motion_encoder.seqTransEncoder_Root.layers"
  width, _ = part.shape("motion_encoder.skel_embedding_Root.weight", what, 2)
  depth = part.count(re.escape(stack) + r"\.(\d+)\.")
  fields = dict(kind="part_tmr", width=width, depth=depth, num_heads=heads_of(num_heads, width, 4),
                mlp_width=part.shape(f"{stack}.0.linear1.weight", what, 2)[0],
                dim=part.shape("motion_projection.projection.weight", what, 2)[0], dropout=0.1, head_dropout=0.5,
                pool="all")
  text_fields = text_fields or _distilbert_fields(part)
  return _made(part, layout, fields, text_fields, part_tmr_from_torch(part.state, text_fields, depth))


def _motion_patches(part, layout, num_heads, text_fields):
  what, model = "MotionPatches", "motion_encoder.model."
  width, _, patch, _ = part.shape(f"{model}patch_embed.proj.weight", what, 4)
  depth = part.count(re.escape(model) + r"blocks\.(\d+)\.")
  chains = len(layout.skeleton.chains)
  rows, rest = divmod(part.shape(f"{model}pos_embed", what, 3)[1] - 1, chains)
  if rest:
    raise ValueError(f"{part.source['file']} has positions of {rows * chains + rest} patches, no multiple of the "
                     f"{chains} chains of a body; this is no MotionPatches")
  fields = dict(kind="motion_patches", width=width, depth=depth, patch=patch, num_points=patch, num_rows=rows * patch,
                num_heads=heads_of(num_heads, width, 12 if width == 768 else None),
                mlp_width=part.shape(f"{model}blocks.0.mlp.fc1.weight", what, 2)[0],
                dim=part.shape("motion_projection.projection.weight", what, 2)[0], head_dropout=0.5,
                upsample=math.isclose(layout.skeleton.fps, 12.5))
  text_fields = text_fields or _distilbert_fields(part)
  return _made(part, layout, fields, text_fields, motion_patches_from_torch(part.state, text_fields, depth))


def _tmr(part, layout, num_heads, text_fields):
  what, stack = "TMR", "motion_encoder.seqTransEncoder.layers"
  width, _ = part.shape("motion_encoder.projection.weight", what, 2)
  depth = part.count(re.escape(stack) + r"\.(\d+)\.")
  fields = dict(kind="tmr", width=width, depth=depth, num_heads=heads_of(num_heads, width, 4 if width == 256 else None),
                mlp_width=part.shape(f"{stack}.0.linear1.weight", what, 2)[0], dropout=0.1, pool="token")
  module = make_teacher(fields, layout)
  text_fields = {"width": part.shape("text_encoder.projection.weight", what, 2)[1]}
  shapes = {"params": teacher_shapes(module, text_fields, layout)["motion"]}
  motion_net = network("teacher", part, module, fields | {"text": text_fields}, shapes, tmr_names(depth))
  return motion_net._replace(params={"motion": motion_net.params["params"]})


def _made(part, layout, fields, text_fields, params):
  module = make_teacher(fields, layout)
  shapes = teacher_shapes(module, text_fields, layout)
  checkpoint.check_fits(params["motion"], shapes["motion"], f"{part.source['file']} does not fit a teacher")
  return Network("teacher", module, fields | {"text": text_fields}, params, part)


def _distilbert_fields(part):
  what = "a teacher with DistilBERT"
  vocab_size, width = part.shape(f"{TEXT}embeddings.word_embeddings.weight", what, 2)
  if width != 768:
    raise ValueError(f"the teacher's text transformer has width {width}, DistilBERT has 768; the tensors do not tell "
                     "its number of heads, give the folder that it started from with --text-encoder")
  return dict(vocab_size=vocab_size, width=width, num_heads=12,
              num_layers=part.count(re.escape(TEXT) + r"transformer\.layer\.(\d+)\."),
              mlp_width=part.shape(f"{TEXT}transformer.layer.0.ffn.lin1.weight", what, 2)[0],
              max_positions=part.shape(f"{TEXT}embeddings.position_embeddings.weight", what, 2)[0])


def write_teacher(out: str | pathlib.Path, file: str | pathlib.Path, stats: Any, text: str | None = None,
                  num_heads: int | None = None) -> list[Network]:
  """Writes the run folder of a released teacher -> the Networks. text: folder of the text encoder for its word pieces;
  the weights of the text transformer are in the file, except for a TMR, which uses a frozen one.
  """
  check_free(out)
  stats = load_stats(stats)
  encoder = None if text is None else load_text_encoder(text)
  net = teacher(file, stats.layout, num_heads, encoder and bert_fields_of(encoder.model))
  fields = dict(net.fields)
  kind, text_fields = fields["kind"], fields.pop("text")
  frames = {"tmr": 200, "part_tmr": 196}.get(kind) or net.module.max_frames
  files = {checkpoint.TEXT: text_identity(encoder)} if encoder else {}
  if kind == "tmr":
    files = text_files(text, text_fields["width"], "teacher", f"{DISTILBERT} has 768")
  words = 128 if kind == "motion_patches" else 77
  config = dict(stage="tmr.teacher", text=text_fields, model=fields, frozen=dict(text=str(text or DISTILBERT)),
                origin={"weights": "released"}, loss=dict(text_pool="first"),
                data=dict(layout=stats.layout.name, mode="benchmark", max_frames=frames, max_words=words))
  write(out, config, [net], net.params, stats, files=files)
  return [net]
