"""T2M-GPT's quantizer, transformer, items, training step and sampling, computed as recorded
(`tests.models.test_recordings`)."""
import functools

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.convert.state import from_torch, select
from motion_jax.latents import RvqCodec
from motion_jax.models.shared.autoencoder_weights import one_level
from motion_jax.models.t2m_gpt import items, losses, sampling
from motion_jax.models.t2m_gpt.weight_names import UNUSED, gpt_names
from motion_jax.motion.representations import to_joints
from motion_jax.nets.token_gpt import CodeGPT
from motion_jax.quant import rvq, vq
from tests.golden import golden
from tests.models.momask import runners as momask
from tests.nets.test_masked_transformer import cast

EXACT = momask.EXACT


def codec_of(sizes, state, dtype):
  width = state["vqvae.encoder.model.0.weight"].shape[1]
  sizes = sizes | {"input_width": width, "args": sizes["args"] | {"num_quantizers": 1}}
  return momask.codec_of(sizes, one_level(state), dtype)[0]


def gpt_of(sizes, state, dtype):
  """-> (net, params, table of names)."""
  net = CodeGPT(num_codes=sizes["num_vq"], width=sizes["embed_dim"], depth=2 * sizes["num_layers"],
                num_heads=sizes["n_head"], ff_width=sizes["fc_rate"] * sizes["embed_dim"], text_dim=sizes["clip_dim"],
                max_length=sizes["block_size"], dropout=0.0, dtype=dtype)
  state = {name: array for name, array in state.items() if not UNUSED.fullmatch(name)}
  table = gpt_names(sizes["num_layers"])
  return net, cast(from_torch(state, table), dtype), table


@golden("t2m_gpt/vq_eval", bounds={"index": EXACT, "": (1e-5, 1e-10)})
def run_vq_eval(fixture, dtype):
  codec = codec_of(fixture.sizes, fixture.params, dtype)
  x, odd = fixture.inputs(dtype, "motion", "motion_odd")

  @jax.jit
  def run(x, odd):
    latents = codec.net.apply(codec.params, x, method="encode")
    indices, vectors = codec.encode(x)
    y = codec.decode(indices)
    used = vq.usage_counts(indices.reshape(-1), fixture.sizes["nb_code"], dtype)[1]
    return {"encoder": latents.swapaxes(1, 2), "index": indices[..., 0], "index_odd": codec.encode(odd)[0][..., 0],
            "vectors": vectors[0], "forward": y, "decoded": codec.decode(indices[:1]),
            # Parity: the reference decodes a batch as one long sequence.
            "decoded_batch": codec.decode(indices.reshape(1, -1, 1)), "perplexity": vq.perplexity(used),
            "loss": momask.loss_terms(y, x, ((latents - vectors[0]) ** 2).mean())}

  return run(x, odd)


@golden("t2m_gpt/vq_train_step", bounds=momask.GRADIENTS | {"index": EXACT, "": (1e-5, 1e-10)})
def run_vq_train_step(fixture, dtype):
  sizes = fixture.sizes
  codec = codec_of(sizes, fixture.params, dtype)
  x, counts = jnp.asarray(fixture["in/motion"], dtype), jnp.asarray(fixture["in/count"], dtype)[None]
  codes = codec.params["codebooks"]["codes"]
  books = vq.Codebook(codes, codes * 3 * counts[..., None], 3 * counts, jnp.ones(1, bool))
  noise = rvq.Noise(jnp.zeros((1, 1, 1), dtype), jnp.zeros_like(codes), jnp.zeros_like(codes))

  @jax.jit
  def run(params):
    def total(params):
      latents = codec.net.apply(params, x, method="encode")
      result, after = rvq.train(books, latents, 1, noise, sizes["args"]["mu"], temperature=0.0)
      y = codec.net.apply(params, result.quantized, method="decode")
      terms = momask.loss_terms(y, x, result.commitment)
      return terms[0], (result, after, terms, y)
    return jax.grad(total, has_aux=True)(params)

  grads, (result, after, terms, y) = run({"params": codec.params["params"]})
  table = {f"vqvae.{theirs}": ours for theirs, ours in momask.autoencoder_table(codec.net).items()}
  made = {"index": result.indices[..., 0], "loss": terms, "perplexity": result.perplexity, "forward": y,
          "codebook": after.codes[0], "code_count": after.counts[0], "code_sum": after.sums[0]}
  return made | momask.compared_grads(fixture, grads, table)


