"""Training of the evaluators, as pure functions: motions and captions by contrast, so that distances can be measured.

Four trainings (docs/papers/cdamd.md#matching-evaluator, #clip-evaluator, docs/papers/cmdm.md#snapmogen): the movement
autoencoder, whose encoder is frozen afterwards; motion and caption encoders that are matched on top of it; the
CLIP-type pair of transformers; SnapMoGen's Gaussians. Networks: `evaluators.networks`, `evaluators.snapmogen_network`.
"""
import jax
import jax.numpy as jnp
import numpy as np
import optax

from motion_jax.evaluators.networks import ClipEvaluator, MovementDecoder, MovementEncoder, T2MEvaluator, unit_vectors
from motion_jax.evaluators.snapmogen_network import GaussianDecoder, SnapEvaluator
from motion_jax.evaluators.words import CLASSES
from motion_jax.models.tmr.losses import divergence, info_nce
from motion_jax.nets.masks import padding_mask
from motion_jax.training.stage import DEVICES, Stage, mixed_precision

_EPS = 1e-6  # Parity: PyTorch's pairwise distance adds it to each difference


def check_columns(model, layout, name="the config"):
  """Raises ValueError unless model.columns is the size of a frame of the layout, and model.features at most that."""
  features, columns = model.get("features", layout.dim), model.get("columns", layout.dim)
  if columns != layout.dim or not 0 < features <= columns:
    exchanged = "; the two are exchanged" if features == layout.dim > columns > 0 else ""
    raise ValueError(f"{name}: got model.features {features} and model.columns {columns}, expected model.columns "
                     f"{layout.dim}, the numbers a frame of layout {layout.name!r}, and model.features from 1 to "
                     f"{layout.dim}, the first of them that are read{exchanged}")


# --- movement autoencoder -----------------------------------------------------------------------------------------


def movement_networks(fields):
  """(encoder, decoder) of config.model: features, columns, width, dim, dropout."""
  return (MovementEncoder(fields["width"], fields["dim"], fields["dropout"]),
          MovementDecoder(fields["features"], fields["width"]))


def init_movement(fields, rng):
  """Random parameters of both: {"encoder": ..., "decoder": ...}."""
  encoder, decoder = movement_networks(fields)
  encoder_rng, decoder_rng = jax.random.split(rng)
  return {"encoder": encoder.init(encoder_rng, jnp.zeros((1, 8, fields["features"])))["params"],
          "decoder": decoder.init(decoder_rng, jnp.zeros((1, 2, encoder.dim)))["params"]}


def movement_stage(config) -> Stage:
  """Trains the movement encoder as half of an autoencoder. Batch: features (B, W, columns), index (B,).

  L1 of the reconstruction of the first `features` columns, plus small weights that keep tokens small and slow.
  """
  encoder, decoder = (mixed_precision(net, config) for net in movement_networks(config.model))
  used = slice(0, config.model.features)

  def errors(params, batch, rngs=None):
    x = batch["features"][..., used]
    tokens = encoder.apply({"params": params["encoder"]}, x, rngs is None, rngs=rngs)
    decoded = decoder.apply({"params": params["decoder"]}, tokens)
    sums = {"reconstruction": jnp.abs(decoded - x).mean(), "size": jnp.abs(tokens).mean(),
            "change": jnp.abs(jnp.diff(tokens, axis=1)).mean()}
    extra = config.loss.size * sums["size"] + config.loss.change * sums["change"]
    return sums | {"loss": sums["reconstruction"] + extra}

  def loss(params, frozen, batch, step, rng):
    return errors(params, batch, {"dropout": jax.random.fold_in(rng, batch["index"][0])}), 1.0

  return Stage(lambda batch, rng: init_movement(config.model, rng), loss,
               lambda params, frozen, batch, rng: errors(params, batch))


# --- matching -----------------------------------------------------------------------------------------------------


