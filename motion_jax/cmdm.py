"""CMDM on one page: a causal tokenizer, a causal denoiser with a noise level per frame, and frame-wise sampling.

The paper is "Causal Motion Diffusion Models for Autoregressive Motion Generation"; facts and numbers follow the
released code, see the comments that start with "Parity".
"""
from typing import Any, NamedTuple

import flax
import jax
import jax.numpy as jnp
import optax

from motion_jax import shapes
from motion_jax.diffusion import continuation, ddpm_forcing, guidance, paths, samplers, schedules, streaming
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.causal_vae import CausalVAE, sample_latent
from motion_jax.nets.masks import block_causal_mask, padding_mask, sliding_mask
from motion_jax.stage import Stage
from motion_jax.teacher import as_seen, frame_features, make_teacher

# --- losses of the tokenizer -------------------------------------------------------------------------------------


def gaussian_nll(prediction, target):
  """Reconstruction under a Gaussian whose one sigma is the best for this batch; summed over all elements.

  s = log sqrt(mean squared error), softly floored at -6; gradients flow through it (facts: cmdm 2.3).
  """
  # Parity: the paper says "standard reconstruction loss"; this likelihood, summed, is the released code's.
  shapes.check(prediction=(prediction, "BTF"), target=(target, "BTF"))
  square = (prediction - target) ** 2
  log_sigma = jnp.log(jnp.maximum(jnp.sqrt(square.mean()), 1e-8))
  log_sigma = -6 + jax.nn.softplus(log_sigma + 6)
  # The constant per element is multiplied, not added up: a long float32 sum of equal numbers drifts.
  return square.sum() / (2 * jnp.exp(2 * log_sigma)) + square.size * (log_sigma + 0.5 * jnp.log(2 * jnp.pi))


def smooth_l1(prediction, target):
  """Reconstruction by SmoothL1 (beta 1), summed over frames and features, averaged over the batch.

  So it weighs against a KL divergence that is summed and averaged alike, as in a VAE's bound.
  """
  return optax.huber_loss(prediction, target).sum() / prediction.shape[0]


RECONSTRUCTIONS = {"gaussian": gaussian_nll, "smooth_l1": smooth_l1}


def kl_to_standard_normal(mean, logvar):
  """KL divergence to N(0, I), summed over latents and channels, averaged over the batch."""
  return -0.5 * (1 + logvar - mean ** 2 - jnp.exp(logvar)).sum((1, 2)).mean()


def align_terms(student, teacher, cos_margin=0.5, distance_margin=0.25):
  """Marginal cosine and marginal distance-matrix losses between (B, N, E) and (B, N, E) (facts: cmdm 2.4).

  The first pulls each latent towards its teacher's direction until their cosine is over 1 - cos_margin, the second
  makes cosines between latents of one window those between the teacher's features, to within distance_margin.
  """
  # Parity: the paper writes the second over unprojected latents and the whole set; the code's is inside a window.
  student, teacher = _unit(student), _unit(teacher)
  cosine = (student * teacher).sum(-1)
  mcos = jax.nn.relu(1 - cos_margin - cosine).mean()
  return mcos, _distance_term(student, teacher, distance_margin)


def _unit(a):
  return a / jnp.maximum(jnp.linalg.norm(a, axis=-1, keepdims=True), 1e-6)


def _distance_term(student, teacher, margin):
  """Mean of what cosines among unit rows (B, N, E) and (B, N, E') of a window differ by beyond the margin."""
  among = lambda a: jnp.einsum("bie,bje->bij", a, a)
  return jax.nn.relu(jnp.abs(among(student) - among(teacher)) - margin).mean()


def set_distances(latents, teacher, margin=0.25):
  """The marginal distance-matrix loss of the paper's equation 6: latents (B, N, C) as they are, not projected, and the
  teacher's features (B, N, E), in pairs over all windows of the micro-batch, (B N)^2 of them."""
  rows = lambda a: _unit(a.reshape(1, -1, a.shape[-1]))
  return _distance_term(rows(latents), rows(teacher), margin)


DISTANCE_PAIRS = ("window", "set")


