"""CDAMD on one page: coordinates to latents and codes, a masked transformer with a diffusion MLP on the latents.

The paper is "Coordinate-based Dual-constrained Autoregressive Motion Generation"; facts and numbers follow the
released code, see the comments that start with "Parity".
"""
from typing import NamedTuple

import jax
import jax.numpy as jnp
from ml_collections import ConfigDict

from motion_jax import shapes
from motion_jax.diffusion import ddpm, guidance, masking, ode, paths, rounds, samplers
from motion_jax.diffusion.draws import draw_step
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.diffusion_mlp import DiffusionMLP, Generator
from motion_jax.nets.masked_transformer import TRANSFORMERS
from motion_jax.nets.masks import LATENT_MASKS, latent_mask, padding_mask
from motion_jax.quant import rvq, vq
from motion_jax.stage import DEVICES, Stage

# --- losses of the autoencoders ----------------------------------------------------------------------------------


def smooth_l1(prediction, target):
  """Mean of d^2 / 2 where the difference d is below 1, of |d| - 1/2 elsewhere."""
  shapes.check(prediction=(prediction, "BTF"), target=(target, "BTF"))
  distance = jnp.abs(prediction - target)
  return jnp.where(distance < 1, distance ** 2 / 2, distance - 0.5).mean()


def l1(prediction, target):
  shapes.check(prediction=(prediction, "BTF"), target=(target, "BTF"))
  return jnp.abs(prediction - target).mean()


DISTANCES = {"smooth_l1": smooth_l1, "l1": l1}


def autoencoder_terms(y, x, distance="smooth_l1", position_weight=1.0, columns=(4, 67)):
  """Loss terms of features x (B, T, F) and their reconstruction y: rec, positions, and their weighted sum, loss."""
  # Parity: the paper says L1. The columns that count twice are the joint positions of 67 columns (22 joints; 4:64 for
  # 21); of coordinates the code takes the same columns, all but the first four numbers.
  measure, part = DISTANCES[distance], slice(*columns)
  y = y.astype(x.dtype)
  terms = {"rec": measure(y, x), "positions": measure(y[..., part], x[..., part]), "mse": ((y - x) ** 2).mean()}
  terms["loss"] = terms["rec"] + position_weight * terms["positions"]
  return terms


def rvq_terms(y, x, commitment, velocity_weight=0.1, commitment_weight=0.02, position_weight=0.1, **reconstruction):
  """The same for the RVQ-VAE, with the error of frame differences and the distance of latents to their codes."""
  # Parity: the paper's eq. (10) has a codebook loss, which `rvq.learn` gives; the code moves the codebooks by running
  # means instead.
  terms = autoencoder_terms(y, x, position_weight=position_weight, **reconstruction)
  terms["velocity"] = ((jnp.diff(y.astype(x.dtype), axis=1) - jnp.diff(x, axis=1)) ** 2).mean()
  terms["commitment"] = commitment
  terms["loss"] += velocity_weight * terms["velocity"] + commitment_weight * commitment
  return terms


# --- autoencoders ------------------------------------------------------------------------------------------------


def encode_codes(net, variables, x, real_mask=None):
  """Features (B, T, F), of real_mask (B, T), to code indices (B, L, Q) and code vectors of each level (Q, B, L, C).

  The RVQ-VAE is an Autoencoder `net` with variables {"params", "codebooks"}, as its run folder holds them.
  """
  return rvq.encode(variables["codebooks"]["codes"], net.apply(variables, x, real_mask=real_mask, method="encode"))


def decode_codes(net, variables, indices, num_levels=None):
  """Code indices (B, L, Q) to features (B, T, F), from the first num_levels levels only if that is given."""
  return net.apply(variables, rvq.decode(variables["codebooks"]["codes"], indices, num_levels), method="decode")


def empty_codebooks(net, quantizer):
  """The RVQ-VAE's collection "codebooks" before training: a dict of the fields of `vq.Codebook`, each (Q, ...)."""
  book = vq.empty_codebook(quantizer.num_codes, net.latent_dim, (quantizer.num_levels,))
  return {"codebooks": book._asdict()}


def autoencoder_shapes(net, quantizer=None):
  """Shapes of the variables of an autoencoder or, with a quantizer section, an RVQ-VAE, to check a file against."""
  x = jnp.zeros((1, net.frames_per_latent, net.features))
  codebooks = (lambda: empty_codebooks(net, quantizer)) if quantizer else dict
  return jax.eval_shape(lambda: {**net.init(jax.random.key(0), x), **codebooks()})