def contrast(text, motion, shift, margin=10.0, same=None):
  """Contrastive loss: {"loss", "positive", "negative"} of text and motion (B, E).

  mean(d+^2) + mean(max(0, margin - d-)^2), Euclidean; the wrong motion of a text is `shift` rows further on. same (B,
  B): pairs of equal meaning, which are not wrong ones; the original has no such filter.
  """
  rows = jnp.arange(len(text))
  other = (rows + shift) % len(text)
  distance = lambda a, b: jnp.sqrt(jnp.square(a - b + _EPS).sum(-1))
  wrong = jnp.ones(len(text), bool) if same is None else ~same[rows, other]
  positive = jnp.square(distance(text, motion)).mean()
  too_near = jnp.square(jnp.maximum(margin - distance(text, motion[other]), 0))
  negative = jnp.where(wrong, too_near, 0).sum() / jnp.maximum(wrong.sum(), 1)
  return {"loss": positive + negative, "positive": positive, "negative": negative}


def by_length(num_frames, *arrays):
  """Rows by decreasing length. Parity: the original rotates the motions in this order, so that the wrong motion of a
  small shift is of similar length; ties stay in order here, in the original as numpy's sort leaves them.
  """
  order = jnp.argsort(-num_frames)
  return [jnp.asarray(array)[order] for array in arrays]


def same_meaning(numbers):
  """(B, B): which rows have the same number."""
  return numbers[:, None] == numbers[None]


def t2m_shapes(net, word_dim):
  """Shapes of a T2M evaluator's parameters, for word vectors of the given dimension."""
  return jax.eval_shape(lambda: init_t2m(net, word_dim, jax.random.key(0)))


def init_t2m(net, word_dim, rng):
  """Random parameters of a `T2MEvaluator`, for word vectors of the given dimension."""
  length = jnp.ones(1, jnp.int32)
  words, classes = jnp.zeros((1, 4, word_dim)), jnp.zeros((1, 4, len(CLASSES)))
  return net.init(rng, words, classes, length, jnp.zeros((1, 8, net.columns)), 8 * length)


def matching_stage(config, axis_name=DEVICES) -> Stage:
  """Trains motion and caption encoders of a `T2MEvaluator`; its movement encoder is frozen, in evaluation mode.

  Batch: features (B, T, columns), num_frames (B,), words (B, S, W), classes (B, S, 15), lengths (B,), meaning (B,),
  index (B,). The contrast is over the whole batch on all devices; axis_name None: outside of a map. loss.first_shift:
  the wrong motions are first_shift .. B - 2 + first_shift rows further on. Parity: 0, as in the original, which one
  time in B - 1 pushes the right pairs apart.
  """
  net = mixed_precision(T2MEvaluator(**config.model), config)
  whole = _gather(axis_name)

  def loss(params, frozen, batch, step, rng):
    inner = params["params"]
    held = {"params": inner | {"movement_encoder": jax.lax.stop_gradient(inner["movement_encoder"])}}
    embedded = _embed(net, held, batch)
    parts = (embedded["text"], embedded["motion"], batch["meaning"])
    text, motion, meaning = by_length(whole(batch["num_frames"]), *map(whole, parts))
    first = config.loss.first_shift
    shift = jax.random.randint(rng, (), first, len(text) - 1 + first)
    return contrast(text, motion, shift, config.loss.margin, same_meaning(meaning)), 1.0

  def init(batch, rng):
    return init_t2m(net, batch["words"].shape[-1], rng)

  return Stage(init, loss, lambda params, frozen, batch, rng: _embed(net, params, batch))


def _embed(net, params, batch):
  given = (batch[name] for name in ("words", "classes", "lengths", "features", "num_frames"))
  text, motion = net.apply(params, *given)
  return {"text": text, "motion": motion}


def _gather(axis_name):
  return (lambda a: a) if axis_name is None else (lambda a: jax.lax.all_gather(a, axis_name, tiled=True))


# --- CLIP-type ----------------------------------------------------------------------------------------------------


