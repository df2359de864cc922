"""The released names at the released sizes: every parameter is counted, and the whole generates."""
import re

import numpy as np
import pytest

from motion_jax.loading import load
from motion_jax.models.cmdm.weights import write_cmdm
from motion_jax.models.tmr.weights import write_teacher
from tests import fixtures
from tests.convert.test_convert import KINDS, save_nested, stats_folder, text_folder
from tests.golden import Fixture

LAYER = re.compile(r"(blocks|layers|layer)\.(\d+)\.")


def enlarged(state, sizes, depth=1):
  """A recorded state dict's names at other sizes: every length by the table `sizes`, the first layer `depth` times."""
  draw, made = np.random.default_rng(0), {}
  for name, array in state.items():
    layer = LAYER.search(name)
    if layer and layer[2] != "0":
      continue
    # The third axis is a kernel's, the same at any size.
    shape = tuple(size if axis == 2 else sizes.get(size, size) for axis, size in enumerate(array.shape))
    for i in range(depth if layer else 1):
      made[LAYER.sub(rf"\g<1>.{i}.", name)] = np.asarray((draw.random(shape, np.float32) - 0.5) * 0.05, np.float32)
  return made


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_full_size(tmp_path, kind):
  fixture = Fixture(fixtures.path("cmdm/full_generate.npz"))
  vae, dit = ({name[4:]: a for name, a in fixture.params.items() if name.startswith(f"{part}/")}
              for part in ("vae", "dit"))
  vae = enlarged(vae, {8: 64, 24: 1024, 12: 256, 16: 128})
  dit = enlarged(dit, {8: 64, 32: 512, 64: 1024, 20: 768, 192: 3072}, depth=8)
  stats = stats_folder(tmp_path / "stats", np.zeros(263), np.ones(263))
  networks = write_cmdm(
      tmp_path / "run", save_nested(tmp_path / "net_best_fid", {"ae": vae, "ep": 49}, kind), stats,
      save_nested(tmp_path / "latest", {"ema_model": dit, "total_it": 9}, kind), text_folder(tmp_path / "text", 768))
  # docs/papers/cmdm.md#tokenizer, #causal-dit
  assert [network.num_params for network in networks] == [76_312_199, 38_697_024]
  assert networks[1].fields["num_heads"] == 4
  model = load(tmp_path / "run")
  motion = model.generate("a person walks", num_frames=24, seeds=[0], num_steps=2, cleanup=False)[0]
  assert model.num_params == 76_312_199 + 38_697_024 and np.isfinite(motion.features).all()


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_full_size_teacher(tmp_path, kind):
  fixture = Fixture(fixtures.path("cmdm/part_tmr.npz"))
  prefix = "text_encoder.text_model."
  motion = {name: a for name, a in fixture.params.items() if not name.startswith(prefix)}
  text = {name: a for name, a in fixture.params.items() if name.startswith(prefix)}
  embed = f"{prefix}embeddings."
  text = enlarged(text, {20: 768, 36: 3072}, depth=6) | {
      f"{embed}word_embeddings.weight": np.zeros((30522, 768), np.float32),
      f"{embed}position_embeddings.weight": np.zeros((512, 768), np.float32)}
  motion = enlarged(motion, {24: 512, 40: 1024, 16: 256, 72: 1536, 20: 768}, depth=4)
  path = save_nested(tmp_path / "best_model", motion | text, kind)
  stats = stats_folder(tmp_path / "stats", np.zeros(263), np.ones(263))
  made = write_teacher(tmp_path / "teacher", path, stats)[0]
  assert made.num_params == 117_443_585  # docs/papers/cmdm.md#part-tmr, DistilBERT and temperature included
