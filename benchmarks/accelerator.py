"""What an accelerator does for this project, piece by piece: sampling, streaming, decoding, training, matmuls.

  python benchmarks/accelerator.py OUT                 all pieces that OUT lacks, the most wanted first
  python benchmarks/accelerator.py OUT --seconds 500   begins no piece after this time; the same command continues
  python benchmarks/accelerator.py OUT --only train/   pieces whose names begin so
  python benchmarks/accelerator.py OUT --tiny          tiny networks, for a test on a CPU
  python benchmarks/accelerator.py OUT --table         writes OUT/README.md from the pieces that are there

OUT holds one JSON file a piece, each with the device's name, so a run that is cut short loses at most one piece. A
piece that fails, for want of memory say, leaves its error in its file and is not tried again unless the file is
removed; so does one that ended the whole program. benchmarks/gpu.sh runs this. Weights and inputs are random: that
changes no time.

Times are medians over several calls after one that compiles. FLOPs are XLA's count of the program before it is
optimized; MFU is that over the time and over the largest rate that a matrix product reached here in the same type.
"""
import argparse
import functools
import json
import pathlib
import platform
import statistics
import time

import jax
import jax.numpy as jnp
import numpy as np
import sampling  # benchmarks/sampling.py, beside this file

from motion_jax.latents import AutoencoderCodec, VaeCodec
from motion_jax.models import cdamd, cmdm
from motion_jax.models.cdamd import draws, mask_schedule, unmasking
from motion_jax.models.cmdm import streaming
from motion_jax.nets import causal_dit
from motion_jax.nets.autoencoder import Autoencoder
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.training import mesh, optimizers, train_step
from motion_jax.training.setup import untrained
from motion_jax.utils import config_files
from motion_jax.utils.atomic import atomic_path

SECONDS = 6  # of motion that a clip has, at 20 frames a second
WORDS, STEPS, LAG, CONTEXT, GUIDANCE = 24, 50, 2, 48, 3.0
SIZES = ("S", "M", "L", "XL")
TYPES = ("bfloat16", "float32")


def pieces(tiny) -> dict:
  """{name: function() -> dict of numbers}, the most wanted first."""
  sizes, batches, sides = (("M",), (1,), (64,)) if tiny else (SIZES, (1, 256), (2048, 4096, 8192))
  types, train_batches = TYPES[1:] if tiny else TYPES, (4,) if tiny else (64, 256)
  found = {f"matmul/{dtype}": functools.partial(matmul, dtype, sides) for dtype in types}

  def add(name, function, *args):
    found[name] = functools.partial(function, *args, tiny)

  for size in sorted(sizes, key="MXLS".find):  # the paper's M first
    for dtype in types:
      for batch in batches:
        add(f"fss/{size}/{dtype}/batch{batch}", sample_cmdm, size, dtype, batch, LAG)
      add(f"stream/{size}/{dtype}", stream, size, dtype)
  for dtype in types:
    for batch in batches:
      add(f"cdamd/full/{dtype}/batch{batch}", sample_cdamd, dtype, batch)
    for size in sorted(sizes, key="MXLS".find):
      for batch in train_batches:
        add(f"train/denoiser-{size}/{dtype}/batch{batch}", train_denoiser, size, dtype, batch)
    for name in ("cdamd_generator", "cmdm_tokenizer", "cdamd_autoencoder", "cdamd_rvq"):
      add(f"train/{name}/{dtype}", train_config, name, dtype)
  for batch in batches:
    for method in ("cmdm", "cdamd"):
      add(f"decode/{method}/batch{batch}", decode, method, batch)
  for size in sizes:
    add(f"ar/{size}/{types[0]}/batch1", sample_cmdm, size, types[0], 1, STEPS)
  return found


# --- pieces ---------------------------------------------------------------------------------------------------------


def matmul(dtype, sides):
  """The largest rate of a square product: the peak that MFU refers to."""
  rates = {}
  for side in sides:
    a, b = (jax.random.normal(jax.random.key(i), (side, side), dtype) for i in range(2))
    run = jax.jit(lambda a, b: a @ b)
    rates[str(side)] = 2 * side ** 3 / timed(run, a, b)["seconds"] / 1e12
  return dict(tflops=max(rates.values()), by_side=rates)


