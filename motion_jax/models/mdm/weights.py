"""MDM's released weights as run folders (docs/papers/mdm.md#files)."""
import json
import pathlib
from typing import Any

from motion_jax.convert.parts import Network, check_free, heads_of, network, read_part, stats_of, text_files, write
from motion_jax.models.mdm.stages import denoiser_shapes
from motion_jax.models.mdm.weight_names import BUFFERS, mdm_names
from motion_jax.motion.representations import layout_for
from motion_jax.nets.motion_denoiser import MotionDenoiser

WEIGHTS = {"ema": ("model_avg", "model"), "model": ("model",)}
TEXT = {"encoder": ("clip-vit-base-patch32", "sentence"), "decoder": ("distilbert-base-uncased", "words")}


def denoiser(path: str | pathlib.Path, weights: str = "ema", num_heads: int | None = None) -> Network:
  """A released network of model#########.pt: averaged weights where it has them, and they are wanted."""
  if weights not in WEIGHTS:
    raise ValueError(f"got weights {weights!r}, expected one of {', '.join(WEIGHTS)}")
  what, part = "MDM denoiser", read_part(path, choices=WEIGHTS[weights], others=WEIGHTS["ema"])
  text = [name for name in part.state if name.startswith("clip_model.")]
  if text:  # the text encoder's folder holds it
    part = part._replace(state={name: array for name, array in part.state.items() if name not in text},
                         left=(*part.left, f"clip_model ({len(text)} tensors)"))
  kind, stack = "encoder", "seqTransEncoder"
  if any(name.startswith("seqTransDecoder.") for name in part.state):
    kind, stack = "decoder", "seqTransDecoder"
  width, features = part.shape("input_process.poseEmbedding.weight", what, 2)
  goals = "embed_target_cond.mlp.0.weight" in part.state
  depth = part.count(stack + r"\.layers\.(\d+)\.")
  fields = dict(features=features, width=width, depth=depth, num_heads=heads_of(num_heads, width, 4 if width == 512
                                                                                else None),
                mlp_width=part.shape(f"{stack}.layers.0.linear1.weight", what, 2)[0],
                text_dim=part.shape("embed_text.weight", what, 2)[1], kind=kind, num_goals=8 if goals else 0)
  net = MotionDenoiser(**fields)
  return network(what, part, net, fields, denoiser_shapes(net), mdm_names(depth, kind, goals), BUFFERS)


def write_mdm(out: str | pathlib.Path, file: str | pathlib.Path, stats: Any, text: str | None = None,
              weights: str = "ema", num_heads: int | None = None) -> list[Network]:
  """The run folder of a released MDM -> its Network.

  args.json beside the file says how many steps it was trained with, and whether it attends to padding; without it those
  of the paper's model are taken. stats: a folder with Mean.npy and Std.npy of the training data. DiP is refused: its
  motions begin from training data, which its file does not hold.
  """
  check_free(out)
  made, path = denoiser(file, weights, num_heads), pathlib.Path(file).parent / "args.json"
  options = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
  if options.get("context_len"):
    raise ValueError(f"{file} is a DiP (context_len {options['context_len']}), whose motions begin from frames of "
                     "training data that the file does not hold; train one with --config mdm_denoiser:dip")
  steps = int(options.get("diffusion_steps", 1000))
  fields = made.fields | dict(num_steps=max(steps, 1), time_token=bool(options.get("emb_trans_dec", False)))
  layout, (encoder, level) = layout_for(fields["features"]), TEXT[fields["kind"]]
  files = text_files(text, fields["text_dim"], "denoiser", encoder, level)
  config = dict(stage="mdm.denoiser", model=fields, frozen=dict(text=str(text or encoder), text_level=level),
                diffusion=dict(num_steps=steps, context=0),
                loss=dict(drop_rate=0.1, mask_frames=bool(options.get("mask_frames", False)), velocity=0.0,
                          positions=0.0, contacts=0.0),
                data=dict(layout=layout.name, mode="benchmark", max_frames=196, max_words=64),
                sampler=dict(guidance_scale=2.5, num_steps=steps, solver="ancestral"))
  write(out, config, [made], made.params, stats_of(stats, fields["features"]), files=files)
  return [made]
