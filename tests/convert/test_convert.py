"""Released weights are taken over whole or refused: every tensor of a checkpoint is accounted for."""
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from motion_jax.convert.parts import read_part
from motion_jax.convert.state import from_torch, load_state, select
from motion_jax.evaluators.evaluator import load_evaluator
from motion_jax.loading import load
from motion_jax.models import cmdm
from motion_jax.models.cmdm import streaming
from motion_jax.models.tmr.space import make_teacher
from motion_jax.models.tmr.weights import teacher, write_teacher
from motion_jax.motion.representations import get_layout
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.text import bert
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint
from motion_jax_studio import cli
from tests import fixtures
from tests.golden import Fixture
from tests.nets.test_causal_dit import captions
from tests.text.reference import params_to_reference

TABLE = {"net.0": ("first", "dense"), "net.norm": ("norm", "norm"), "conv": ("deep/conv", "conv")}


def state():
  draw = np.random.default_rng(0).normal
  return {"net.0.weight": draw(size=(3, 2)), "net.0.bias": draw(size=3), "net.norm.weight": draw(size=3),
          "net.norm.bias": draw(size=3), "conv.weight": draw(size=(5, 4, 3)), "conv.bias": draw(size=5)}


def test_layouts_are_turned():
  theirs = state()
  params = from_torch(theirs, TABLE)["params"]
  np.testing.assert_allclose(params["first"]["kernel"], theirs["net.0.weight"].T, rtol=1e-6)
  assert params["norm"]["scale"].shape == (3,) and params["first"]["kernel"].dtype == np.float32
  assert params["deep"]["conv"]["kernel"].shape == (3, 4, 5)  # (kernel, in, out)


def test_no_tensor_is_left_over_and_none_made_up():
  with pytest.raises(ValueError, match=r"missing 1 \(net.0.bias\), unknown 0"):
    from_torch({name: array for name, array in state().items() if name != "net.0.bias"}, TABLE)
  with pytest.raises(ValueError, match=r"missing 0 \(\), unknown 1 \(pe\)"):
    from_torch(state() | {"pe": np.zeros(4)}, TABLE)
  assert from_torch(state() | {"pe": np.zeros(4)}, TABLE, ignore=("pe",))


def test_files(tmp_path):
  arrays = {name: array.astype(np.float32) for name, array in state().items()}
  save_file(arrays, tmp_path / "weights.safetensors")
  loaded = load_state(tmp_path / "weights.safetensors")
  assert loaded.keys() == arrays.keys()
  np.testing.assert_array_equal(loaded["conv.weight"], arrays["conv.weight"])
  (tmp_path / "cut.safetensors").write_bytes((tmp_path / "weights.safetensors").read_bytes()[:100])
  with pytest.raises(ValueError, match="no whole safetensors file"):
    load_state(tmp_path / "cut.safetensors")
  with pytest.raises(FileNotFoundError, match="no checkpoint"):
    load_state(tmp_path / "nothing.tar")
  (tmp_path / "latest.tar").write_bytes(b"no checkpoint at all")
  with pytest.raises(ValueError, match="no whole PyTorch checkpoint .no zip archive."):
    load_state(tmp_path / "latest.tar")


# --- run folders out of released checkpoints ---------------------------------------------------------------------


KINDS = ["safetensors", pytest.param("torch", marks=pytest.mark.torch)]


def save_nested(path, content, kind):
  """A checkpoint {entry: state dict or value}, by torch, or as safetensors with the tensors alone."""
  if kind == "torch":
    import torch
    turn = lambda value: ({name: turn(inner) for name, inner in value.items()} if isinstance(value, dict) else
                          torch.from_numpy(np.array(value)) if isinstance(value, np.ndarray) else value)
    torch.save(turn(content), path.with_suffix(".tar"))
    return path.with_suffix(".tar")
  flat = {}
  for entry, state in content.items():
    if isinstance(state, np.ndarray):
      flat[entry] = state
    elif isinstance(state, dict):
      flat |= {f"{entry}/{name}": array for name, array in state.items() if isinstance(array, np.ndarray)}
  save_file(flat, path.with_suffix(".safetensors"))
  return path.with_suffix(".safetensors")


