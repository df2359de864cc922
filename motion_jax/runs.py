"""Run folders: resolve a path or the name of a shipped run, check the folder, and read its config and weights.

Every model, tokenizer, teacher and evaluator is loaded through `load_run`, which also checks that the run is of the
expected stage. `with_defaults` adds fields that the config lacks, so that all other code reads the fields plainly.
`exchange_decoder` and `average` make a run of two runs, as passes of configs/shipped do.
"""
import copy
import dataclasses
import functools
import os
import pathlib
import shutil
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import jax
import ml_collections
import numpy as np

from motion_jax.latents import SAMPLED, TOKENIZER
from motion_jax.motion.representations import get_layout
from motion_jax.motion.stats import Stats, load_stats
from motion_jax.training import checkpoint
from motion_jax.utils.atomic import atomic_folder
from motion_jax.utils.errors import InputError, reading
from motion_jax.utils.input_files import read_json, tensor_sizes
from motion_jax.utils.nearest import did_you_mean
from motion_jax.utils.numerals import shortened

if TYPE_CHECKING:
  from motion_jax.text.encoder import TextEncoder

PRETRAINED = pathlib.Path(__file__).parent / "pretrained"
# {stage of a generator: stage of the tokenizer that it holds}
TOKENIZERS = {"cmdm.denoiser": "cmdm.tokenizer", "cdamd.generator": "cdamd.autoencoder",
              "momask.masked": "momask.rvq", "t2m_gpt.gpt": "t2m_gpt.vq", "mld.denoiser": "mld.vae",
              "motionstreamer.generator": "motionstreamer.tokenizer"}


@dataclasses.dataclass(frozen=True)
class Run:
  """A run folder with its complete config; statistics and weights are read on first use.

  raw: read the weights of the last step, where an average or validated weights are stored beside them.
  """
  folder: pathlib.Path
  config: ml_collections.FrozenConfigDict
  raw: bool = False

  @property
  def stage(self) -> str:
    return self.config.stage

  @property
  def params_file(self) -> str:
    return checkpoint.RAW if self.raw else checkpoint.PARAMS

  @functools.cached_property
  def stats(self) -> Stats:
    """Mean and std of the features in training."""
    return load_stats(self.folder, self.config.data.layout)

  @functools.cached_property
  def fingerprint(self) -> str | None:
    """Fingerprint of the text encoder in training; None if the folder does not have it."""
    return checkpoint.load_fingerprint(self.folder)

  @property
  def text(self) -> str | pathlib.Path:
    """The text encoder of training: the copy in the folder, or the name in the config."""
    carried = self.folder / checkpoint.ENCODER
    return carried if carried.is_dir() else self.config.frozen.text

  def params(self, like: Any = None) -> Any:
    """The weights, less those of a critic; with `like` (arrays or shapes) every name and shape must agree."""
    if not self.config.get("loss", {}).get(checkpoint.CRITIC):
      return checkpoint.load_params(self.folder, like, self.params_file)
    params = checkpoint.load_params(self.folder, name=self.params_file)
    params["params"].pop(checkpoint.CRITIC, None)
    if like is not None:
      checkpoint.check_fits(params, like, f"{self.folder / self.params_file} does not fit its config")
    return params

  def frozen(self, like: Any = None) -> dict[str, Any]:
    """The frozen parts that it was trained with; `like` selects some of them and checks their shapes.

    A shipped model may share these with another, which its config names as its tokenizer.
    """
    folder, other = self.folder, str(self.config.frozen.get("tokenizer", ""))
    if not (folder / checkpoint.FROZEN).is_file() and other in shipped_names(self.stage):
      folder = PRETRAINED / other
    parts = checkpoint.load_params(folder, name=checkpoint.FROZEN)
    if like is not None:
      parts = {name: parts[name] for name in like if name in parts}
      checkpoint.check_fits(parts, like, f"{folder / checkpoint.FROZEN} does not fit its config")
    return parts

  def check_encoder(self, encoder: "TextEncoder") -> None:
    """Raises InputError if the text encoder is another than that of training."""
    if self.fingerprint not in (None, encoder.fingerprint):
      raise InputError(f"{self.folder} was trained on another version of the text encoder "
                       f"{self.config.frozen.get('text', encoder.name)!r} than {encoder.name!r} is; pass the folder "
                       "with the old one as text, or train the run again")


