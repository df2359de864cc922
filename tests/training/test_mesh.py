"""A state is sharded by fields of the config; what it learns is the same."""
import importlib.metadata
import json

import jax
import jax.numpy as jnp
import ml_collections
import numpy as np
import pytest
from jax.sharding import AbstractMesh

from benchmarks.counting import transfers
from configs import common
from motion_jax.nets.partitioning import LAYOUTS, shardings
from motion_jax.training import mesh
from motion_jax.utils.errors import InputError
from tests import processes
from tests.conftest import devices_env, some_of
from tests.training.test_train_step import steps, tiny

SHARDED, TENSOR = LAYOUTS["fully_sharded"], LAYOUTS["tensor"]


def _spec(axes, shape, rules, data=4, model=2):
  there = AbstractMesh((data, model), ("data", "model"))
  return tuple(shardings({"a": axes}, {"a": jax.ShapeDtypeStruct(shape, jnp.float32)}, there, rules)["a"].spec)


@pytest.mark.parametrize("axes, shape, rules, spec", [
    (("embed", "mlp"), (32, 64), TENSOR, (None, "model")),
    (("embed", "mlp"), (32, 64), SHARDED, ("data", "model")),
    (("layers", "embed", "mlp"), (3, 32, 64), SHARDED, (None, "data", "model")),
    (("embed",), (4096,), SHARDED, (None,)),           # vectors stay whole over data,
    (("layers", "embed"), (8, 4096), SHARDED, (None, None)),
    (("embed", None), (16, 8), SHARDED, (None, None)),  # and small arrays
    (("embed", None), (30, 64), SHARDED, (None, "data")),  # 30 is no multiple of 4: another axis
    ((None, None, None), (3, 64, 128), SHARDED, (None, None, "data")),  # no names: the longest one
    ((None, None), (33, 77), SHARDED, (None, None)),
    (("embed", "mlp"), (32, 64), (("*", "data"),), (None, "data"))])
def test_rules_place_the_axes_of_an_array(axes, shape, rules, spec):
  assert _spec(axes, shape, rules) == spec


def test_a_width_that_the_mesh_does_not_divide_is_refused():
  with pytest.raises(InputError, match=r"got mesh.model 8 and an axis 'mlp' of 100 in \['a'\], expected a divisor; try "
                                       "mesh.model 4, or another width"):
    _spec(("embed", "mlp"), (32, 100), TENSOR, model=8)


@pytest.mark.parametrize("fields, said", [
    (dict(map="all"), "got mesh.map 'all', expected one of auto, pmap, shard_map"),
    (dict(layout="cut"), "got mesh.layout 'cut', expected one of replicated, tensor, fully_sharded"),
    (dict(rules=(("embed", "rows"),)), "got mesh.rules that place an axis on 'rows', expected pairs"),
    (dict(model=2), "got mesh.model 2 and mesh.layout 'replicated', which shards nothing; expected mesh.model 1"),
    (dict(layout="tensor", map="pmap"), "got mesh.map 'pmap' with a sharded state"),
    (dict(layout="tensor", data=3), "got mesh.data 3 and mesh.model 1 on 1 devices, expected a product of 1 .*try "
                                    "mesh.data 0, mesh.model 1"),
    (dict(layout="tensor", model=2), "got mesh.data 0 and mesh.model 2 on 1 devices")])
def test_a_mesh_that_cannot_be_is_refused(fields, said):
  with pytest.raises(InputError, match=said):
    mesh.make_mesh(ml_collections.ConfigDict(common.mesh() | fields))


# --- eight devices ----------------------------------------------------------------------------------------------------

MESHES = {"replicated": (8, 1, ()), "fully sharded": (8, 1, SHARDED), "4 x 2": (4, 2, SHARDED),
          "tensor": (2, 4, TENSOR)}


