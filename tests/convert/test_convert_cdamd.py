"""CDAMD's and MARDM's released files become run folders that make the recorded motion, whole or not at all."""
import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from motion_jax.convert.parts import stats_of
from motion_jax.evaluators.evaluator import load_evaluator
from motion_jax.latents import RvqCodec
from motion_jax.loading import load
from motion_jax.models.cdamd import draws
from motion_jax.models.cdamd import setup as setups
from motion_jax.models.cdamd.weights import write_cdamd
from motion_jax.models.shared import mask_schedule as masking
from motion_jax.nets.post_norm import sinusoids
from motion_jax.training import checkpoint
from tests import fixtures
from tests.conftest import load_config
from tests.convert.test_convert import KINDS, run, save_nested, text_folder, training_state
from tests.golden import Fixture
from tests.models.cdamd.test_cdamd_golden import coordinates, recorded_draw


def recorded(name):
  return Fixture(fixtures.path(f"cdamd/{name}.npz"))


def split(state, prefix):
  """(what lies below a prefix, the rest)."""
  below = {name.removeprefix(prefix): array for name, array in state.items() if name.startswith(prefix)}
  return below, {name: array for name, array in state.items() if not name.startswith(prefix)}


def with_positions(state):
  """The table of sines that the references save with their weights."""
  width = state["input_process.poseEmbedding.weight"].shape[0]
  return state | {"position_enc.pe": np.array(sinusoids(5000, width))[:, None]}


def statistics(folder, columns=66, name="_abs"):
  folder.mkdir(exist_ok=True)
  draw = np.random.default_rng(0).normal
  mean, std = draw(size=columns), np.exp(0.1 * draw(size=columns))
  np.save(folder / f"Mean{name}.npy", mean.astype(np.float32))
  np.save(folder / f"Std{name}.npy", std.astype(np.float32))
  return folder


def files(folder, kind="safetensors", change=lambda parts: None):
  """Flags for the recorded small CDAMD, each part saved as the authors save it."""
  fixture = recorded("generate")
  ae, transformer = split(fixture.params, "ae.")
  parts = dict(ae=ae, transformer=with_positions(transformer), rvq=recorded("rvq_eval").params,
               length=recorded("length_estimator").params)
  change(parts)
  rest = training_state(ae) if kind == "torch" else {"ep": 3}
  save = lambda name, content: save_nested(folder / name, content, kind)
  return fixture, {
      "--tokenizer": save("ae", {"ae": parts["ae"], **rest}), "--stats": statistics(folder / "stats"), "--heads": 4,
      "--generator": save("transformer", {"t2m_transformer": parts["transformer"], **rest}),
      "--rvq": save("rvq", {"vq_model": parts["rvq"], **rest}),
      "--length": save("length", {"estimator": parts["length"], "epoch": 3})}


class Words:
  """Stands for the text encoder: recorded sentence vectors."""
  level = "sentence"

  def __init__(self, vectors):
    self.vectors = jnp.asarray(vectors)[:, None]

  def __call__(self, sentences):
    return self.vectors, np.ones(self.vectors.shape[:2], bool)

  def out_of_vocabulary(self, sentence):
    return []


def generate(fixture, folder, monkeypatch, **choices):
  """Features that a run folder makes of the recorded words and noise; the batch is padded as in the recording."""
  order, counts = fixture["in/order"], fixture["in/lengths"]
  config = json.loads((folder / "config.json").read_text())
  config["data"]["max_frames"] = 4 * order.shape[1]
  (folder / "config.json").write_text(json.dumps(config))
  real, num_iterations = np.arange(order.shape[1]) < counts[:, None], fixture.meta["arguments"]["rounds"]
  masked = masking.masked_table(np.where(real, order, np.inf), masking.masked_counts(num_iterations, counts))
  noise = jnp.asarray(recorded_draw(fixture, "", masked, np.float32)[0])
  monkeypatch.setattr(draws, "draw_order", lambda *_: order)

  def recorded_noise(keys, *_):
    motion = jax.random.key_data(keys)[:, -1:].astype(int)  # a motion's seed, which is its place in the file
    return lambda k, j, places: noise[k, j, motion, places]

  monkeypatch.setattr(draws, "make_draw", recorded_noise)
  model = load(folder)
  model.encoder = Words(fixture["in/text"])
  with jax.default_matmul_precision("highest"):
    made = model.generate(["a person walks"] * len(counts), (4 * counts).tolist(), seeds=range(len(counts)),
                          cleanup=False, num_iterations=num_iterations,
                          guidance_scale=fixture.meta["arguments"]["scale"], **choices)
  return model, made