def resolve_run(name: str | os.PathLike, stage: str | Sequence[str] | None = None) -> pathlib.Path:
  """The folder of a run: `name` itself, or the shipped run of that name.

  stage: limits the names in the error text, see `load_run`. Raises TypeError or FileNotFoundError.
  """
  if not isinstance(name, str | os.PathLike):
    raise TypeError(f"got {name!r} ({type(name).__name__}) to load, expected a run folder or the name of one that "
                    f"ships: {', '.join(shipped_names(stage))}")
  for folder in (pathlib.Path(name), PRETRAINED / name):
    if os.path.isdir(folder):  # not Path.is_dir, which raises where a name is longer than any file's
      return folder
  shipped = shipped_names(stage)
  raise FileNotFoundError(f"found neither a run folder {shortened(str(name), 200)!r}{did_you_mean(name, shipped)} nor "
                          f"one of that name that ships: {', '.join(shipped) or 'of this kind none does'}")


def stage_of(name: str | os.PathLike) -> str | None:
  """The stage of the run in a folder, or of the shipped run of that name; None where there is no such run."""
  try:
    return checkpoint.load_config(resolve_run(name)).get("stage")
  except (OSError, TypeError, ValueError):
    return None


def load_run(name: str | os.PathLike, stage: str | Sequence[str] | None = None, raw: bool = False) -> Run:
  """The run in a folder, or the shipped run of that name. stage: the stage, or those, that its config may have.

  Raises FileNotFoundError if there is no run, InputError for one of another stage or with a damaged config.
  """
  folder = resolve_run(name, stage)
  config = checkpoint.load_config(folder)
  stage_name, wanted = config.get("stage"), _stages(stage)
  if stage_name is None or wanted and stage_name not in wanted:
    named = isinstance(stage_name, str) and stage_name.isprintable()
    said = shortened(repr(stage_name)) if named else f"{type(stage_name).__name__} as the stage of a"
    raise InputError(f"{folder} holds a {said} run, expected one of stage {' or '.join(wanted) or 'any kind'}")
  with reading(folder / checkpoint.CONFIG, "restore it from the run that wrote it"):
    return Run(folder, with_defaults(config), raw)


def held_stats(config: ml_collections.ConfigDict) -> Stats | None:
  """The statistics of the run that a partly frozen stage (config.train.freeze) starts from, to which its parameters
  belong; None for other stages, whose statistics come from their data."""
  return load_run(config.train.start).stats if config.train.freeze else None


_STORE = {"data.store": ""}
_MOTION_ERRORS = {"data.balance": 0.0, "loss.acceleration": 0.0, "loss.extremity_velocity": 0.0,
                  "loss.foot_contact": 0.0, "loss.brief_contact": 0.0, "loss.bone_length": 0.0}
_CRITIC = {"loss.critic": 0.0, "loss.critic_matching": 0.0, "loss.critic_after": 0, "loss.critic_width": 64}
_CONTRAST = {"loss.contrast": 0.0, "loss.contrast_margin": 0.1, "loss.contrast_until": 0.5}
_TEXT_ITEMS = {"data.frames_per_latent": 4, "data.crop_frames": 0, "data.keep_long": False, "data.shorten_rate": 1 / 3}
_MDM = {"model.num_goals": 0, "loss.goals": 0.0, "diffusion.schedule": "cosine", "frozen.text_pieces": 0}
_EVALUATOR = {"frozen.text": "", "data.max_frames": 196,
              "model.columns": lambda config: get_layout(config["data"]["layout"]).dim}
_CAPTIONED_EVALUATOR = _EVALUATOR | _TEXT_ITEMS
_QUANTIZER = _MOTION_ERRORS | {"data.released_windows": False, "data.short_window": 0, "quantizer.learn": "means",
                              "data.one_per_clip": False}
