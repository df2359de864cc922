"""Functions as ONNX graphs of fixed shapes, which programs in other languages run: Unity, Unreal, C++, a browser.

A `Graph` names the tensors of a function. `write` traces it with JAX, converts it by jax2onnx and stores its weights in
float32, float16 or int8; arithmetic is float32 in all three, so that every runtime gives the same numbers. A JSON file
beside the graphs states their tensors.
"""
import contextlib
import json
import logging
import os
import pathlib
import tempfile
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError
from motion_jax.utils.install import pip_install

PRECISIONS = ("float32", "float16", "int8")
MANIFEST = "model.json"
_LARGE = 2048    # numbers of a tensor that is worth storing in fewer bits
_OPSET = 18
_PRODUCTS = ("MatMul", "Gemm", "Einsum", "Conv")


class Graph(NamedTuple):
  """A function of named tensors, to be run step after step.

  fn: takes the inputs in their order, returns a tuple. inputs: an example of each, or what its state begins with.
  state: {input: the output that is this input of the next step}. about: a sentence for each tensor.
  """
  name: str
  fn: Callable[..., tuple]
  inputs: Mapping[str, np.ndarray]
  outputs: Sequence[str]
  state: Mapping[str, str]
  about: Mapping[str, str]


def write(graphs: Sequence[Graph], about: Mapping[str, Any], folder: str | os.PathLike, precision: str = "float16"
          ) -> list[pathlib.Path]:
  """Writes NAME.onnx for each graph and model.json, which states their tensors and `about`; returns the paths."""
  if precision not in PRECISIONS:
    raise InputError(f"got precision {precision!r}, expected one of {', '.join(PRECISIONS)}")
  require()
  folder, written, described = pathlib.Path(folder), [], {}
  models = {graph.name: stored(convert(graph), precision) for graph in graphs}
  folder.mkdir(parents=True, exist_ok=True)
  for graph in graphs:
    path = folder / f"{graph.name}.onnx"
    with atomic_path(path) as temporary:
      temporary.write_bytes(models[graph.name].SerializeToString())
    written.append(path)
    described[graph.name] = {"file": path.name, "bytes": path.stat().st_size} | describe(graph)
  document = {"format": "motion_jax.onnx", "version": 1, "precision": precision, **about, "graphs": described}
  with atomic_path(folder / MANIFEST) as temporary:
    temporary.write_text(json.dumps(document, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
  return [*written, folder / MANIFEST]


def require() -> None:
  """Raises InputError where the extra `onnx` is not installed."""
  try:
    import jax2onnx  # noqa: F401
    import onnx  # noqa: F401
    import onnxruntime  # noqa: F401
  except ImportError as error:
    raise InputError(f"ONNX graphs need jax2onnx and onnxruntime: {pip_install('onnx')}") from error


def convert(graph: Graph) -> Any:
  """The ONNX model of a graph, weights in float32."""
  import jax2onnx
  logging.getLogger("onnx_ir").setLevel(logging.ERROR)  # it reports each tensor inside whose type it leaves out
  inputs = [jax.ShapeDtypeStruct(np.shape(a), np.asarray(a).dtype) for a in graph.inputs.values()]
  # Loops over layers and iterations are unrolled: runtimes plan a flat graph better than loops inside of one. It is
  # traced before the converter looks at it, which replaces functions of JAX and Flax by its own.
  with jax.disable_jit():
    traced = jax.make_jaxpr(graph.fn)(*inputs)
  model = jax2onnx.to_onnx(lambda *tensors: tuple(_run(traced.jaxpr, traced.consts, tensors)), inputs,
                           model_name=graph.name, opset=_OPSET, input_names=list(graph.inputs),
                           output_names=list(graph.outputs))
  names = [value.name for value in model.graph.input]
  if names != list(graph.inputs):
    raise ValueError(f"the graph {graph.name!r} has the inputs {names}, expected {list(graph.inputs)}")
  return simplified(model)


def simplified(model: Any) -> Any:
  """The model with its constants folded and without operators that change nothing: half as many nodes.

  onnxruntime does this, by those of its rules that leave operators of the ONNX standard alone, which any runtime knows.
  Done here it costs once, not at each start of a program.
  """
  import onnx
  import onnxruntime
  with tempfile.TemporaryDirectory() as folder:
    options, path = onnxruntime.SessionOptions(), pathlib.Path(folder, "simple.onnx")
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    options.optimized_model_filepath = str(path)
    options.log_severity_level = 3  # it warns of each name that is in the graph no more
    onnxruntime.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
    result = onnx.load(path)
  standard = [opset for opset in result.opset_import if opset.domain == ""]
  del result.opset_import[:]
  result.opset_import.extend(standard)  # onnxruntime lists all that it knows
  return result


def _run(jaxpr, consts, inputs):
  """`jax.core.eval_jaxpr` that runs what is inside of custom gradients and jitted functions, not those themselves.

  What depends on constants alone is computed here, so that weights of layers that lie in one array get their own."""
  known = dict(zip([*jaxpr.constvars, *jaxpr.invars], [*consts, *inputs], strict=True))
  read = lambda var: var.val if hasattr(var, "val") else known[var]
  for equation in jaxpr.eqns:
    inner = next((equation.params[name] for name in ("call_jaxpr", "jaxpr") if name in equation.params), None)
    values, primitive = list(map(read, equation.invars)), equation.primitive
    if inner is not None:
      results = _run(getattr(inner, "jaxpr", inner), getattr(inner, "consts", ()), values)
    else:
      fixed = not any(isinstance(value, jax.core.Tracer) for value in values) and primitive.name != "broadcast_in_dim"
      with jax.ensure_compile_time_eval() if fixed else contextlib.nullcontext():
        results = _bind(primitive, values, equation.params)
      results = results if primitive.multiple_results else [results]
    known |= zip(equation.outvars, results, strict=True)
  return list(map(read, jaxpr.outvars))


def _bind(primitive, values, params):
  """A primitive's result; a product of rows and a matrix as one of two matrices, the fastest product of runtimes."""
  if primitive.name == "dot_general" and values[1].ndim == 2 < values[0].ndim + 1:
    x, kernel = values
    if params["dimension_numbers"] == (((x.ndim - 1,), (0,)), ((), ())):
      return jnp.matmul(x.reshape(-1, x.shape[-1]), kernel).reshape(*x.shape[:-1], kernel.shape[-1])
  return primitive.bind(*values, **params)


def describe(graph: Graph) -> dict:
  """Names, types and shapes of a graph's tensors, and what its state begins with."""
  shapes = jax.eval_shape(graph.fn, *graph.inputs.values())
  tensors = lambda names, arrays: [
      {"name": name, "type": str(array.dtype), "shape": list(array.shape), "about": graph.about.get(name, "")}
      for name, array in zip(names, arrays, strict=True)]
  state = {name: {"next": graph.state[name], "start": _start(np.asarray(graph.inputs[name]))} for name in graph.state}
  return {"inputs": tensors(graph.inputs, map(np.asarray, graph.inputs.values())),
          "outputs": tensors(graph.outputs, shapes), "state": state}


def _start(array: np.ndarray) -> Any:
  return array.tolist() if array.any() else 0


def stored(model: Any, precision: str) -> Any:
  """The model with its large weights in fewer bits, each followed by a cast to float32, which runtimes do once when
  they load it.

  float16: matrices are rounded, those that were float16 in their run's file lose nothing. int8: whole numbers from -127
  to 127 times a scale for each channel of the last axis. Other tensors lose nothing in either: they are float16 where
  that holds them exactly. A tensor of one value becomes that value in all three.
  """
  import onnx
  from onnx import TensorProto, helper, numpy_helper
  factors = {name for node in model.graph.node if node.op_type in _PRODUCTS for name in node.input[1:2]}
  factors |= {node.input[0] for node in model.graph.node if node.op_type == "Transpose" and node.output[0] in factors}
  kept, nodes = [], []

  def keep(array, name):
    kept.append(numpy_helper.from_array(array, name))

  def cast(array, name, result):
    keep(array, name)
    nodes.append(helper.make_node("Cast", [name], [result], to=TensorProto.FLOAT))

  for tensor in model.graph.initializer:
    name, array = tensor.name, numpy_helper.to_array(tensor)
    if tensor.data_type != TensorProto.FLOAT or array.size < _LARGE:
      kept.append(tensor)
    elif (array == array.flat[0]).all():
      keep(np.array(array.shape, np.int64), f"{name}_shape")
      nodes.append(helper.make_node("ConstantOfShape", [f"{name}_shape"], [name],
                                    value=numpy_helper.from_array(array.flatten()[:1])))
    elif precision == "int8" and name in factors:
      scale = np.maximum(np.abs(array).max(axis=tuple(range(array.ndim - 1)), keepdims=True), 1e-12) / 127
      cast(np.round(array / scale).astype(np.int8), f"{name}_int8", f"{name}_whole")
      keep(scale.astype(np.float32), f"{name}_scale")
      nodes.append(helper.make_node("Mul", [f"{name}_whole", f"{name}_scale"], [name]))
    elif precision != "float32" and (name in factors or _is_float16(array)):
      cast(array.astype(np.float16), f"{name}_float16", name)
    else:
      kept.append(tensor)
  result = onnx.ModelProto()
  result.CopyFrom(model)
  del result.graph.initializer[:], result.graph.node[:]
  result.graph.initializer.extend(kept)
  result.graph.node.extend([*nodes, *model.graph.node])
  return result


def _is_float16(array):
  with np.errstate(over="ignore"):
    return (array == array.astype(np.float16)).all()
