"""Training set-ups of CMDM: how its teacher, its tokenizer and its denoiser are trained."""
import functools
import os
from typing import Any

import jax
from ml_collections import ConfigDict

from motion_jax import runs
from motion_jax.control import conditioning
from motion_jax.data import batches, sources, store
from motion_jax.latents import TOKENIZER, VaeCodec
from motion_jax.models import cmdm
from motion_jax.models.cmdm import distill, scored
from motion_jax.models.cmdm.parts import most_parts, time_left, words_by_part
from motion_jax.models.shared import motion_errors
from motion_jax.models.shared.captioned_batches import (
  check_captions,
  contradicted,
  contradictions_of,
  held_out_means,
  measured_loss,
  text_files,
  undisturbed,
)
from motion_jax.models.shared.critic import with_critic
from motion_jax.models.tmr import alignment
from motion_jax.models.tmr.space import make_teacher, teacher_shapes
from motion_jax.motion import stats as stats_lib
from motion_jax.motion.representations import get_layout
from motion_jax.motion.stats import Stats
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.runs import held_stats
from motion_jax.text import bert
from motion_jax.text.captions import vary_subject
from motion_jax.text.encoder import load_text_encoder
from motion_jax.text.padding import narrowest
from motion_jax.training import checkpoint
from motion_jax.training.setup import (
  TrainingSetup,
  demand_same_network,
  held_out,
  reconstruction_error,
  resolve_epochs,
  untrained,
)
from motion_jax.utils.config_files import module_fields
from motion_jax.utils.errors import InputError

RANDOM_INIT_TEXT = bert.bert_fields(dict(model_type="distilbert", vocab_size=4, dim=8, n_layers=1, n_heads=1,
                                         hidden_dim=8))
_TOKENIZERS = ("cmdm.tokenizer", "cmdm.denoiser")  # runs with one in them


def tokenizer(config: ConfigDict) -> TrainingSetup:
  data = sources.load_features(config.data, stats=held_stats(config), captioned=False)
  windows = batches.Windows(data.features, config.data.window, config.data.stride,
                            groups=data.groups, balance=config.data.balance, short=config.data.short_window,
                            factors=data.source_factors(config.data))
  config = resolve_epochs(config, len(windows))  # the weight of the alignment falls to the end of training
  validation = held_out(config, data.stats).features
  vae = CausalVAE(**config.model)
  reconstruct = jax.jit(lambda params, x: VaeCodec(vae, params).reconstruct(x))

  def evaluate(params):
    return {"held_out_mm": round(reconstruction_error(lambda x: reconstruct(params, x), validation, data.stats), 2)}

  def next_batch(step, rows=batches.ALL):
    return windows.batch(config.data.batch_size, config.seed, step, rows)

  frozen = motion_errors.frozen_stats(config, data.stats)
  if config.frozen.teacher:
    frozen["teacher"], view = load_teacher(config, data.stats)
    if view is not None:
      frozen["teacher_view"] = view
  stage = with_critic(cmdm.tokenizer_stage(config), config)
  return TrainingSetup(stage, next_batch, frozen, evaluate, data.stats, {}, len(windows))


def load_teacher(config: ConfigDict, stats: Stats) -> tuple[Any, dict[str, Any] | None]:
  """(parameters of the teacher's motion side, `alignment.view_of` it) from a run folder, or "random-init"; its fields
  are those of config.teacher, see `tokenizer_fields`.

  Raises ValueError where it cannot read the features that the tokenizer is given.
  """
  folder, fields = config.frozen.teacher, config.teacher.to_dict()
  own_layout = fields.get("layout", config.data.layout)
  if folder == "random-init":
    teacher_stats = alignment.plain_stats(own_layout)
    view = None if own_layout == stats.layout.name else alignment.view_of(stats, teacher_stats, folder)
  else:
    run = runs.load_run(folder, "tmr.teacher")
    view = alignment.view_of(stats, run.stats, folder)
  teacher = make_teacher(fields, config.data.layout)
  if teacher.dim != config.model.teacher_dim:
    raise ValueError(f"the teacher gives {teacher.dim} numbers a frame, config.model.teacher_dim is "
                     f"{config.model.teacher_dim}; make them agree")
  if folder == "random-init":
    shapes = teacher_shapes(teacher, RANDOM_INIT_TEXT, own_layout)
    return alignment.motion_side(teacher, untrained({"motion": shapes["motion"]})), view
  params = run.params()
  shapes = teacher_shapes(teacher, run.config.text, own_layout)
  checkpoint.check_fits(params, shapes, f"the teacher in {folder} does not fit its config")
  return alignment.motion_side(teacher, params), view