def assert_same(made, motion, fixture, stats, bound):
  for i, count in enumerate(4 * fixture["in/lengths"]):
    expected = motion[i, :count] * stats.std + stats.mean
    difference = np.abs(made.features[i, :count] - expected).max() / max(1, np.abs(expected).max())
    print(f"motion {i}: {difference:.1e}")
    assert difference < bound


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_released_cdamd_makes_the_recorded_motion(tmp_path, monkeypatch, capsys, kind):
  """The whole way of a user: four files by the command line to a folder, the folder to motion."""
  fixture, flags = files(tmp_path, kind)
  flags["--text-encoder"] = text_folder(tmp_path / "text", 16)
  assert run("cdamd", "--out", tmp_path / "run", **flags) == 0
  printed = capsys.readouterr().out
  assert "dilations (9, 3, 1)" in printed and "num_heads 4" in printed and "--model" in printed
  assert "rows 16 to 1026 are kept and belong to no code" in printed
  if kind == "torch":
    assert "left aside: ep, opt_model, scheduler, total_it" in printed
  model, made = generate(fixture, tmp_path / "run", monkeypatch, solver="euler", num_steps=10)
  assert made[0].meta["mask"] == "causal" and model.config.frozen.text == str(tmp_path / "text")
  assert_same(made, fixture["out/euler/motion"], fixture, model.stats, 5e-5)

  recording = recorded("length_estimator")
  logits = model.length.apply(model.frozen["length"], jnp.asarray(recording["in/text"]))
  np.testing.assert_allclose(logits, recording["out/logits"], atol=1e-5)
  config = json.loads((tmp_path / "run" / "config.json").read_text())
  assert config["converted"]["RVQ-VAE"]["part"] == "vq_model" and config["sampler"]["guidance_scale"] == 4.0


@pytest.mark.slow
def test_released_mardm_makes_the_recorded_motion(tmp_path, monkeypatch, capsys):
  """Its averaged weights, trained as DDPM; the tensors tell that it is MARDM's."""
  fixture = recorded("generate_mardm_ddpm")
  _, flags = files(tmp_path)
  negative = {name: -array for name, array in fixture.params.items()}
  content = {"ema_mardm": with_positions(fixture.params), "mardm": with_positions(negative)}
  flags |= {"--generator": save_nested(tmp_path / "mardm", content, "safetensors"),
            "--text-encoder": text_folder(tmp_path / "text", 16)}
  del flags["--rvq"], flags["--length"]
  assert run("mardm", "--diffusion", "ddpm", "--out", tmp_path / "run", **flags) == 0
  assert "left aside: mardm" in capsys.readouterr().out
  model, made = generate(fixture, tmp_path / "run", monkeypatch)
  assert made[0].meta["solver"] == "ddpm" and made[0].meta["num_steps"] == 50
  assert made[0].meta["mask"] == "bidirectional" and model.length is None
  net, params = coordinates(recorded("generate"), jnp.float32)
  motion = jax.jit(lambda z: net.apply(params, z, method="decode"))(fixture["out/latents"].swapaxes(1, 2))
  assert_same(made, np.asarray(motion), fixture, model.stats, 5e-5)


@pytest.mark.slow
def test_an_autoencoder_and_an_rvq_vae_alone(tmp_path):
  """Runs of them are what `config.frozen` of a training names."""
  _, flags = files(tmp_path)
  stats = flags["--stats"]
  assert run("cdamd", "--rvq", flags["--rvq"], "--stats", stats, "--out", tmp_path / "rvq") == 0
  assert run("cdamd", "--tokenizer", flags["--tokenizer"], "--stats", stats, "--out", tmp_path / "ae") == 0
  config = load_config("cdamd_generator", "full").unlock()
  config.prior.update(latent_dim=12, width=16)
  config.quantizer.num_codes = 16
  net, variables, own = setups.load_frozen(tmp_path / "rvq", config.prior, "cdamd.rvq", config, config.quantizer)
  recording = recorded("rvq_eval")
  indices, _ = jax.jit(lambda variables, x: RvqCodec(net, variables).encode(x))(variables, recording["in/motion"])
  np.testing.assert_array_equal(indices, recording["out/index"])
  assert variables["codebooks"]["initialised"].all() and (variables["codebooks"]["counts"] == 1).all()
  config.tokenizer.update(latent_dim=8, width=16)
  _, variables, theirs = setups.load_frozen(tmp_path / "ae", config.tokenizer, "cdamd.autoencoder", config)
  assert own.fingerprint == theirs.fingerprint == stats_of(stats, 66).fingerprint
  assert checkpoint.load_config(tmp_path / "ae").data.layout == "coordinates"


