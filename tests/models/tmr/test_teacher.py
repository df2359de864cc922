"""Motion-language teachers: the contrast, what a run keeps, says and retrieves, what a tokenizer is taught, weights to
start from."""
import json
import shutil
import types

import jax
import jax.numpy as jnp
import ml_collections
import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from motion_jax import export, retrieval
from motion_jax import fit as training
from motion_jax.data.clip import Clip
from motion_jax.data.datasets.humanml3d import write_folder
from motion_jax.data.datasets.registry import dataset_of
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.evaluation.candidates import Candidate
from motion_jax.evaluators.evaluator import load_evaluator
from motion_jax.models import cmdm, tmr
from motion_jax.models.cmdm import setup as setups
from motion_jax.models.tmr import alignment
from motion_jax.models.tmr import setup as teachers
from motion_jax.models.tmr.space import make_teacher
from motion_jax.models.tmr.weight_names import vit_from_torch
from motion_jax.models.tmr.weights import teacher
from motion_jax.motion.representations import get_layout, to_features
from motion_jax.motion.stats import Stats, compute_stats, save_stats
from motion_jax.nets.causal_vae import CausalVAE
from motion_jax.training import checkpoint
from motion_jax.training.optimizers import make_optimizer
from motion_jax.training.setup import untrained
from motion_jax.training.stage import DEVICES
from motion_jax_studio import cli
from tests import fixtures
from tests.conftest import brief_run, load_config, some_of
from tests.convert.test_convert import run, save_nested, stats_folder, text_folder
from tests.golden import Fixture

pytestmark = pytest.mark.usefixtures("kept_features")

ONE_PART = dict(kind="whole_body")  # compiles faster than six
KINDS = {"part_tmr": ONE_PART, "tmr": {}, "motion_patches": {}}


@pytest.fixture(scope="module", params=["tmr", "motion_patches"])
def teacher_run(request, runs):
  return runs(request.param)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
  """runs(config) -> a run folder after one step; a second one has captions of another length, another program."""
  made = {}

  def folder(name):
    if name not in made:
      made[name] = brief_run(name, tmp_path_factory.mktemp("teachers") / name, num_steps=1, **KINDS[name])
    return made[name]

  return folder


@pytest.fixture(scope="module")
def data(tmp_path_factory):
  folder = tmp_path_factory.mktemp("data") / "clips"
  write_folder(synthetic_clips(0, 8), folder, mirror=False)
  return folder


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
  monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


# --- training -----------------------------------------------------------------------------------------------------


def test_contrast_of_orthogonal_pairs():
  """Right pairs at cosine 1, all others at 0: log(1 + (B - 1) e^-scale) both ways; the same words are no
  counter-example to each other, in whatever row."""
  value, logits = tmr.info_nce(np.eye(4), np.eye(4), 2.0)
  assert np.isclose(value, np.log(1 + 3 * np.exp(-2.0)), atol=1e-6) and np.allclose(logits, 2 * np.eye(4))
  text = np.eye(4)[[0, 0, 1, 2]]
  assert tmr.info_nce(text, text, 20.0)[0] > 0.3 > 1e-6 > tmr.info_nce(text, text, 20.0, text @ text.T > 0.5)[0]


def test_contrast_counts_both_ways():
  """Rows that find their columns and columns that find their rows are not the same where logits are not symmetric."""
  logits = np.array([[2.0, 0, 1], [5, 1, 0], [4, 2, 2]])
  ways = [-np.mean(np.diag(a) - np.log(np.exp(a).sum(1))) for a in (logits, logits.T)]
  assert abs(ways[0] - ways[1]) > 0.1
  np.testing.assert_allclose(tmr.symmetric_cross_entropy(jnp.asarray(logits)), np.mean(ways), rtol=1e-5)


def test_rates_hold_parameters_still_or_slow_them():
  config = load_config("part_tmr", "full").optimizer
  tx = make_optimizer(config, 100)
  params = {"motion": {"logit_scale": jnp.ones(()), "w": jnp.ones(2)}, "text": {"w": jnp.ones(2)}}
  updates, _ = tx.update(jax.tree.map(jnp.ones_like, params), tx.init(params), params)
  assert updates["motion"]["logit_scale"] == 0
  assert np.allclose(updates["text"]["w"], 0.1 * updates["motion"]["w"]) and updates["motion"]["w"][0] < 0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["part_tmr", "tmr"])