INDICES = {f"{case}/step{i}/{name}": EXACT for case in ("many", "few") for i in range(9) for name in ("index", "dead")}


@golden("t2m_gpt/quantizer_train", bounds=INDICES | {"": (1e-5, 1e-10)})
def run_quantizer_train(fixture, dtype):
  made = {}
  for case, sizes in fixture.sizes.items():
    x = momask.given(fixture, dtype, f"in/{case}/")
    steps = sorted({name.split("/")[0] for name in x if name.startswith("step")}, key=lambda name: int(name[4:]))
    tiles = iter(x[f"tile{i}"] for i in range(sum(name.startswith("tile") for name in x)))  # noqa: B023
    state = vq.empty_codebook(sizes["codes"], sizes["dim"], (1,), dtype)
    tile = lambda: next(tiles)[None, :sizes["codes"]]  # noqa: B023
    for i, step in enumerate(steps):
      rows = x[f"{step}/x"].swapaxes(1, 2)
      none = jnp.zeros((1, sizes["codes"], sizes["dim"]), dtype)
      few = rows.shape[0] * rows.shape[1] < sizes["codes"]
      noise = rvq.Noise(none[:, :1, :1], tile() if few and not i else none, tile() if few else none)
      quantize = jax.jit(lambda rows, state, noise: rvq.train(state, rows, 1, noise, temperature=0.0))

      def total(rows, state=state, noise=noise, quantize=quantize):
        result = quantize(rows, state, noise)[0]
        return result.quantized.sum() + result.commitment

      grad = jax.grad(total)(rows)
      result, state = quantize(rows, state, noise)
      out = {"quantized": result.quantized.swapaxes(1, 2), "index": result.indices[..., 0],
             "commit": result.commitment, "perplexity": result.perplexity, "grad": grad.swapaxes(1, 2),
             "codebook": state.codes[0], "code_sum": state.sums[0], "code_count": state.counts[0],
             "dead": vq.num_dead(state)[0]}
      made |= {f"{case}/{step}/{name}": array for name, array in out.items()}
  return made


