"""The released files of MDM, MLD and MotionStreamer become run folders that generate; what does not fit is refused."""
import json

import jax
import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from motion_jax.loading import load
from motion_jax.models.mdm.weights import denoiser, write_mdm
from motion_jax.models.mld.weights import write_mld
from motion_jax.models.motionstreamer.weights import write_motionstreamer
from motion_jax.runs import load_run
from motion_jax.utils.errors import InputError
from tests import fixtures
from tests.convert.test_convert import save_nested, stats_folder, text_folder
from tests.golden import Fixture


def below(fixture, prefix):
  return {name[len(prefix):]: a for name, a in fixture.params.items() if name.startswith(prefix)}


@pytest.mark.slow
def test_mdm(tmp_path):
  state = Fixture(fixtures.path("mdm/mdm_encoder.npz")).params
  state |= {"sequence_pos_encoder.pe": np.zeros((5, 1, 32)), "clip_model.logit_scale": np.zeros(1)}
  file = save_nested(tmp_path / "model000475000", {"model": state, "model_avg": state}, "safetensors")
  (tmp_path / "args.json").write_text(json.dumps(dict(diffusion_steps=4, mask_frames=True)))
  stats, text = stats_folder(tmp_path / "stats", np.zeros(263), np.ones(263)), text_folder(tmp_path / "text", 20)
  made, = write_mdm(tmp_path / "run", file, stats, text, num_heads=4)
  assert made.num_params == 34919 and made.fields["kind"] == "encoder"
  model = load(tmp_path / "run")
  assert model.config.diffusion.num_steps == 4 and model.config.loss.mask_frames
  assert np.isfinite(model.generate("a person walks", 24, seeds=[0])[0].features).all()
  with pytest.raises(ValueError, match="gives 24 numbers a sentence, the denoiser was trained on 20"):
    write_mdm(tmp_path / "other", file, stats, text_folder(tmp_path / "wide", 24), num_heads=4)
  (tmp_path / "args.json").write_text(json.dumps(dict(context_len=20)))
  with pytest.raises(ValueError, match=r"is a DiP \(context_len 20\), .*train one with --config mdm_denoiser:dip"):
    write_mdm(tmp_path / "other", file, stats, text, num_heads=4)


def mdm_file(tmp_path, **options):
  file = save_nested(tmp_path / "model", {"model": Fixture(fixtures.path("mdm/mdm_encoder.npz")).params}, "safetensors")
  (tmp_path / "args.json").write_text(json.dumps(options))
  return file, stats_folder(tmp_path / "stats", np.zeros(263), np.ones(263)), text_folder(tmp_path / "text", 20)


def test_options_of_mdm_are_followed(tmp_path):
  file, stats, text = mdm_file(tmp_path, diffusion_steps="40", noise_schedule="linear", cond_mask_prob=0)
  write_mdm(tmp_path / "run", file, stats, text, num_heads=4)
  config = load_run(tmp_path / "run").config
  assert (config.diffusion.num_steps, config.diffusion.schedule) == (40, "linear")
  assert config.sampler.guidance_scale == 1.0 and config.loss.drop_rate == 0.0  # there is no half without captions
  assert (config.frozen.text_level, config.frozen.text_pieces) == ("sentence", 22)  # CLIP's 20 and the two special ones


@pytest.mark.parametrize("name, options, text", [
    ("pooled", dict(text_encoder_type="clip", emb_trans_dec=True), ("sentence", 22)),
    ("words", dict(text_encoder_type="bert"), ("words", 0)), ("words", {}, ("words", 0))])
