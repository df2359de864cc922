"""What CDAMD trains, as pure functions: the autoencoder, the RVQ-VAE, and the masked transformer on their latents."""
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Bool, Float, Int
from ml_collections import ConfigDict

from motion_jax.latents import AutoencoderCodec, RvqCodec
from motion_jax.models import motion_errors
from motion_jax.models.cdamd.draws import draw_step
from motion_jax.models.cdamd.losses import autoencoder_terms, generator_loss, rvq_terms, with_motion_errors
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.diffusion_mlp import DiffusionMLP, Generator
from motion_jax.nets.masked_transformer import TRANSFORMERS
from motion_jax.nets.masks import padding_mask
from motion_jax.quant import rvq, vq
from motion_jax.shapes import Array
from motion_jax.training.stage import DEVICES, Stage, mixed_precision


def empty_codebooks(net: Autoencoder, quantizer: Any) -> dict[str, Any]:
  """The RVQ-VAE's collection "codebooks" before training: a dict of the fields of `vq.Codebook`, each (Q, ...)."""
  book = vq.empty_codebook(quantizer.num_codes, net.latent_dim, (quantizer.num_levels,))
  return {"codebooks": book._asdict()}


def autoencoder_shapes(net: Autoencoder, quantizer: Any = None) -> Any:
  """Shapes of the variables of an autoencoder or, with a quantizer section, an RVQ-VAE, to check a file against."""
  x = jnp.zeros((1, net.frames_per_latent, net.features))
  codebooks = (lambda: empty_codebooks(net, quantizer)) if quantizer else dict
  return jax.eval_shape(lambda: {**net.init(jax.random.key(0), x), **codebooks()})


def _item_keys(rng, batch):
  """One key per item, by its place in the whole batch: the same noise on one device as on many."""
  return jax.vmap(lambda i: jax.random.fold_in(rng, i))(batch["index"])


def _with_dropout(net, params, method, x, items, rng):
  return net.apply(params, x, items, method=method, rngs={"dropout": rng})


def _terms(config):
  """(fields of config.loss for the terms on features, a function that adds those on the decoded motion to them)."""
  weights = motion_errors.weights(config.loss)
  fields = {name: value for name, value in config.loss.items() if name not in (*motion_errors.NAMES, "latent_noise")}

  def add(terms, y, x, frozen, batch):
    errors = motion_errors.of_features(config, frozen)
    if errors is None:
      return terms
    frame_mask = padding_mask(batch["num_frames"], x.shape[1]) if "num_frames" in batch else None
    return with_motion_errors(terms, errors(y.astype(x.dtype), x, frame_mask), weights)

  return fields, add


def _blurred(latents, amount, rng, batch, axis_name):
  """Latents (B, L, C) with noise of `amount` standard deviations of each channel, over the batch of all devices."""
  mean_of = lambda a: jax.lax.pmean(a.mean((0, 1)), axis_name)
  scale = jax.lax.stop_gradient(jnp.sqrt(mean_of((latents - mean_of(latents)) ** 2)))
  noise = jax.vmap(lambda key: jax.random.normal(key, latents.shape[1:]))(_item_keys(rng, batch))
  return latents + amount * scale * noise


_ABOUT_RECONSTRUCTION = ("mean error of normalized numbers, below 1 from the start; held_out_mm at each save is the "
                         "joint error in millimetres")


def autoencoder_stage(config: ConfigDict) -> Stage:
  """Trains the deterministic autoencoder on windows: batch["features"] (B, T, F), normalized.

  With config.loss.latent_noise its decoder is given latents that are a little off, as a generator's are, and learns to
  take a motion's path from all latents around, not from each by itself; then items of a batch meet in the loss.
  """
  net, noise = mixed_precision(Autoencoder(**config.model), config), config.loss.latent_noise
  fields, add_errors = _terms(config)

  def init(batch, rng):
    return net.init(rng, batch["features"][:1])

  def loss(params, frozen, batch, step, rng):
    x = batch["features"]
    if noise:
      encoder_rng, noise_rng, decoder_rng = jax.random.split(rng, 3)
      latents = _with_dropout(net, params, "encode", x, batch["index"], encoder_rng)
      y = _with_dropout(net, params, "decode", _blurred(latents, noise, noise_rng, batch, DEVICES), batch["index"],
                        decoder_rng)
    else:
      y = _with_dropout(net, params, "__call__", x, batch["index"], rng)
    terms = add_errors(autoencoder_terms(y, x, **fields), y, x, frozen, batch)
    return jax.tree.map(lambda term: term * len(x), terms), float(len(x))

  def predict(params, frozen, batch, rng):
    latents = net.apply(params, batch["features"], method="encode")
    return {"features": net.apply(params, latents, method="decode"), "latents": latents}

  return Stage(init, loss, predict, in_parts=not noise, about_loss=_ABOUT_RECONSTRUCTION)