def sample_cmdm(size, dtype, batch, lag, tiny):
  """Clips of 6 s, from noise to features: frame-wise sampling, or block after block where lag is all steps."""
  dit, params = denoiser(size, dtype, tiny)
  codec = cmdm_codec(tiny)
  steps = 4 if tiny else STEPS
  length = frames_of(tiny) // codec.frames_per_latent
  plan = streaming.make_plan(steps, min(lag, steps), dit.block, CONTEXT, length // dit.block)
  text_emb, text_mask = words(dit.text_dim, batch)
  run = jax.jit(lambda params, codec, keys: cmdm.generate(
      dit, plan, length // dit.block, params, codec, text_emb=text_emb, text_mask=text_mask,
      scale=jnp.float32(GUIDANCE), keys=keys))
  found = timed(run, params, codec, jax.vmap(jax.random.key)(jnp.arange(batch)))
  return found | dict(fps=batch * length * codec.frames_per_latent / found["seconds"], frames=length * 4, batch=batch)


def stream(size, dtype, tiny):
  """Seconds to a stream's first block of 3 latents, and between later ones."""
  dit, params = denoiser(size, dtype, tiny)
  text_emb, text_mask = words(dit.text_dim, 1)
  plan = streaming.make_plan(4 if tiny else STEPS, LAG, dit.block, CONTEXT)
  keys = jax.vmap(jax.random.key)(jnp.arange(1))
  first, further = sampling.stream_times(dit, plan, params, text_emb, text_mask, keys, jnp.float32(GUIDANCE), 12)
  return dict(first_seconds=first, next_seconds=further, next_latent_seconds=further / dit.block,
              fps=4 * dit.block / further)


def sample_cdamd(dtype, batch, tiny):
  """Clips of CDAMD's generator of 290 M parameters with its decoder, 10 decoding iterations of 10 midpoint steps."""
  config, net, codec = generator(dtype, tiny)
  params = random_params(cdamd.generator_shapes(net))
  length = frames_of(tiny) // codec.frames_per_latent
  keys, real = jax.vmap(jax.random.key)(jnp.arange(batch)), np.ones((batch, length), bool)
  order = draws.draw_order(keys, np.full(batch, length), length, "random")
  counts = mask_schedule.masked_counts(2 if tiny else 10, real.sum(-1))
  masked = jnp.asarray(mask_schedule.masked_table(np.asarray(order), counts))
  plan = cdamd.make_plan(num_steps=2 if tiny else 10, num_rows=unmasking.most_unmasked(counts))
  text_emb = jax.random.normal(jax.random.key(2), (batch, 1, net.transformer.text_dim))

  def make(params, codec, keys):
    draw = draws.make_draw(keys, length, net.transformer.latent_dim)
    return cdamd.generate(net, plan, params, codec, real_mask=jnp.asarray(real), text_emb=text_emb, masked=masked,
                          scale=jnp.float32(4.0), draw=draw)

  found = timed(jax.jit(make), params, codec, keys)
  frames = batch * length * codec.frames_per_latent
  return found | dict(fps=frames / found["seconds"], frames=frames // batch, batch=batch)


def decode(method, batch, tiny):
  codec, frames = cmdm_codec(tiny) if method == "cmdm" else generator("float32", tiny)[2], frames_of(tiny)
  z = jax.random.normal(jax.random.key(0), (batch, frames // codec.frames_per_latent, codec.net.latent_dim))
  masks = () if isinstance(codec, VaeCodec) else (jnp.ones(z.shape[:2], bool),)
  found = timed(jax.jit(lambda codec, z: codec.decode(z, *masks)), codec, z)
  return found | dict(fps=batch * frames / found["seconds"], batch=batch)


def train_denoiser(size, dtype, batch, tiny):
  config = config_of("cmdm_denoiser", tiny)
  if not tiny:
    config.model.update(causal_dit.size(size))
  return train_of(config, cmdm.denoiser_stage, dtype, batch)


def train_config(name, dtype, tiny):
  config = config_of(name, tiny)
  if name == "cmdm_tokenizer":
    config.frozen.teacher = ""  # alone: the teacher is a constant that others choose
    config.model.teacher_dim = 0
  stage = {"cdamd_generator": cdamd.generator_stage, "cmdm_tokenizer": cmdm.tokenizer_stage,
           "cdamd_autoencoder": cdamd.autoencoder_stage, "cdamd_rvq": cdamd.rvq_stage}[name]
  return train_of(config, stage, dtype, config.data.batch_size)


def train_of(config, make_stage, dtype, batch_size):
  """A training step of a config, with its optimizer, on a batch of its shapes."""
  with config.unlocked():
    (config.train if "dtype" in config.train else config.model).dtype = dtype
  stage, batch, frozen = make_stage(config), batch_of(config, batch_size), frozen_of(config)
  tx = optimizers.make_optimizer(config.optimizer, config.train.num_steps)
  average, devices = config.optimizer.ema_decay > 0, mesh.make_mesh(config.mesh)
  state = jax.jit(lambda batch, key: train_step.init_state(stage, tx, batch, key, average))(batch, jax.random.key(0))
  run = devices.compiled(train_step.make_train_step(stage, tx, config.optimizer.ema_decay, config.optimizer.skip_loss))
  found = timed(run, devices.put(state), devices.put(frozen), jax.device_put(devices.rows(batch)), jax.random.key(1),
                carried=True)
  return found | dict(samples_per_second=batch_size / found["seconds"], batch=batch_size)


# --- networks and inputs ----------------------------------------------------------------------------------------------


def config_of(name, tiny):
  return config_files.load(f"{name}:tiny" if tiny else name)


def frames_of(tiny):
  return 24 if tiny else SECONDS * 20


def random_params(shapes):
  return jax.device_put(untrained(shapes))


def denoiser(size, dtype, tiny):
  fields = config_of("cmdm_denoiser", tiny).model.to_dict() | ({} if tiny else causal_dit.size(size))
  dit = CausalDiT(**fields | dict(dtype=jnp.dtype(dtype)))
  return dit, random_params(cmdm.denoiser_shapes(dit))


def cmdm_codec(tiny):
  vae = CausalVAE(**config_of("cmdm_denoiser", tiny).tokenizer)
  return jax.device_put(VaeCodec.of(vae, untrained(cmdm.frozen_shapes(vae))))


def generator(dtype, tiny):
  config = config_of("cdamd_generator", tiny)
  net, autoencoder = cdamd.make_generator(config.model, jnp.dtype(dtype)), Autoencoder(**config.tokenizer)
  return config, net, jax.device_put(AutoencoderCodec.of(autoencoder, untrained(cdamd.frozen_shapes(autoencoder))))


def words(dim, batch):
  return jax.random.normal(jax.random.key(3), (batch, WORDS, dim)), jnp.ones((batch, WORDS), bool)


def batch_of(config, size):
  """Random numbers in the shapes of a config's batches."""
  draw = np.random.default_rng(0)
  frames = config.data.get("window") or config.data.max_frames
  features = config.get("tokenizer", config.model).features
  batch = dict(features=draw.standard_normal((size, frames, features), np.float32), index=np.arange(size))
  if "tokenizer" in config:
    sentence = "transformer" in config.model  # a vector a caption, where CMDM has one a word
    dim = config.model.transformer.text_dim if sentence else config.model.text_dim
    count = 1 if sentence else config.data.max_words
    batch |= dict(num_frames=np.full(size, frames, np.int32),
                  text_emb=draw.standard_normal((size, count, dim), np.float32))
    batch |= {} if sentence else dict(text_mask=np.ones((size, count), bool))
  return batch


def frozen_of(config):
  if "tokenizer" not in config:
    return {}
  if config.stage == "cmdm.denoiser":
    return untrained(cmdm.frozen_shapes(CausalVAE(**config.tokenizer)))
  frozen = untrained(cdamd.frozen_shapes(Autoencoder(**config.tokenizer)))
  if config.loss.prior_levels:
    frozen["prior"] = untrained(cdamd.autoencoder_shapes(Autoencoder(**config.prior), config.quantizer))
  return frozen


def timed(function, *args, carried=False, repeats=7):
  """Seconds of a call, of compiling, working memory in MB and XLA's count of FLOPs; carried: the first result takes the
  place of the first argument, which is donated."""
  lowered = function.lower(*args)
  start = time.perf_counter()
  compiled = lowered.compile()
  compiling, times, rest = time.perf_counter() - start, [], list(args)
  for _ in range(1 + repeats):
    start = time.perf_counter()
    made = jax.block_until_ready(compiled(*rest))
    times.append(time.perf_counter() - start)
    if carried:
      rest[0] = made[0]
  memory, cost = compiled.memory_analysis(), lowered.cost_analysis() or {}
  return dict(seconds=statistics.median(times[1:]), compile_seconds=compiling, flops=cost.get("flops"),
              working_mb=memory.temp_size_in_bytes / 1e6 if memory else None,
              arguments_mb=memory.argument_size_in_bytes / 1e6 if memory else None)


# --- the run and its table --------------------------------------------------------------------------------------------


def device():
  first = jax.devices()[0]
  return dict(device=first.device_kind, platform=first.platform, jax=jax.__version__, python=platform.python_version())


def measure(out, wanted, seconds):
  """Runs what is wanted and not there yet. True if nothing is left."""
  began = time.monotonic()
  for name, run in wanted.items():
    path = out / f"{name.replace('/', '-')}.json"
    if path.exists():
      continue
    if time.monotonic() - began > seconds:
      print(f"{seconds:g} s are over; the same command continues at {name}")
      return False
    write(path, dict(piece=name, error="the program ended in this piece") | device())  # until it is done
    try:
      found = run()
    except Exception as error:  # out of memory, an operation that the device lacks: the others go on
      found = dict(error=f"{type(error).__name__}: {str(error)[:300]}")
    write(path, dict(piece=name) | found | device())
    print(name, json.dumps({key: float(f"{value:.4g}") if isinstance(value, float) else value
                            for key, value in found.items() if not isinstance(value, dict)}), flush=True)
    jax.clear_caches()
  return True


def write(path, content):
  with atomic_path(path) as whole:
    whole.write_text(json.dumps(content, indent=1) + "\n")


def table(out):
  """README.md beside the pieces: a table of each kind, a row a piece."""
  rows = [json.loads(path.read_text()) for path in sorted(out.glob("*.json"))]
  if not rows:
    raise SystemExit(f"{out} holds no piece yet: run without --table first")
  peaks = {row["piece"].split("/")[1]: row["tflops"] for row in rows if row["piece"].startswith("matmul/") and
           "tflops" in row}
  lines = [f"# {', '.join(sorted({row['device'] for row in rows}))}", "",
           "Written by `benchmarks/gpu.sh` (benchmarks/accelerator.py says what each number is). jax "
           + ", ".join(sorted({row["jax"] for row in rows})) + ". Random weights of the papers' sizes; a clip is "
           f"{SECONDS} s. Largest measured matrix product, TFLOP/s: "
           + (", ".join(f"{dtype} {rate:.3g}" for dtype, rate in peaks.items()) or "not measured") + "."]
  for kind in dict.fromkeys(row["piece"].partition("/")[0] for row in rows):
    if kind == "matmul":
      continue
    own = [row for row in rows if row["piece"].startswith(f"{kind}/")]
    columns = ["ms", "frames/s", "samples/s", "MFU %", "first ms", "next block ms", "next latent ms", "memory MB",
               "compile s"]
    cells = [numbers_of(row, peaks) for row in own]
    columns = [name for name in columns if any(name in cell for cell in cells)]
    lines += ["", f"## {kind}", "", "| piece | " + " | ".join(columns) + " |", "|" + " --- |" * (len(columns) + 1)]
    for row, cell in zip(own, cells):
      values = [row["error"]] if "error" in row else [f"{cell[name]:.4g}" if name in cell else "" for name in columns]
      lines.append(f"| {row['piece'].partition('/')[2]} | " + " | ".join(values) + " |")
  with atomic_path(out / "README.md") as whole:
    whole.write_text("\n".join(lines) + "\n")


def numbers_of(row, peaks):
  """{column: number} of a piece."""
  names = {"ms": ("seconds", 1000), "frames/s": ("fps", 1), "samples/s": ("samples_per_second", 1),
           "first ms": ("first_seconds", 1000), "next block ms": ("next_seconds", 1000),
           "next latent ms": ("next_latent_seconds", 1000), "compile s": ("compile_seconds", 1)}
  found = {column: row[key] * scale for column, (key, scale) in names.items() if row.get(key) is not None}
  if row.get("working_mb") is not None:
    found["memory MB"] = row["working_mb"] + row["arguments_mb"]
  peak = next((rate for dtype, rate in peaks.items() if f"/{dtype}" in row["piece"]), None)
  if row["piece"].startswith("train/") and row.get("flops") and peak:
    found["MFU %"] = 100 * row["flops"] / row["seconds"] / (peak * 1e12)
  return found


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("out", type=pathlib.Path)
  parser.add_argument("--seconds", type=float, default=1e9)
  parser.add_argument("--only", default="")
  parser.add_argument("--tiny", action="store_true")
  parser.add_argument("--table", action="store_true")
  args = parser.parse_args()
  if args.table:
    return table(args.out)
  args.out.mkdir(parents=True, exist_ok=True)
  print(json.dumps(device()))
  wanted = {name: run for name, run in pieces(args.tiny).items() if name.startswith(args.only)}
  if not wanted:
    parser.error(f"no piece begins with {args.only!r}; they are {', '.join(pieces(args.tiny))}")
  raise SystemExit(0 if measure(args.out, wanted, args.seconds) else 75)


if __name__ == "__main__":
  main()
