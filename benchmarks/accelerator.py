"""What an accelerator does for this project, piece by piece: sampling, streaming, decoding, training, matmuls, and the
shipped models: their speed, and whether a motion is the same in a batch, in a stream and on the CPU (agreement.py).

  python benchmarks/accelerator.py OUT                 all pieces that OUT lacks, the most wanted first
  python benchmarks/accelerator.py OUT --seconds 500   begins no piece after this time; the same command continues
  python benchmarks/accelerator.py OUT --only train/   pieces whose names begin so
  python benchmarks/accelerator.py OUT --compile 0/8   compiles every eighth of them, from the first on, into JAX's
                                                       compilation cache, and measures nothing
  python benchmarks/accelerator.py OUT --tiny          tiny networks, for a test on a CPU
  python benchmarks/accelerator.py OUT --table PAGE    writes a page of the rows that are there

OUT holds one JSON file a piece, each with the device's name, so a run that is cut short loses at most one piece. A
piece that fails, for want of memory say, leaves its error in its file and is not tried again unless the file is
removed; so does one that ended the whole program. benchmarks/gpu.sh runs this, benchmarks/programs.py has the
programs.

Times are medians over several calls after one that compiles. FLOPs are counted by benchmarks/counting.py; MFU
is that over the time and over the largest rate that a matrix product reached here in the same type.
"""
import argparse
import functools
import json
import pathlib
import platform
import statistics
import time

import agreement  # like those below a file beside this one
import counting
import jax
import jax.numpy as jnp
import programs
import results
import sampling
import shipped_speed

from motion_jax import loading
from motion_jax.models import cmdm
from motion_jax.models.cmdm import streaming
from motion_jax.utils.atomic import atomic_path

SIDES = (2048, 4096, 8192)
AGREEMENT = {f"{name.replace('_', ' ')}, mm": name for name in (
    "again", "in_a_batch", "streamed", "exact_in_a_batch", "default_and_exact", "default_and_cpu", "exact_and_cpu")}
SHIPPED = ("cmdm-small", "cmdm-small-fast", "cdamd-small")


def pieces(tiny) -> dict:
  """{name: function() -> dict of numbers}, the most wanted first."""
  types = ("float32",) if tiny else programs.TYPES
  wanted = {f"matmul/{dtype}": functools.partial(matmul, dtype, (64,) if tiny else SIDES) for dtype in types}
  for name in SHIPPED[1:2] if tiny else SHIPPED:
    wanted[f"agreement/{name}"] = functools.partial(agreement.millimetres, name, frames=24 if tiny else 120)
    wanted[f"shipped/{name}"] = functools.partial(shipped, name, 1 if tiny else 7)
  for name, build in programs.all_programs(tiny).items():
    kind, what, dtype = (name.split("/") + [""])[:3]
    wanted[name] = functools.partial(stream, what, dtype, tiny) if kind == "stream" else functools.partial(run, build)
  return wanted


# --- pieces ---------------------------------------------------------------------------------------------------------


def matmul(dtype, sides):
  """The largest rate of a square product: the peak that MFU refers to."""
  rates = {}
  for side in sides:
    a, b = (jax.random.normal(jax.random.key(i), (side, side), dtype) for i in range(2))
    run = jax.jit(lambda a, b: a @ b)
    rates[str(side)] = 2 * side ** 3 / timed(run, a, b)["seconds"] / 1e12
  return dict(tflops=max(rates.values()), by_side=rates)


def run(build):
  """A program on arguments of its shapes, with frames or samples a second."""
  program = build()
  work = counting.work(program.function, *program.shapes(), carried=program.carried, loops=program.loops)
  cost = timed(program.function, *jax.jit(program.arguments)(), carried=program.carried)
  rate = dict(fps=program.batch * program.frames / cost["seconds"], frames=program.frames) if program.frames else dict(
      samples_per_second=program.batch / cost["seconds"])
  return cost | rate | dict(batch=program.batch, flops=work.flops)


def stream(size, dtype, tiny):
  """Seconds to a stream's first block of 3 latents, and between later ones."""
  dit = programs.denoiser(size, dtype, tiny, "xla")
  params, (text_emb, text_mask), keys = jax.jit(lambda: (
      programs.filled(cmdm.denoiser_shapes(dit)), programs.words(dit.text_dim, 1), programs.keys_of(1)))()
  plan = streaming.make_plan(4 if tiny else programs.STEPS, programs.LAG, dit.block, programs.CONTEXT)
  first, further = sampling.stream_times(dit, plan, params, text_emb, text_mask, keys, jnp.float32(programs.GUIDANCE),
                                         12)
  return dict(first_seconds=first, next_seconds=further, next_latent_seconds=further / dit.block,
              fps=4 * dit.block / further)


def shipped(name, rounds):
  """Medians of a shipped model by the library's calls, as benchmarks/shipped_speed.py has them."""
  model = loading.load(name)
  rounds_ = [shipped_speed.one_round(model, {}, seed) for seed in range(rounds + 1)][1:]
  first, following, whole, cleaned = map(statistics.median, zip(*rounds_))
  return dict(first_seconds=first / 1000, next_seconds=following / 1000, seconds=whole / 1000,
              cleaned_seconds=cleaned / 1000, fps=1000 * shipped_speed.FRAMES / whole)


def compile_only(wanted, share):
  """Fills JAX's compilation cache with the programs of every N-th piece from the I-th on, share being (I, N)."""
  first, step = share
  for name in list(wanted)[first::step]:
    began, error = time.perf_counter(), ""
    try:
      piece = wanted[name]
      if piece.func is run:
        program = piece.args[0]()
        program.function.lower(*program.shapes()).compile()
        jax.jit(program.arguments).lower().compile()
      else:
        piece()
    except Exception as failure:  # said again where the piece is measured
      error = f", {type(failure).__name__}"
    print(f"compiled {name} in {time.perf_counter() - began:.1f} s{error}", flush=True)
    jax.clear_caches()


