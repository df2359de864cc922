"""MDM's released weights as run folders (docs/papers/mdm.md#files)."""
import pathlib
from typing import Any

from motion_jax.convert.parts import Network, check_free, heads_of, network, read_part, stats_of, text_files, write
from motion_jax.models.mdm.sampling import SCHEDULES
from motion_jax.models.mdm.stages import denoiser_shapes
from motion_jax.models.mdm.weight_names import BUFFERS, mdm_names
from motion_jax.motion.representations import layout_for
from motion_jax.nets.motion_denoiser import MotionDenoiser
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import read_json

WEIGHTS = {"ema": ("model_avg", "model"), "model": ("model",)}
# {text_encoder_type of args.json: (encoder, level, word pieces that are read of a caption; 0 for all)}.
# Parity: CLIP's captions are cut to 20 word pieces and the two special ones (docs/papers/mdm.md).
TEXT = {"clip": ("clip-vit-base-patch32", "sentence", 22), "bert": ("distilbert-base-uncased", "words", 0)}
_MOST_STEPS = 100_000
# args.json: {option: (default, of the released scripts, kinds)}.
_OPTIONS: dict[str, tuple[Any, tuple[type, ...]]] = {
    "diffusion_steps": (1000, (int,)), "noise_schedule": ("cosine", (str,)), "sigma_small": (True, (bool,)),
    "cond_mask_prob": (0.1, (int, float)), "unconstrained": (False, (bool,)), "mask_frames": (False, (bool,)),
    "emb_trans_dec": (False, (bool,)), "context_len": (0, (int,)), "text_encoder_type": ("", (str,)),
    "emb_policy": ("add", (str,))}


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

  args.json beside the file says how many steps it was trained with, by which schedule, how often captions were dropped,
  whether it attends to padding and what encodes its text; without it those of the paper's model are taken. stats: a
  folder with Mean.npy and Std.npy of the training data. DiP is refused: its motions begin from training data, which its
  file does not hold.
  """
  check_free(out)
  network, options = denoiser(file, weights, num_heads), _options(pathlib.Path(file))
  steps, drop_rate = options["diffusion_steps"], float(options["cond_mask_prob"])
  fields = network.fields | dict(num_steps=max(steps, 1), time_token=options["emb_trans_dec"])
  layout, kind = layout_for(fields["features"]), _text_of(options, fields)
  encoder, level, pieces = TEXT[kind]
  files = text_files(text, fields["text_dim"], "denoiser", encoder, level)
  config = dict(stage="mdm.denoiser", model=fields,
                frozen=dict(text=str(text or encoder), text_level=level, text_pieces=pieces),
                diffusion=dict(num_steps=steps, context=0, schedule=options["noise_schedule"]),
                loss=dict(drop_rate=drop_rate, mask_frames=options["mask_frames"], velocity=0.0, positions=0.0,
                          contacts=0.0),
                data=dict(layout=layout.name, mode="benchmark", max_frames=196, max_words=64),
                sampler=dict(guidance_scale=2.5 if drop_rate else 1.0, num_steps=steps, solver="ancestral"))
  write(out, config, [network], network.params, stats_of(stats, fields["features"]), files=files)
  return [network]


def _options(file):
  """The options of training in args.json beside a file. Raises InputError for those that cannot be followed."""
  path = file.parent / "args.json"
  given = read_json(path, advice="fetch it again, or remove it to take the paper's options") if path.is_file() else {}
  options = {name: default for name, (default, _) in _OPTIONS.items()}
  for name, (_, kinds) in _OPTIONS.items():
    value = given.get(name)
    if name == "diffusion_steps" and isinstance(value, str) and value.isdecimal():
      value = int(value)
    if value is None:
      continue
    if not isinstance(value, kinds) or isinstance(value, bool) and bool not in kinds:
      raise InputError(f"{path}: {name} is {str(value)[:60]!r}, expected {' or '.join(k.__name__ for k in kinds)}")
    options[name] = value
  if options["context_len"]:
    raise InputError(f"{file} is a DiP (context_len {options['context_len']}), whose motions begin from frames of "
                     "training data that the file does not hold; train one with --config mdm_denoiser:dip")
  if options["noise_schedule"] not in SCHEDULES:
    raise InputError(f"{path}: noise_schedule is {options['noise_schedule']!r}, expected {' or '.join(SCHEDULES)}")
  if options["noise_schedule"] == "linear" and options["diffusion_steps"] < 20:
    raise InputError(f"{path}: a linear schedule of {options['diffusion_steps']} steps has variances above 1; expected "
                     "20 steps or more")
  if not options["sigma_small"]:
    raise InputError(f"{path}: it was trained with sigma_small false, whose larger variances are not sampled here")
  if options["emb_policy"] != "add":
    raise InputError(f"{path}: emb_policy is {options['emb_policy']!r}, expected 'add': the time added to the text")
  if options["unconstrained"]:
    raise InputError(f"{path}: it was trained without captions (unconstrained); there is no text to generate from")
  if not 0 <= options["cond_mask_prob"] < 1 or not 1 <= options["diffusion_steps"] <= _MOST_STEPS:
    raise InputError(f"{path}: got cond_mask_prob {options['cond_mask_prob']} and diffusion_steps "
                     f"{options['diffusion_steps']}, expected 0 to below 1, and 1 to {_MOST_STEPS}")
  return options


def _text_of(options, fields):
  """The kind of text encoder, a key of TEXT: as args.json says, or by the width that the network reads."""
  clip = fields["text_dim"] == 512 or fields["kind"] == "encoder"
  known = options["text_encoder_type"] or ("clip" if clip else "bert")
  if known not in TEXT:
    raise InputError(f"args.json: text_encoder_type is {known!r}, expected {' or '.join(TEXT)}")
  return known