def rvq_stage(config: ConfigDict, axis_name: str | None = DEVICES) -> Stage:
  """Trains the RVQ-VAE: batch["features"] (B, T, F), normalized, windows or whole clips padded with zeros.

  The codebooks learn without a gradient, so they are the stage's extra state. axis_name: None to run the loss on one
  device outside of the training loop.
  """
  # Parity: padding takes part in the loss and in the codebooks, as in the released code; windows have none.
  net, quantizer = mixed_precision(Autoencoder(**config.model), config), config.quantizer
  if quantizer.learn == "gradient":
    return _rvq_by_gradient(net, config, axis_name)
  fields, add_errors = _terms(config)

  def init(batch, rng):
    return net.init(rng, batch["features"][:1])

  def init_extra(batch, rng):
    return empty_codebooks(net, quantizer)

  def loss(params, frozen, batch, step, rng, extra):
    x, books = batch["features"], vq.Codebook(**extra["codebooks"])
    encoder_rng, decoder_rng, code_rng, tile_rng, active_rng = jax.random.split(rng, 5)
    latents = _with_dropout(net, params, "encode", x, batch["index"], encoder_rng)
    noise = rvq.draw_noise(tile_rng, _item_keys(code_rng, batch), latents.shape[1], books)
    num_active = rvq.draw_active(active_rng, quantizer.num_levels, quantizer.drop_rate)
    made, books = rvq.train(books, latents, num_active, noise, quantizer.decay, quantizer.temperature,
                            quantizer.gain_once, axis_name)
    y = _with_dropout(net, params, "decode", made.quantized, batch["index"], decoder_rng)
    terms = add_errors(rvq_terms(y, x, made.commitment, **fields), y, x, frozen, batch)
    dead = vq.num_dead(books).mean(dtype=x.dtype, where=books.initialised)
    terms |= {"perplexity": made.perplexity, "usage": made.usage, "dead": dead}
    return jax.tree.map(lambda term: term * len(x), terms), float(len(x)), {"codebooks": books._asdict()}

  def predict(variables, frozen, batch, rng):
    codec = RvqCodec(net, variables)
    indices, _ = codec.encode(batch["features"])
    return {"features": codec.decode(indices), "indices": indices}

  return Stage(init, loss, predict, init_extra, about_loss=_ABOUT_RECONSTRUCTION)


def _rvq_by_gradient(net, config, axis_name):
  """`rvq_stage` by the paper's equations 8 to 10: nearest codes, which are parameters and learn by a loss of theirs."""
  quantizer = config.quantizer
  fields, add_errors = _terms(config)

  def init(batch, rng):
    net_rng, code_rng = jax.random.split(rng)
    params = net.init(net_rng, batch["features"][:1])
    latents = net.apply(params, batch["features"], method="encode")
    book = vq.codebook_of(rvq.first_codes(latents, quantizer.num_levels, quantizer.num_codes, code_rng))
    # In the collection of the other way, so that a run folder is read alike; all of it floats, which gradients need.
    return {**params, "codebooks": jax.tree.map(lambda a: a.astype(latents.dtype), book._asdict())}

  def loss(params, frozen, batch, step, rng):
    x, codes = batch["features"], params["codebooks"]["codes"]
    encoder_rng, decoder_rng, active_rng = jax.random.split(rng, 3)
    latents = _with_dropout(net, params, "encode", x, batch["index"], encoder_rng)
    num_active = rvq.draw_active(active_rng, quantizer.num_levels, quantizer.drop_rate)
    made, codebook = rvq.learn(codes, latents, num_active, axis_name)
    y = _with_dropout(net, params, "decode", made.quantized, batch["index"], decoder_rng)
    terms = add_errors(rvq_terms(y, x, made.commitment, **fields), y, x, frozen, batch)
    terms |= {"loss": terms["loss"] + codebook, "codebook": codebook, "perplexity": made.perplexity,
              "usage": made.usage}
    return jax.tree.map(lambda term: term * len(x), terms), float(len(x))

  def predict(variables, frozen, batch, rng):
    codec = RvqCodec(net, variables)
    indices, _ = codec.encode(batch["features"])
    return {"features": codec.decode(indices), "indices": indices}

  return Stage(init, loss, predict, about_loss=_ABOUT_RECONSTRUCTION)


def make_generator(config: ConfigDict, dtype: Any = jnp.float32, remat: bool = False) -> Generator:
  """The module of a model section: transformer (kind "cdamd" or "mardm", and fields), head (fields).

  dtype: what it computes in; parameters, norms and softmax are float32. remat: see the modules.
  """
  fields, head = ({"dtype": dtype, "remat": remat, **section} for section in (config.transformer, config.head))
  kind = fields.pop("kind")
  if kind not in TRANSFORMERS:
    raise ValueError(f"got transformer kind {kind!r}, expected one of {', '.join(TRANSFORMERS)}")
  transformer = TRANSFORMERS[kind](**fields)
  return Generator(transformer, DiffusionMLP(latent_dim=transformer.latent_dim, **head))