def test_two_devices_contrast_the_whole_batch(name):
  """Each sentence meets the motions of the other device too, and a TMR's noise is that of a pair's place in the whole
  batch. Dropout is off: its masks fall on other rows."""
  config = load_config(name, "tiny").unlock()
  config.model.update(dropout=0.0, **({} if name == "tmr" else dict(head_dropout=0.0) | ONE_PART))
  setup = teachers.teacher(training.resolve(config)[0])
  batch = setup.next_batch(0)
  params = untrained(jax.eval_shape(setup.stage.init, batch, jax.random.key(0)))

  def value(params, count):
    rows = {name: np.reshape(array, (count, -1, *array.shape[1:])) for name, array in batch.items()}
    each = lambda rows: setup.stage.loss(params, {}, rows, 0, jax.random.key(1))[0]["loss"]
    return jax.vmap(each, axis_name=DEVICES)(rows).mean()

  (one, of_one), (two, of_two) = (jax.jit(jax.value_and_grad(value), static_argnums=1)(params, n) for n in (1, 2))
  np.testing.assert_allclose(one, two, rtol=1e-5)
  for a, b in zip(jax.tree.leaves(of_one), jax.tree.leaves(of_two)):
    np.testing.assert_allclose(a, b, rtol=1e-3, atol=1e-5)


@pytest.mark.slow
def test_captions_that_say_the_same_are_read_with_their_sentence():
  config = training.resolve(load_config("tmr", "tiny"))[0].unlock()
  setup = teachers.teacher(config)
  batch = setup.next_batch(0)
  assert batch["sentence"].shape[0] == 4 and np.allclose(np.linalg.norm(batch["sentence"], axis=-1), 1, atol=1e-5)
  assert batch["text_emb"].shape[1] % 32 == 0 and config.text.to_dict() == {"width": batch["text_emb"].shape[-1]}
  config.frozen.sentence = ""
  assert "sentence" not in teachers.teacher(config).next_batch(0)


# --- retrieval ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", some_of(KINDS, slow=["tmr"]))
def test_a_run_retrieves_and_judges(name, runs):
  """Unit vectors, the same for a motion or a sentence alone as among others, in retrieval as in judging."""
  retriever, evaluator = retrieval.load(runs(name)), load_evaluator(runs(name))
  features = [retriever.features_of(clip) for clip in synthetic_clips(0, 3)]
  motions = retriever.embed_motion(features)
  said = ["a person walks", "a person jumps up and down again and again and then sits down on the floor"]
  sentences = retriever.embed_text(said)
  assert np.allclose(np.linalg.norm([*motions, *sentences], axis=-1), 1, atol=1e-5)
  assert np.allclose(retriever.embed_motion(features[1:2])[0], motions[1], atol=1e-5)
  assert np.allclose(retriever.embed_text(said[:1])[0], sentences[0], atol=1e-5)
  assert np.allclose(evaluator.embed_text(said), sentences, atol=1e-5)
  x = retriever.stats.normalize(features[0][:60])[None]
  assert np.allclose(evaluator.embed_motion(x, np.array([60]))[0], retriever.embed_motion([features[0][:60]])[0],
                     atol=1e-5)


@pytest.mark.slow
def test_a_long_motion_is_the_mean_of_its_pieces(runs):
  retriever = retrieval.load(runs("part_tmr"))
  x = np.concatenate([retriever.features_of(clip) for clip in synthetic_clips(0, 3)])[:128]
  halves = retriever.embed_motion([x[:64], x[64:]]).sum(0)
  assert np.allclose(retriever.embed_motion([x])[0], halves / np.linalg.norm(halves), atol=1e-5)