def training_state(state):
  """What torch's optimizer and scheduler of the released script put into a checkpoint, after a step."""
  import torch
  params = [torch.nn.Parameter(torch.from_numpy(np.array(array))) for array in state.values()]
  optimizer = torch.optim.AdamW(params, betas=(0.9, 0.99), lr=2e-4, weight_decay=1e-5)
  scheduler = torch.optim.lr_scheduler.MultiStepLR(optimizer, milestones=[50_000], gamma=0.1)
  sum((param ** 2).sum() for param in params).backward()
  optimizer.step()
  scheduler.step()
  return {"opt_model": optimizer.state_dict(), "scheduler": scheduler.state_dict(), "ep": 3, "total_it": 9}


def text_folder(folder, dim, heads=2):
  """A random DistilBERT of that width in Hugging Face layout."""
  encoder = load_text_encoder("random-init")
  config = dict(model_type="distilbert", vocab_size=encoder.tokenizer.get_vocab_size(), dim=dim, n_layers=1,
                n_heads=heads, hidden_dim=32, max_position_embeddings=64)
  fields = bert.bert_fields(config)
  shapes = jax.eval_shape(lambda: bert.Bert(**fields).init(
      jax.random.key(0), jnp.zeros((1, 1), jnp.int32), jnp.ones((1, 1), bool)))["params"]
  draw = np.random.default_rng(0)
  params = jax.tree.map(lambda a: draw.normal(size=a.shape, scale=0.2).astype(np.float32), shapes)
  folder.mkdir()
  (folder / "config.json").write_text(json.dumps(config))
  (folder / "tokenizer.json").write_text(encoder.tokenizer.to_str())
  save_file({name: np.ascontiguousarray(a) for name, a in params_to_reference(params, fields).items()},
            folder / "model.safetensors")
  return folder


def stats_folder(folder, mean, std):
  folder.mkdir()
  np.save(folder / "Mean.npy", np.asarray(mean, np.float32))
  np.save(folder / "Std.npy", np.asarray(std, np.float32))
  return folder


def cmdm_files(folder, kind, change=lambda vae, dit: None):
  """Both files of the recorded small CMDM, as the authors save theirs, and its statistics."""
  fixture = Fixture(fixtures.path("cmdm/full_generate.npz"))
  vae, dit = ({name[4:]: a for name, a in fixture.params.items() if name.startswith(f"{part}/")}
              for part in ("vae", "dit"))
  change(vae, dit)
  content = {"model": {name: -array for name, array in dit.items()}, "ema_model": dit}
  if kind == "torch":
    content |= training_state(dit)
  stats = stats_folder(folder / "stats", fixture["in/mean"], fixture["in/std"])
  return fixture, {"--tokenizer": save_nested(folder / "net_best_fid", {"ae": vae, "ep": 49}, kind),
                   "--denoiser": save_nested(folder / "latest", content, kind), "--stats": stats, "--heads": 2}