def generator_shapes(net: Generator) -> Any:
  """Shapes of the generator's parameters, to check a file against."""
  transformer = net.transformer
  x, text_emb = jnp.zeros((1, 1, transformer.latent_dim)), jnp.zeros((1, 1, transformer.text_dim))
  return jax.eval_shape(lambda: net.init(jax.random.key(0), x, text_emb, jnp.ones((1, 1, 1, 1), bool), jnp.zeros(())))


def frozen_shapes(autoencoder: Autoencoder) -> dict[str, Any]:
  """Shapes of what making motion needs of a generator's frozen parts; training needs the prior, too."""
  channel = jax.ShapeDtypeStruct((autoencoder.latent_dim,), jnp.float32)
  return AutoencoderCodec(autoencoder, autoencoder_shapes(autoencoder), channel, channel).parts


def prior_codes(prior: RvqCodec, features: Float[Array, "b t f"], real_mask: Bool[Array, "b l"], num_levels: int
                ) -> Int[Array, "b l *q"]:
  """Codes of the first levels (B, L, Q) by the codec of an RVQ-VAE, of one level (B, L)."""
  codes = prior.encode(features, prior.real_frames(real_mask))[0]
  # Parity: one level alone comes without the row that tells levels apart.
  return codes[..., 0] if num_levels == 1 else codes[..., :num_levels]


def generator_stage(config: ConfigDict) -> Stage:
  """Trains the masked transformer and its diffusion head on latents of the frozen autoencoder.

  Batch: features (B, T, F) padded or, of a store, latents (B, L, C) and codes (B, L, Q); num_frames (B,), text_emb
  (B, S, E), of which the first is the whole caption's, text_mask (B, S) if S > 1, index (B,) place in the whole batch.
  frozen:
  the parts of the autoencoder's codec and, if loss.prior_levels, prior: the RVQ-VAE's variables.
  """
  autoencoder, net = Autoencoder(**config.tokenizer), make_generator(
      config.model, jnp.dtype(config.train.dtype), config.train.remat)
  rvq_net = Autoencoder(**config.prior) if config.loss.prior_levels else None

  def inputs(frozen, batch):
    stored = "latents" in batch
    length = batch["latents"].shape[1] if stored else batch["features"].shape[1] // autoencoder.frames_per_latent
    real_mask = padding_mask(batch["num_frames"] // autoencoder.frames_per_latent, length)
    if stored:
      codes: Any = batch["codes"][..., :config.loss.prior_levels] if config.loss.prior_levels else None
      codes = codes[..., 0] if config.loss.prior_levels == 1 else codes
      return batch["latents"], real_mask, batch["text_emb"], codes, batch.get("text_mask")
    codec, codes = AutoencoderCodec.of(autoencoder, frozen), None
    if rvq_net:
      prior = RvqCodec(rvq_net, frozen["prior"])
      codes = prior_codes(prior, batch["features"], real_mask, config.loss.prior_levels)
    # Parity: not scaled in the released code, where the codec's mean is 0 and its std 1.
    z1 = codec.encode(batch["features"], real_mask)
    return z1, real_mask, batch["text_emb"], codes, batch.get("text_mask")

  def init(batch, rng):
    x = jnp.zeros((1, 1, net.transformer.latent_dim))
    return net.init(rng, x, batch["text_emb"][:1], jnp.ones((1, 1, 1, 1), bool), jnp.zeros(()))

  def loss(params, frozen, batch, step, rng):
    z1, real_mask, text_emb, codes, text_mask = inputs(frozen, batch)
    draw_rng, dropout_rng, prior_rng = jax.random.split(rng, 3)
    draws = draw_step(prior_rng, _item_keys(draw_rng, batch), z1.shape[1], z1.shape[2], config.loss)
    return generator_loss(net, params, z1, real_mask, text_emb, codes, draws, config.loss,
                          (dropout_rng, batch["index"]), text_mask)

  def predict(params, frozen, batch, rng):
    """The loss with the sampler's mask, captions given, no dropout: sums over the masked latents, and their weight.

    "loss" is without the prior, as motion is made; "with_prior" is the reference's validation, in which a latent to be
    made sees its own code.
    """
    z1, real_mask, text_emb, codes, text_mask = inputs(frozen, batch)
    fields = ConfigDict(config.loss.to_dict() | dict(mask=config.sampler.mask, drop_rate=0.0, prior_drop_rate=0.0))
    draws = draw_step(rng, _item_keys(rng, batch), z1.shape[1], z1.shape[2], config.loss)
    measure = lambda codes: generator_loss(net, params, z1, real_mask, text_emb, codes, draws, fields,
                                           text_mask=text_mask)
    sums, weight = measure(None)
    made = {"loss": sums["loss"], "weight": weight}
    return made if codes is None else made | {"with_prior": measure(codes)[0]["loss"]}

  return Stage(init, loss, predict, in_parts=True,
               about_loss="mean squared error of the diffusion head, per number of a masked latent")
