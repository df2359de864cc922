"""Training set-ups of the evaluators, whose networks the benchmarks measure with."""
import functools

import jax
import numpy as np

from motion_jax import runs
from motion_jax.data import batches, sources
from motion_jax.evaluators import stages as matching
from motion_jax.evaluators.networks import T2MEvaluator
from motion_jax.evaluators.words import CONVERTED, WordFeatures, load_words
from motion_jax.metrics import scores
from motion_jax.motion import stats as stats_lib
from motion_jax.motion.representations import get_layout
from motion_jax.text.captions import meanings
from motion_jax.text.encoder import load_text_encoder
from motion_jax.text.tagger import tag
from motion_jax.training import checkpoint
from motion_jax.training.setup import TrainingSetup, encoder_files, held_out, one_clip_per_caption
from motion_jax.utils.config_files import module_fields

_RULES = ("frames_per_latent", "shorten_rate", "crop_frames", "keep_long")  # of `batches.TextItems`
NUM_VALIDATION = 8  # batches of the validation split over which a loss is averaged, the same every time


def movement(config) -> TrainingSetup:
  """The movement autoencoder, on windows of whole clips."""
  data = sources.load_features(config.data, captioned=False)
  windows = lambda features: batches.Windows(features, config.data.window, config.data.stride)
  train, val = windows(data.features), windows(held_out(config, data.stats).features)
  stage = matching.movement_stage(config)
  predict = jax.jit(lambda params, batch: stage.predict(params, {}, batch, None))

  def evaluate(params):
    size = min(config.data.batch_size, len(val))
    outputs = [predict(params, val.batch(size, config.seed, i)) for i in range(min(NUM_VALIDATION, len(val) // size))]
    return {"held_out_loss": round(float(np.mean([row["loss"] for row in outputs])), 5)}

  next_batch = lambda step, rows=batches.ALL: train.batch(config.data.batch_size, config.seed, step, rows)
  return TrainingSetup(stage, next_batch, {}, evaluate, data.stats, {}, len(train))


def match(config) -> TrainingSetup:
  """Motion and caption encoders on top of a trained movement encoder; words of a GloVe vocabulary or of a text encoder.
  """
  encoder, stats = load_movement(config)
  data = sources.load_features(config.data, stats=stats)
  words, files = load_vocabulary(config)
  stage = matching.matching_stage(config)

  def read(batch, data):
    tokens = [data.tokens.get(caption) or _tagged(caption) for caption in batch.pop("caption")]
    batch["words"], batch["classes"], batch["lengths"] = words(tokens, config.data.max_words)
    return batch

  fresh_init, contrast = stage.init, jax.jit(matching.contrast)

  def init(batch, rng):
    inner = fresh_init(batch, rng)["params"]
    return {"params": inner | {"movement_encoder": encoder or inner["movement_encoder"]}}

  def loss(rows):
    meaning = matching.same_meaning(rows["meaning"])
    text, motion, order = rows["text"], rows["motion"], np.argsort(-rows["num_frames"], kind="stable")
    losses = [contrast(text[order], motion[order], shift, config.loss.margin, meaning[order][:, order])["loss"]
              for shift in range(1, min(len(order), 17))]
    return float(np.mean(losses))

  nearness = lambda text, motion: -scores.distances(text, motion)
  return _captioned_setup(config, stage._replace(init=init), data, read, files, nearness, loss)


def clip(config) -> TrainingSetup:
  """The CLIP-type evaluator; its tables of word pieces are those of the text encoder config.frozen.text."""
  encoder = load_text_encoder(config.frozen.text)
  tokens, positions = matching.piece_tables(encoder)
  fields = config.model
  if tokens.shape != (fields.vocab_size, fields.width) or len(positions) < fields.max_words:
    raise ValueError(f"text encoder {config.frozen.text!r} has tables of {tokens.shape} pieces and {len(positions)} "
                     f"positions, model says vocab_size {fields.vocab_size}, width {fields.width}, max_words "
                     f"{fields.max_words}; make them agree")
  data = sources.load_features(config.data)
  stage = matching.clip_stage(config)
  tables = {"tokens": tokens, "positions": positions[:fields.max_words]}
  fresh_init = stage.init

  def read(batch, data):
    batch["pieces"] = matching.piece_ids(encoder, batch.pop("caption"), fields.max_words)
    return batch

  stage = stage._replace(init=lambda batch, rng: {"params": fresh_init(batch, rng)["params"] | tables})
  return _captioned_setup(config, stage, data, read, encoder_files(encoder), scores.cosines)


def gaussian(config) -> TrainingSetup:
  """SnapMoGen's evaluator, on hidden states of the frozen text encoder config.frozen.text."""
  encoder = load_text_encoder(config.frozen.text)
  data = sources.load_features(config.data)

  def read(batch, data):
    batch["text_emb"], batch["text_mask"] = matching.hidden_states(encoder, batch.pop("caption"), config.data.max_words)
    return batch

  stage = matching.gaussian_stage(config)
  return _captioned_setup(config, stage, data, read, encoder_files(encoder), scores.cosines)


def _captioned_setup(config, stage, data, read, files, nearness, loss=None):
  """The common part of matching and CLIP-type training: clips with captions, validation by loss and retrieval.

  read(batch, data) adds the captions to the batch as the network reads them. nearness(text, motion) (N, N).
  """
  train, val = _Items(config, data), _Items(config, held_out(config, data.stats, captioned=True))
  single = one_clip_per_caption(val.data, config.data.max_frames)
  predict = jax.jit(lambda params, batch: stage.predict(params, {}, batch, None))

  def embed(params, batch):
    batch = read(dict(batch), val.data)
    return batch | jax.tree.map(np.asarray, predict(params, batch))

  def evaluate(params):
    """Retrieval among one clip of each first caption of the split, and where there is a loss of it, that."""
    size = min(config.data.batch_size, len(val.items))
    chosen = np.concatenate([single.kept, np.repeat(single.kept[-1:], -len(single) % size)])
    parts = [embed(params, single.rows(rows, batches.step_rng(config.seed, 4))) for rows in chosen.reshape(-1, size)]
    text, motion = (np.concatenate([part[name] for part in parts])[:len(single)] for name in ("text", "motion"))
    metrics = scores.retrieval(nearness(text, motion))
    metrics["recall"] = float(np.mean([metrics[f"{way}r{k}"] for way in ("", "back_") for k in (1, 2, 3)]))
    if loss:
      metrics["held_out_loss"] = np.mean([loss(embed(params, val.batch(size, config.seed, i)))
                                          for i in range(NUM_VALIDATION)])
    return {name: round(float(value), 4) for name, value in metrics.items()}

  next_batch = lambda step, rows=batches.ALL: read(train.batch(config.data.batch_size, config.seed, step, rows), data)
  return TrainingSetup(stage, next_batch, {}, evaluate, data.stats, files, len(train.items))


class _Items:
  """Clips with captions. Items with equal numbers in `meaning` are not counter-examples to one another.

  config.data.same says which have equal numbers: "" none, "caption" those with the same words, "meaning" also those
  with captions of one clip.
  """

  def __init__(self, config, data):
    rules = config.data
    self.data = data
    self.items = batches.TextItems(data.features, data.captions, rules.min_frames, rules.max_frames,
                                   tuple(rules.lengths), **{name: rules[name] for name in _RULES})
    if rules.same not in ("", "caption", "meaning"):
      raise ValueError(f"got data.same {rules.same!r}, expected '', caption or meaning")
    linked = data.captions if rules.same == "meaning" else [[caption] for row in data.captions for caption in row]
    self.numbers = meanings(linked) if rules.same else {}

  def batch(self, size, seed, step, rows=batches.ALL):
    batch = self.items.batch(size, seed, step, rows)
    captions = batch["caption"][rows]
    meaning = [self.numbers.get(caption, -1 - i) for i, caption in zip(batch["index"], captions)]
    return batch | {"caption": captions, "meaning": np.array(meaning, np.int32)}


@functools.lru_cache(maxsize=100_000)
def _tagged(caption):
  return tuple(tag(caption))


def load_movement(config):
  """(parameters of the movement encoder, statistics) of a trained autoencoder; (None, None) for "random-init"."""
  folder = config.frozen.movement
  if folder == "random-init":
    return None, None
  run = runs.load_run(folder, "evaluator.movement")
  theirs, ours = run.config.model, config.model
  if (theirs.features, theirs.columns, theirs.width, theirs.dim) != (
      ours.features, ours.columns, ours.movement_width, ours.movement_dim):
    raise ValueError(f"the movement encoder in {folder} is {module_fields(theirs)}, which does not fit model "
                     f"{module_fields(ours)}; make them agree")
  params = run.params()["encoder"]
  shapes = matching.t2m_shapes(T2MEvaluator(**ours), 1)["params"]["movement_encoder"]
  checkpoint.check_fits(params, shapes, f"the movement encoder in {folder} does not fit its config")
  return params, stats_lib.load_stats(folder, config.data.layout)


def load_vocabulary(config):
  """(words, files of the run folder): GloVe's of config.frozen.glove if given, else of a text encoder."""
  if config.frozen.glove:
    words = load_words(config.frozen.glove)
    return words, {CONVERTED: words.to_bytes()}
  encoder = load_text_encoder(config.frozen.text)
  return WordFeatures(encoder), encoder_files(encoder)


def _checked(setup):
  """A set-up whose config is checked before any data is read."""
  def checked(config):
    matching.check_columns(config.model, get_layout(config.data.layout))
    return setup(config)
  return checked


SETUPS = {"evaluator.movement": _checked(movement), "evaluator.matching": _checked(match),
          "evaluator.clip": _checked(clip), "evaluator.snapmogen": _checked(gaussian)}