def narrow(parts):
  """An autoencoder with latents of 12 numbers: that of the recorded RVQ-VAE."""
  parts["ae"] = {name: array for name, array in parts["rvq"].items() if not name.startswith("quantizer")}


WRONG = [
    (lambda parts: parts["transformer"].pop("DiffMLPs.net.final_layer.linear.bias"), {}, "missing 1 (DiffMLPs"),
    (lambda parts: parts["transformer"]["position_enc.pe"].fill(0), {}, "other than sines"),
    (lambda parts: parts["rvq"].update({"quantizer.layers.1.codebook": np.ones((5, 12), np.float32)}), {}, "(5, 12)"),
    (narrow, {}, "latents of 8 numbers"),
    (lambda parts: parts["length"].update({"output.0.weight": np.ones((512, 20), np.float32)}), {}, "20 numbers a"),
    (None, {"--tokenizer": None}, "give the file of the tokenizer"),
    (None, {"--generator": None}, "an RVQ-VAE alone"),
    (None, {"--generator": "--rvq"}, "expected ema_mardm"),
    (None, {"--stats": "nowhere"}, "no statistics of 66 numbers"),
    (None, {"--text-encoder": "random-init"}, "32 numbers a sentence"),
]


@pytest.mark.parametrize("change, other, words", WRONG, ids=[words for _, _, words in WRONG])
def test_a_wrong_file_or_flag_is_one_line_and_leaves_nothing(tmp_path, capsys, change, other, words):
  _, flags = files(tmp_path, change=change or (lambda parts: None))
  flags |= {flag: flags.get(value, value) for flag, value in other.items()}
  before = set(tmp_path.iterdir())
  given = {flag: value for flag, value in flags.items() if value is not None}
  assert run("cdamd", "--out", tmp_path / "run", **given) == 1
  told = capsys.readouterr().err.splitlines()
  assert len(told) == 1 and words in told[0], told
  assert set(tmp_path.iterdir()) == before


@pytest.mark.slow
def test_a_prior_must_fit(tmp_path):
  _, flags = files(tmp_path, change=lambda parts: parts["rvq"].update(
      {f"quantizer.layers.{q}.codebook": np.ones((1100, 12), np.float32) for q in range(4)}))
  given = dict(tokenizer_file=flags["--tokenizer"], stats=flags["--stats"], rvq_file=flags["--rvq"], num_heads=4)
  with pytest.raises(ValueError, match="1100 codes, the generator's table 1027 rows"):
    write_cdamd(tmp_path / "run", generator_file=flags["--generator"], **given)
  mardm = save_nested(tmp_path / "mardm", {"mardm": recorded("generate_mardm").params}, "safetensors")
  with pytest.raises(ValueError, match="no prior"):
    write_cdamd(tmp_path / "run", generator_file=mardm, weights="model", **given)


def test_statistics_of_coordinates_may_be_three_numbers(tmp_path):
  folder = statistics(tmp_path / "stats", 3)
  stats = stats_of(folder, 66)
  assert stats.layout.name == "coordinates"
  np.testing.assert_array_equal(stats.mean, np.tile(np.load(folder / "Mean_abs.npy"), 22))
  statistics(folder, 67, "")
  assert stats_of(folder, 67).layout.name == "essential"
  with pytest.raises(FileNotFoundError, match="no statistics of 63 numbers.*Mean_abs.npy and Std_abs.npy, or Mean.npy"):
    stats_of(tmp_path, 63)


def test_evaluators_on_coordinates(tmp_path):
  """T2M's on 66 columns keeps all of them; statistics are those of the coordinates."""
  fixture = recorded("evaluator")
  content = {f"{part}_encoder": split(fixture.params, f"{part}.")[0] for part in ("movement", "motion", "text")}
  content["movement_decoder"] = split(fixture.params, "decoder.")[0]
  path = save_nested(tmp_path / "finest", content, "safetensors")
  assert run("evaluator", path, "--stats", statistics(tmp_path / "stats"), "--out", tmp_path / "run") == 0
  evaluator = load_evaluator(tmp_path / "run")
  assert evaluator.layout.name == "coordinates"
  made = evaluator.motion(fixture["in/motion"], fixture["in/frames"])
  np.testing.assert_allclose(made, fixture["out/motion"], atol=1e-5)
