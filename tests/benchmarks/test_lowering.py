"""Programs for machines that we do not have: each sampler and training step is lowered for CUDA and TPU, and its work
counted. Nothing is compiled or run, and no parameter takes memory."""
import pathlib
import re
import sys

import jax
import jax.numpy as jnp
import pytest
from jax import export

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "benchmarks"))

import counting  # noqa: E402
import programs  # noqa: E402
import results  # noqa: E402
import roofline  # noqa: E402

from tests.conftest import some_of  # noqa: E402

ALL = {name: build for name, build in {
    **programs.all_programs(types=("bfloat16",), train_batches=(1, 256), attention="cudnn"),
    **programs.all_programs(types=("float32",), sizes=("S",), batches=(1,), train_batches=(1,))}.items()
       # Of float32 and of block after block one size is enough: other programs differ from them in numbers alone.
       if name.startswith(("fss/S/", "train/cdamd_generator/")) or "float32" not in name and (
           not name.startswith("ar/") or name.startswith("ar/S/"))}
QUICK = ("stream/M/bfloat16", "train/denoiser-S/bfloat16/batch1", "train/cdamd_autoencoder/bfloat16",
         "decode/cmdm/batch1", "decode/cdamd/batch256")
CUDNN = [export.DisabledSafetyCheck.custom_call(f"__cudnn$fmha{name}") for name in (
    "ScaleBiasSoftmax", "ScaleBiasSoftmaxBackward")]


LARGE = re.compile(r"/(?:denoiser-)?(?:M|L|XL)/")  # the same programs as of size S, with other numbers


@pytest.mark.parametrize("name", some_of(ALL, QUICK, [name for name in ALL if not LARGE.search(name)]))
def test_every_program_is_lowered_for_cuda_and_tpu(name, traced_cudnn):
  program = ALL[name]()
  texts = {platform: export.export(program.function, platforms=[platform], disabled_checks=CUDNN)(
      *program.shapes()).mlir_module() for platform in ("cuda", "tpu")}
  kind, what, *rest = name.split("/")
  # Heads of size S are too wide for the kernel, and attention with dropout is plain.
  fused = "bfloat16" in rest and (kind in ("fss", "ar", "stream", "cdamd") or "denoiser" in what) and "S" not in (
      what, what[-1])
  assert ("__cudnn$fmha" in texts["cuda"]) == fused and "__cudnn" not in texts["tpu"]
  for text in texts.values():
    assert ("bf16" in text) == ("bfloat16" in rest)
    # A training step takes means over the devices, and a codebook sees the latents of all; samplers exchange nothing.
    assert set(counting.collectives(text)) == ({"all_reduce"} if kind == "train" else set()) | (
        {"all_gather"} if what == "cdamd_rvq" else set())


def test_all_sizes_and_batches_are_there():
  sizes = {name.split("/")[1] for name in ALL if name.startswith("fss/")}
  assert sizes == {"S", "M", "L", "XL"} == {name.split("/")[1].removeprefix("denoiser-") for name in ALL
                                            if name.startswith("train/denoiser")}
  for prefix in ("fss/XL/bfloat16/", "train/denoiser-XL/bfloat16/", "cdamd/full/bfloat16/"):
    assert {prefix + "batch1", prefix + "batch256"} <= set(ALL)


def test_products_are_counted_as_often_as_they_run():
  shape = lambda *size: jax.ShapeDtypeStruct(size, jnp.bfloat16)

  def function(a, b, kernel):
    c, _ = jax.lax.scan(lambda x, _: (jax.nn.relu(x @ b), None), a, length=5)
    d = jax.lax.cond(c.sum() > 0, lambda x: x @ b @ b, lambda x: x, c)
    return d, jax.lax.conv_general_dilated(a[None], kernel, (1,), "SAME", dimension_numbers=("NWC", "WIO", "NWC"))

  found = counting.work(function, shape(4, 8), shape(8, 8), shape(3, 8, 2))
  product, conv = 2 * 4 * 8 * 8, 2 * 4 * 2 * 3 * 8
  assert found.count == 8 and found.flops == 7 * product + conv
  assert found.bytes == 2 * (7 * (4 * 8 + 8 * 8 + 4 * 8) + 4 * 8 + 3 * 8 * 2 + 4 * 2)
  assert {one.dtype for one in found.products} == {"bfloat16"}
  until = lambda a, b: jax.lax.while_loop(lambda x: x.sum() > 0, lambda x: x @ b, a)
  with pytest.raises(ValueError, match="while loop"):
    counting.work(until, shape(4, 8), shape(8, 8))
  assert counting.work(until, shape(4, 8), shape(8, 8), loops=3).flops == 3 * product


def test_a_state_is_read_and_written_once():
  shape = jax.ShapeDtypeStruct((10,), jnp.float32)
  assert counting.work(lambda a: a + 1, shape, carried=True).state_bytes == 80
  assert counting.work(lambda a: a + 1, shape).bytes == 0


def test_work_grows_with_the_batch_and_not_with_the_type():
  work = lambda name: counting.work(ALL[name]().function, *ALL[name]().shapes())
  one, many = (work(f"decode/cmdm/batch{batch}") for batch in (1, 256))
  assert many.flops == pytest.approx(256 * one.flops, rel=0.01) and many.count == one.count


def test_the_roofline_takes_what_binds_each_product():
  device = roofline.Device("D", 100.0, 10.0, 5.0, 0.5, "source")
  bound = counting.Product(flops=1000.0, bytes=5.0, dtype="bfloat16")  # 10 s of work, 1 s of memory
  slow = counting.Product(flops=10.0, bytes=20.0, dtype="float32")     # 1 s of work, 4 s of memory
  assert roofline.limit(counting.Work({bound: 2, slow: 3}, state_bytes=5.0), device) == 2 * 10 + 3 * 4 + 1


def test_computed_figures_are_marked_and_none_is_claimed_as_measured():
  names = [device.name for device in roofline.DEVICES]
  row = dict(flops=1e9, bytes=1e9, products=10, batch=1, frames=12, steps=25, seconds=dict.fromkeys(names, 1e-3))
  rows = [dict(row, piece="stream/M/bfloat16"), dict(row, piece="train/a/float32", frames=0)]
  text = roofline.tables(rows)
  assert all(f"{name}, *computed*" in text for name in names) and text.count("| not measured |") == 3
  assert all(f"| stream/M/bfloat16 | 1 | 1 | 10 | {cell} |" in text for cell in ("1 / 1.03", "25 / 25.8"))


def test_what_was_measured_stands_beside_it(tmp_path):
  names = [device.name for device in roofline.DEVICES]
  row = dict(flops=1e9, bytes=1e9, products=10, batch=1, frames=12, steps=25, seconds=dict.fromkeys(names, 1e-3))
  rows = [dict(row, piece="stream/M/bfloat16"), dict(row, piece="train/a/float32", frames=0)]
  about = dict(device="NVIDIA H100 80GB HBM3")
  results.write(tmp_path / "a.json", dict(piece="stream/M/bfloat16", next_seconds=2.5e-3, first_seconds=0.05, **about))
  results.write(tmp_path / "b.json", dict(piece="train/a/float32", seconds=0.01, samples_per_second=6400.0, **about))
  text = roofline.tables(rows, roofline.measurements([tmp_path]))
  assert all(f"| H100 SXM {cell} |" in text for cell in ("2.5", "50", "10, 6,400/s")) and "not measured" not in text