def tokenizer_fields(config: ConfigDict) -> dict[str, Any]:
  """Config fields that record what a tokenizer's latents were aligned with: the fields of the teacher, and where its
  weights came from."""
  if not config.frozen.teacher and config.train.start:  # what a tokenizer was aligned with stays true
    before = runs.load_run(config.train.start).config.get("alignment_teacher", {})
    return {"alignment_teacher": before.to_dict()} if before else {}
  if not config.frozen.teacher:
    return {}
  if config.frozen.teacher == "random-init":
    return {"alignment_teacher": {"weights": "untrained"}}
  run = runs.load_run(config.frozen.teacher, "tmr.teacher").config
  fields = run.model.to_dict()
  if get_layout(run.data.layout) != get_layout(config.data.layout):
    fields["layout"] = get_layout(run.data.layout).name
  return {"teacher": fields, "alignment_teacher": {"kind": fields["kind"], **run.origin.to_dict()}}


def denoiser_fields(config: ConfigDict) -> dict[str, Any]:
  """Config fields taken over from the runs of frozen parts: the teacher with which the tokenizer was aligned, for the
  record, and the number of control features per latent. A student takes over all sizes, text encoder and latents of
  its teacher, and starts from its parameters."""
  if "num_steps" in config.distill and not config.distill.teacher:
    raise InputError("got no config.distill.teacher, expected the denoiser that the student learns from: a run folder, "
                     "or a name that ships such as cmdm-small")
  if _has_teacher(config):
    run = runs.load_run(config.distill.teacher, "cmdm.denoiser")
    sections = {name: run.config[name].to_dict() for name in ("model", "tokenizer", "alignment_teacher")}
    text = {"text": str(run.text), "text_level": run.config.frozen.text_level}
    return sections | {"frozen": config.frozen.to_dict() | text | {"tokenizer": str(run.folder)},
                       "train": config.train.to_dict() | {"start": config.train.start or config.distill.teacher}}
  fields: dict[str, Any] = {}
  if config.data.control and not config.model.control:
    count = conditioning.size(2 ** config.tokenizer.num_halvings)
    fields["model"] = config.model.to_dict() | {"control": count}
  if config.frozen.tokenizer == "random-init":
    return fields
  taught = runs.load_run(config.frozen.tokenizer, _TOKENIZERS).config.alignment_teacher
  return fields | ({"alignment_teacher": taught.to_dict()} if taught else {})


def _has_teacher(config):
  """Whether a student's teacher is a run; "random-init" is one with random weights, to try things out."""
  return config.distill.teacher not in ("", "random-init")


def _denoiser_parts(config):
  """(data, their cuts with captions, text encoder, codec) of a denoiser's config."""
  if _has_teacher(config):
    run = runs.load_run(config.distill.teacher, "cmdm.denoiser")
    vae = CausalVAE(**module_fields(config.tokenizer))
    stats, codec = run.stats, VaeCodec.of(vae, run.frozen(cmdm.frozen_shapes(vae)))
  else:
    codec, stats = load_tokenizer(config.frozen.tokenizer, config)
  data = sources.load_features(config.data, stats=stats)
  if config.data.per_segment_captions and not any(data.spans):
    raise InputError(f"got data.per_segment_captions={config.data.per_segment_captions:g}, but no clip was put "
                     "together of several; add some with data.augment.stitched or data.augment.idle")
  items = _items(config, data, tuple(config.data.lengths), data.draw_weights(config.data))
  encoder = load_text_encoder(config.frozen.text, level=config.frozen.text_level)
  check_captions(data, encoder)
  if codec.mean is None:  # a bare tokenizer's latents have no scale yet
    codec = codec.fitted(data.features) if config.loss.unit_latents else codec.unscaled()
  return data, items, encoder, codec


