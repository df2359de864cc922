"""Programs for machines that we do not have: each sampler and training step is lowered for CUDA and TPU, and its work
counted. Nothing is compiled or run, and no parameter takes memory."""
import pathlib
import sys

import jax
import jax.numpy as jnp
import pytest
from jax import export

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "benchmarks"))

import counting  # noqa: E402
import meshes  # noqa: E402
import programs  # noqa: E402
import roofline  # noqa: E402

from motion_jax.nets.partitioning import LAYOUTS  # noqa: E402
from motion_jax.training.mesh import Mesh  # noqa: E402
from tests.conftest import some_of  # noqa: E402

ALL = {name: build for name, build in {
    **programs.all_programs(types=("bfloat16",), train_batches=(1, 256), attention="cudnn"),
    **programs.all_programs(types=("float32",), sizes=("S",), batches=(1,), train_batches=(1,))}.items()
       # Of float32 and of block after block one size is enough: other programs differ from them in numbers alone.
       if name.startswith(("fss/S/", "train/cdamd_generator/")) or "float32" not in name and (
           not name.startswith("ar/") or name.startswith("ar/S/"))}
QUICK = ("decode/cmdm/batch1",)
SLOW = ("stream/M/bfloat16", "train/cdamd_rvq/bfloat16")
CUDNN = [export.DisabledSafetyCheck.custom_call(f"__cudnn$fmha{name}") for name in (
    "ScaleBiasSoftmax", "ScaleBiasSoftmaxBackward")]


@pytest.mark.parametrize("name", some_of(ALL, QUICK, SLOW))
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


def test_the_roofline_takes_what_binds_each_product():
  device = roofline.Device("D", 100.0, 10.0, 5.0, 0.5, "source")
  bound = counting.Product(flops=1000.0, bytes=5.0, dtype="bfloat16")  # 10 s of work, 1 s of memory
  slow = counting.Product(flops=10.0, bytes=20.0, dtype="float32")     # 1 s of work, 4 s of memory
  assert roofline.limit(counting.Work({bound: 2, slow: 3}, state_bytes=5.0), device) == 2 * 10 + 3 * 4 + 1


@pytest.mark.exhaustive
def test_the_memory_of_a_large_denoiser_is_split():
  """The table of docs/pods.md#memory."""
  trained = meshes.training("denoiser", "3B")
  shapes, placed = Mesh(64, 4, LAYOUTS["fully_sharded"], 256).shapes(trained.init, *trained.args())
  whole = sum(leaf.size * 4 for leaf in jax.tree.leaves(shapes.params))
  assert 2.9e9 < whole / 4 < 3.2e9
  assert whole / 256 <= meshes.on_one_device(shapes.params, placed.params) < 1.2 * whole / 256
  assert meshes.on_one_device(shapes, placed) < 1.2 * 4 * whole / 256  # two moments and an average


@pytest.mark.slow
def test_a_step_is_lowered_for_devices_that_are_not_there():
  where = Mesh(64, 4, LAYOUTS["fully_sharded"], 256)
  text = meshes.lowered(meshes.training("denoiser", "XL", tiny=True), where).as_text()
  assert 'sdy.mesh @mesh = <["data"=64, "model"=4]>' in text and '{"data"}' in text and '{"model"}' in text
