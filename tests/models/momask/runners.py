"""MoMask's quantizer, transformers, training steps, decoding, edits and pipeline, computed as recorded
(`tests.models.test_recordings`), and what the recordings of T2M-GPT share with them."""
import functools

import jax
import jax.numpy as jnp
import numpy as np
from ml_collections import ConfigDict

from motion_jax.convert.state import from_torch, select
from motion_jax.latents import RvqCodec
from motion_jax.models.momask import losses, sampling
from motion_jax.models.momask.weight_names import masked_names, residual_names
from motion_jax.models.shared import autoencoders
from motion_jax.models.shared import mask_schedule as masking
from motion_jax.models.shared.autoencoder_weights import autoencoder_names, rvq_from_torch
from motion_jax.motion.representations import layout_for, to_joints
from motion_jax.motion.stats import biased_std
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.masks import padding_mask
from motion_jax.nets.token_transformers import MaskedCodeTransformer, ResidualCodeTransformer
from motion_jax.quant import rvq, vq
from motion_jax.training.optimizers import make_schedule
from tests.golden import golden
from tests.nets.naming import by_reference
from tests.nets.test_masked_transformer import cast

EXACT = (0, 0)
CODES = {name: EXACT for name in ("ids", "masked", "input", "drawn", "res_codes", "tokens")}


def codec_of(sizes, state, dtype):
  """-> (RvqCodec, number of levels) of a recorded RVQ-VAE."""
  net = Autoencoder(features=sizes["input_width"], latent_dim=sizes["output_emb_width"], width=sizes["width"],
                    num_halvings=sizes["down_t"],
                    dilations=tuple(sizes["dilation_growth_rate"] ** b for b in reversed(range(sizes["depth"]))),
                    dropout=0.0, dtype=dtype)
  levels = sizes["args"]["num_quantizers"]
  return RvqCodec(net, cast(rvq_from_torch(state, levels, net.num_halvings, len(net.dilations)), dtype)), levels


def transformer_of(kind, sizes, state, dtype, **fields):
  """-> (net, params, table of names) of a recorded transformer of MoMask."""
  fields |= dict(num_codes=sizes["opt"]["num_tokens"], code_dim=sizes["code_dim"], width=sizes["latent_dim"],
                 depth=sizes["num_layers"], num_heads=sizes["num_heads"], ff_width=sizes["ff_size"],
                 text_dim=sizes["clip_dim"], dropout=0.0, dtype=dtype)
  if kind == "masked":
    net, table = MaskedCodeTransformer(**fields), masked_names(sizes["num_layers"])
  else:
    shared = "token_embed_weight_" in state
    net = ResidualCodeTransformer(num_levels=sizes["opt"]["num_quantizers"], shared_tables=shared, **fields)
    table = residual_names(sizes["num_layers"], shared)
  return net, cast(from_torch(state, table), dtype), table


def given(fixture, dtype, prefix="in/"):
  """Inputs: integers as they are, numbers in the precision of the run."""
  return {name: jnp.asarray(array, None if array.dtype.kind in "iub" else dtype)
          for name, array in fixture.under(prefix).items()}


def recorded(fixture, dtype, name):
  wide = fixture.arrays.get(f"out64/{name}") if dtype == jnp.float64 else None
  return fixture[f"out/{name}"] if wide is None else wide


def compared_grads(fixture, grads, table, prefix=""):
  """Gradients to be compared, by their names in the file; one that is rounding on both sides counts as the recorded."""
  made, found = by_reference(grads["params"], table), {}
  for name, expected in fixture.under(f"out/{prefix}grad/").items():
    array = np.asarray(made[name])
    if np.abs(expected).max() < 1e-7:  # biases of keys do nothing
      assert np.abs(array).max() < 1e-6, name
      array = expected
    found[f"{prefix}grad/{name}"] = array
  return found


GRADIENTS = {f"{case}grad/": (2e-5, 1e-5) for case in ("", "all/", "drop/", "shared/", "plain/", "fixed/", "drawn/")}


def loss_terms(y, x, commitment):
  """(total, all columns, positions, commitment) as MoMask and T2M-GPT weigh them."""
  columns = (4, 64 if x.shape[-1] == 251 else 67)
  terms = autoencoders.rvq_terms(y, x[:, :y.shape[1]], commitment, velocity_weight=0.0, commitment_weight=0.02,
                                 position_weight=0.5, columns=columns)
  return jnp.stack([terms[name] for name in ("loss", "rec", "positions", "commitment")])