def test_a_decoder_reads_what_its_text_encoder_gives(name, options, text, tmp_path):
  """One vector of CLIP, or the words of DistilBERT, as args.json says."""
  params = Fixture(fixtures.path(f"mdm/mdm_decoder_{name}.npz")).params
  state = widened({key: array for key, array in params.items() if "/" not in key})
  file = save_nested(tmp_path / "model", {"model": state}, "safetensors")
  (tmp_path / "args.json").write_text(json.dumps(options))
  stats = stats_folder(tmp_path / "stats", np.zeros(263), np.ones(263))
  made, = write_mdm(tmp_path / "run", file, stats, text_folder(tmp_path / "text", len(state["embed_text.weight"][0])),
                    num_heads=4)
  config = load_run(tmp_path / "run").config
  assert (config.frozen.text_level, config.frozen.text_pieces) == text and made.fields["kind"] == "decoder"
  assert config.model.time_token == (name == "pooled")


def widened(state):
  """A recorded network with HumanML3D's 263 columns."""
  rows = {"input_process.poseEmbedding.weight": 1, "output_process.poseFinal.weight": 0,
          "output_process.poseFinal.bias": 0}
  return state | {key: np.resize(state[key], [263 if i == axis else size for i, size in enumerate(state[key].shape)])
                  for key, axis in rows.items()}


@pytest.mark.parametrize("options, words", [
    (dict(noise_schedule="sqrt"), "noise_schedule is 'sqrt', expected cosine or linear"),
    (dict(noise_schedule="linear", diffusion_steps=4), "variances above 1"), (dict(sigma_small=False), "sigma_small"),
    (dict(emb_policy="concat"), "emb_policy is 'concat', expected 'add'"),
    (dict(unconstrained=True), "without captions"), (dict(diffusion_steps=[4]), "diffusion_steps is"),
    (dict(cond_mask_prob=3), "cond_mask_prob 3"), (dict(cond_mask_prob=1.0), "0 to below 1"),
    (dict(diffusion_steps=10**9), "1 to 100000"), (dict(text_encoder_type="t5"), "text_encoder_type is 't5'")])
def test_options_of_mdm_that_cannot_be_followed_are_refused(options, words, tmp_path):
  file, stats, text = mdm_file(tmp_path, **options)
  with pytest.raises(InputError, match=words):
    write_mdm(tmp_path / "run", file, stats, text, num_heads=4)
  assert not (tmp_path / "run").exists()


def test_shards_are_one_checkpoint(tmp_path):
  file, stats, text = mdm_file(tmp_path)
  state, files = load_file(file), [f"model-{i:05d}-of-00002.safetensors" for i in (1, 2)]
  for i, name in enumerate(files):
    save_file({key: array for j, (key, array) in enumerate(sorted(state.items())) if j % 2 == i}, tmp_path / name)
  places = {key: files[j % 2] for j, key in enumerate(sorted(state))}
  (tmp_path / "model.safetensors.index.json").write_text(json.dumps({"metadata": {}, "weight_map": places}))
  whole, *parts = (denoiser(tmp_path / name, num_heads=4) for name in (
      file.name, "model.safetensors.index.json", files[1]))
  for part in parts:
    jax.tree.map(np.testing.assert_array_equal, part.params, whole.params)
    assert part.part.source["sha256"] == parts[0].part.source["sha256"] != whole.part.source["sha256"]
  (tmp_path / files[0]).unlink()
  with pytest.raises(FileNotFoundError, match=f"of 2 files, of which 1 are missing in .*: {files[0]}; fetch them, too"):
    denoiser(tmp_path / files[1], num_heads=4)


@pytest.mark.parametrize("content", ["[1, 2]", '{"diffusion_steps": 1000,'])
def test_options_that_are_no_object_are_named(content, tmp_path):
  file, stats, text = mdm_file(tmp_path)
  (tmp_path / "args.json").write_text(content)
  with pytest.raises(InputError, match="args.json"):
    write_mdm(tmp_path / "run", file, stats, text, num_heads=4)