def run(*arguments, **flags):
  return cli.main(["convert", *map(str, arguments), *(str(part) for flag in flags.items() for part in flag)])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_released_weights_make_the_recorded_motion(tmp_path, monkeypatch, capsys, kind):
  """The whole way of a user: two files by the command line to a folder, the folder to motion."""
  fixture, flags = cmdm_files(tmp_path, kind)
  text = text_folder(tmp_path / "text", 20)
  assert run("cmdm", "--text-encoder", text, "--out", tmp_path / "run", **flags) == 0
  printed = capsys.readouterr().out
  assert "left aside: " + ("ep, model, opt_model, scheduler, total_it" if kind == "torch" else "model") in printed
  assert "num_heads 2" in printed and "dilations (9, 3, 1)" in printed and "ema_model" in printed

  noise = jnp.pad(jnp.asarray(fixture["in/noise"]), ((0, 0), (0, 300), (0, 0)))

  def recorded(keys, index, plan, channels):
    row = jnp.asarray(keys)[:, -1].astype(int)  # a motion's seed, which is its place in the file
    return jax.lax.dynamic_slice_in_dim(noise[jnp.minimum(row, len(noise) - 1)], index * plan.block, plan.block, axis=1)

  monkeypatch.setattr(streaming, "block_noise", recorded)
  model = load(tmp_path / "run")
  model.encode_words = lambda prompts, contrast: tuple(
      part[np.array([int(prompt) for prompt in prompts])] for part in captions(fixture, jnp.float32))
  sizes, frames = fixture.config["dit"], (fixture["in/frames"] // 4 * 4).tolist()
  with jax.default_matmul_precision("highest"):
    made = model.generate([str(i) for i in range(len(frames))], frames, seeds=range(len(frames)), cleanup=False,
                          num_steps=sizes["sampling_timesteps"], lag=sizes["uncertainty_scale"],
                          guidance_scale=fixture.config["scale"])
  for i, count in enumerate(frames):
    whole = count // 4 * 4  # in whole latents, as there
    for name, ours in (("denormalised", made.features), ("joints", made.joints)):
      expected = fixture[f"out/{name}"][i, :whole]
      difference = np.abs(ours[i, :whole] - expected).max() / max(1, np.abs(expected).max())
      print(f"motion {i}, {name}: {difference:.1e}")
      assert difference < fixture.meta["tolerance"], (name, difference)
  assert json.loads((tmp_path / "run" / "config.json").read_text())["converted"]["denoiser"]["part"] == "ema_model"


@pytest.mark.slow
def test_the_last_weights_and_a_tokenizer_alone(tmp_path, capsys):
  _, flags = cmdm_files(tmp_path, "safetensors")
  assert run("cmdm", "--weights", "model", "--block", 1, "--out", tmp_path / "last", **flags) == 0
  assert run("cmdm", "--out", tmp_path / "average", **flags) == 0
  assert run("cmdm", "--out", tmp_path / "average", **flags) == 1 and "exists already" in capsys.readouterr().err
  last, average = (checkpoint.load_params(tmp_path / name) for name in ("last", "average"))
  assert all((a == -b).all() for a, b in zip(jax.tree.leaves(last), jax.tree.leaves(average), strict=True))
  assert checkpoint.load_config(tmp_path / "last").model.block == 1

  del flags["--denoiser"], flags["--heads"]
  assert run("cmdm", "--out", tmp_path / "tokenizer", **flags) == 0
  config = checkpoint.load_config(tmp_path / "tokenizer")
  vae = CausalVAE(**{**config.model})
  params = checkpoint.load_params(tmp_path / "tokenizer", cmdm.frozen_shapes(vae)["tokenizer"])
  assert config.stage == "cmdm.tokenizer" and vae.teacher_dim == 12
  assert np.array_equal(params["params"]["encoder"]["head"]["kernel"],
                        checkpoint.load_params(tmp_path / "average", name=checkpoint.FROZEN)["tokenizer"]["params"][
                            "encoder"]["head"]["kernel"])


def rename(state, old, new):
  state[new] = state.pop(old)


def reshape(state, name, shape):
  state[name] = np.ones(shape, np.float32)


WRONG = [
    (lambda vae, dit: dit.pop("final_layer.bias"), {}, "missing 1 (final_layer.bias)"),
    (lambda vae, dit: rename(dit, "final_layer.bias", "head.bias"), {}, "unknown 1 (head.bias)"),
    (lambda vae, dit: vae.update(extra=np.ones(3, np.float32)), {}, "unknown 1 (extra)"),
    (lambda vae, dit: reshape(dit, "final_layer.weight", (9, 32)), {}, "(32, 9) instead of (32, 8)"),
    (lambda vae, dit: reshape(vae, "decoder.model.0.conv.weight", (24, 24)), {}, "decoder.model.0.conv.weight has the"),
    (lambda vae, dit: reshape(vae, "decode_proj.bias", (24, 1)), {}, "(24, 1) instead of (24,)"),
    (lambda vae, dit: dit.pop("x_embedder.weight"), {}, "no denoiser: x_embedder.weight is missing"),
    (lambda vae, dit: dit["x_embedder.bias"].fill(np.nan), {}, "holds NaN"),
    (lambda vae, dit: dit["x_embedder.bias"].fill(-np.inf), {}, "or infinity"),
    (lambda vae, dit: dit.clear(), {}, "holds no tensor"),
    (None, {"--heads": 5}, "5 heads for width 32"),
    (None, {"--heads": None}, "--heads"),
    (None, {"--tokenizer": "--denoiser"}, "expected ae"),
    (None, {"--denoiser": "--tokenizer"}, "expected ema_model"),
    (None, {"--denoiser": "nothing.tar"}, "no checkpoint"),
    (None, {"--stats": "nowhere"}, "no Mean.npy"),
    (None, {"--text-encoder": "random-init"}, "32 numbers a word"),
]


@pytest.mark.parametrize("change, other, words", WRONG, ids=[words for _, _, words in WRONG])
def test_a_wrong_file_or_flag_is_one_line_and_leaves_nothing(tmp_path, capsys, change, other, words):
  _, flags = cmdm_files(tmp_path, "safetensors", change or (lambda vae, dit: None))
  flags |= {flag: flags.get(value, value) for flag, value in other.items()}
  before = set(tmp_path.iterdir())
  assert run("cmdm", "--out", tmp_path / "run", **{f: value for f, value in flags.items() if value is not None}) == 1
  told = capsys.readouterr().err.splitlines()
  assert len(told) == 1 and words in told[0], told
  assert set(tmp_path.iterdir()) == before


def test_another_kind_of_checkpoint_is_told(tmp_path):
  path = save_nested(tmp_path / "x", {"ae": state(), "discriminator": state()}, "safetensors")
  with pytest.raises(ValueError, match="holds ae, discriminator.*another kind"):
    read_part(path, ("ae",))
  with pytest.raises(ValueError, match="nothing under 'vae/'.*ae, discriminator"):
    select(load_state(path), "vae/")


@pytest.mark.parametrize("prefix", ["module.", "_orig_mod.", "module._orig_mod.", "_orig_mod.module.", 2 * "module."])
def test_wrappers_of_modules_are_taken_off_in_any_order(prefix, tmp_path):
  """Of data-parallel, compiled and averaged modules."""
  wrapped = {f"{prefix}{name}": array for name, array in state().items()} | {"n_averaged": np.zeros(())}
  part = read_part(save_nested(tmp_path / "y", wrapped, "safetensors"), ("ae",))
  assert part.state.keys() == state().keys() and part.left == ("n_averaged",)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_the_teacher(tmp_path, kind):
  """A run folder of it is what `config.frozen.teacher` and `retrieve` read."""
  fixture = Fixture(fixtures.path("cmdm/part_tmr.npz"))
  sizes = fixture.config
  tables = {name: np.ones((5, 1, sizes["width"]), np.float32) for name in fixture.meta["skipped_state"]}
  path = save_nested(tmp_path / "best_model", fixture.params | tables, kind)
  stats = stats_folder(tmp_path / "stats", np.zeros(263), np.ones(263))
  with pytest.raises(ValueError, match="give the folder that it started from with --text-encoder"):
    write_teacher(tmp_path / "run", path, stats)
  fields = bert.bert_fields({"model_type": "distilbert", **sizes["text"]})
  network = teacher(path, get_layout("full"), text_fields=fields)
  state = dict(fixture.params)
  assert network.num_params == sum(array.size for array in state.values())

  text = text_folder(tmp_path / "text", 20, heads=4)
  state = {name: a for name, a in state.items() if not name.startswith("text_encoder")} | {
      f"text_encoder.text_model.{name}": a for name, a in load_file(text / "model.safetensors").items()}
  path = save_nested(tmp_path / "teacher", state, kind)
  assert run("teacher", path, "--stats", stats, "--text-encoder", text, "--out", tmp_path / "run") == 0
  config = checkpoint.load_config(tmp_path / "run")
  module = make_teacher(config.model.to_dict(), config.data.layout)
  params = checkpoint.load_params(tmp_path / "run")
  made = jax.jit(lambda x: module.apply({"params": params["motion"]}, x, method="frames"))(fixture["in/motion"])
  expected = fixture["out/frame_embeddings"].swapaxes(0, 1)
  assert np.abs(made - expected).max() / np.abs(expected).max() < fixture.meta["tolerance"]
  assert config.stage == "tmr.teacher" and config.text.num_heads == 4 and params["text"]["words"]["embedding"].any()


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.slow
def test_the_evaluators(tmp_path, kind):
  fixture = Fixture(fixtures.path("cmdm/evaluators_67.npz"))
  parts = {part: {name[len(part) + 1:]: a for name, a in fixture.params.items() if name.startswith(f"{part}/")}
           for part in ("movement_encoder", "motion_encoder", "text_encoder", "contrast_model")}
  clip = {"contrast_model": parts.pop("contrast_model")}
  folder = tmp_path / "stats"
  folder.mkdir()
  np.save(folder / "eval_mean_67.npy", np.zeros(67, np.float32))
  np.save(folder / "eval_std_67.npy", np.full(67, 2, np.float32))
  np.save(folder / "eval_mean.npy", np.zeros(263, np.float32))
  np.save(folder / "eval_std.npy", np.ones(263, np.float32))
  motion, frames = jnp.asarray(fixture["in/motions"]), jnp.asarray(fixture["in/m_lens"])
  for name, content, heads, out in (("t2m", parts, [], "motion"), ("clip", clip, ["--heads", 4], "clip_motion")):
    path = save_nested(tmp_path / name, content, kind)
    assert run("evaluator", path, "--stats", folder, "--out", tmp_path / f"{name}_run", *heads) == 0
    evaluator = load_evaluator(tmp_path / f"{name}_run")
    assert evaluator.layout.dim == 67 and (evaluator.stats.std == 2).all()
    made = evaluator.motion(motion, frames)
    with pytest.raises(FileNotFoundError, match="--glove FOLDER" if name == "t2m" else "clip-vit-base-patch16"):
      evaluator.embed_text(["a person walks"])
    expected = fixture[f"out/plain/{out}"]
    assert np.abs(made - expected).max() / max(1, np.abs(expected).max()) < fixture.meta["tolerance"]
  # With the words that it was trained with it reads sentences; other ones are told.
  width = fixture.params["text_encoder/pos_emb.weight"].shape[0]
  given = lambda size: np.savez(tmp_path / "our_vab.npz", words=["sos", "eos", "unk", "walk"],
                                vectors=np.ones((4, size), np.float32))
  command = ["evaluator", path.with_stem("t2m"), "--stats", folder, "--out", tmp_path / "whole"]
  given(width + 1)
  assert run(*command, "--glove", tmp_path) != 0 and run(*command, "--text-encoder", "random-init") != 0
  given(width)
  assert run(*command, "--glove", tmp_path) == 0
  evaluator = load_evaluator(tmp_path / "whole")
  assert np.isfinite(evaluator.embed_text(["a person walks"])).all() and len(evaluator.words()) == 64
  with pytest.raises(ValueError, match="expected one of stage evaluator.matching"):
    (tmp_path / "t2m_run" / "config.json").write_text('{"stage": "cmdm.denoiser"}')
    load_evaluator(tmp_path / "t2m_run")