def _items(config, data, lengths, weights=None):
  rules = {name: config.data[name] for name in ("frames_per_latent", "crop_frames", "keep_long", "shorten_rate")}
  if config.data.per_segment_captions and any(data.spans):
    rules |= dict(spans=data.spans, per_segment_captions=config.data.per_segment_captions)
  if _is_scored(config):
    if None in data.optimality:
      raise InputError(f"got {data.optimality.count(None)} clips without an optimality, expected an archive of scored "
                       "samples alone, by motion-jax data compose --group")
    rules["optimality"] = data.optimality
  return batches.TextItems(data.features, data.captions, config.data.min_frames, config.data.max_frames, lengths,
                           weights=weights, **rules)


def _is_scored(config):
  """Whether a denoiser learns from its own scored samples."""
  return bool(config.get("scored", {}).get("sampler"))


def _held_out_loss(config, stats, encoder, codec):
  """evaluate(params): the loss of held-out clips, captions given; on the same cuts, times and noise every time, so that
  only the parameters make a difference. None where no held-out clip is long enough."""
  data = held_out(config, stats, captioned=True)
  try:
    items = _items(config, data, (config.data.max_frames,))
  except ValueError as error:
    print(f"note: no loss on held-out clips: {error}")
    return None
  check_captions(data, encoder)
  size = min(config.data.batch_size, len(items))
  frozen = codec.parts | motion_errors.frozen_stats(config, stats)

  def batch(i):
    drawn = items.batch(size, config.seed, i)
    text_emb, text_mask = encoder(drawn.pop("caption"), at_least=config.data.max_words)
    return drawn | {"text_emb": text_emb, "text_mask": text_mask} | _time_left(config, drawn, [()] * size)

  return held_out_means(batch, measured_loss(cmdm.denoiser_stage(undisturbed(config)).loss), frozen)