@pytest.mark.slow
def test_retrieve_from_the_command_line(runs, data, tmp_path, capsys):
  run, data = str(runs("part_tmr")), str(data)
  ask = lambda *words: cli.main(["retrieve", *words, "--data", data, "--teacher", run])
  out = tmp_path / "nearest.npz"
  assert ask("a person walks", "--top-k", "3", "--out", str(out)) == 0
  lines = capsys.readouterr().out.splitlines()
  cosines = [float(line.split()[0]) for line in lines[1:4]]
  assert "8 clips" in lines[0] and cosines == sorted(cosines, reverse=True)
  nearest = export.load(out)
  assert nearest.id == lines[1].split()[1] or nearest.num_frames > 8
  index, = (tmp_path / "cache" / "motion_jax" / "indices").iterdir()
  assert ask(str(out)) == 0  # the other way: a motion in, captions out
  assert len(capsys.readouterr().out.splitlines()) >= 3
  assert ask() == 0
  recall = capsys.readouterr().out
  assert recall.count("text to motion: at 1 ") == 1  # a TMR has a second row, of captions that say nearly the same
  assert cli.main(["retrieve", "--data", data, "--teacher", str(runs("tmr"))]) == 0
  assert capsys.readouterr().out.count("text to motion") == 2

  # From the index nothing is read or embedded again; a damaged one is replaced by the same bytes.
  whole = index.read_bytes()
  with pytest.MonkeyPatch.context() as patch:
    patch.setattr(retrieval, "read_clips", None)
    assert ask() == 0
    assert capsys.readouterr().out == recall
  index.write_bytes(whole[:-5] + b"trash")
  assert ask() == 0
  assert capsys.readouterr().out == recall and index.read_bytes() == whole


@pytest.mark.slow
def test_the_index_belongs_to_data_and_teacher(runs, data, tmp_path):
  data = shutil.copytree(data, tmp_path / "data")
  before = dataset_of(data).fingerprint(data)
  text = next((data / "texts").glob("*.txt"))
  text.write_text(text.read_text().replace("person", "robot"))
  assert dataset_of(data).fingerprint(data) != before
  run = shutil.copytree(runs("part_tmr"), tmp_path / "run")
  one = retrieval.load(run).fingerprint
  np.save(run / "Mean.npy", np.load(run / "Mean.npy") + 1)
  assert retrieval.load(run).fingerprint != one


def test_mistakes_are_told(runs, data, tmp_path, capsys, tiny_run):
  run, data = str(runs("part_tmr")), str(data)
  ask = lambda *words: cli.main(["retrieve", *words])
  for words, told in (
      (["a", "--data", str(tmp_path), "--teacher", run], "is no data folder"),
      (["a", "--data", data, "--teacher", str(tmp_path / "none")], "neither a run folder"),
      (["a", "--data", data, "--teacher", str(tiny_run)], "tmr.teacher"),
      ([" ", "--data", data, "--teacher", run], "empty sentence"),
      (["none.npz", "--data", data, "--teacher", run], "none.npz")):
    assert ask(*words) == 1
    assert told in capsys.readouterr().err
  with pytest.raises(SystemExit):
    ask("a", "--top-k", "0", "--data", data, "--teacher", run)
  assert "--top-k: got '0', expected a whole number from 1 to 10,000" in capsys.readouterr().err
  clip = synthetic_clips(0, 1)[0]
  write_folder([Clip(clip.joints, captions=clip.captions, id="a", split="train")], tmp_path / "one", mirror=False)
  with pytest.raises(ValueError, match="no clip with a caption in split 'test'"):
    retrieval.read_clips(tmp_path / "one", "test")


# --- tokenizers ---------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_a_tokenizer_is_taught_by_it(teacher_run):
  """What the tokenizer's run keeps: the motion side alone, the teacher's fields, both statistics where they differ."""
  config = load_config("cmdm_tokenizer", "tiny").unlock()
  config.frozen.teacher, config.model.teacher_dim = str(teacher_run), 8
  config, _ = training.resolve(config)
  setup = setups.tokenizer(config)
  own = checkpoint.load_params(teacher_run)["motion"]
  view = setup.frozen["teacher_view"]
  assert np.array_equal(view["own_mean"], np.load(teacher_run / "Mean.npy"))
  assert np.array_equal(view["std"], setup.stats.std)
  if config.teacher.kind == "tmr":
    assert set(setup.frozen["teacher"]) == {"motion_encoder"} and view["own_std"].shape == (263,)
    assert config.alignment_teacher.to_dict() == {"kind": "tmr", "text": "random-init"}
  else:
    assert set(setup.frozen["teacher"]) == set(own) and config.teacher.layout == "coordinates"
    assert config.alignment_teacher.vit.to_dict() == {"weights": "random"}
  stage = cmdm.tokenizer_stage(config)
  batch = setup.next_batch(0)
  sums = jax.eval_shape(lambda batch, rng: stage.loss(stage.init(batch, rng), setup.frozen, batch, 0, rng)[0], batch,
                        jax.random.key(0))
  assert {"mcos", "mdms", "align_weight"} <= set(sums)
  config.unlock().model.teacher_dim = 6
  with pytest.raises(ValueError, match="gives 8 numbers a frame, config.model.teacher_dim is 6"):
    setups.tokenizer(config)