def align_loss(vae, params, z, teacher, distance_pairs="window"):
  """(mcos, mdms) of latents z (B, N, C) and the teacher's features (B, N, E) at each.

  distance_pairs: whose cosines the second compares, "window" (`align_terms`) or "set" (`set_distances`).
  """
  if distance_pairs not in DISTANCE_PAIRS:
    raise ValueError(f"got loss.distance_pairs {distance_pairs!r}, expected one of {', '.join(DISTANCE_PAIRS)}")
  mcos, mdms = align_terms(*vae.apply(params, z, teacher, method="aligned"))
  return mcos, mdms if distance_pairs == "window" else set_distances(z, teacher)


def pool_teacher(features, num_latents):
  """The teacher's frame features (B, T, E) -> their mean over each latent's frames (B, N, E)."""
  batch, frames, dim = features.shape
  if frames % num_latents:
    # Parity: the code lets the term vanish without a word.
    raise ValueError(f"got windows of {frames} frames for {num_latents} latents; data.window must be a multiple of the "
                     "frames of a latent")
  return features.reshape(batch, num_latents, -1, dim).mean(2)


LAST_LAYERS = {"convolution": ("encoder", "conv_out", "conv", "kernel"), "linear": ("encoder", "head", "kernel")}


def align_ratio(vae, params, x, noise, teacher, reconstruction="gaussian", distance_pairs="window",
                last_layer="convolution"):
  """|d rec / d W| / |d align / d W| at W, the encoder's last convolution, and both norms (facts: cmdm 2.4).

  last_layer "linear": at the linear layer behind it.

  Constants to the gradient. Neither derivative goes deeper than W, so that rec costs one pass back through the decoder,
  without its parameters' gradients; the forward pass is the loss's own and compiled once.
  """
  # Parity: the paper says "the final layer of the encoder"; the code takes the last convolution, not the linear layer.
  params, x, teacher = jax.lax.stop_gradient((params, x, teacher))
  path = ("params", *LAST_LAYERS[last_layer])
  flat = flax.traverse_util.flatten_dict(params)

  def of_kernel(kernel):
    changed = flax.traverse_util.unflatten_dict({**flat, path: kernel})
    y, mean, logvar = vae.apply(changed, x, noise)
    z = sample_latent(mean, logvar, noise)
    align = sum(align_loss(vae, changed, z, teacher, distance_pairs))
    return RECONSTRUCTIONS[reconstruction](y.astype(x.dtype), x), align

  (rec, align), pull = jax.vjp(of_kernel, flat[path])
  norms = [jnp.linalg.norm(pull(seeds)[0]) for seeds in ((jnp.ones_like(rec), jnp.zeros_like(align)),
                                                         (jnp.zeros_like(rec), jnp.ones_like(align)))]
  ratio = jnp.clip(norms[0] / jnp.maximum(norms[1], 1e-4), 0, 1e4)
  return jax.lax.stop_gradient((ratio, *norms))


def align_factor(step, config, num_steps):
  """Factor of the alignment term: from config.align to a tenth of it, linearly, after the ramp of the KL term.

  config.align_fall says by which share of it instead of 0.9; 0 keeps it.
  """
  progress = jnp.clip((step - config.kl_ramp) / max(num_steps - config.kl_ramp, 1), 0, 1)
  return config.align * (1 - config.get("align_fall", 0.9) * progress)


def tokenizer_terms(vae, params, x, noise, kl_weight, root_weight, root_columns=slice(0, 4), teacher=None,
                    align_weight=0.0, adaptive=True, reconstruction="gaussian", **alignment):
  """Loss terms of one micro-batch x (B, T, F): a dict with rec, root, kl and their weighted sum, loss.

  With teacher (B, N, E), its features at each latent, also mcos, mdms, their sum align, and the weight that it gets:
  align_weight times the ratio of gradients, or plain if not adaptive. alignment: distance_pairs, last_layer of
  `align_ratio`.
  """
  # Parity: the root term is the code's alone, and its KL weight is 0.01 with a ramp, the paper's 1.0; both are fields.
  y, mean, logvar = vae.apply(params, x, noise)
  y = y.astype(x.dtype)
  measure = RECONSTRUCTIONS[reconstruction]
  terms = {"rec": measure(y, x), "root": measure(y[..., root_columns], x[..., root_columns]),
           "kl": kl_to_standard_normal(mean, logvar), "mse": ((y - x) ** 2).mean()}
  terms["loss"] = terms["rec"] + kl_weight * terms["kl"] + root_weight * terms["root"]
  if teacher is not None:
    z = sample_latent(mean, logvar, noise)
    terms["mcos"], terms["mdms"] = align_loss(vae, params, z, teacher, alignment.get("distance_pairs", "window"))
    terms["align"] = terms["mcos"] + terms["mdms"]
    ratio = 1.0
    if adaptive:
      ratio, terms["grad_rec"], terms["grad_align"] = align_ratio(vae, params, x, noise, teacher,
                                                                        reconstruction, **alignment)
    terms["align_weight"] = jnp.asarray(align_weight * ratio, x.dtype)
    terms["loss"] += terms["align_weight"] * terms["align"]
  return terms