# {stage: {field: value}} of the fields that a config may leave out, "" for all stages. Configs of converted checkpoints
# say nothing about training, and a method from outside the package names only the fields that it needs.
DEFAULTS: dict[str, dict[str, Any]] = {
    "": {"data.feature_bias": 0.0, "optimizer.warmup": "full", "data.mode": "benchmark",
         "data.kinematic_captions": False, "data.paraphrases": 0, "data.augment": {}, "data.workers": 0,
         "data.source_weights": (), "data.source_shares": (),
         "optimizer.name": "adamw", "optimizer.fields": {}, "optimizer.schedule_fields": {},
         "optimizer.boundaries": (), "optimizer.gamma": 0.1, "optimizer.skip_loss": 0.0,
         "optimizer.final_rate": 0.0,
         "optimizer.rates": {}, "optimizer.clip_parts": (), "train.dtype": "float32",
         "train.start": "", "train.best": "", "train.workers": 0,
         "train.num_epochs": 0, "train.num_saves": 20, "train.keep_last": 2, "train.tensorboard": False,
         "train.sample_every": 0, "train.cpu_seconds": 0.0, "train.seconds": 0.0, "train.max_skips": 20,
         "train.max_rollbacks": 3, "train.hang_minutes": 60.0, "train.freeze": (),
         "train.start_parts": (), "optimizer.skip_spikes": 0.0,
         "optimizer.accumulate_steps": 1, "optimizer.ema_debias": False,
         "mesh.map": "auto", "mesh.layout": "replicated",
         "mesh.rules": (), "mesh.data": 0, "mesh.model": 1},
    "tmr.teacher": {"model.kind": "part_tmr", "frozen.sentence": "", "frozen.vit": "", "origin": {}},
    "cmdm.tokenizer": _MOTION_ERRORS | _CRITIC | {
        "data.short_window": 0, "frozen.teacher": "", "frozen.evaluator": "", "teacher": {},
        "alignment_teacher": {},
        "loss.adaptive_align": True, "loss.align_fall": 0.9, "loss.reconstruction": "gaussian",
        "loss.distance_pairs": "window", "loss.last_layer": "convolution"},
    "cmdm.denoiser": _TEXT_ITEMS | _STORE | _MOTION_ERRORS | _CONTRAST | {
        "train.remat": False, "train.scan_layers": False, "train.attention": "xla", "frozen.text_level": "words",
        "alignment_teacher": {},
        "distill.teacher": "", "loss.mean_latents": False, "loss.decoded_from": 0.5, "loss.self_forcing": 0.0,
        "loss.pyramid_levels": 0.0, "model.time_left": False, "loss.time_left_drop": 0.0,
        "data.per_segment_captions": 0.0, "data.control": 0.0, "model.control": 0,
        "loss.control": 0.0,
        "loss.level_block": lambda config: config["model"].get("block", 3), "data.vary_subject": 0.0,
        "sampler.schedule": "fss",
        "sampler.solver": lambda config: "ancestral" if config["model"].get("predicts") == "ddpm" else "euler"},
    "cdamd.autoencoder": _MOTION_ERRORS | _CRITIC | {"data.released_windows": False, "data.short_window": 0,
                                            "data.one_per_clip": False,
                                            "loss.latent_noise": 0.0},
    "cdamd.rvq": _MOTION_ERRORS | {"data.released_windows": False, "data.short_window": 0,
                                   "quantizer.learn": "means", "data.one_per_clip": False},
    "cdamd.generator": _TEXT_ITEMS | _STORE | _CONTRAST | {
        "train.remat": False, "train.attention": "xla", "frozen.text_level": "sentence", "frozen.length": "",
        "length": {}, "loss.mask_draw": "count", "data.vary_subject": 0.0},
    "cdamd.length": {"data.vary_subject": 0.0},
    "mdm.denoiser": _MDM, "mdm.dip": _MDM, "mld.vae": {}, "mld.denoiser": {}, "mld.frames": {},
    "motionstreamer.tokenizer": {}, "motionstreamer.generator": {},
    "momask.rvq": _QUANTIZER,
    "momask.masked": _TEXT_ITEMS | {"data.vary_subject": 0.0, "frozen.text_level": "sentence", "frozen.residual": "",
                                    "frozen.length": "", "residual": {}, "length": {}},
    "momask.residual": _TEXT_ITEMS | {"data.vary_subject": 0.0},
    "momask.length": {"data.vary_subject": 0.0},
    "t2m_gpt.vq": _QUANTIZER,
    "t2m_gpt.gpt": {"data.vary_subject": 0.0, "data.shorten_rate": 1 / 3, "frozen.text_level": "sentence"},
    "evaluator.movement": {},
    "evaluator.matching": _CAPTIONED_EVALUATOR | {"frozen.glove": ""},
    "evaluator.t2m": _EVALUATOR,
    "evaluator.clip": _CAPTIONED_EVALUATOR,
    "evaluator.snapmogen": _CAPTIONED_EVALUATOR,
}


def with_defaults(config: ml_collections.ConfigDict) -> ml_collections.ConfigDict:
  """A config with every field that its stage reads: fields that it leaves out get the values of `DEFAULTS`.

  Returns a new ConfigDict, frozen or locked as the given one.
  """
  fields = config.to_dict()
  for path, value in {**DEFAULTS[""], **DEFAULTS.get(fields.get("stage"), {})}.items():
    section, _, field = path.rpartition(".")
    if section == "model" and section not in fields:
      continue  # no network has a default size
    place = fields.setdefault(section, {}) if section else fields
    if isinstance(place, dict) and field not in place:
      place[field] = value(fields) if callable(value) else copy.deepcopy(value)
  new = type(config)(fields)
  return new.lock() if config.is_locked else new


