"""What accelerators should reach: the roofline of each program, computed, next to what was measured.

  python benchmarks/roofline.py OUT              counts the work of all programs, a row each in OUT.jsonl (minutes)
  python benchmarks/roofline.py OUT --only fss/M
  python benchmarks/roofline.py OUT --table [MEASURED ...]    prints the tables from the rows, and from the files of
                                                 devices that benchmarks/gpu.sh wrote

Work is counted by benchmarks/counting.py from the jaxprs of benchmarks/programs.py, which tests lower for CUDA and TPU.
The time of a matrix product is the larger of its operations over the device's peak and its bytes over the memory's
bandwidth. A program's time is the sum over its products; a training step also reads and writes parameters, moments and
average once. This is a lower limit: norms, softmax and activations are assumed to be fused into the products and free,
operands to be read once in the type of the computation, and no time to pass between two products. In the training step
of a generator all latents of the batch are masked. Training steps sum over the devices (all-reduce; the codebooks of an
RVQ also gather latents), which costs nothing on one device; samplers exchange nothing. "With launches" adds the time of
a kernel launch for each product, which limits programs of thousands of small products in sequence; on a TPU, where all
products are one program, nothing is added.
"""
import argparse
import pathlib
from typing import NamedTuple

import counting  # benchmarks/counting.py, programs.py and results.py, beside this file
import programs
import results

LAUNCH = 3e-6  # seconds from one small kernel of a GPU to the next, an assumption: 2 to 5 us are usual


class Device(NamedTuple):
  """Peaks by the vendor, without sparsity: products of 16 bits and of float32 in FLOP/s, memory in bytes a second.

  By JAX's default precision float32 is multiplied as TF32 on these GPUs and as bfloat16 on a TPU. launch: seconds
  between two products; source: where the peaks are printed.
  """
  name: str
  half: float
  single: float
  bandwidth: float
  launch: float
  source: str


DEVICES = (
    Device("H100 SXM", 989.4e12, 494.7e12, 3.35e12, LAUNCH, "https://www.nvidia.com/en-us/data-center/h100"),
    Device("H200 SXM", 989.4e12, 494.7e12, 4.8e12, LAUNCH, "https://www.nvidia.com/en-us/data-center/h200"),
    Device("A100 SXM 80 GB", 312e12, 156e12, 2.039e12, LAUNCH, "https://www.nvidia.com/en-us/data-center/a100"),
    Device("TPU v5e", 197e12, 197e12, 0.819e12, 0.0, "https://cloud.google.com/tpu/docs/v5e"),
)
NOT_MEASURED = "not measured"


def row_of(build) -> dict:
  """The counted work of a program and the time that it needs on each device at least."""
  program = build()
  work = counting.work(program.function, *program.shapes(), carried=program.carried, loops=program.loops)
  half = sum(product.flops * count for product, count in work.products.items() if "16" in product.dtype)
  seconds = {device.name: limit(work, device) for device in DEVICES}
  return dict(flops=work.flops, half_flops=half, bytes=work.bytes, state_bytes=work.state_bytes, products=work.count,
              batch=program.batch, frames=program.frames, steps=program.steps, seconds=seconds)


def limit(work: counting.Work, device: Device) -> float:
  """Seconds that a device needs for a program's products at least."""
  total = work.state_bytes / device.bandwidth
  for product, count in work.products.items():
    peak = device.half if "16" in product.dtype else device.single
    total += count * max(product.flops / peak, product.bytes / device.bandwidth)
  return total


def bare(row, device: Device) -> float:
  return row["seconds"][device.name]


def launched(row, device: Device) -> float:
  return bare(row, device) + row["products"] * device.launch


def measurements(files) -> dict:
  """{(piece, device's name): row} of benchmarks/gpu.sh; a device is known by the first word of its name."""
  measured = [row for file in files for row in results.read(file) if "error" not in row]
  return {(row["piece"], device.name): row for row in measured for device in DEVICES
          if device.name.split()[0] in row["device"].split()}