@golden("t2m_gpt/gpt", bounds={"": (3e-5, 1e-10)})
def run_gpt(fixture, dtype):
  net, params, _ = gpt_of(fixture.sizes, fixture.params, dtype)
  ids, text = fixture["in/ids"], jnp.asarray(fixture["in/text"], dtype)
  made = {}
  for name in fixture.under("out/logits"):
    made[f"logits{name}"] = jax.jit(net.apply)(params, ids[:, :int(name)], text)
  half = functools.partial(net.apply, method="hidden", num_blocks=net.depth // 2)
  return made | {"half": jax.jit(half)(params, ids, text)}


@golden("t2m_gpt/gpt_train", bounds=momask.GRADIENTS | {
    name: EXACT for case in ("fixed", "drawn") for name in (f"{case}/input", f"{case}/right")} | {"": (1e-5, 1e-10)})
def run_gpt_train(fixture, dtype):
  net, params, table = gpt_of(fixture.sizes, fixture.params, dtype)
  x, made = momask.given(fixture, dtype), {}
  target, lengths = x["target"], x["lengths"]
  for case in sorted({name.split("/")[0] for name in x if "/" in name}):
    drawn = f"{case}/rate" in x
    # As a number of its own precision: a float32 rate would round.
    draws = losses.Draws(x[f"{case}/keep_u"], x[f"{case}/random_ids"], x[f"{case}/rate"][0] if drawn else jnp.zeros(()))
    given = losses.corrupt(target, draws, -1 if drawn else 0.5)

    @jax.jit
    def run(params, given=given):
      def total(params):
        sums, weight = losses.gpt_loss(net, params, target, lengths, x["text"], given)
        return sums["loss"] / weight
      return jax.value_and_grad(total)(params)

    loss, grads = run(params)
    right = jnp.argmax(jax.jit(net.apply)(params, given, x["text"]), -1) == target
    counted = np.arange(target.shape[1]) <= np.asarray(lengths)[:, None]
    made |= {f"{case}/input": given, f"{case}/loss": loss, f"{case}/right": (right & counted).sum()}
    made |= momask.compared_grads(fixture, grads, table, f"{case}/")
  return made


@golden("t2m_gpt/token_items", bounds={"": EXACT})
def run_token_items(fixture, dtype):
  """Parity: the reference cuts the codes of tagged captions out of a whole clip's; the rows are made from those."""
  made, end = {}, fixture.sizes["codebook_size"]
  unit = fixture.sizes["unit_length"]
  for data, named in fixture.meta["items"].items():
    fps = {"t2m": 20, "kit": 12.5}[data]
    for i, name in enumerate(named):
      clip, *times = name.split("_")
      codes = fixture[f"in/{data}/{clip}"][0]
      if times:
        first, past = (int(float(time) * fps / unit) for time in times)
        codes = codes[first:past]
      length = fixture[f"out/{data}/item{i}/whole"].shape[0]
      rows = {place: items.without_one(codes, place) for place in ("whole", "tail", "head")}
      made |= {f"{data}/item{i}/{place}": items.target_row(row, length, end) for place, row in rows.items()}
      made[f"{data}/item{i}/lengths"] = np.array([len(row) for row in rows.values()])
  return made


def by_sum(u):
  """choose(place, logits) by recorded uniforms u (N, places)."""
  def choose(place, logits):
    shares = jnp.cumsum(jax.nn.softmax(logits, -1), axis=-1)
    return jnp.minimum((shares <= u[:, place, None]).sum(-1), logits.shape[-1] - 1)
  return choose


SAMPLED = {f"{mode}/{name}": EXACT for mode in ("greedy", "categorical") for name in ("codes", "length", "calls")}


@golden("t2m_gpt/gpt_sample", bounds=SAMPLED | {"": (3e-5, 1e-10)})
def run_gpt_sample(fixture, dtype):
  net, params, _ = gpt_of(fixture.sizes, fixture.params, dtype)
  text, u, made = jnp.asarray(fixture["in/text"], dtype), jnp.asarray(fixture["in/u"], dtype), {}
  fewest, most = jnp.zeros(len(text), int), jnp.full(len(text), net.max_length - 1)
  for mode, choose in (("greedy", sampling.greedy), ("categorical", by_sum(u))):
    if f"out/{mode}/codes" not in fixture.arrays:
      continue
    codes = jax.jit(lambda text, choose=choose: sampling.sample(net, params, text, choose, fewest, most))(text)
    length = (codes >= 0).sum(-1)
    logits = jax.jit(net.apply)(params, jnp.where(codes >= 0, codes, net.end_code), text)
    called = jnp.arange(net.max_length) <= length[:, None]
    made |= {f"{mode}/codes": codes, f"{mode}/length": length, f"{mode}/calls": jnp.minimum(length + 1, net.max_length),
             f"{mode}/logits": jnp.where(called[..., None], logits, jnp.nan)}
  return made


@golden("t2m_gpt/pipeline", bounds={f"codes{i}": EXACT for i in range(99)} | {"": (2e-4, 1e-10)})
def run_pipeline(fixture, dtype):
  sizes = fixture.sizes
  net, params, _ = gpt_of(sizes, select(fixture.params, "gpt."), dtype)
  codec: RvqCodec = codec_of(sizes["vqvae"], select(fixture.params, "vq."), dtype)
  x = momask.given(fixture, dtype)
  fewest, most = jnp.ones(len(x["text"]), int), jnp.full(len(x["text"]), net.max_length - 1)
  codes = jax.jit(lambda text: sampling.sample(net, params, text, sampling.greedy, fewest, most))(x["text"])
  made = {}
  for i, row in enumerate(np.asarray(codes)):
    row = row[row >= 0]
    motion = jax.jit(codec.decode)(row[None, :, None])
    made |= {f"codes{i}": row, f"motion{i}": motion, f"joints{i}": to_joints(motion * x["std"] + x["mean"])}
  return made
