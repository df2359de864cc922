"""The whole way from words to joints is the reference's; and the runner of recorded fixtures tells when one is not."""
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.state import from_torch
from motion_jax.data.batches import Windows
from motion_jax.diffusion.schedules import staircase, staircase_levels
from motion_jax.latents import VaeCodec
from motion_jax.models.cmdm.weight_names import causal_dit_names
from motion_jax.motion import representations as features_lib
from motion_jax.nets.causal_dit import CausalDiT
from motion_jax.nets.masks import block_causal_mask, padding_mask
from motion_jax.text.bert import bert_fields
from tests import fixtures, golden
from tests.models.cmdm.test_streaming import whole
from tests.nets import test_causal_vae
from tests.nets.test_causal_dit import captions
from tests.text import test_bert


@golden.golden("full_generate")
def run_full_generate(fixture, dtype):
  """Text features and noise to latents, features, de-normalized features, joints."""
  sizes = fixture.config["dit"]
  dit = CausalDiT(sizes["input_dim"], sizes["latent_dim"], sizes["num_layers"], sizes["num_heads"], sizes["ff_size"],
                  sizes["clip_dim"], block=3, dtype=dtype)
  state = {name[4:]: array for name, array in fixture.params.items() if name.startswith("dit/")}
  params = jax.tree.map(lambda a: jnp.asarray(a, dtype), from_torch(state, causal_dit_names(dit.depth)))
  vae, vae_params = test_causal_vae.network(fixture, dtype, "vae/")

  noise = jnp.asarray(fixture["in/noise"], dtype)
  length, num_steps, lag = noise.shape[1], sizes["sampling_timesteps"], sizes["uncertainty_scale"]
  levels = staircase_levels(num_steps, length, lag, 3)
  times = 1 - (num_steps - levels) / num_steps if dtype == jnp.float64 else staircase(num_steps, length, lag, 3)
  real = padding_mask(fixture["in/frames"] // vae.frames_per_latent, length)
  mask = block_causal_mask(length, 3) & real[:, None, None, :]
  latents = whole(dit, params, *captions(fixture, dtype), mask, noise, jnp.asarray(times, dtype),
                  fixture.config["scale"])
  features = jax.jit(VaeCodec(vae, vae_params).decode)(latents)
  motion = features * jnp.asarray(fixture["in/std"], dtype) + jnp.asarray(fixture["in/mean"], dtype)
  return {"latents": latents, "features": features, "denormalised": motion,
          "joints": jax.jit(features_lib.to_joints)(motion)}


@golden.golden("joints")
def run_joints(fixture, dtype):
  features = jnp.asarray(fixture["in/features"], dtype)
  layout = features_lib.layout_for(features.shape[-1])  # 263 columns, or the first 67 of them; KIT's 251, 64
  heading, path = features_lib.root_path(features, layout)
  return {"joints": features_lib.to_joints(features, layout), "root": path, "root_quaternion": heading}


# The README's absolute bounds by block, in metres and, for KIT, in millimetres.
BLOCKS = {"full": {"contacts": 0, "turn": 2e-5, "rotations": 1e-4, "": 2e-5},
          "full_kit": {"contacts": 0, "turn": 5e-5, "rotations": 5e-4, "": 1e-2}}


@golden.golden("features_humanml3d", bounds={"": (1e-4, 1e-10)})
@golden.golden("features_kit", bounds={"": (1e-4, 1e-10)})
def run_features(fixture, dtype):
  """Clips to the uniform skeleton, to features, and back in two ways; blocks of features have bounds of their own."""
  offsets, made = fixture["in/offsets"], {}
  layout = features_lib.get_layout("full" if len(offsets) == 22 else "full_kit")
  skeleton, bounds = layout.skeleton.with_offsets(offsets), BLOCKS[layout.name]
  for name, joints in fixture.under("in/").items():
    if not name.endswith("/joints"):
      continue
    clip, recorded = name.split("/")[0], fixture[f"out/{name.split('/')[0]}/features"]
    canonical = features_lib.canonicalize(joints, skeleton)
    features = features_lib.extract(canonical, skeleton)
    for block, columns in layout.blocks.items():
      worst = np.abs(features[:, columns] - recorded[:, columns]).max()
      assert worst <= bounds.get(block, bounds[""]), f"{clip} {block} differs by {worst:.1e}"
    made |= {f"{clip}/canonical": canonical, f"{clip}/features": features,
             f"{clip}/recovered": features_lib.to_joints(recorded, layout),
             f"{clip}/recovered_rotations": features_lib.rotations_to_joints(recorded, layout, offsets)}
  return made


@golden.golden("windows", bounds={"": (0, 0)})
def run_windows(fixture, dtype):
  """Clip k holds rows numbered 1000 k + row; what comes back is read off the batches that training gets."""
  clips = [1000 * k + np.arange(length)[:, None] for k, length in enumerate(fixture["in/lengths"])]
  windows = Windows(clips, fixture.meta["arguments"]["window_size"], stride=1, released=True)
  size = len(windows)
  rows = windows.batch(size, 0, 0)["features"][..., 0]
  assert (np.diff(rows, axis=1) == 1).all() and sorted(rows[:, 0]) == sorted(windows.starts @ [1000, 1])
  return {"first": windows.starts @ [1000, 1], "rows": np.full(size, rows.shape[1])}


@golden.golden("bert")
@golden.golden("distilbert")
def run_bert(fixture, dtype):
  net = fixture.config["net"]
  kind = "distilbert" if "n_layers" in net else "bert"
  fields = {**bert_fields({"model_type": kind, **net}), "has_pooler": kind == "bert"}
  return test_bert.outputs(fixture.arrays, fixture.params, fields, dtype.name)


@golden.recordings("motion/features_humanml3d", "motion/features_kit", "motion/joints", single=("data/windows",),
                   slow=("cmdm/full_generate",))
def test_features_and_windows(name, precision):
  """And the whole way from words to joints."""
  assert not golden.check(fixtures.path(f"{name}.npz"), [precision]).failures


def test_every_recording_here_has_a_runner_of_its_own(capsys):
  golden.import_runners()
  assert not capsys.readouterr().err  # every module could be imported
  files = [path for path in fixtures.path(".").glob("*/*.npz") if path.parent.name not in ("data", "robots")]
  names = [{path.stem, f"{path.parent.name}/{path.stem}"} for path in files]
  assert len(files) > 20 and not [one for one in names if not one & golden.RUNNERS.keys()]


def write(folder, name, fixture=None, tolerance=1e-6, **recorded):
  recorded = recorded or {"a": np.ones(3, np.float32)}
  np.savez(folder / f"{name}.npz", meta=np.array(json.dumps({"fixture": fixture or name, "tolerance": tolerance})),
           **{f"out/{name}": array for name, array in recorded.items()})


def register(monkeypatch, **runs):
  monkeypatch.setattr(golden, "RUNNERS", {name: golden.Runner(run, (), {}) for name, run in runs.items()})
  monkeypatch.setattr(golden, "import_runners", lambda: None)


@pytest.mark.parametrize("made, failure", [
    ({}, None), (dict(a=[1, 1.0001, 1]), "float32 a differs by 1.0e-04 > 1e-06"),
    (dict(a=[np.nan] * 3), "float32 a differs by inf"),
    (dict(a=None), "float32 a is not computed"), (dict(a=[1] * 4), "float32 a has shape (4,), recorded is (3,)"),
    (dict(words=["walk", "ran"]), "float32 words differs by inf"), (dict(mask=[0, 0]), "float32 mask differs by inf")])
def test_a_wrong_number_and_a_missing_one_are_seen(made, failure, tmp_path, monkeypatch):
  recorded = dict(a=np.ones(3, np.float32), words=np.array(["walk", "run"]), mask=np.array([0, -np.inf]),
                  none=np.zeros((0, 3)))
  write(tmp_path, "x", **recorded)
  answer = recorded | {name: np.array(array) for name, array in made.items()}
  register(monkeypatch, x=lambda fixture, dtype: {name: array for name, array in answer.items() if array.shape})
  found = golden.check(tmp_path / "x.npz").failures
  assert len(found) == bool(failure) and all(one.startswith(failure) for one in found)
  assert golden.main([str(tmp_path)]) == bool(failure)


def test_the_table_goes_on_after_a_failure_and_knows_no_unknown(tmp_path, monkeypatch, capsys):
  def broken(fixture, dtype):
    raise KeyError("width")

  register(monkeypatch, broken=broken, good=lambda fixture, dtype: {"a": jnp.ones(3)}, vague=lambda *_: {})
  for name in ("broken", "good", "strange"):
    write(tmp_path, name)
  write(tmp_path, "good_unbounded", tolerance="see notes")
  np.savez(tmp_path / "vague.npz", meta=np.array("{}"))
  (tmp_path / "good_cut.npz").write_bytes(b"PK no archive")
  assert golden.main([str(tmp_path)]) == 1
  lines = {line.split()[0]: line for line in capsys.readouterr().out.splitlines()}
  assert lines["good"].endswith("ok") and "1e-06" in lines["good"] and "0.0e+00" in lines["good"]
  for name, words in (("broken", "float32 raised KeyError: 'width'"), ("good_cut", "cannot be read"),
                      ("strange", "no runner knows this fixture"), ("vague", "nothing of it is compared"),
                      ("good_unbounded", "no tolerance")):
    assert words in lines[name] and "FAILED" in lines[name]
  assert lines["1"] == "1 of 6 fixtures agree"
  assert (golden.main([str(tmp_path), "good"]), golden.main([str(tmp_path), "strange"])) == (0, 1)
  with pytest.raises(SystemExit):
    golden.main([str(tmp_path), "absent"])
  with pytest.raises(FileNotFoundError, match="tests never skip"):
    golden.check(tmp_path / "causal_dit.npz")


def source(repo):
  return {"source": [{"repo": repo, "commit": "0"}]}


@pytest.mark.parametrize("name, meta, folder, expected", [
    *((name, {}, "", "mac_vae") for name in ("mac_vae", "mac_vae-seed7", "mac_vae2")),
    ("mac_vae_loss_seed7", {}, "", "mac_vae_loss"), ("mac_vaes", {}, "", None), ("odd_3", {}, "", None),
    ("renamed", {"fixture": "mac_vae_loss"}, "", "mac_vae_loss"), ("evaluators_66", {}, "", "evaluators_67"),
    # A name that several methods use: by the source, then by the folder.
    ("pipeline", source("EricGuo5513/momask-codes"), "", "momask/pipeline"),
    ("pipeline_seed7", source("Mael-zys/T2M-GPT"), "momask", "t2m_gpt/pipeline"),
    ("other", source("Mael-zys/T2M-GPT") | {"fixture": "pipeline"}, "", "t2m_gpt/pipeline"),
    ("pipeline", source("fly-dk/CDAMD"), "momask", "pipeline"), ("pipeline", {}, "momask", "momask/pipeline")])
def test_runners_are_found_for_other_names(name, meta, folder, expected, monkeypatch):
  same = lambda fixture, dtype: {}
  names = ("mac_vae", "mac_vae_loss", "ae", "odd_1", "odd_2", "pipeline", "momask/pipeline", "t2m_gpt/pipeline")
  register(monkeypatch, evaluators_67=same, evaluators_259=same, **{name: (lambda *_: {}) for name in names})
  assert golden.runner_name(name, meta, folder) == expected