class Recorded(mesh.Mesh):
  """A mesh that keeps in `seen` what its step sends, and the bytes of its state: of all of it, and on one device."""

  def compiled(self, train_step):
    jitted = super().compiled(train_step)

    def step(state, *args):
      if not hasattr(self, "seen"):
        leaves, params = jax.tree.leaves(state), jax.tree.leaves(state.params)
        self.step = jitted.lower(state, *args).compile()
        self.seen = dict(sent=transfers(self.step.as_text()), state=sum(leaf.nbytes for leaf in leaves),
                         params=sum(leaf.nbytes for leaf in params),
                         on_one=sum(leaf.addressable_shards[0].data.nbytes for leaf in leaves))
      return self.step(state, *args)

    return step


def measured(count, path):
  """Writes, for the first of MESHES: losses of two steps, norms of the parameters after them, what a step sends."""
  found, sizes = {}, dict(width=64, num_heads=4, ff_width=128)
  for kind, where in list(MESHES.items())[:count]:
    where = Recorded(*where)
    state, losses = steps(tiny("cmdm_denoiser", model=sizes, optimizer=dict(clip_norm=0.5)), where)
    norms = [float(np.linalg.norm(leaf)) for leaf in jax.tree.leaves(state.params)]
    found[kind] = where.seen | dict(losses=losses, norms=norms)
  path.write_text(json.dumps(found))


@pytest.mark.parametrize("count", some_of([3, 4], slow=[3]))
def test_every_layout_learns_the_same(tmp_path, count):
  """Losses of two steps, and what the parameters are then, up to the rounding of sums in another order."""
  code = (f"import pathlib; from tests.training import test_mesh; "
          f"test_mesh.measured({count}, pathlib.Path({str(tmp_path / 'found.json')!r}))")
  done = processes.run(["-c", code], devices_env(8))
  assert done.returncode == 0, done.stderr[-3000:]
  found = json.loads((tmp_path / "found.json").read_text())
  whole = found["replicated"]
  for kind, one in found.items():
    for ours, theirs in zip(one["losses"], whole["losses"], strict=True):
      assert ours.keys() == theirs.keys()
      for key, value in theirs.items():
        np.testing.assert_allclose(ours[key], value, rtol=1e-4, atol=1e-6, err_msg=f"{kind}: {key}")
    np.testing.assert_allclose(one["norms"], whole["norms"], rtol=1e-4, atol=1e-5, err_msg=kind)
  # Parameters, average and optimizer's state alike: each is a quarter or more of the whole.
  assert whole["on_one"] == whole["state"] > 4 * found["fully sharded"]["on_one"]
  # What a step sends, in calls and bytes on one device (docs/pods.md).
  sent, params = {kind: one["sent"] for kind, one in found.items()}, found["replicated"]["params"]
  of = lambda kind, name: sent[kind].get(name, (0, 0))[1]
  assert sent["replicated"].keys() == {"all-reduce"} and 0 <= of("replicated", "all-reduce") - params < 100
  # Sharded parameters are gathered once forwards, and those that a gradient needs once more backwards.
  assert 0.5 * params < of("fully sharded", "all-gather") < 2 * params
  assert of("4 x 2", "all-gather") < 0.6 * of("fully sharded", "all-gather")
  if "tensor" in found:
    assert of("tensor", "all-gather") < 0.2 * params  # no parameters, only what a modulation gives
    assert found["tensor"]["on_one"] < 0.3 * found["tensor"]["state"]
  if importlib.metadata.version("jaxlib").startswith("0.10."):  # the partitioner's choices in detail
    counts = {kind: {name: count for name, (count, _) in calls.items()} for kind, calls in sent.items()}
    expected = {
        "replicated": {"all-reduce": 2},
        "fully sharded": {"all-reduce": 17, "all-gather": 16, "all-to-all": 3},
        "4 x 2": {"all-reduce": 30, "all-gather": 16, "all-to-all": 10, "collective-permute": 3},
        "tensor": {"all-reduce": 19, "all-gather": 1, "all-to-all": 7, "collective-permute": 3}}
    assert counts == {kind: expected[kind] for kind in counts}