def test_the_record_of_a_generator_says_what_its_tokenizer_was_taught_by(tmp_path):
  config, stats = load_config("cmdm_denoiser", "tiny").unlock(), alignment.plain_stats("full")
  said = {"kind": "motion_patches", "text": "random-init", "vit": {"weights": "random"}}
  shapes = cmdm.frozen_shapes(CausalVAE(**config.tokenizer))["tokenizer"]
  checkpoint.save_config(tmp_path, ml_collections.ConfigDict(dict(
      stage="cmdm.tokenizer", model=config.tokenizer.to_dict(), alignment_teacher=said, data=dict(layout="full"))))
  checkpoint.save_params(tmp_path, untrained(shapes))
  save_stats(stats, tmp_path)
  config.frozen.tokenizer = str(tmp_path)
  config = training.resolve(config)[0].unlock()
  assert config.alignment_teacher.to_dict() == said
  model = types.SimpleNamespace(folder=tmp_path, config=config, stats=stats, num_params=0, can=lambda ability: False)
  about = lambda: Candidate("row", model, "hash", tmp_path).about
  assert about()["alignment_teacher"] == said
  del config.alignment_teacher
  assert "alignment_teacher" not in about()


def test_windows_are_seen_as_joints_or_by_other_statistics():
  """A window of full features becomes its joints, from the origin, in the teacher's statistics."""
  joints = synthetic_clips(0, 1)[0].joints
  features, shown = (to_features(joints, layout, "corrected") for layout in ("full", "coordinates"))
  grouped, single = (compute_stats(features, "full", per_column=one) for one in (False, True))
  std = features.astype(np.float64).std(0)
  moves = std > 1e-5
  assert np.allclose(single.std[moves], std[moves], rtol=1e-4) and (single.std[~moves] == 1).all()
  assert len(set(grouped.std[4:67])) == 1 and not np.allclose(grouped.std, single.std, rtol=0.01)
  x = grouped.normalize(features)[None, :32].astype(np.float32)
  # The same data and some more: 1 stays, of a column that never moves.
  more = Stats(grouped.mean, np.where(grouped.std == 1, 1, 1.1 * grouped.std), grouped.layout)
  for stats in (single, more):
    seen = alignment.as_seen(x, alignment.view_of(grouped, stats, "a run"), "full", "full")
    assert np.allclose(seen[0], stats.normalize(features)[:32], atol=1e-3)
  own = compute_stats(shown, "coordinates")
  view = alignment.view_of(grouped, own, "a run")
  seen, later = (own.denormalize(np.asarray(alignment.as_seen(part, view, "full", "coordinates"))[0])
                 for part in (x, x[:, 8:]))
  assert np.allclose(seen, shown[:32], atol=1e-4)
  assert np.allclose(later[0, [0, 2]], 0, atol=1e-5)  # a clip of its own
  assert alignment.view_of(grouped, grouped, "a run") is None
  for mean, std in ((grouped.mean + grouped.std, grouped.std), (single.mean, 2 * single.std),
                    (grouped.mean, 1.5 * grouped.std)):
    with pytest.raises(ValueError, match="a run was trained on features of other statistics"):
      alignment.view_of(grouped, Stats(mean, std, grouped.layout), "a run")
  with pytest.raises(ValueError, match="layout 'coordinates_kit' cannot read windows of layout 'full'"):
    alignment.view_of(grouped, alignment.plain_stats("coordinates_kit"), "a run")


# --- weights ------------------------------------------------------------------------------------------------------


def test_other_kinds_of_teachers_are_refused():
  for fields, told in ((dict(kind="tnr"), "expected one of part_tmr, whole_body, tmr, motion_patches"),
                       (dict(kind="tmr", width=8, head_dropout=0.1), "head_dropout.*'whole_body'")):
    with pytest.raises(ValueError, match=told):
      make_teacher(fields, "full")