def timed(function, *args, carried=False, repeats=7):
  """Seconds of a call and of compiling, working memory in MB; carried: the first result takes the place of the first
  argument, which is donated."""
  lowered = function.lower(*args)
  start = time.perf_counter()
  compiled = lowered.compile()
  compiling, times, rest = time.perf_counter() - start, [], list(args)
  for _ in range(1 + repeats):
    start = time.perf_counter()
    result = jax.block_until_ready(compiled(*rest))
    times.append(time.perf_counter() - start)
    if carried:
      rest[0] = result[0]
  memory = compiled.memory_analysis()
  return dict(seconds=statistics.median(times[1:]), compile_seconds=compiling,
              working_mb=memory.temp_size_in_bytes / 1e6 if memory else None,
              arguments_mb=memory.argument_size_in_bytes / 1e6 if memory else None)


# --- the run and its table --------------------------------------------------------------------------------------------


def device():
  first = jax.devices()[0]
  return dict(device=first.device_kind, platform=first.platform, jax=jax.__version__, python=platform.python_version())


def table(out, page):
  """Writes a page with a table of each kind of piece, a row a piece."""
  rows = results.read(out)
  if not rows:
    raise SystemExit(f"{out} holds no piece yet: run without --table first")
  peaks = {row["piece"].split("/")[1]: row["tflops"] for row in rows if row["piece"].startswith("matmul/") and
           "tflops" in row}
  lines = [f"# {', '.join(sorted({row['device'] for row in rows}))}", "",
           "Written by `benchmarks/gpu.sh` (benchmarks/accelerator.py says what each number is). jax "
           + ", ".join(sorted({row["jax"] for row in rows})) + ". Random weights of the papers' sizes; a clip is "
           f"{programs.SECONDS} s. Largest measured matrix product in JAX's default precision, TFLOP/s: "
           + (", ".join(f"{dtype} {rate:.3g}" for dtype, rate in peaks.items()) or "not measured") + "."]
  for kind in dict.fromkeys(row["piece"].partition("/")[0] for row in rows):
    if kind == "matmul":
      continue
    of_kind = [row for row in rows if row["piece"].startswith(f"{kind}/")]
    columns = ["ms", "frames/s", "samples/s", "MFU %", "cleaned ms", "first ms", "next block ms", "next latent ms",
               *AGREEMENT, "memory MB", "compile s"]
    cells = [numbers_of(row, peaks) for row in of_kind]
    columns = [name for name in columns if any(name in cell for cell in cells)]
    lines += ["", f"## {kind}", "", "| piece | " + " | ".join(columns) + " |", "|" + " --- |" * (len(columns) + 1)]
    for row, cell in zip(of_kind, cells):
      values = [row["error"]] if "error" in row else [f"{cell[name]:.4g}" if name in cell else "" for name in columns]
      lines.append(f"| {row['piece'].partition('/')[2]} | " + " | ".join(values) + " |")
  page.parent.mkdir(parents=True, exist_ok=True)
  with atomic_path(page) as whole:
    whole.write_text("\n".join(lines) + "\n")


def numbers_of(row, peaks):
  """{column: number} of a piece."""
  names = {"ms": ("seconds", 1000), "frames/s": ("fps", 1), "samples/s": ("samples_per_second", 1),
           "first ms": ("first_seconds", 1000), "next block ms": ("next_seconds", 1000),
           "next latent ms": ("next_latent_seconds", 1000), "cleaned ms": ("cleaned_seconds", 1000),
           "compile s": ("compile_seconds", 1)} | {column: (key, 1) for column, key in AGREEMENT.items()}
  numbers = {column: row[key] * scale for column, (key, scale) in names.items() if row.get(key) is not None}
  if row.get("working_mb") is not None:
    numbers["memory MB"] = row["working_mb"] + row["arguments_mb"]
  peak = next((rate for dtype, rate in peaks.items() if f"/{dtype}" in row["piece"]), None)
  if row["piece"].startswith("train/") and row.get("flops") and peak:
    numbers["MFU %"] = 100 * row["flops"] / row["seconds"] / (peak * 1e12)
  return numbers


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("out", type=pathlib.Path)
  parser.add_argument("--seconds", type=float, default=1e9)
  parser.add_argument("--only", nargs="+", default=[""])
  parser.add_argument("--compile", metavar="I/N", type=lambda text: tuple(map(int, text.split("/"))))
  parser.add_argument("--tiny", action="store_true")
  parser.add_argument("--table", type=pathlib.Path, metavar="PAGE", help="measure nothing, write this page of the rows")
  args = parser.parse_args()
  if args.table:
    return table(args.out, args.table)
  args.out.parent.mkdir(parents=True, exist_ok=True)
  print(json.dumps(device()))
  wanted = {name: run for name, run in pieces(args.tiny).items() if name.startswith(tuple(args.only))}
  if not wanted:
    parser.error(f"no piece begins with {args.only!r}; they are {', '.join(pieces(args.tiny))}")
  if args.compile:
    done = results.pieces_of(args.out)
    missing = {name: piece for name, piece in wanted.items() if name not in done}
    return compile_only(missing, args.compile)
  done = results.measure(args.out, wanted, args.seconds, device(), jax.clear_caches)
  raise SystemExit(0 if done else 75)


if __name__ == "__main__":
  main()