def shipped_names(stage: str | Sequence[str] | None = None) -> list[str]:
  """Names of the shipped runs, of these stages if any are given."""
  names = sorted(path.parent.name for path in PRETRAINED.glob("*/config.json")
                 if (path.parent / "Mean.npy").is_file())  # less the tables of words
  wanted = _stages(stage)
  return [name for name in names if not wanted or checkpoint.load_config(PRETRAINED / name).get("stage") in wanted]


def about(name: str) -> dict[str, str]:
  """The about.json of a shipped model: purpose, abilities, licence and speed."""
  return read_json(PRETRAINED / name / "about.json")


def num_params(folder: str | os.PathLike) -> int:
  """Number of parameters of the run in a folder, as by `TextToMotionModel.num_params`, counted from the headers of its
  files without loading them.
  """
  folder = resolve_run(folder)
  config = checkpoint.load_config(folder)
  tokenizer = folder / checkpoint.FROZEN
  if not tokenizer.is_file() and (shared := (config.get("frozen") or {}).get("tokenizer")) in shipped_names():
    tokenizer = PRETRAINED / shared / checkpoint.FROZEN
  network = sum(tensor_sizes(folder / checkpoint.PARAMS).values())
  inside = tensor_sizes(tokenizer) if tokenizer.is_file() else {}
  return network + sum(count for name, count in inside.items() if name.partition("/")[0] in SAMPLED)


def _stages(stage):
  return (stage,) if isinstance(stage, str) else tuple(stage or ())


# --- runs made of runs: a generator with another decoder, the mean of two generators ----------------------------------


def exchange_decoder(generator: str | pathlib.Path, tokenizer: str | pathlib.Path, out: str | pathlib.Path) -> None:
  """Writes in `out` the run of a generator with the decoder of a tokenizer whose encoder was frozen (train.freeze).

  All other parameters are the generator's. Raises InputError where the encoder has changed, for its latents are not
  those that the generator learned.
  """
  run = load_run(generator, tuple(TOKENIZERS))
  given = load_run(tokenizer, TOKENIZERS[run.stage]).params()["params"]
  frozen = run.frozen()
  own = frozen[TOKENIZER]["params"]
  width = load_run(tokenizer).config.model.get("decoder_width", 0)
  if width == run.config.tokenizer.get("decoder_width", 0):
    checkpoint.check_fits(given["decoder"], own["decoder"], f"the decoder in {tokenizer} does not fit {generator}")
  if not all(map(np.array_equal, *map(jax.tree.leaves, (given["encoder"], own["encoder"])))):
    raise InputError(f"the encoder in {tokenizer} differs from that in {generator}, which learned the latents of its "
                     "own; train with config.train.freeze = (\"encoder\",), or train the generator on it")
  own["decoder"] = given["decoder"]
  _write_changed(run, out, {checkpoint.FROZEN: frozen}, {"decoder_width": width})


def average(first: str | pathlib.Path, second: str | pathlib.Path, out: str | pathlib.Path) -> None:
  """Writes in `out` the first run with the mean of the parameters of both."""
  run = load_run(first)
  params, others = run.params(), load_run(second, run.stage).params()
  checkpoint.check_fits(others, params, f"the parameters in {second} do not fit {first}")
  _write_changed(run, out, {checkpoint.PARAMS: jax.tree.map(lambda a, b: (a + b) / 2, params, others)})


COMBINATIONS = {"exchange_decoder": exchange_decoder, "average": average}


def _write_changed(run, out, changed, tokenizer=None):
  """Copies the files of a run that loading needs, with changed ones {name: parameters}, and changed fields of the
  config's section tokenizer; all of it or nothing."""
  out = pathlib.Path(out)
  if out.exists():
    raise InputError(f"{out} is there already; choose another folder")
  with atomic_folder(out) as folder:
    left_out = shutil.ignore_patterns("checkpoints", "run.lock", "metrics.jsonl", "samples", "profile", "*.tfevents.*")
    shutil.copytree(run.folder, folder, dirs_exist_ok=True, ignore=left_out)
    for name, params in changed.items():
      checkpoint.save_params(folder, params, name=name)
    config = checkpoint.load_json(folder, checkpoint.CONFIG)
    if any(config.get("tokenizer", {}).get(field, 0) != value for field, value in (tokenizer or {}).items()):
      checkpoint.save_config(folder, ml_collections.ConfigDict(config | {"tokenizer": config["tokenizer"] | tokenizer}))