def vit_state(width=16, depth=1, patch=16):
  """A ViT's ImageNet checkpoint under timm's names, random."""
  sizes = {"cls_token": (1, 1, width), "pos_embed": (1, 1 + 14 * 14, width), "patch_embed.proj.bias": (width,),
           "patch_embed.proj.weight": (width, 3, patch, patch), "norm.weight": (width,), "norm.bias": (width,),
           "head.weight": (5, width), "head.bias": (5,)}
  for i in range(depth):
    for name, shape in (("norm1", (width,)), ("attn.qkv", (3 * width, width)), ("attn.proj", (width, width)),
                        ("norm2", (width,)), ("mlp.fc1", (width, width)), ("mlp.fc2", (width, width))):
      sizes |= {f"blocks.{i}.{name}.weight": shape, f"blocks.{i}.{name}.bias": shape[:1]}
  draw = np.random.default_rng(0).normal
  return {name: draw(size=shape).astype(np.float32) for name, shape in sizes.items()}


HUGGINGFACE = {"cls_token": "vit.embeddings.cls_token", "pos_embed": "vit.embeddings.position_embeddings",
               "patch_embed.proj": "vit.embeddings.patch_embeddings.projection", "norm": "vit.layernorm",
               "head": "classifier", "blocks.0.attn.proj": "vit.encoder.layer.0.attention.output.dense",
               "blocks.0.norm1": "vit.encoder.layer.0.layernorm_before",
               "blocks.0.norm2": "vit.encoder.layer.0.layernorm_after",
               "blocks.0.mlp.fc1": "vit.encoder.layer.0.intermediate.dense",
               "blocks.0.mlp.fc2": "vit.encoder.layer.0.output.dense"}


def huggingface(state):
  """The same checkpoint under Hugging Face's names."""
  made = {}
  for name, array in state.items():
    part, _, leaf = name.rpartition(".")
    if part == "blocks.0.attn.qkv":
      for letter, piece in zip(("query", "key", "value"), np.split(array, 3)):
        made[f"vit.encoder.layer.0.attention.attention.{letter}.{leaf}"] = np.ascontiguousarray(piece)
    else:
      made[HUGGINGFACE.get(name) or f"{HUGGINGFACE[part]}.{leaf}"] = array
  return made


def test_a_vision_transformer_starts_from_a_folder(tmp_path):
  """Both namings give the same weights; the head is left out, positions are resized, and the run says where from."""
  state = vit_state()
  ours, left = vit_from_torch(state, 1)
  theirs, also_left = vit_from_torch(huggingface(state), 1)
  assert jax.tree.all(jax.tree.map(np.array_equal, ours, theirs))
  assert left == ["head.bias", "head.weight", "norm.bias", "norm.weight"] and len(also_left) == 4
  width = state["cls_token"].size
  assert np.array_equal(ours["block0"]["attn"]["k"]["kernel"],
                        state["blocks.0.attn.qkv.weight"][width:2 * width].T)
  folder = tmp_path / "vit_tiny"
  folder.mkdir()
  save_file(state, folder / "model.safetensors")
  (folder / "config.json").write_text(json.dumps({"architecture": "vit_tiny_patch16_224"}))
  config = load_config("motion_patches", "tiny").unlock()
  config.frozen.vit = str(folder)
  config, _ = training.resolve(config)
  setup = teachers.teacher(config)
  params = jax.jit(setup.stage.init)(setup.next_batch(0), jax.random.key(0))["motion"]
  assert np.array_equal(params["vit"]["block0"]["mlp_in"]["kernel"], state["blocks.0.mlp.fc1.weight"].T)
  assert params["vit"]["positions"].shape == (1 + 4 * 5, width)
  assert np.array_equal(params["vit"]["positions"][0], state["pos_embed"][0, 0])
  assert np.array_equal(params["fc_norm"]["scale"], np.ones(width))
  said = config.origin.vit.to_dict()
  assert (said["weights"], said["file"], said["architecture"]) == ("file", "vit_tiny/model.safetensors",
                                                                   "vit_tiny_patch16_224")
  assert len(said["sha256"]) == 64 and said["left_out"] == left


def test_a_wrong_vision_transformer_is_told(tmp_path):
  config = load_config("motion_patches", "tiny").unlock()
  net = make_teacher(config.model, config.data.layout)
  with pytest.raises(FileNotFoundError, match="found no .*model.safetensors"):
    teachers.imagenet(tmp_path, net)
  for name, state, told in (("wide", vit_state(width=24), "width 24 .* config.model has width 16"),
                            ("deep", vit_state(depth=2), r"unknown 12 \(blocks.1"),
                            ("small", vit_state(patch=8), "patches of 192 numbers"),
                            ("odd", vit_state() | {"pos_embed": np.zeros((1, 190, 16), np.float32)}, "190 positions"),
                            ("more", vit_state() | {"extra": np.zeros(3, np.float32)}, r"unknown 1 \(extra\)")):
    (tmp_path / name).mkdir()
    save_file(state, tmp_path / name / "model.safetensors")
    with pytest.raises(ValueError, match=told):
      teachers.imagenet(tmp_path / name, net)