def init_clip(net, rng):
  """Random parameters of a `ClipEvaluator`, its tables too."""
  return net.init(rng, jnp.zeros((1, net.max_words), jnp.int32), jnp.zeros((1, 4, net.columns)),
                  jnp.full(1, 4, jnp.int32))


def clip_shapes(net):
  """Shapes of a `ClipEvaluator`'s parameters."""
  return jax.eval_shape(lambda: init_clip(net, jax.random.key(0)))


def clip_stage(config, axis_name=DEVICES) -> Stage:
  """Trains a `ClipEvaluator` by symmetric InfoNCE with a learned scale over the whole batch, of all devices.

  Batch: features (B, T, columns), num_frames (B,), pieces (B, max_words), meaning (B,), index (B,). The tables of word
  pieces come with `init` from a text encoder (see `setup`) and stay as they are.
  """
  net = mixed_precision(ClipEvaluator(**config.model), config)
  whole = _gather(axis_name)

  def run(params, method, rng, *inputs):
    rngs = None if rng is None else {"dropout": rng}
    return unit_vectors(net.apply(params, *inputs, rng is None, method=method, rngs=rngs))

  def embed(params, batch, text_rng=None, motion_rng=None):
    return {"text": run(params, "text", text_rng, batch["pieces"]),
            "motion": run(params, "motion", motion_rng, batch["features"], batch["num_frames"])}

  def loss(params, frozen, batch, step, rng):
    # Dropout masks differ from device to device, as the batch they fall on does.
    embedded = embed(params, batch, *jax.random.split(jax.random.fold_in(rng, batch["index"][0])))
    same = same_meaning(whole(batch["meaning"]))
    scale = net.apply(params, method="scale")
    value, logits = info_nce(whole(embedded["text"]), whole(embedded["motion"]), scale, same)
    hit = (logits.argmax(1) == jnp.arange(len(logits))).mean()
    return {"loss": value, "batch_recall": hit, "scale": scale}, 1.0

  return Stage(lambda batch, rng: init_clip(net, rng), loss,
               lambda params, frozen, batch, rng: embed(params, batch))


# --- SnapMoGen's --------------------------------------------------------------------------------------------------


def gaussian_networks(fields):
  """(evaluator, decoder) of config.model, the decoder as deep and wide as the encoders."""
  net = SnapEvaluator(**fields)
  return net, GaussianDecoder(net.features, net.depth, net.num_heads, net.mlp_width, net.dropout)


def init_gaussian(fields, word_dim, rng):
  """Random parameters {"params": the evaluator's, "decoder": ...}, for word vectors of the given dimension."""
  net, decoder = gaussian_networks(fields)
  net_rng, decoder_rng = jax.random.split(rng)
  real_mask, frames = jnp.ones((1, 8), bool), jnp.full(1, 8, jnp.int32)
  return {"params": net.init(net_rng, jnp.zeros((1, 8, word_dim)), real_mask, jnp.zeros((1, 8, net.columns)),
                             frames)["params"],
          "decoder": decoder.init(decoder_rng, jnp.zeros((1, net.width)), real_mask)["params"]}