# --- stages ------------------------------------------------------------------------------------------------------


def tokenizer_stage(config) -> Stage:
  """Trains the causal VAE on windows: batch["features"] (B, T, F), normalized.

  With config.frozen.teacher its latents are aligned with one: config.teacher holds its fields, frozen["teacher"] its
  parameters, and frozen["teacher_view"] both statistics, if it reads another layout or other statistics than these.

  The sigma of the reconstruction loss belongs to a micro-batch, so the batch is cut into micro-batches of a fixed size,
  and the same ones arise on any number of devices.
  """
  vae = CausalVAE(**config.model)
  loss_config = config.loss
  teacher = make_teacher(config.teacher, config.data.layout) if config.frozen.get("teacher") else None
  layout = config.data.layout
  own_layout = config.get("teacher", {}).get("layout", layout)

  def latent_shape(x):
    return x.shape[:-2] + (x.shape[-2] // 2 ** vae.num_halvings, vae.latent_dim)

  def init(batch, rng):
    x = batch["features"][:1]
    return vae.init(rng, x, jnp.zeros(latent_shape(x)))

  def loss(params, frozen, batch, step, rng):
    x = batch["features"]
    size = min(loss_config.micro_batch, config.data.batch_size)
    if x.shape[0] % size:
      raise ValueError(f"got {x.shape[0]} windows on a device, expected a multiple of loss.micro_batch = {size}; "
                       "change data.batch_size, loss.micro_batch or the number of devices")
    # One key per window, by its place in the whole batch: the same noise on one device as on many.
    keys = jax.vmap(lambda i: jax.random.fold_in(rng, i))(batch["index"])
    noise = jax.vmap(lambda key: jax.random.normal(key, latent_shape(x)[1:]))(keys)
    kl_weight = loss_config.kl_weight * (jnp.minimum(1.0, step / loss_config.kl_ramp) if loss_config.kl_ramp else 1.0)
    split = lambda a: a.reshape((-1, size) + a.shape[1:])
    guides = [None] * (x.shape[0] // size)
    if teacher is not None:
      seen = as_seen(x, frozen["teacher_view"], layout, own_layout) if "teacher_view" in frozen else x
      guides = split(pool_teacher(frame_features(teacher, frozen["teacher"], seen), noise.shape[1]))
    align_weight = align_factor(step, loss_config, config.train.num_steps) if teacher is not None else 0.0
    paper = {name: loss_config[name] for name in ("reconstruction", "distance_pairs", "last_layer")
             if name in loss_config}
    terms = [tokenizer_terms(vae, params, a, e, kl_weight, loss_config.root_weight, teacher=g,
                             align_weight=align_weight, adaptive=loss_config.get("adaptive_align", True), **paper)
             for a, e, g in zip(split(x), split(noise), guides)]
    return jax.tree.map(lambda *parts: sum(parts), *terms), float(len(terms))

  def predict(params, frozen, batch, rng):
    mean, logvar = vae.apply(params, batch["features"], method="encode")
    return {"features": vae.apply(params, mean, method="decode"), "mean": mean, "logvar": logvar}

  return Stage(init, loss, predict)


def encode_latents(vae, frozen, features, rng_keys):
  """Latents (B, N, C) to diffuse: a draw of the frozen encoder per clip, scaled to unit variance if asked.

  frozen: params of the tokenizer and latent_mean, latent_std (C,), which are 0 and 1 in the released code
  (Parity: latents are sampled, not means, and not scaled; scaling is an option, facts cmdm 7 row 16).
  """
  mean, logvar = vae.apply(frozen["tokenizer"], features, method="encode")
  noise = jax.vmap(lambda key: jax.random.normal(key, mean.shape[1:]))(rng_keys)
  return (sample_latent(mean, logvar, noise) - frozen["latent_mean"]) / frozen["latent_std"]


def denoiser_stage(config) -> Stage:
  """Trains the causal diffusion transformer by diffusion forcing on latents of the frozen tokenizer.

  Batch: features (B, T, F), num_frames (B,), text_emb (B, S, E), text_mask (B, S), index (B,) place in the whole batch.
  """
  vae = CausalVAE(**config.tokenizer)
  dit = CausalDiT(**config.model)
  block = dit.block
  level_block = config.loss.get("level_block", block)

  def inputs(frozen, batch, rng):
    encode_rng, level_rng, noise_rng, drop_rng = jax.random.split(rng, 4)
    keys = lambda key: jax.vmap(lambda i: jax.random.fold_in(key, i))(batch["index"])
    if config.loss.get("mean_latents", False):  # Parity: the paper's algorithm 1 says E(x), the code draws
      z1 = encode_motion(vae, frozen, batch["features"])
    else:
      z1 = encode_latents(vae, frozen, batch["features"], keys(encode_rng))
    latent_mask = padding_mask(batch["num_frames"] // vae.frames_per_latent, z1.shape[1])
    z1 = jnp.where(latent_mask[..., None], z1, 0.0)
    # Parity: the code draws one time per block of 3 latents, the paper one per latent; level_block says which.
    draw = (ddpm_forcing if dit.predicts == "ddpm" else paths).forcing_times
    t = jax.vmap(lambda key: draw(key, 1, z1.shape[1], level_block)[0])(keys(level_rng))
    noise = jax.vmap(lambda key: jax.random.normal(key, z1.shape[1:]))(keys(noise_rng))
    drop = jax.vmap(lambda key: jax.random.bernoulli(key, config.loss.drop_rate))(keys(drop_rng))
    # Parity: the code zeroes the word features and keeps the mask; it also leaves the text encoder's dropout on while
    # training; ours is off, as the paper's frozen encoder has it, so that features can be cached.
    text_emb = jnp.where(drop[:, None, None], 0.0, batch["text_emb"])
    return z1, latent_mask, t, noise, text_emb

  def init(batch, rng):
    length = batch["features"].shape[1] // vae.frames_per_latent
    x = jnp.zeros((1, length, vae.latent_dim))
    return dit.init(rng, x, jnp.zeros((1, length)), batch["text_emb"][:1], block_causal_mask(length, block),
                    batch["text_mask"][:1])

  def loss(params, frozen, batch, step, rng):
    z1, latent_mask, t, noise, text_emb = inputs(frozen, batch, rng)
    attn_mask = block_causal_mask(z1.shape[1], block) & latent_mask[:, None, None, :]
    # Equal times inside a block are modulated once.
    shared = block if block > 1 and level_block % block == 0 and z1.shape[1] % block == 0 else 1
    velocity = lambda x, t: dit.apply(params, x, t[:, ::shared], text_emb, attn_mask, batch["text_mask"])
    if dit.predicts == "ddpm":
      # Parity: the paper's algorithm 1; the code, and our default, learn the velocity of a straight path.
      return ddpm_forcing.forcing_loss(velocity, z1, latent_mask, t, noise)
    return paths.forcing_loss(velocity, z1, latent_mask, t, noise, config.loss.get("target", dit.predicts))

  def predict(params, frozen, batch, rng):
    z1, latent_mask, t, noise, text_emb = inputs(frozen, batch, rng)
    attn_mask = block_causal_mask(z1.shape[1], block) & latent_mask[:, None, None, :]
    ddpm = dit.predicts == "ddpm"
    x = (ddpm_forcing if ddpm else paths).add_noise(z1, noise, t)
    return {"velocity": dit.apply(params, x, t, text_emb, attn_mask, batch["text_mask"]),
            "target": noise if ddpm else z1 - noise}

  return Stage(init, loss, predict)


def denoiser_shapes(dit):
  """Shapes of the denoiser's parameters, to check a file against."""
  mask = jnp.ones((1, 1), bool)
  return jax.eval_shape(lambda: dit.init(jax.random.key(0), jnp.zeros((1, dit.block, dit.latent_dim)), jnp.zeros(
      (1, dit.block)), jnp.zeros((1, 1, dit.text_dim)), block_causal_mask(dit.block, dit.block), mask))


def frozen_shapes(vae):
  """Shapes of what the denoiser's run keeps of its tokenizer."""
  x, noise = jnp.zeros((1, vae.frames_per_latent, vae.features)), jnp.zeros((1, 1, vae.latent_dim))
  params = jax.eval_shape(lambda: vae.init(jax.random.key(0), x, noise))
  channel = jax.ShapeDtypeStruct((vae.latent_dim,), jnp.float32)
  return {"tokenizer": params, "latent_mean": channel, "latent_std": channel}


# --- generating --------------------------------------------------------------------------------------------------


def encode_motion(vae, frozen, features):
  """Normalized features (B, T, F) to the latents that the denoiser knows, the encoder's means (B, T / 4, C)."""
  # Parity: training samples latents, as the code does; what is to be kept of a given motion is its mean.
  mean, _ = vae.apply(frozen["tokenizer"], features, method="encode")
  return (mean - frozen["latent_mean"]) / frozen["latent_std"]


def decode_latents(vae, frozen, latents):
  """Latents as the denoiser knows them (B, N, C) to normalized features (B, 4 N, F)."""
  z = latents * frozen["latent_std"] + frozen["latent_mean"]
  return vae.apply(frozen["tokenizer"], z, method="decode")


def generate(dit, vae, plan, num_blocks, params, frozen, text_emb, text_mask, scale, keys, segment=None):
  """Normalized features (B, frames, F) of num_blocks blocks, by frame-wise sampling (lag < num_steps) or block after
  block (lag = num_steps). keys (B,): one per motion. Pure; dit, vae, plan and num_blocks are static.

  With segment (B, num_blocks), text_emb (B, G, S, E) and text_mask (B, G, S) are G captions a motion, and segment says
  which of them each block has; plan.captions is that of `streaming.captions_seen`.
  """
  constants = streaming.make_constants(dit, params, plan)
  text = streaming.encode_text(dit, params, text_emb, text_mask, plan.guided)
  latents = streaming.sample(dit, plan, params, constants, text, scale, keys, num_blocks, segment=segment)
  return decode_latents(vae, frozen, latents)


def generate_whole(dit, vae, plan, num_blocks, params, frozen, text_emb, text_mask, scale, keys, segment=None):
  """The same by the plain loop over all latents at once; a plan of lag 0 cleans them all together.

  What `generate` is tested against, and the full-sequence schedule of the paper's ablation.
  """
  length = num_blocks * plan.block
  noise = jnp.concatenate([streaming.block_noise(keys, i, plan, dit.latent_dim) for i in range(num_blocks)], axis=1)
  if segment is not None:
    text_emb, text_mask = words_of_latents(text_emb, text_mask, jnp.repeat(segment, plan.block, axis=1))
  attn_mask = sliding_mask(length, plan.block, plan.context)
  velocity = plain_velocity(dit, params, text_emb, text_mask, attn_mask, scale, plan.guided)
  if plan.solver in ddpm_forcing.SOLVERS:
    # Parity: algorithm 2 of the paper, whose steps draw fresh noise; the code's, and our default, are Euler's.
    levels = schedules.staircase_levels(plan.num_steps, length, plan.lag, plan.block)
    steps, blocks = ddpm_forcing.make_steps(plan.num_steps, plan.solver), jnp.arange(num_blocks)
    fresh = lambda now: streaming.fresh_noise(keys, blocks, now[::plan.block], plan, dit.latent_dim)
    return decode_latents(vae, frozen, ddpm_forcing.sample(velocity, noise, levels, steps, fresh))
  times = jnp.asarray(schedules.staircase(plan.num_steps, length, plan.lag, plan.block))
  return decode_latents(vae, frozen, samplers.SOLVERS[plan.solver](velocity, noise, times))


def words_of_latents(text_emb, text_mask, segment):
  """Words (B, G * S, E) and mask (B, L, G * S) that show each latent its own of G captions; segment (B, L)."""
  batch, count, words, _ = text_emb.shape
  mask = text_mask[:, None] & (segment[:, :, None, None] == jnp.arange(count)[:, None])
  return text_emb.reshape(batch, count * words, -1), mask.reshape(mask.shape[:2] + (-1,))


def plain_velocity(dit, params, text_emb, text_mask, attn_mask, scale, guided=True):
  """velocity(x, t (L,)) of the network as it is, everything computed anew in every call."""
  def velocity(x, t, drop):
    twice = lambda a: jnp.concatenate([a, a]) if drop.shape[0] > a.shape[0] > 1 else a
    emb = jnp.where(drop[:, None, None], 0.0, jnp.concatenate([text_emb] * (drop.shape[0] // text_emb.shape[0])))
    mask = jnp.concatenate([text_mask] * (drop.shape[0] // text_mask.shape[0]))
    return dit.apply(params, x, jnp.broadcast_to(t, x.shape[:2]), emb, twice(attn_mask), mask)

  if guided:
    return guidance.guided(velocity, scale)
  return lambda x, t: velocity(x, t, jnp.zeros(x.shape[0], bool))


def chained(dit, plan, params, text_emb, text_mask, scale, lengths, past, noise, fresh, times=None):
  """New latents (B, N, C) behind a past (B, P, C) as the released code makes them: plain recompute, past re-noised.

  noise (B, P + N, C) and fresh(m) alike: see `continuation.renoised`; lengths (B,) of the new latents, those beyond
  mean nothing. P = 0 is the first segment of a chain, an ordinary run. Positions start anew in every segment, and
  blocks count from the window's start.
  """
  length, given = noise.shape[1], past.shape[1]
  if times is None:
    times = jnp.asarray(schedules.staircase(plan.num_steps, length, plan.lag, plan.block))
  context = plan.context + -(-given // plan.block) * plan.block  # the past comes on top, 1 + 48 in the code
  attn_mask = sliding_mask(length, plan.block, context) & padding_mask(given + lengths, length)[:, None, None, :]
  velocity = plain_velocity(dit, params, text_emb, text_mask, attn_mask, scale, plan.guided)
  if not given:
    return samplers.euler(velocity, noise, times)
  return continuation.renoised(velocity, noise, times, past, fresh)[:, given:]


def chain_segment(dit, plan, length, params, text_emb, text_mask, scale, lengths, past, keys):
  """`chained` for a window of `length`, past included; its noise belongs to a motion's key and a latent's place."""
  def fresh(m):
    keys_now = jax.vmap(lambda key: jax.random.fold_in(key, m))(keys)
    blocks = [streaming.block_noise(keys_now, i, plan, dit.latent_dim) for i in range(-(-length // plan.block))]
    return jnp.concatenate(blocks, axis=1)[:, :length]

  return chained(dit, plan, params, text_emb, text_mask, scale, lengths, past, fresh(0), lambda m: fresh(m + 1))


def extend(dit, plan, num_blocks, params, text_emb, text_mask, scale, keys, past, count, segment, past_segment):
  """Clean latents (B, num_blocks * block, C) that go on from the last `count` of past (B, P, C), itself clean.

  The past is kept at t = 1 in the cache. text_emb (B, G, S, E), text_mask (B, G, S); segment (B, num_blocks) and
  past_segment (B, P / block) say which caption each block has.
  """
  # Parity: the paper's clean past in the context (equation 12); `chained` is what the code does instead.
  constants = streaming.make_constants(dit, params, plan)
  text = streaming.encode_text(dit, params, text_emb, text_mask, plan.guided)
  state = streaming.prime(dit, plan, params, constants, text, past, count, streaming.init_stream(dit, plan, keys),
                          past_segment)
  return streaming.sample(dit, plan, params, constants, text, scale, keys, num_blocks, segment=segment, state=state)


class MotionStream(NamedTuple):
  """State of a stream of motion: latents in denoising, and the decoder's memory."""
  latents: streaming.Stream
  decoder: Any


def init_stream(dit, vae, plan, frozen, keys) -> MotionStream:
  decoder = vae.apply(frozen["tokenizer"], keys.shape[0], method="init_decode_state")
  return MotionStream(streaming.init_stream(dit, plan, keys), decoder)


def stream_step(dit, vae, plan, active, use_cache, params, frozen, constants, text, scale, keys, state, caption=None):
  """One block further -> (state, normalized features (B, frames of a block, F), done), the step of `generate`.

  caption (B, active): which of the captions in text the blocks of the window have, see `streaming.advance`. Until done
  is true the features mean nothing and the decoder has not moved.
  """
  latents, block, done = streaming.advance(dit, plan, active, use_cache, params, constants, text, scale, keys,
                                           state.latents, caption)
  z = block * frozen["latent_std"] + frozen["latent_mean"]
  features, decoder = vae.apply(frozen["tokenizer"], z, state.decoder, method="decode_step")
  decoder = jax.tree.map(lambda new, old: jnp.where(done, new, old), decoder, state.decoder)
  return MotionStream(latents, decoder), features, done