def test_released_motion_patches(tmp_path):
  """By the command line to a run folder, whose motions have the recorded vectors."""
  fixture = Fixture(fixtures.path("cmdm/motion_patches.npz"))
  text = text_folder(tmp_path / "text", 20, heads=4)
  state = {name: a for name, a in fixture.params.items() if not name.startswith("text_encoder")}
  state |= {f"text_encoder.text_model.{name}": a for name, a in load_file(text / "model.safetensors").items()}
  path = save_nested(tmp_path / "best_model", state, "safetensors")
  stats = stats_folder(tmp_path / "stats", fixture["in/mean"], fixture["in/std"])
  assert run("teacher", path, "--stats", stats, "--text-encoder", text, "--heads", 4, "--out", tmp_path / "run") == 0
  config = checkpoint.load_config(tmp_path / "run")
  assert config.model.num_rows == 48 and config.origin.weights == "released" and not config.model.upsample
  retriever = retrieval.load(tmp_path / "run")
  clips = np.split(fixture["in/joints"].astype(np.float32), np.cumsum(fixture.config["frames"])[:-1])
  clips = [clip.reshape(len(clip), -1) for clip in clips if len(clip) <= 48]
  with jax.default_matmul_precision("highest"):
    made = retriever.embed_motion(clips)
  assert np.abs(made - fixture["out/motion_unit"][:len(clips)]).max() < 1e-5


@pytest.mark.parametrize("as_folder", some_of([False, True], slow=[True]))
def test_released_tmr(tmp_path, as_folder):
  """A checkpoint of the whole, or the three parts that are given out, to a run folder that retrieves."""
  fixture, draw = Fixture(fixtures.path("cmdm/tmr.npz")), np.random.default_rng(0)
  wide = lambda *shape: draw.normal(size=shape).astype(np.float32)
  state = fixture.params | {"motion_encoder.projection.weight": wide(16, 263),
                            "motion_decoder.final_layer.weight": wide(263, 16),
                            "motion_decoder.final_layer.bias": wide(263)}
  if as_folder:
    (tmp_path / "tmr").mkdir()
    for part in ("motion_encoder", "text_encoder", "motion_decoder"):
      save_file({name.removeprefix(f"{part}."): a for name, a in state.items() if name.startswith(f"{part}.")},
                tmp_path / "tmr" / f"{part}.safetensors")
    path = tmp_path / "tmr"
  else:
    path = save_nested(tmp_path / "last", {"state_dict": state, "lr_schedulers": {"x": np.zeros(1)}}, "safetensors")
  stats = stats_folder(tmp_path / "stats", np.zeros(263), np.ones(263))
  text = text_folder(tmp_path / "text", 24, heads=4)
  assert run("teacher", path, "--stats", stats, "--text-encoder", text, "--heads", 2, "--out", tmp_path / "run") == 0
  retriever = retrieval.load(tmp_path / "run")
  given = (jnp.asarray(fixture[f"in/{name}"]) for name in ("text", "text_mask"))
  text_mu = retriever.space.text(retriever.params, *given)
  expected = fixture["out/text_mu"] / np.linalg.norm(fixture["out/text_mu"], axis=-1, keepdims=True)
  assert np.abs(text_mu - expected).max() < 1e-5
  assert retriever.embed_motion([wide(30, 263)]).shape == (1, 16)
  assert retriever.embed_text(["a person walks"]).shape == (1, 16)


@pytest.mark.slow
def test_files_that_are_no_teacher_are_told(tmp_path, capsys):
  stats = stats_folder(tmp_path / "stats", np.zeros(263), np.ones(263))
  path = save_nested(tmp_path / "x", {"weight": np.ones((2, 2), np.float32)}, "safetensors")
  assert cli.main(["convert", "teacher", str(path), "--stats", str(stats), "--out", str(tmp_path / "run")]) == 1
  assert "is no Part-TMR, TMR or MotionPatches; it holds weight" in capsys.readouterr().err
  with pytest.raises(FileNotFoundError, match="has no motion_encoder.pt"):
    teacher(tmp_path, get_layout("full"))