@pytest.mark.slow
def test_mld(tmp_path):
  fixture = Fixture(fixtures.path("mld/mld_sample.npz"))
  state = fixture.params | {"t2m_moveencoder.out.bias": np.zeros(2)}
  # The recorded 30 columns belong to no representation.
  rows = {"vae.skel_embedding.weight": (32, 263), "vae.final_layer.weight": (263, 32), "vae.final_layer.bias": (263,)}
  state = {name: np.zeros(rows[name], np.float32) if name in rows else a for name, a in state.items()}
  file = save_nested(tmp_path / "1222_mld", {"state_dict": state, "epoch": 3}, "safetensors")
  stats, text = stats_folder(tmp_path / "stats", np.zeros(263), np.ones(263)), text_folder(tmp_path / "text", 40)
  vae, made = write_mld(tmp_path / "run", file, stats, text, num_heads=4)
  assert (vae.fields["depth"], made.fields["depth"], vae.fields["num_tokens"]) == (3, 3, 1)
  motion = load(tmp_path / "run").generate("a person walks", 24, seeds=[0], num_steps=2)[0]
  assert motion.features.shape == (24, 263) and np.isfinite(motion.features).all()
  with pytest.raises(ValueError, match="gives 24 numbers a sentence, the MLD denoiser was trained on 40"):
    write_mld(tmp_path / "other", file, stats, text_folder(tmp_path / "wide", 24), num_heads=4)


def test_mld_without_a_vae(tmp_path):
  state = Fixture(fixtures.path("mld/mld_novae.npz")).params
  state = {f"denoiser.{name}": a for name, a in state.items()}
  rows = {"denoiser.pose_embd.weight": 1, "denoiser.pose_proj.weight": 0, "denoiser.pose_proj.bias": 0}
  for name, axis in rows.items():  # the recorded columns belong to no representation
    shape = list(state[name].shape)
    shape[axis] = 263
    state[name] = np.zeros(shape, np.float32)
  file = save_nested(tmp_path / "1216_novae", {"state_dict": state, "epoch": 3}, "safetensors")
  text_dim = state["denoiser.time_embedding.linear_1.weight"].shape[1]
  stats, text = stats_folder(tmp_path / "stats", np.zeros(263), np.ones(263)), text_folder(tmp_path / "text", text_dim)
  made, = write_mld(tmp_path / "run", file, stats, text, num_heads=4)
  assert made.fields["features"] == 263 and not any("pos" in name for name in made.part.left)


@pytest.mark.slow
def test_motionstreamer(tmp_path):
  fixture = Fixture(fixtures.path("motionstreamer/ms_generate.npz"))
  trans, net = below(fixture, "trans."), below(fixture, "net.")
  trans |= {name: np.array(np.log2(16 * 15), np.float32) for name in trans if name.endswith("attn.scale")}
  files = (save_nested(tmp_path / "net_last", {"net": net}, "safetensors"),
           save_nested(tmp_path / "latest", {"trans": trans}, "safetensors"))
  stats, text = stats_folder(tmp_path / "stats", np.zeros(272), np.ones(272)), text_folder(tmp_path / "text", 12)
  _, made = write_motionstreamer(tmp_path / "run", *files, stats, text, num_heads=4)
  assert made.fields["transformer"]["max_length"] == 16  # read off the attention's scale
  motion = load(tmp_path / "run").generate("a person walks", 24, seeds=[0], num_steps=4)[0]
  assert motion.features.shape == (24, 272) and np.isfinite(motion.features).all()
  with pytest.raises(ValueError, match="gives 24 numbers a sentence, the generator was trained on 12"):
    write_motionstreamer(tmp_path / "other", *files, stats, text_folder(tmp_path / "wide", 24), num_heads=4)


@pytest.mark.slow
def test_weights_of_another_method_are_refused(tmp_path):
  state = Fixture(fixtures.path("motionstreamer/ms_tae.npz")).params
  file = save_nested(tmp_path / "net_last", {"model": state}, "safetensors")
  stats = stats_folder(tmp_path / "stats", np.zeros(263), np.ones(263))
  with pytest.raises(ValueError, match="is no MDM denoiser: input_process.poseEmbedding.weight is missing"):
    write_mdm(tmp_path / "run", file, stats)