def autoencoder_table(net):
  return autoencoder_names(net.num_halvings, len(net.dilations))


def real_rows(fixture, dtype, name, array, real, axis):
  """Ours at real places; what lies at padding means nothing. axis: that of places, of ours and of the recorded."""
  shape = [1] * array.ndim
  shape[-real.ndim if axis == -1 and array.ndim == real.ndim else axis] = real.shape[-1]
  batch = array.ndim - 3 if array.ndim > real.ndim else array.ndim - 2
  shape[batch] = real.shape[0]
  return np.where(np.reshape(real, shape), np.asarray(array), recorded(fixture, dtype, name))


def gumbel_of(u):
  """Gumbel noise of uniform numbers, as the reference makes it."""
  log = lambda x: jnp.log(jnp.maximum(x, 1e-20))
  return -log(-log(u))


@golden("momask/rvq_eval", bounds={"index": EXACT, "": (1e-5, 1e-10)})
def run_rvq_eval(fixture, dtype):
  codec, levels = codec_of(fixture.sizes, fixture.params, dtype)
  x, odd = jnp.asarray(fixture["in/motion"], dtype), jnp.asarray(fixture["in/motion_odd"], dtype)

  @jax.jit
  def run(x, odd):
    latents = codec.net.apply(codec.params, x, method="encode")
    indices, codes = codec.encode(x)
    y = codec.decode(indices)
    residuals = latents - jnp.concatenate([jnp.zeros_like(codes[:1]), jnp.cumsum(codes, axis=0)[:-1]])
    used = [vq.perplexity(vq.usage_counts(indices[..., q].reshape(-1), fixture.sizes["nb_code"], dtype)[1])
            for q in range(levels)]
    terms = loss_terms(y, x, ((residuals - codes) ** 2).mean())
    turned = lambda a: a.swapaxes(-1, -2)
    holes = indices.at[:, -2:].set(-1)
    return {"encoder": turned(latents), "index": indices, "index_odd": codec.encode(odd)[0], "codes": turned(codes),
            "sum": turned(codes.sum(0)), "decoded": y, "forward": y, "decoded_two_levels": codec.decode(indices, 2),
            "decoded_holes": codec.decode(holes), "loss": terms, "perplexity": jnp.stack(used).mean()}

  return run(x, odd)