def _item_keys(rng, batch):
  """One key per item, by its place in the whole batch: the same noise on one device as on many."""
  return jax.vmap(lambda i: jax.random.fold_in(rng, i))(batch["index"])


def _with_dropout(net, params, method, x, keys):
  run = lambda item, key: net.apply(params, item[None], False, method=method, rngs={"dropout": key})[0]
  return jax.vmap(run)(x, keys)


def autoencoder_stage(config) -> Stage:
  """Trains the deterministic autoencoder on windows: batch["features"] (B, T, F), normalized."""
  net = Autoencoder(**config.model)

  def init(batch, rng):
    return net.init(rng, batch["features"][:1])

  def loss(params, frozen, batch, step, rng):
    x = batch["features"]
    terms = autoencoder_terms(_with_dropout(net, params, "__call__", x, _item_keys(rng, batch)), x, **config.loss)
    return jax.tree.map(lambda term: term * len(x), terms), float(len(x))

  def predict(params, frozen, batch, rng):
    latents = net.apply(params, batch["features"], method="encode")
    return {"features": net.apply(params, latents, method="decode"), "latents": latents}

  return Stage(init, loss, predict)


def rvq_stage(config, axis_name=DEVICES) -> Stage:
  """Trains the RVQ-VAE: batch["features"] (B, T, F), normalized, windows or whole clips padded with zeros.

  The codebooks learn without a gradient, so they are the stage's extra state. axis_name: None to run the loss on one
  device outside of the training loop.
  """
  # Parity: padding takes part in the loss and in the codebooks, as in the released code; windows have none.
  net, quantizer = Autoencoder(**config.model), config.quantizer
  if quantizer.get("learn", "means") == "gradient":
    return _rvq_by_gradient(net, config, axis_name)

  def init(batch, rng):
    return net.init(rng, batch["features"][:1])

  def init_extra(batch, rng):
    return empty_codebooks(net, quantizer)

  def loss(params, frozen, batch, step, rng, extra):
    x, books = batch["features"], vq.Codebook(**extra["codebooks"])
    encoder_rng, decoder_rng, code_rng, tile_rng, active_rng = jax.random.split(rng, 5)
    latents = _with_dropout(net, params, "encode", x, _item_keys(encoder_rng, batch))
    noise = rvq.draw_noise(tile_rng, _item_keys(code_rng, batch), latents.shape[1], books)
    num_active = rvq.draw_active(active_rng, quantizer.num_levels, quantizer.drop_rate)
    made, books = rvq.train(books, latents, num_active, noise, quantizer.decay, quantizer.temperature,
                            quantizer.gain_once, axis_name)
    y = _with_dropout(net, params, "decode", made.quantized, _item_keys(decoder_rng, batch))
    terms = rvq_terms(y, x, made.commitment, **config.loss)
    dead = vq.num_dead(books).mean(dtype=x.dtype, where=books.initialised)
    terms |= {"perplexity": made.perplexity, "usage": made.usage, "dead": dead}
    return jax.tree.map(lambda term: term * len(x), terms), float(len(x)), {"codebooks": books._asdict()}

  def predict(variables, frozen, batch, rng):
    indices, _ = encode_codes(net, variables, batch["features"])
    return {"features": decode_codes(net, variables, indices), "indices": indices}

  return Stage(init, loss, predict, init_extra)


def _rvq_by_gradient(net, config, axis_name):
  """`rvq_stage` by the paper's equations 8 to 10: nearest codes, which are parameters and learn by a loss of theirs."""
  quantizer = config.quantizer

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
    latents = _with_dropout(net, params, "encode", x, _item_keys(encoder_rng, batch))
    num_active = rvq.draw_active(active_rng, quantizer.num_levels, quantizer.drop_rate)
    made, codebook = rvq.learn(codes, latents, num_active, axis_name)
    y = _with_dropout(net, params, "decode", made.quantized, _item_keys(decoder_rng, batch))
    terms = rvq_terms(y, x, made.commitment, **config.loss)
    terms |= {"loss": terms["loss"] + codebook, "codebook": codebook, "perplexity": made.perplexity,
              "usage": made.usage}
    return jax.tree.map(lambda term: term * len(x), terms), float(len(x))

  def predict(variables, frozen, batch, rng):
    indices, _ = encode_codes(net, variables, batch["features"])
    return {"features": decode_codes(net, variables, indices), "indices": indices}

  return Stage(init, loss, predict)