def _time_left(config, batch, segments):
  """{"time_left": (B, L)} of a batch, for a network with time_left; else {}."""
  if not config.model.get("time_left"):
    return {}
  data = config.data
  count = (batch["distribution"].shape[1] if "distribution" in batch else
           batch["features"].shape[1] // data.frames_per_latent)
  return {"time_left": time_left(batch["num_frames"], segments, count, data.frames_per_latent, config.model.block)}


def not_sampled(config: ConfigDict) -> list[str]:
  """Limits of a denoiser that is trained by this config, a sentence each."""
  notes = []
  if not config.tokenizer.causal:
    notes.append("the tokenizer looks both ways (tokenizer.causal=False): whole motions alone, no stream, and "
                 "constraints do not pull them")
  if config.sampler.schedule == "full":
    notes.append("sampler.schedule='full' cleans all latents together: no stream and no continued motion, but with "
                 "--sampling schedule=fss")
  if config.sampler.solver != "euler":
    notes.append(f"sampler.solver={config.sampler.solver!r}: way=chain, the usual one of long motions in evaluations, "
                 "knows only euler; evaluate them with --sampling way=stream")
  return notes


def denoiser(config: ConfigDict) -> TrainingSetup:
  for note in not_sampled(config):
    print(f"note: {note}")
  data, items, encoder, codec = _denoiser_parts(config)
  words, draw = narrowest(config.data.max_words), items.batch
  if config.data.store:
    if wanted := motion_errors.weights(config.loss):
      raise InputError(f"got loss.{next(iter(wanted))} and data.store: a store holds latents, and decoded motion is "
                       "held to the features of real motion; leave out one of the two")
    if config.data.control:
      raise InputError("got data.control and data.store: a store holds latents, and constraints are drawn from the "
                       "joints of real motions; leave out one of the two")
    if config.data.per_segment_captions:
      raise InputError("got data.per_segment_captions and data.store: a store holds the words of whole clips; leave "
                       "out one of the two")
    kept = store.Store(config.data.store)
    kept.require(store.identity_of(codec.parts, items, encoder))
    encoder.recall(kept.words)
    draw = functools.partial(store.stored_batch, kept, items, ("distribution",), latents_look_back=codec.net.causal)

  reader = encoder.for_training()

  def next_batch(step, rows=batches.ALL):
    batch = draw(config.data.batch_size, config.seed, step, rows)
    rng = batches.step_rng(config.seed, 2, step)
    said = [vary_subject(caption, rng, config.data.vary_subject) for caption in batch.pop("caption")]
    # Parity: the reference cuts no caption, and pads all batches alike; here to one of a few widths, by the longest.
    segments = [[(vary_subject(text, rng, config.data.vary_subject), *span) for text, *span in row]
                for row in batch.pop("segments", None) or ()]

    def encoded(said, segments):
      if segments:
        return words_by_part(reader, said, segments, most_parts(data.spans), batch["features"].shape[1],
                             config.data.frames_per_latent, config.model.block, words, rows)
      return dict(zip(("text_emb", "text_mask"), reader(said, at_least=words, rows=rows)))

    arrays = encoded(said, segments)
    if config.loss.contrast:
      shown = [[text for text, *_ in spans] or [caption] for caption, spans in zip(said, segments or [[]] * len(said))]
      false = contradicted([text for texts in shown for text in texts], config.seed, step)
      other = encoded([false.get(caption, caption) for caption in said],
                      [[(false[text], *span) for text, *span in row] for row in segments])
      arrays = contradictions_of(arrays, other, [any(false[text] != text for text in texts) for texts in shown[rows]])
    spans: list[Any] = [*segments] or [()] * len(said)
    return batch | arrays | _time_left(config, batch, spans[rows])

  evaluate = _held_out_loss(config, data.stats, encoder, codec)
  stage, frozen = cmdm.denoiser_stage(config), codec.parts | motion_errors.frozen_stats(config, data.stats)
  if _is_scored(config):
    shapes = cmdm.denoiser_shapes(CausalDiT(**module_fields(config.model)))
    stage, evaluate = scored.scored_stage(config), None
    frozen = frozen | {name: untrained(shapes) if config.scored[name] == "random-init" else
                       runs.load_run(config.scored[name], "cmdm.denoiser").params(shapes)
                       for name in (scored.SAMPLER, scored.REFERENCE)}
  if config.distill.teacher:
    shapes = cmdm.denoiser_shapes(CausalDiT(**module_fields(config.model)))
    teacher = (runs.load_run(config.distill.teacher, "cmdm.denoiser").params(shapes) if _has_teacher(config)
               else untrained(shapes))
    stage, frozen = distill.student_stage(config), frozen | {distill.TEACHER: teacher}
  return TrainingSetup(stage, next_batch, frozen, evaluate, data.stats, text_files(data, encoder), len(items))


def encode_denoiser(config: ConfigDict, folder: str | os.PathLike) -> str:
  """Writes the store of a denoiser's data; returns a line of summary."""
  _, items, encoder, codec = _denoiser_parts(config)
  encode = lambda parts, x, num_frames: {"distribution": VaeCodec.of(codec.net, parts).distribution(x)}
  return store.encode(folder, codec.parts, items, encoder, encode, config.data.vary_subject > 0,
                      latents_look_back=codec.net.causal)


def load_tokenizer(folder: str, config: ConfigDict) -> tuple[VaeCodec, Stats]:
  """(codec, stats) of a trained tokenizer, without a scale of its latents (None), or of the one that a denoiser's run
  or a model that ships stands on, with the scale that the denoiser knows; "random-init" makes one to try things out.
  """
  if folder == "random-init":
    vae = CausalVAE(**config.tokenizer)
    return VaeCodec(vae, untrained(cmdm.frozen_shapes(vae)[TOKENIZER]), None, None), sources.load_features(
        config.data).stats
  run = runs.load_run(folder, _TOKENIZERS)
  inside = run.config.stage == "cmdm.denoiser"
  fields = module_fields(run.config.tokenizer if inside else run.config.model)
  theirs = CausalVAE(**fields)
  vae = CausalVAE(**module_fields(config.tokenizer))
  # What it was aligned with plays no part any more.
  demand_same_network(f"the tokenizer in {folder}", theirs, vae, teacher_dim=0, teacher_to_latent=False)
  stats = stats_lib.load_stats(run.folder, config.data.layout)
  if inside:
    return VaeCodec.of(vae, run.frozen(cmdm.frozen_shapes(vae))), stats
  params = run.params(cmdm.frozen_shapes(theirs)[TOKENIZER])
  params["params"].pop("align", None)
  return VaeCodec(vae, params, None, None), stats


RESOLVED = {"cmdm.tokenizer": tokenizer_fields, "cmdm.denoiser": denoiser_fields}
STORES = {"cmdm.denoiser": encode_denoiser}
SETUPS = {"cmdm.tokenizer": tokenizer, "cmdm.denoiser": denoiser}