def gaussian_stage(config, axis_name=DEVICES) -> Stage:
  """Trains a `SnapEvaluator` as TMR is trained: both latents decode to the motion, the Gaussians of a pair are alike
  and close to the unit one, and a contrast separates pairs by their cosines.

  Batch: features (B, T, columns), num_frames (B,), text_emb (B, S, W), text_mask (B, S), meaning (B,), index (B,).
  SnapMoGen's weights of the losses are TMR's (docs/papers/cmdm.md#snapmogen). Parity: padded frames count in the
  reconstruction, as zeros that are met, which lowers the loss of short clips.
  """
  net, decoder = (mixed_precision(module, config) for module in gaussian_networks(config.model))
  whole = _gather(axis_name)

  def encode(params, batch, text_rng=None, motion_rng=None):
    def run(method, rng, *inputs):
      rngs = None if rng is None else {"dropout": rng}
      return net.apply({"params": params["params"]}, *inputs, rng is None, method=method, rngs=rngs)

    return (run("text_gaussian", text_rng, batch["text_emb"], batch["text_mask"]),
            run("motion_gaussian", motion_rng, batch["features"], batch["num_frames"]))

  def loss(params, frozen, batch, step, rng):
    # Noise and dropout differ from device to device, as the batch they fall on does.
    keys = iter(jax.random.split(jax.random.fold_in(rng, batch["index"][0]), 6))
    (_, *text), (_, *motion) = encode(params, batch, next(keys), next(keys))
    draw = lambda mean, logvar: mean + jnp.exp(logvar / 2) * jax.random.normal(next(keys), mean.shape)
    text_z, motion_z = draw(*text), draw(*motion)
    target = batch["features"][..., :net.features]
    real_mask = padding_mask(batch["num_frames"], target.shape[1])
    rebuilt = [decoder.apply({"params": params["decoder"]}, z, real_mask, False, rngs={"dropout": next(keys)})
               for z in (text_z, motion_z)]
    unit_gaussian = [jnp.zeros_like(text_z)] * 2
    sums = {"reconstruction": sum(optax.huber_loss(prediction, target).mean() for prediction in rebuilt),
            "divergence": (divergence(text, unit_gaussian) + divergence(motion, unit_gaussian)
                           + divergence(text, motion) + divergence(motion, text)),
            "latent": optax.huber_loss(text_z, motion_z).mean(),
            "contrast": info_nce(whole(unit_vectors(text_z)), whole(unit_vectors(motion_z)),
                                 1 / config.loss.temperature, same_meaning(whole(batch["meaning"])))[0]}
    return sums | {"loss": sum(config.loss[name] * value for name, value in sums.items())}, 1.0

  def predict(params, frozen, batch, rng):
    (_, text, _), (_, motion, _) = encode(params, batch)
    return {"text": text, "motion": motion}

  return Stage(lambda batch, rng: init_gaussian(config.model, batch["text_emb"].shape[-1], rng), loss, predict)


# --- word pieces --------------------------------------------------------------------------------------------------


def piece_tables(encoder):
  """Token (V, W) and position (P, W) tables of a BERT- or CLIP-like text encoder, which the CLIP-type evaluator reads.

  The network finds the end of a sentence at its largest id, as CLIP's is; where the encoder's end piece is another, it
  is given a new last row.
  """
  params = encoder.params
  if not {"words", "positions"} <= params.keys():
    raise ValueError(f"text encoder {encoder.name!r} has no tables of words and positions; take a CLIP or BERT model")
  tokens, positions = (np.asarray(params[name]["embedding"]) for name in ("words", "positions"))
  end = _end(encoder)
  return (tokens if end == len(tokens) - 1 else np.concatenate([tokens, tokens[end:end + 1]])), positions


def piece_ids(encoder, captions, max_words):
  """Captions as word pieces (B, max_words): begin, words, end (the largest id), zeros. Longer ones are cut."""
  end, rows = _end(encoder), len(encoder.params["words"]["embedding"])
  out = np.zeros((len(captions), max_words), np.int32)
  for row, caption in zip(out, captions):
    ids = encoder.tokenizer.encode(caption).ids[:-1][:max_words - 1]
    row[:len(ids)], row[len(ids)] = ids, end if end == rows - 1 else rows
  return out


def _end(encoder):
  return encoder.tokenizer.encode("a").ids[-1]


def hidden_states(encoder, captions, max_words):
  """Hidden states of a text encoder for captions, (B, max_words, W), and their mask (B, max_words).

  Parity: SnapMoGen cuts the caption before it is encoded, here its hidden states are cut.
  """
  text_emb, text_mask = encoder(captions)
  size = min(text_mask.shape[1], max_words)
  out = np.zeros((len(captions), max_words, text_emb.shape[-1]), np.float32), np.zeros((len(captions), max_words), bool)
  out[0][:, :size], out[1][:, :size] = text_emb[:, :size], text_mask[:, :size]
  return out