# --- generator: losses -------------------------------------------------------------------------------------------


def make_generator(config) -> Generator:
  """The module of a model section: transformer (kind "cdamd" or "mardm", and fields), head (fields)."""
  fields = dict(config.transformer)
  kind = fields.pop("kind")
  if kind not in TRANSFORMERS:
    raise ValueError(f"got transformer kind {kind!r}, expected one of {', '.join(TRANSFORMERS)}")
  transformer = TRANSFORMERS[kind](**fields)
  return Generator(transformer, DiffusionMLP(latent_dim=transformer.latent_dim, **config.head))


def generator_shapes(net):
  """Shapes of the generator's parameters, to check a file against."""
  transformer = net.transformer
  x, text_emb = jnp.zeros((1, 1, transformer.latent_dim)), jnp.zeros((1, 1, transformer.text_dim))
  return jax.eval_shape(lambda: net.init(jax.random.key(0), x, text_emb, jnp.ones((1, 1, 1, 1), bool), jnp.zeros(())))


def frozen_shapes(autoencoder):
  """Shapes of what making motion needs of a generator's frozen parts; training needs the prior, too."""
  channel = jax.ShapeDtypeStruct((autoencoder.latent_dim,), jnp.float32)
  return {"tokenizer": autoencoder_shapes(autoencoder), "latent_mean": channel, "latent_std": channel}


def trained_mask(kinds, known_mask, real_mask, mask_u=None):
  """The mask (B, 1, L, L) of a training step; of several kinds, "dccm+bcm", each item draws one, mask_u (B,).

  A model that was trained on several can be asked by any of them (one for generation, one for editing).
  """
  masks = jnp.stack([latent_mask(kind, known_mask, real_mask) for kind in kinds.split("+")])
  if len(masks) == 1:
    return masks[0]
  chosen = jnp.floor(mask_u * len(masks)).astype(int)
  return jnp.take_along_axis(masks, chosen[None, :, None, None, None], axis=0)[0]


def generator_loss(net, params, z1, real_mask, text_emb, codes, draws, config, dropout_keys=None, text_mask=None):
  """(sums, weight) of one step: the diffusion loss of every masked latent, M times over (facts: cdamd 4.3, 5).

  z1 (B, L, C) clean latents, 0 at padding; codes (B, L) or (B, L, Q) of the prior, or None. dropout_keys (B,): trains
  with dropout. All rows are computed and the masked ones summed, so that shapes do not depend on the draw.
  """
  made = masking.corruption(draws.time_u, draws.order_u, draws.noise_u, draws.keep_u, real_mask, config.noise_rate,
                            config.mask_rate, config.get("mask_draw", "count"))
  x = masking.corrupt(z1, made, draws.noise, net.apply(params, method="hidden"), real_mask)
  text_emb = jnp.where((draws.text_u < config.drop_rate)[:, None, None], 0.0, text_emb)
  attn_mask = trained_mask(config.mask, real_mask & ~made.masked, real_mask, draws.mask_u)
  prior_mask = None if codes is None else draws.prior_u >= config.prior_drop_rate
  inputs = (x, text_emb, attn_mask, codes, prior_mask, text_mask)
  if dropout_keys is None:
    condition = net.apply(params, *inputs, method="condition")
  else:
    of_item = lambda key, *item: net.apply(params, *jax.tree.map(lambda a: a[None], item), deterministic=False,
                                           method="condition", rngs={"dropout": key})[0]
    condition = jax.vmap(of_item)(dropout_keys, *inputs)
  predict = lambda x, t: net.apply(params, x, t, jnp.broadcast_to(condition, x.shape[:-1] + condition.shape[-1:]),
                                   method="predict")
  if config.diffusion == "ddpm":
    schedule = ddpm.cosine_schedule(config.ddpm_steps)
    error = ddpm.loss_rows(predict, schedule, jnp.broadcast_to(z1, draws.diffusion_noise.shape), draws.t,
                           draws.diffusion_noise)
  else:
    velocity = predict(paths.add_noise(z1, draws.diffusion_noise, draws.t), draws.t)
    error = ((velocity - (z1 - draws.diffusion_noise)) ** 2).mean(-1)
  total = jnp.where(made.masked, error.astype(jnp.promote_types(error.dtype, jnp.float32)), 0.0).sum()
  # A batch of short clips may have nothing masked at all.
  return {"loss": total}, jnp.maximum(made.masked.sum() * len(draws.t), jnp.finfo(total.dtype).tiny)


