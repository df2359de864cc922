"""Released MoMask and T2M-GPT become run folders, read without PyTorch; files of another method or size are refused."""
import collections

import numpy as np
import pytest

from motion_jax import runs
from motion_jax.models.momask.weights import masked, write_momask
from motion_jax.models.t2m_gpt.weights import gpt, write_t2m_gpt
from motion_jax_studio import cli
from tests import fixtures
from tests.convert.test_torch_files import tensor, write
from tests.golden import Fixture


def save(path, entry, state, **more):
  """A checkpoint {entry: state, ...} as PyTorch writes it, half precision as float32."""
  storages, tensors = {}, collections.OrderedDict()
  for i, (name, array) in enumerate(state.items()):
    storages[str(i)] = np.ascontiguousarray(array, np.float32)
    tensors[name] = tensor(str(i), "FloatStorage", array.shape)
  return write(path, {entry: tensors, "ep": 3, **more}, storages)


def part(state, prefix):
  return {name[len(prefix):]: array for name, array in state.items() if name.startswith(prefix)}


@pytest.fixture(scope="module")
def released(tmp_path_factory):
  """{name: file} of the recorded pipelines as their authors save them, and a folder of statistics."""
  folder = tmp_path_factory.mktemp("released")
  momask, t2m = (Fixture(fixtures.path(f"{name}/pipeline.npz")).params for name in ("momask", "t2m_gpt"))
  np.save(folder / "mean.npy", np.zeros(263, np.float32))
  np.save(folder / "std.npy", np.ones(263, np.float32))
  clip = {"clip_model.token": np.ones((2, 2), np.float32)}
  positions = {"trans_base.pos_embedding.weight": np.zeros((14, 32), np.float32),
               "trans_base.blocks.0.attn.mask": np.ones((1, 1, 14, 14), np.float32)}
  files = dict(
      vq=save(folder / "vq.tar", "vq_model", part(momask, "vq.")),
      masked=save(folder / "masked.tar", "t2m_transformer", part(momask, "mask.") | clip, total_it=7),
      residual=save(folder / "residual.tar", "res_transformer", part(momask, "res.")),
      net=save(folder / "net.pth", "net", part(t2m, "vq.")),
      gpt=save(folder / "gpt.pth", "trans", part(t2m, "gpt.") | positions))
  return files | {"stats": folder}


def test_momask(released, tmp_path, capsys):
  command = ["convert", "momask", "--tokenizer", str(released["vq"]), "--masked", str(released["masked"]), "--residual",
             str(released["residual"]), "--stats", str(released["stats"]), "--heads", "3", "--out", f"{tmp_path}/run"]
  assert cli.main(command) == 0
  printed = capsys.readouterr().out
  assert "left aside: clip_model (1 tensors), ep, total_it" in printed.replace("ep, total_it, clip_model (1 tensors)",
                                                                           "clip_model (1 tensors), ep, total_it")
  run = runs.load_run(tmp_path / "run", "momask.masked")
  assert run.config.quantizer.to_dict() == {"num_levels": 4, "num_codes": 32}
  assert run.config.residual.shared_tables and run.config.sampler.guidance_scale == 4.0
  recorded = Fixture(fixtures.path("momask/pipeline.npz")).params
  np.testing.assert_array_equal(run.params()["params"]["code_table"], recorded["mask.token_emb.weight"])
  frozen = run.frozen()
  np.testing.assert_array_equal(frozen["residual"]["params"]["last_table"], recorded["res.output_proj_weight_"])
  np.testing.assert_array_equal(frozen["tokenizer"]["codebooks"]["codes"][1],
                                recorded["vq.quantizer.layers.1.codebook"])
  assert write_momask(tmp_path / "rvq", released["vq"], released["stats"])[0].what == "RVQ-VAE"
  assert runs.load_run(tmp_path / "rvq").stage == "momask.rvq"


def test_t2m_gpt(released, tmp_path):
  made = write_t2m_gpt(tmp_path / "run", released["net"], released["stats"], released["gpt"], num_heads=4)
  assert [one.what for one in made] == ["RVQ-VAE", "GPT"]
  run = runs.load_run(tmp_path / "run", "t2m_gpt.gpt")
  assert run.config.model.max_length == 14 and run.config.model.depth == 2
  recorded = Fixture(fixtures.path("t2m_gpt/pipeline.npz")).params
  np.testing.assert_array_equal(run.params()["params"]["out"]["kernel"], recorded["gpt.trans_head.head.weight"].T)


def test_files_that_do_not_belong_together_are_refused(released, tmp_path):
  with pytest.raises(ValueError, match="is no masked transformer: token_emb.weight is missing.*this is T2M-GPT's GPT"):
    masked(released["gpt"])
  with pytest.raises(ValueError, match="holds ep, vq_model; expected trans .*; this is MoMask's RVQ-VAE"):
    gpt(released["vq"])
  with pytest.raises(ValueError, match="width 24 is none of the known sizes; give it with --heads"):
    masked(released["masked"])
  other = {name: array for name, array in part(Fixture(fixtures.path("momask/mask_generate.npz")).params, "").items()}
  other["token_emb.weight"] = other["token_emb.weight"][:-2]
  with pytest.raises(ValueError, match="knows 30 codes, the RVQ-VAE has 32; they are of different trainings"):
    write_momask(tmp_path / "run", released["vq"], released["stats"],
                 save(tmp_path / "other.tar", "t2m_transformer", other | {
                     name: array[:30] for name, array in other.items() if "poseFinal" in name}), num_heads=3)
  residual = part(Fixture(fixtures.path("momask/pipeline.npz")).params, "res.")
  narrow = save(tmp_path / "narrow.tar", "res_transformer",
                residual | {"cond_emb.weight": residual["cond_emb.weight"][:, :20]})
  length = Fixture(fixtures.path("cdamd/length_estimator.npz")).params | {"output.0.weight": np.ones((512, 20))}
  for what, files in {"residual transformer": dict(residual_file=narrow), "length estimator": dict(
      length_file=save(tmp_path / "length.tar", "estimator", length))}.items():
    with pytest.raises(ValueError, match=f"{what} reads 20 numbers of text, the masked transformer 512; they are of"):
      write_momask(tmp_path / "run", released["vq"], released["stats"], released["masked"], num_heads=3, **files)
  with pytest.raises(ValueError, match="makes no motion without --masked"):
    write_momask(tmp_path / "run", released["vq"], released["stats"], residual_file=released["residual"])
  assert not (tmp_path / "run").exists()
