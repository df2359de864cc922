"""The exported graphs are the model: each alone, and a whole motion by numpy and onnxruntime (examples/)."""
import json
import subprocess
import sys

import jax
import numpy as np
import onnxruntime
import pytest

import motion_jax as mj
from motion_jax.export import graphs as export_graphs
from motion_jax.models.cmdm import streaming
from motion_jax.models.cmdm.graphs import graphs_of
from motion_jax.models.cmdm.loop import SamplingLoop
from motion_jax.models.keys import random_keys
from motion_jax.utils.errors import InputError
from tests.conftest import ROOT

pytestmark = pytest.mark.slow
PROMPT = "a person walks forward, then waves"
TOLERANCE = 1e-4


@pytest.fixture(scope="module")
def model():
  return mj.load("cmdm-small-fast")


@pytest.fixture(scope="module")
def exported(model, tmp_path_factory):
  """(graphs, folder) of a model as the command writes it."""
  folder = tmp_path_factory.mktemp("graphs")
  graphs, about = graphs_of(model)
  export_graphs.write(graphs, about, folder)
  return graphs, folder


def _random(name, array, rng):
  """A value of an input as large as those of a run; masks show at least the first word piece."""
  if array.dtype == bool:
    return np.arange(array.shape[-1]) < rng.integers(1, array.shape[-1], (*array.shape[:-1], 1))
  if array.dtype == np.int32:
    return {"ids": rng.integers(4, 400, array.shape), "steps": np.array(rng.integers(20, 40)), "past": np.array(0),
            "length": np.array(rng.integers(60, 90)),
            "caption": rng.integers(0, 4, array.shape), "since": np.full(array.shape, 20)}[name].astype(np.int32)
  return rng.normal(size=array.shape).astype(np.float32)


@pytest.mark.parametrize("number, name", list(enumerate(["text", "step", "decoder", "joints"])))
def test_each_graph_is_its_function(exported, number, name):
  graphs, folder = exported
  graph, rng = graphs[number], np.random.default_rng(number)
  assert graph.name == name
  inputs = {key: _random(key, np.asarray(value), rng) for key, value in graph.inputs.items()}
  if name == "joints":
    inputs["heading"] /= np.linalg.norm(inputs["heading"])
  found = onnxruntime.InferenceSession(folder / f"{name}.onnx").run(list(graph.outputs), inputs)
  for output, ours, theirs in zip(graph.outputs, jax.jit(graph.fn)(*inputs.values()), found, strict=True):
    scale = max(1.0, float(np.abs(ours).max()))
    assert np.abs(np.asarray(ours) - theirs).max() < TOLERANCE * scale, output


def test_a_motion_without_jax_is_the_same(model, exported, tmp_path):
  """Noise, word pieces and loop of the example: less than a millimetre from `generate`."""
  out = tmp_path / "motion.npy"
  run = subprocess.run([sys.executable, ROOT / "examples" / "onnx_stream.py", exported[1], PROMPT, out],
                       capture_output=True, text=True)
  assert run.returncode == 0, run.stderr
  ours = model.generate([PROMPT], num_frames=120, seeds=[0], clauses=False)[0].joints
  assert np.linalg.norm(np.load(out) - ours, axis=-1).max() < 1e-3


def test_given_blocks_are_filled_in_as_a_loop_does(model, exported):
  """A change of prompt starts behind clean blocks: `SamplingLoop.prefill`, then a step."""
  plan, rng = model.plan_of()[0], np.random.default_rng(3)
  past = rng.normal(size=(1, 2 * plan.block, model.dit.latent_dim)).astype(np.float32)
  loop = SamplingLoop(model, plan, np.ones(1, np.float32), random_keys([5]))
  emb, mask = model.encode_words([PROMPT] * 4)
  loop.say(emb[None], mask[None])
  loop.prefill(past, caption=0)
  first = {graph.name: graph for graph in exported[0]}
  sessions = {name: onnxruntime.InferenceSession(exported[1] / f"{name}.onnx") for name in ("text", "step")}
  ids, words = model.encoder.tokenizer.encode(PROMPT).ids, model.encoder.max_words
  row, mask = np.zeros((1, words), np.int32), np.arange(words)[None] < len(ids)
  row[0, :len(ids)] = ids
  text = dict(zip(("text_k", "text_v"), sessions["text"].run(None, {"ids": row, "mask": mask})))
  feeds = dict(first["step"].inputs) | {name: np.stack([value] * 4) for name, value in text.items()}
  feeds |= {"text_mask": np.repeat(mask, 4, axis=0), "past": np.array(past.shape[1], np.int32)}
  keys = random_keys([5])
  for steps in range(-2, plan.age):
    noise = (past[:, (steps + 2) * plan.block:][:, :plan.block] if steps < 0 else
             np.asarray(streaming.block_noise(keys, steps, plan, model.dit.latent_dim)))
    made = dict(zip(first["step"].outputs, sessions["step"].run(None, feeds | {
        "noise": noise, "steps": np.array(steps, np.int32)})))
    feeds |= {name: made[after] for name, after in first["step"].state.items()}
    block = None if steps < 0 else loop.step(np.zeros((1, plan.width), int))
  assert np.abs(block - made["clean"]).max() < TOLERANCE


def test_graphs_are_of_standard_operators_with_constants_folded(exported):
  import onnx
  for name in ("text", "step", "decoder", "joints"):
    model = onnx.load(exported[1] / f"{name}.onnx")
    assert [one.domain for one in model.opset_import] == [""] and {one.domain for one in model.graph.node} == {""}, name
    assert not {"Shape", "Constant"} & {one.op_type for one in model.graph.node}, name


def test_word_pieces_are_those_of_the_tokenizer(model, exported):
  sys.path.insert(0, str(ROOT / "examples"))
  try:
    from onnx_words import word_pieces
  finally:
    sys.path.pop(0)
  table = json.loads((exported[1] / "model.json").read_text())["tokenizer"]
  for sentence in (PROMPT, "A person's CAFÉ-style twirl; 3.5 m!", "zxqj snake_case \U0001f600 跳", "don't  stop"):
    assert word_pieces(table, sentence, 64) == model.encoder.tokenizer.encode(sentence).ids


def test_int8_is_a_scale_and_whole_numbers(exported):
  """Weights differ by half a step of their channel at the most; float16 loses nothing of these."""
  from onnx import numpy_helper
  graphs, _ = exported
  whole = export_graphs.convert(graphs[2])
  arrays = lambda model: {one.name: numpy_helper.to_array(one) for one in model.graph.initializer}
  plain, half, eight = (arrays(export_graphs.stored(whole, name)) for name in export_graphs.PRECISIONS)
  names = [name.removesuffix("_int8") for name in eight if name.endswith("_int8")]
  assert len(names) > 10
  for name in names:
    back = eight[f"{name}_int8"].astype(np.float32) * eight[f"{name}_scale"]
    assert (np.abs(back - plain[name]) <= 0.501 * eight[f"{name}_scale"]).all()
    assert (half[f"{name}_float16"].astype(np.float32) == plain[name]).all()


@pytest.mark.parametrize("sampling", [dict(schedule="full"), dict(negative_prompts=dict, contrast_scale=1.0)])
def test_what_no_graph_can_be_is_refused(model, sampling):
  with pytest.raises(InputError):
    graphs_of(model, **sampling)