@golden("momask/rvq_train_step", bounds=GRADIENTS | {"all/index": EXACT, "drop/index": EXACT, "": (1e-5, 1e-10)})
def run_rvq_train_step(fixture, dtype):
  sizes, made = fixture.sizes, {}
  codec, levels = codec_of(sizes, fixture.params, dtype)
  x, counts = jnp.asarray(fixture["in/motion"], dtype), jnp.asarray(fixture["in/count"], dtype)
  codes = codec.params["codebooks"]["codes"]
  books = vq.Codebook(codes, codes * 3 * counts[..., None], 3 * counts, jnp.ones(levels, bool))
  params = {"params": codec.params["params"]}
  for case in sorted({name.split("/")[0] for name in fixture.under("in/") if "/" in name}):
    step = fixture.under(f"in/{case}/")
    active = int(step.get("start", levels - 1)) + 1
    rows = x.shape[0] * (x.shape[1] // codec.net.frames_per_latent)
    gumbel = jnp.stack([gumbel_of(jnp.asarray(step[f"u{q}"], dtype)) if q < active else
                        jnp.zeros((rows, codes.shape[1]), dtype) for q in range(levels)])
    noise = rvq.Noise(gumbel, jnp.zeros_like(codes), jnp.zeros_like(codes))

    @jax.jit
    def run(params, noise, active=active):
      def total(params):
        latents = codec.net.apply(params, x, method="encode")
        result, after = rvq.train(books, latents, active, noise, sizes["args"]["mu"])
        terms = loss_terms(codec.net.apply(params, result.quantized, method="decode"), x, result.commitment)
        return terms[0], (result, after, terms)

      return jax.grad(total, has_aux=True)(params)

    grads, (result, after, terms) = run(params, noise)
    out = {"index": result.indices, "loss": terms, "perplexity": result.perplexity}
    for q in range(levels):
      out |= {f"level{q}/codebook": after.codes[q], f"level{q}/code_count": after.counts[q]}
    made |= {f"{case}/{name}": array for name, array in out.items()}
    made |= compared_grads(fixture, grads, autoencoder_table(codec.net), f"{case}/")
  return made


@golden("momask/mask_transformer", bounds={"": (3e-5, 1e-10)})
def run_mask_transformer(fixture, dtype):
  net, params, _ = transformer_of("masked", fixture.sizes, fixture.params, dtype)
  ids, text, lengths = (given(fixture, dtype)[name] for name in ("ids", "text", "lengths"))
  real = padding_mask(lengths, ids.shape[1])
  logits = jax.jit(lambda text: net.apply(params, ids, text, real))
  hidden = jax.jit(lambda text: net.apply(params, ids, text, real, method="hidden"))
  made = {"logits_text": logits(text), "logits_null": logits(0 * text), "hidden_text": hidden(text),
          "hidden_null": hidden(0 * text)}
  for name in fixture.under("out/logits_scale"):
    made[f"logits_scale{name}"] = jax.jit(lambda text, scale: sampling.guided(
        lambda t: net.apply(params, jnp.tile(ids, (2, 1)), t, jnp.tile(real, (2, 1))), text, scale))(text, float(name))
  return {name: real_rows(fixture, dtype, name, array.swapaxes(-1, -2) if "logits" in name else array, real,
                          -1 if "logits" in name else -2) for name, array in made.items()}


@golden("momask/mask_corruption", bounds={"": EXACT})
def run_mask_corruption(fixture, dtype):
  return corruption_of(fixture, dtype, fixture.sizes["num_tokens"])[0]


def corruption_of(fixture, dtype, num_codes):
  """-> ({"input", "labels"}, Draws, real_mask) of a recorded training step."""
  x = given(fixture, dtype)
  real = padding_mask(x["lengths"], x["ids"].shape[1])
  draws = losses.Draws(x["time_u"], x.get("text_u", jnp.ones(len(real))), x["order_u"], x["replace_u"], x["mask_u"],
                       x["random_ids"])
  shown, hidden = losses.hide(x["ids"], real, draws, num_codes)
  return {"input": shown, "labels": jnp.where(hidden, x["ids"], num_codes)}, draws, real


@golden("momask/mask_train_step", bounds=GRADIENTS | {
    "predicted": EXACT, "input": EXACT, "accuracy": (1e-6, 1e-6), "": (1e-5, 1e-10)})
def run_mask_train_step(fixture, dtype):
  sizes = fixture.sizes
  net, params, table = transformer_of("masked", sizes, fixture.params, dtype)
  out, draws, real = corruption_of(fixture, dtype, net.num_codes)
  x = given(fixture, dtype)
  config = ConfigDict(dict(noise_rate=0.1, mask_rate=0.88, drop_rate=sizes["cond_drop_prob"]))

  @jax.jit
  def run(params):
    def total(params):
      sums, weight = losses.masked_loss(net, params, x["ids"], real, x["text"], draws, config)
      return sums["loss"] / weight, sums["accuracy"] / weight
    return jax.value_and_grad(total, has_aux=True)(params)

  text = jnp.where((draws.text_u < config.drop_rate)[:, None], 0, x["text"])
  predicted = jnp.argmax(net.apply(params, out["input"], text, real), -1)
  (loss, accuracy), grads = run(params)
  return {"loss": loss, "accuracy": accuracy, "input": out["input"],
          "predicted": np.where(real, predicted, fixture["out/predicted"])} | compared_grads(
              fixture, grads, table)


@golden("momask/residual_transformer", bounds={"": (1e-4, 1e-10)})
def run_residual_transformer(fixture, dtype):
  x, made = given(fixture, dtype), {}
  real = padding_mask(x["lengths"], x["ids"].shape[1])
  for kind in sorted({name.split(".")[0] for name in fixture.params}):
    net, params, _ = transformer_of("residual", fixture.sizes, select(fixture.params, f"{kind}."), dtype)
    for name in fixture.under(f"out/{kind}/"):
      level = int("".join(c for c in name.split("_")[0] if c.isdigit()))
      levels = jnp.full(len(real), level)
      history = net.apply(params, x["ids"], levels, method="history")
      if name.startswith("history"):
        made[f"{kind}/{name}"] = history
        continue
      word, scale = name.split("_")[1], None
      if word.startswith("scale"):
        scale = float(word.removeprefix("scale"))
      rows = 1 if scale is None else 2
      logits = jax.jit(functools.partial(residual_logits, net, scale, rows))(
          params, history, levels, 0 * x["text"] if word == "null" else x["text"], real)
      made[f"{kind}/{name}"] = real_rows(fixture, dtype, f"{kind}/{name}", logits.swapaxes(1, 2), real, -1)
  return made


def residual_logits(net, scale, rows, params, history, levels, text, real):
  tiled = lambda a: jnp.tile(a, (rows,) + (1,) * (a.ndim - 1))
  return sampling.guided(lambda text: net.apply(params, tiled(history), tiled(levels), text, tiled(real)), text, scale)


@golden("momask/residual_train_step", bounds=GRADIENTS | {
    "levels": EXACT, "shared/predicted": EXACT, "plain/predicted": EXACT, "shared/accuracy": (1e-6, 1e-6),
    "plain/accuracy": (1e-6, 1e-6), "": (1e-5, 1e-10)})
def run_residual_train_step(fixture, dtype):
  sizes, x = fixture.sizes, given(fixture, dtype)
  real, zeros = padding_mask(x["lengths"], x["ids"].shape[1]), jnp.zeros(x["ids"].shape[:2], dtype)
  draws = losses.Draws(x["level_u"], x["text_u"], zeros, zeros, zeros, zeros.astype(int))
  config = ConfigDict(dict(drop_rate=sizes["cond_drop_prob"]))
  level = losses.level_of(x["level_u"], sizes["opt"]["num_quantizers"])
  made = {"levels": level}
  for kind in sorted({name.split(".")[0] for name in fixture.params}):
    net, params, table = transformer_of("residual", sizes, select(fixture.params, f"{kind}."), dtype)

    @jax.jit
    def run(params, net=net):
      def total(params):
        sums, weight = losses.residual_loss(net, params, x["ids"], real, x["text"], draws, config)
        return sums["loss"] / weight, sums["accuracy"] / weight
      return jax.value_and_grad(total, has_aux=True)(params)

    (loss, accuracy), grads = run(params)
    history = net.apply(params, jnp.where(real[..., None], x["ids"], net.padding_code), level, method="history")
    text = jnp.where((draws.text_u < config.drop_rate)[:, None], 0, x["text"])
    predicted = jnp.argmax(net.apply(params, history, level, text, real), -1)
    out = {"loss": loss, "accuracy": accuracy, "history": history,
           "predicted": np.where(real, predicted, fixture[f"out/{kind}/predicted"])}
    made |= {f"{kind}/{name}": array for name, array in out.items()}
    made |= compared_grads(fixture, grads, table, f"{kind}/")
  return made


@golden("momask/schedules", bounds={"lr/": (1e-10, 1e-15), "": EXACT})
def run_schedules(fixture, dtype):
  made = {}
  for name in fixture.under("out/rounds/"):
    made[f"rounds/{name}"] = masking.masked_counts(int(name), np.arange(1, len(fixture[f"out/rounds/{name}"]) + 1)).T
  u = fixture["in/u"]
  count = lambda length: masking.choose_masked(jnp.asarray(u), jnp.tile(jnp.arange(length) / length, (len(u), 1)),
                                               jnp.ones((len(u), int(length)), bool)).sum(-1)
  made["train"] = np.stack([count(length) for length in fixture["in/train_lengths"]], -1)
  for name in fixture.under("out/level/"):
    made[f"level/{name}"] = losses.level_of(jnp.asarray(u), int(name))
  made["kept"] = np.array([[sampling.num_kept(threshold, int(classes)) for classes in fixture["in/classes"]]
                           for threshold in fixture["in/thresholds"]])
  rate = fixture.meta["lr"]
  for name, late in (("transformer", 0), ("rvq", rate["warm_up"] - 1)):
    config = ConfigDict(dict(schedule="step", learning_rate=rate["lr"], warmup_steps=rate["warm_up"],
                             boundaries=[one + late for one in rate["milestones"]], gamma=rate["gamma"],
                             warmup="released"))
    made[f"lr/{name}"] = np.array([make_schedule(config, rate["steps"])(step) for step in range(rate["steps"])])
  return made


@golden("momask/statistics", bounds={"": (1e-7, 1e-7)})
def run_statistics(fixture, dtype):
  made = {}
  for name in sorted({name.split("/")[0] for name in fixture.under("in/")}):
    std, bias = np.asarray(fixture[f"in/{name}/std"], np.float32), fixture.sizes["feat_bias"]
    once = biased_std(std, bias)
    made |= {f"{name}/once": once, f"{name}/twice": biased_std(once, bias)}
  return made


# --- sampling, editing, pipeline ------------------------------------------------------------------------------------


def recorded_choice(draws, prefix, threshold, temperature, gumbel=True):
  """choose(i, logits) by recorded uniforms u0, u1, ... below a prefix, in order; levels count from 1."""
  names = sorted((name for name in draws if name.startswith(prefix) and name[len(prefix):].isdigit()),
                 key=lambda name: int(name[len(prefix):]))
  first, u = int(names[0][len(prefix):]), jnp.stack([draws[name] for name in names])

  def by_sum(i, logits):
    shares = jax.nn.softmax(sampling.keep_likeliest(logits, threshold) / temperature, -1)
    return jnp.minimum((jnp.cumsum(shares, axis=-1) <= u[i - first][..., None]).sum(-1), logits.shape[-1] - 1)

  if not gumbel:
    return by_sum
  return sampling.chooser(lambda i: gumbel_of(u[i - first]), temperature, threshold)


def decoded_rounds(fixture, dtype, net, params, codes, editable, real, text, draws, prefix, num_rounds, scale,
                   counts=None, threshold=0.9, temperature=1.0, gumbel=True, rescore=False):
  """The recorded loop -> ({"masked", "input", "drawn", "ids", "logits"}, last codes)."""
  counts = masking.masked_counts(num_rounds, np.asarray(editable).sum(-1)) if counts is None else counts
  choose = recorded_choice(draws, prefix, threshold, temperature, gumbel)
  scale = None if scale == 1 else scale
  run = jax.jit(lambda codes, text: sampling.decode_masked(net, params, codes, editable, real, counts, text, scale,
                                                           choose, rescore))
  rounds = run(codes, text)
  ids = jnp.where(real, rounds.codes[-1], -1)
  return {"masked": rounds.masked, "input": rounds.given, "drawn": rounds.drawn, "ids": ids,
          "logits": jnp.moveaxis(rounds.logits, -1, -2)}, ids


def kept(fixture, dtype, prefix, out, real):
  """Outputs that the file has, ours at real places."""
  made = {}
  for name, array in out.items():
    if f"out/{prefix}{name}" in fixture.arrays:
      here = np.asarray(real)
      shown = np.broadcast_to(here[:, None] if name == "logits" else here, array.shape)
      made[prefix + name] = np.where(shown, array, recorded(fixture, dtype, prefix + name))
  return made


RUNS = {f"{run}/{name}": EXACT for run in ("gumbel", "categorical", "warm", "plain", "no_text")
        for name in ("ids", "masked", "input", "drawn")}


@golden("momask/mask_generate", bounds=RUNS | {"": (1e-4, 1e-10)})
def run_mask_generate(fixture, dtype):
  net, params, _ = transformer_of("masked", fixture.sizes, fixture.params, dtype)
  x, made = given(fixture, dtype), {}
  length = fixture["out/" + next(iter(fixture.meta["runs"])) + "/ids"].shape[1]
  real = padding_mask(x["lengths"], length)
  for run, fields in fixture.meta["runs"].items():
    text, scale = x["text"], fields["cond_scale"]
    if fields.get("force_mask"):
      text, scale = 0 * text, 1
    out, _ = decoded_rounds(fixture, dtype, net, params, jnp.zeros(real.shape, int), real, real, text,
                            given(fixture, dtype, f"in/{run}/"), "u", fields["timesteps"], scale,
                            threshold=fields.get("topk_filter_thres", 0.9), temperature=fields.get("temperature", 1),
                            gumbel=fields["gsample"])
    made |= kept(fixture, dtype, f"{run}/", out, real)
  return made


def levels_of(net, params, ids, real, text, draws, prefix, scale, num_levels=None, threshold=0.9, temperature=1.0):
  choose = recorded_choice(draws, prefix, threshold, temperature)
  scale = None if scale == 1 else scale
  run = jax.jit(lambda ids, text: sampling.add_levels(net, params, ids, real, text, scale, choose, num_levels,
                                                      padding_class=True))
  return run(ids, text)


@golden("momask/residual_generate", bounds={f"{run}/codes": EXACT for run in ("scale5", "scale2", "two_levels")} | {
    "": (1e-4, 1e-10)})
def run_residual_generate(fixture, dtype):
  net, params, _ = transformer_of("residual", fixture.sizes, fixture.params, dtype)
  x, made = given(fixture, dtype), {}
  real = padding_mask(x["lengths"], x["ids"].shape[1])
  for run, fields in fixture.meta["runs"].items():
    codes, logits = levels_of(net, params, x["ids"], real, x["text"], given(fixture, dtype, f"in/{run}/"), "u",
                              fields["cond_scale"], fields.get("num_res_layers"), fields.get("topk_filter_thres", 0.9),
                              fields["temperature"])
    made[f"{run}/codes"] = codes
    for level, array in enumerate(logits, 1):
      if f"out/{run}/logits{level}" in fixture.arrays:
        made[f"{run}/logits{level}"] = real_rows(fixture, dtype, f"{run}/logits{level}", array.swapaxes(1, 2), real, -1)
  return made


def parts_of(fixture, dtype):
  sizes, state = fixture.sizes, fixture.params
  codec, _ = codec_of(sizes["rvq"], select(state, "vq."), dtype)
  return codec, transformer_of("masked", sizes, select(state, "mask."), dtype)[:2], transformer_of(
      "residual", sizes, select(state, "res."), dtype)[:2]


CASES = {f"{case}/{name}": EXACT for case in ("middle", "frames", "free") for name in (*CODES, "edit_mask")}


@golden("momask/edit", bounds=CASES | CODES | {"": (2e-4, 1e-10)})
def run_edit(fixture, dtype):
  codec, (net, params), (res_net, res_params) = parts_of(fixture, dtype)
  x = given(fixture, dtype)
  tokens = jax.jit(lambda x: codec.encode(x)[0])(x["motion"])
  length, unit = tokens.shape[1], codec.frames_per_latent
  real = padding_mask(x["frames"] // unit, length)
  made = {"tokens": tokens}
  for case, fields in fixture.meta["cases"].items():
    counts, editable = None, np.zeros((1, length), bool)
    for first, past in fields.get("sections", []):
      # Parity: a share counts on the padded tokens, in the reference.
      place = (lambda a: int(a * length)) if isinstance(first, float) else (lambda a: a // unit)
      editable[:, place(first):place(past)] = True
    if "sections" in fields:
      made[f"{case}/edit_mask"] = editable
      editable = editable & np.asarray(real)
    else:
      editable = np.asarray(real)
      share = np.float32(fixture.stated(r"([\d.]+) % of the valid") / 100) * editable.sum(-1).astype(np.float32)
      counts = np.tile(np.maximum(1, np.round(share)).astype(int), (fields["rounds"], 1))
    draws = given(fixture, dtype, f"in/{case}/")
    out, ids = decoded_rounds(fixture, dtype, net, params, tokens[..., 0], jnp.asarray(editable), real, x["text"],
                              draws, "u", fields["rounds"], fields["scale"], counts, rescore=counts is not None)
    # Parity: the reference draws the residual levels of the whole clip again, and feeds the padding class on.
    codes, _ = levels_of(res_net, res_params, ids, real, x["text"], draws, "res_u", fields.get("res_scale", 2))
    made |= kept(fixture, dtype, f"{case}/", out, real)
    made |= {f"{case}/res_codes": codes, f"{case}/motion": jax.jit(codec.decode)(codes)}
  return made


@golden("momask/pipeline", bounds=CODES | {"": (2e-4, 1e-10)})
def run_pipeline(fixture, dtype):
  codec, (net, params), (res_net, res_params) = parts_of(fixture, dtype)
  x = given(fixture, dtype)
  lengths = fixture["in/frames"] // codec.frames_per_latent
  real = padding_mask(jnp.asarray(lengths), int(lengths.max()))
  rounds = len([name for name in fixture.under("in/u") if name.isdigit()])
  empty = jnp.zeros(real.shape, int)
  out, ids = decoded_rounds(fixture, dtype, net, params, empty, real, real, x["text"], x, "u", rounds,
                            fixture.sizes["scale"])
  codes, _ = levels_of(res_net, res_params, ids, real, x["text"], x, "res_u", fixture.sizes["res_scale"])
  # Parity: the reference decodes padding as zero vectors, so the end of a clip depends on its batch; ours ends there.
  motion = jax.jit(codec.decode)(codes)
  features = motion * x["std"] + x["mean"]
  made = kept(fixture, dtype, "", out, real) | {"res_codes": codes, "motion": motion}
  for i, length in enumerate(lengths):
    made[f"joints{i}"] = to_joints(features[i, :length * codec.frames_per_latent], layout_for(fixture.sizes["columns"]))
  return made