def real_frames(autoencoder, real_mask):
  """(B, T) of a mask of latents (B, L)."""
  return jnp.repeat(real_mask, autoencoder.frames_per_latent, axis=1)


def latents_of(autoencoder, frozen, features, real_mask):
  """Latents (B, L, C) as the generator knows them, zero at padding: of the frozen encoder, scaled if asked for."""
  # Parity: not scaled in the released code, where latent_mean is 0 and latent_std 1.
  z1 = autoencoder.apply(frozen["tokenizer"], features, real_mask=real_frames(autoencoder, real_mask), method="encode")
  return jnp.where(real_mask[..., None], (z1 - frozen["latent_mean"]) / frozen["latent_std"], 0.0)


def decode_latents(autoencoder, frozen, latents, real_mask):
  """Latents as the generator knows them (B, L, C) to normalized features (B, 4 L, F); real_mask (B, L)."""
  z = latents * frozen["latent_std"] + frozen["latent_mean"]
  return autoencoder.apply(frozen["tokenizer"], z, real_mask=real_mask, method="decode")


def prior_codes(net, frozen, features, real_mask, num_levels):
  """Codes of the first levels (B, L, Q), of one level (B, L), of none None."""
  if not num_levels:
    return None
  codes = encode_codes(net, frozen["prior"], features, real_frames(net, real_mask))[0]
  # Parity: one level alone comes without the row that tells levels apart.
  return codes[..., 0] if num_levels == 1 else codes[..., :num_levels]