def tables(rows, measured=None) -> str:
  """All tables as Markdown. measured: see `measurements`."""
  measured, names = measured or {}, [device.name for device in DEVICES]
  of_kind = lambda *kinds: [row for row in rows if row["piece"].split("/")[0] in kinds and "error" not in row]
  parts = [results.markdown(
      ["device", "bfloat16, TFLOP/s", "float32 products, TFLOP/s", "memory, TB/s", "source"],
      [[device.name, *(f"{peak / 1e12:g}" for peak in (device.half, device.single, device.bandwidth)), device.source]
       for device in DEVICES])]

  def add(title, chosen, cell, head, shown):
    columns = [head, "GFLOP", "GB", "products", *(f"{name}, *computed*" for name in names), "measured"]
    lines = []
    for row in chosen:
      seen = [f"{name} {shown(measured[row['piece'], name])}" for name in names if (row["piece"], name) in measured]
      lines.append([row["piece"], row["flops"] / 1e9, row["bytes"] / 1e9, row["products"],
                    *(cell(row, device) for device in DEVICES), ", ".join(seen) or NOT_MEASURED])
    if lines:
      parts.append(f"**{title}**\n\n" + results.markdown(columns, lines))

  ms = lambda key: lambda row: f"{1000 * row[key]:.3g}"
  both = lambda seconds, slower: f"{1000 * seconds:.3g} / {1000 * slower:.3g}"
  add("Latency of a stream: milliseconds a block of 12 frames, limit / with launches",
      of_kind("stream"), lambda row, device: both(bare(row, device), launched(row, device)), "program",
      ms("next_seconds"))
  add("Latency of a stream: milliseconds to the first block, if all of its steps cost what later ones do",
      of_kind("stream"), lambda row, device: both(*(row["steps"] * time(row, device) for time in (bare, launched))),
      "program", ms("first_seconds"))
  add("Clips of 6 s, one at a time: milliseconds a clip, limit / with launches",
      [row for row in of_kind("fss", "ar", "cdamd", "decode") if row["batch"] == 1],
      lambda row, device: both(bare(row, device), launched(row, device)), "program", ms("seconds"))
  rate = lambda row, seconds: row["batch"] * (row["frames"] or 1) / seconds
  add("Clips of 6 s in batches of 256: frames a second at most",
      [row for row in of_kind("fss", "ar", "cdamd", "decode") if row["batch"] > 1],
      lambda row, device: f"{rate(row, launched(row, device)):,.0f}", "program", lambda row: f"{row['fps']:,.0f}")
  add("A training step: milliseconds at least, and samples a second",
      of_kind("train"), lambda row, device: f"{1000 * bare(row, device):.3g}, "
      f"{rate(row, bare(row, device)):,.0f}/s", "program",
      lambda row: f"{ms('seconds')(row)}, {row['samples_per_second']:,.0f}/s")
  return "\n\n".join(parts)


def main():
  parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
  parser.add_argument("out", type=pathlib.Path)
  parser.add_argument("--seconds", type=float, default=1e9)
  parser.add_argument("--only", default="")
  parser.add_argument("--table", nargs="*", type=pathlib.Path, metavar="MEASURED")
  args = parser.parse_args()
  if args.table is not None:
    print(tables(results.read(args.out), measurements(args.table)))
    return
  args.out.parent.mkdir(parents=True, exist_ok=True)
  chosen = programs.all_programs(types=("bfloat16",)) | programs.all_programs(
      types=("float32",), sizes=("M",), batches=(1,), train_batches=(64,))
  wanted = {name: lambda build=build: row_of(build) for name, build in chosen.items() if name.startswith(args.only)}
  done = results.measure(args.out, wanted, args.seconds, dict(computed=True))
  raise SystemExit(0 if done else 75)


if __name__ == "__main__":
  main()