def generator_stage(config) -> Stage:
  """Trains the masked transformer and its diffusion head on latents of the frozen autoencoder.

  Batch: features (B, T, F) padded, num_frames (B,), text_emb (B, S, E), of which the first is the whole caption's,
  text_mask (B, S) if S > 1, index (B,) place in the whole batch. frozen:
  tokenizer, latent_mean, latent_std (C,) and, if loss.prior_levels, prior: the RVQ-VAE's variables.
  """
  autoencoder, net = Autoencoder(**config.tokenizer), make_generator(config.model)
  rvq_net = Autoencoder(**config.prior) if config.loss.prior_levels else None

  def inputs(frozen, batch):
    length = batch["features"].shape[1] // autoencoder.frames_per_latent
    real_mask = padding_mask(batch["num_frames"] // autoencoder.frames_per_latent, length)
    codes = prior_codes(rvq_net, frozen, batch["features"], real_mask, config.loss.prior_levels)
    z1 = latents_of(autoencoder, frozen, batch["features"], real_mask)
    return z1, real_mask, batch["text_emb"], codes, batch.get("text_mask")

  def init(batch, rng):
    x = jnp.zeros((1, 1, net.transformer.latent_dim))
    return net.init(rng, x, batch["text_emb"][:1], jnp.ones((1, 1, 1, 1), bool), jnp.zeros(()))

  def loss(params, frozen, batch, step, rng):
    z1, real_mask, text_emb, codes, text_mask = inputs(frozen, batch)
    draw_rng, dropout_rng, prior_rng = jax.random.split(rng, 3)
    draws = draw_step(prior_rng, _item_keys(draw_rng, batch), *z1.shape[1:], config.loss)
    return generator_loss(net, params, z1, real_mask, text_emb, codes, draws, config.loss,
                          _item_keys(dropout_rng, batch), text_mask)

  def predict(params, frozen, batch, rng):
    """The loss with the sampler's mask, captions given, no dropout: sums over the masked latents, and their weight.

    "loss" is without the prior, as motion is made; "with_prior" is the reference's validation, in which a latent to be
    made sees its own code.
    """
    z1, real_mask, text_emb, codes, text_mask = inputs(frozen, batch)
    fields = ConfigDict(config.loss.to_dict() | dict(mask=config.sampler.mask, drop_rate=0.0, prior_drop_rate=0.0))
    draws = draw_step(rng, _item_keys(rng, batch), *z1.shape[1:], config.loss)
    measure = lambda codes: generator_loss(net, params, z1, real_mask, text_emb, codes, draws, fields,
                                           text_mask=text_mask)
    sums, weight = measure(None)
    made = {"loss": sums["loss"], "weight": weight}
    return made if codes is None else made | {"with_prior": measure(codes)[0]["loss"]}

  return Stage(init, loss, predict)


# --- generating and editing --------------------------------------------------------------------------------------


class Plan(NamedTuple):
  """The choices that shapes and loops depend on; hashable, so that jit can specialize on it."""
  solver: str = "midpoint"     # of samplers.FIXED_STEP, or "dopri5", or "ddpm"
  num_steps: int = 10          # of the solver; dopri5 chooses its own
  mask: str = "causal"
  guided: bool = True
  num_rows: int | None = None  # rounds.most_revealed, or None: solve for every hidden latent as the reference does
  ddpm_steps: int = 50         # of training
  temperature: float = 1.0     # of the DDPM's noise; flows have none


def make_plan(**fields) -> Plan:
  """A Plan; raises ValueError for a solver, mask or number that does not exist."""
  plan = Plan(**fields)
  solvers = (*samplers.FIXED_STEP, "dopri5", "ddpm")
  if plan.solver not in solvers:
    raise ValueError(f"got solver {plan.solver!r}, expected one of {', '.join(solvers)}")
  if plan.mask not in LATENT_MASKS:
    raise ValueError(f"got mask {plan.mask!r}, expected one of {', '.join(LATENT_MASKS)}")
  if plan.num_steps < 1:
    raise ValueError(f"got {plan.num_steps} solver steps, expected at least 1")
  return plan


def make_latents(net, plan, params, text_emb, latents, hidden, real_mask, scale, draw, text_mask=None):
  """Latents after each round (N, B, L, C), the last the finished ones. Pure; net and plan are static.

  text_emb (B, S, E), text_mask (B, S) or None; latents (B, L, C), of which those are kept that hidden (N, B, L) never
  names; real_mask (B, L); scale () of the guidance; draw: see `diffusion.draws.make_draw`.
  """
  twice = (lambda a: jnp.concatenate([a, a])) if plan.guided else lambda a: a
  words = jnp.concatenate([text_emb, 0 * text_emb]) if plan.guided else text_emb

  def condition(z, hidden):
    attn_mask = latent_mask(plan.mask, real_mask & ~hidden, real_mask)
    words_mask = None if text_mask is None else twice(text_mask)
    return net.apply(params, twice(z), words, twice(attn_mask), text_mask=words_mask, method="condition")

  def solve(condition, rows, fresh):
    predict = lambda x, t, *_: net.apply(params, x, t, condition, method="predict").astype(latents.dtype)
    predict = guidance.guided(predict, scale) if plan.guided else predict
    noise = fresh(0).astype(latents.dtype)
    if plan.solver == "ddpm":
      schedule = ddpm.respace(ddpm.cosine_schedule(plan.ddpm_steps), min(plan.num_steps, plan.ddpm_steps))
      return ddpm.ancestral(predict, schedule, noise, lambda m: fresh(m + 1).astype(latents.dtype), plan.temperature)
    if plan.solver == "dopri5":
      return ode.dopri5(predict, noise, rows).value
    times = jnp.linspace(0, 1, plan.num_steps + 1, dtype=latents.dtype)[:, None]
    return samplers.FIXED_STEP[plan.solver](predict, noise, times)

  return rounds.sample(condition, solve, draw, latents, hidden, net.apply(params, method="hidden"), plan.num_rows)


def generate(net, autoencoder, plan, params, frozen, text_emb, hidden, real_mask, scale, draw, text_mask=None):
  """Normalized features (B, 4 L, F) of new motions; hidden (N, B, L) of `masking.hidden_table`. Pure."""
  latents = jnp.zeros(real_mask.shape + (net.transformer.latent_dim,))
  made = make_latents(net, plan, params, text_emb, latents, hidden, real_mask, scale, draw, text_mask)[-1]
  return decode_latents(autoencoder, frozen, made, real_mask)


def edit(net, autoencoder, plan, params, frozen, features, text_emb, edited, hidden, real_mask, scale, draw,
         paste=False, text_mask=None):
  """Normalized features (B, 4 L, F): the given ones, of which the latents edited (B, L) are made anew. Pure.

  paste: put the frames of kept latents back as they came. They have been through the autoencoder otherwise.
  """
  # Parity: the released code decodes everything and pastes nothing back.
  latents = latents_of(autoencoder, frozen, features, real_mask)
  made = make_latents(net, plan, params, text_emb, latents, hidden, real_mask, scale, draw, text_mask)[-1]
  y = decode_latents(autoencoder, frozen, made, real_mask)
  if not paste:
    return y
  kept = jnp.repeat(~edited & real_mask, autoencoder.frames_per_latent, axis=1)
  return jnp.where(kept[..., None], features[:, :y.shape[1]], y)
