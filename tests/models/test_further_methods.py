"""MDM, DiP, MLD and MotionStreamer as methods: sampled, edited, continued, streamed, refused in one sentence."""
import functools
import re

import numpy as np
import pytest

import motion_jax as mj
from motion_jax import export, fit, runs
from motion_jax.data.clip import Clip
from motion_jax.models import registry
from motion_jax.models.block_stream import prompts_by_block
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.utils.input_files import tensor_sizes
from motion_studio import Pipeline, cli
from tests.conftest import load_config

NAMES = ("mdm", "dip", "mld", "mld frames", "motionstreamer")
BLOCKS = ("dip", "motionstreamer")


@pytest.fixture(scope="module")
def models(random_run):
  """A loaded model with random parameters by the name of its method."""
  return functools.cache(lambda name: mj.load(random_run(name)))


def walk(seconds=3.0):
  """A body in its rest pose that glides ahead."""
  rest = np.zeros((22, 3))
  for joint, parent in enumerate(HUMANML3D.parents):
    if joint:
      rest[joint] = rest[parent] + HUMANML3D.offsets[joint]
  rest[:, 1] -= rest[:, 1].min()
  path = np.arange(round(seconds * 20))[:, None, None] * np.array([0, 0, 0.03])
  return Clip((rest + path).astype(np.float32), 20.0, (), id="walk")


@pytest.mark.parametrize("name", (*NAMES, "momask", "t2m_gpt"))
def test_parameters_of_all_networks_are_counted(name, random_run):
  """The generator's, and those of every network that lies in its folder; of shipped models: test_shipped_models.py."""
  folder = random_run(name)
  inside = tensor_sizes(folder / "frozen.safetensors") if (folder / "frozen.safetensors").is_file() else {}
  networks = {part for part, _, rest in (name.partition("/") for name in inside) if rest.startswith("params/")}
  assert networks == {"mld": {"tokenizer"}, "momask": {"tokenizer", "residual"}, "t2m_gpt": {"tokenizer"},
                      "motionstreamer": {"tokenizer"}}.get(name, set())
  wanted = sum(tensor_sizes(folder / "params.safetensors").values()) + sum(
      count for tensor, count in inside.items() if tensor.partition("/")[0] in networks)
  assert runs.num_params(folder) == mj.load(folder).num_params == wanted


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.slow
def test_a_motion_depends_on_its_seed_alone(models, name):
  model = models(name)
  both = model.generate(["a person waves", "a person walks"], [24, 40], seeds=[1, 2])
  alone = model.generate("a person walks", 40, seeds=[2])[0]
  assert both.joints.shape == (2, 40, 22, 3) and alone.meta["seed"] == 2
  np.testing.assert_allclose(both[1].joints, alone.joints, atol=1e-4)
  other = model.generate("a person walks", 40, seeds=[3])[0]
  assert np.abs(other.joints - alone.joints).max() > 1e-3
  with pytest.raises(ValueError, match="trained with|expected a number|expected at most|expected a whole"):
    model.generate("a person walks", 40, num_steps=999)


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.slow
def test_a_stream_is_the_motion(models, name):
  model = models(name)
  whole = model.generate("a person waves", 100, seeds=[2])[0].joints
  streamed = np.concatenate(list(model.stream("a person waves", seed=2, num_frames=100)))
  np.testing.assert_allclose(streamed, whole, atol=1e-4)
  rows = [("a person waves", 40 / 20), ("a person sits", 60 / 20)]
  whole = model.multi_prompt(rows, seed=4)
  stream = model.stream("a person waves", seed=4, num_frames=100)
  first = [next(stream) for _ in range(40 // model.block_frames)]
  assert stream.say("a person sits") == 40 and stream.script == [(40, "a person sits")]
  fork = stream.fork(num_frames=100)
  rest = list(stream)
  np.testing.assert_array_equal(np.concatenate(rest), np.concatenate(list(fork)))
  np.testing.assert_allclose(np.concatenate(first + rest), whole.joints, atol=1e-4)
  assert [caption.text for caption in whole.captions] == ["a person waves", "a person sits"]


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.slow
def test_a_motion_is_continued(models, name):
  clip = walk()
  made = models(name).extend(clip, "a person jumps", seconds=2.0, seed=5)
  np.testing.assert_array_equal(made.joints[:60], clip.joints)
  assert len(made.joints) == 100 and np.isfinite(made.joints).all()


@pytest.mark.slow
def test_mdm_edits_frames_and_parts_of_the_body(models):
  model, clip = models("mdm"), walk()
  edited = model.edit(clip, "a person kicks", change=[(20, 40)], seed=3)
  np.testing.assert_allclose(edited.joints[:20], clip.joints[:20], atol=1e-5)
  assert edited.meta["made"] == [[20, 40]] and np.abs(edited.joints[25:35] - clip.joints[25:35]).max() > 1e-3
  arms = model.edit(clip, "a person waves", change=[(20, 40)], seed=3, part="upper_body")
  legs = [0, 1, 2, 4, 5, 7, 8, 10, 11]
  np.testing.assert_allclose(arms.joints[:, legs], clip.joints[:, legs], atol=1e-5)
  assert np.abs(arms.joints[25:35, 20:22] - clip.joints[25:35, 20:22]).max() > 1e-3
  with pytest.raises(ValueError, match="got part 'legs', expected one of body, upper_body, lower_body"):
    model.edit(clip, "a person waves", change=[(20, 40)], part="legs")


@pytest.mark.slow
def test_a_motion_may_end_by_itself(models):
  model = models("motionstreamer")
  far = model.generate("a person walks", 40, seeds=[1], ends="itself", stop_distance=0.0)[0]
  near = model.generate("a person walks", 40, seeds=[1], ends="itself", stop_distance=1e6)[0]
  assert (far.num_frames, near.num_frames) == (40, 4)
  np.testing.assert_array_equal(near.joints, far.joints[:4])


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.slow
def test_commands_for_several_prompts_and_continued_files(name, random_run, tmp_path, capsys):
  """They have no choice of a way, and do not read what the past shows; what they cannot is refused in a sentence."""
  model, rows = ["--model", str(random_run(name))], "a person walks:2 | a person sits:2"
  both, longer = (str(tmp_path / file) for file in ("both.npz", "longer.npz"))
  assert cli.main(["multi-prompt", rows, "--ease", *model, "--out", both]) == 0
  made = export.load(both, check=False)
  assert made.num_frames == 80 and made.meta["eased"] and "way" not in made.meta
  assert cli.main(["multi-prompt", rows, "--rest", "--way", "joined", *model, "--out", longer]) == 0
  export.save(walk(), tmp_path / "walk.npz")
  assert cli.main(["extend", str(tmp_path / "walk.npz"), "--prompt", rows, *model, "--out", longer]) == 0
  assert export.load(longer, check=False).num_frames == 60 + 80
  capsys.readouterr()
  for command, said in (
      (["multi-prompt", rows, "--way", "chain"], "got way 'chain', .* knows stream, joined"),
      (["extend", both, "--prompt", "walks", "--past-prompt", "sits"], "got --past-prompt for .*no such choice"),
      (["extend", both, "--prompt", "walks", "--way", "stream"], "got --way for the model .*, which has no such")):
    assert cli.main([*command, *model, "--out", longer]) == 1
    assert re.search(said, capsys.readouterr().err), said


def test_prompts_change_with_whole_blocks():
  assert prompts_by_block([("a", 40), ("b", 60)], 40) == ["a", "b", "b"]
  assert prompts_by_block([("a", 10), ("b", 10)], 40) == ["a", "b"]
  assert prompts_by_block([("a", 100)], 40) == ["a"] * 3


def test_abilities_are_those_of_the_methods():
  assert {"mdm.dip", "motionstreamer.generator"} <= set(registry.model_stages("multi_prompt"))
  assert "mdm.denoiser" in registry.model_stages("edit") and "mld.denoiser" in registry.model_stages("reconstruct")


# (config, size, changed fields; a value "run of NAME" is the folder of that random run), what the sentence says.
BAD = [
    ("mld_denoiser", {"frozen.tokenizer": "run of momask rvq"}, "a 'momask.rvq' run, expected one of stage mld.vae"),
    ("momask_masked", {"frozen.tokenizer": "run of t2m_gpt vq"}, "'t2m_gpt.vq' run, expected one of stage momask.rvq"),
    ("momask_masked", {"frozen.residual": "run of momask"}, "'momask.masked' run, expected one of stage momask.resid"),
    ("t2m_gpt_gpt", {"frozen.tokenizer": "run of mld vae"}, "a 'mld.vae' run, expected one of stage t2m_gpt.vq"),
    ("motionstreamer_generator", {"frozen.tokenizer": "run of mld vae"}, "one of stage motionstreamer.tokenizer"),
    ("mld_denoiser:kit", {"frozen.tokenizer": "run of mld vae"}, "features 263, config.tokenizer says features 251"),
    ("momask_masked:kit", {"frozen.tokenizer": "run of momask rvq"}, "features 263, this config says features 251"),
    ("t2m_gpt_gpt:kit", {"frozen.tokenizer": "run of t2m_gpt vq"}, "features 263, this config says features 251"),
    ("motionstreamer_generator:kit", {"frozen.tokenizer": "run of motionstreamer tae"},
     "the tokenizer in .* has features 263, config.tokenizer says features 251; make them agree"),
    ("mld_denoiser", {"frozen.tokenizer": "run of mld vae", "tokenizer.depth": 5},
     "the VAE in .* has depth 3, config.tokenizer says depth 5; make them agree"),
    ("t2m_gpt_gpt", {"frozen.tokenizer": "run of t2m_gpt vq", "quantizer.num_codes": 9, "model.num_codes": 9},
     "has 1 levels of 8 codes, config.quantizer says 1 of 9; make them agree"),
    *((name, {"data.layout": "essential"}, "features = 263, layout 'essential' has 67 numbers a frame; make them agree")
      for name in ("mdm_denoiser", "mld_vae", "mld_denoiser", "mld_frames", "momask_rvq", "momask_masked",
                   "momask_residual", "t2m_gpt_vq", "t2m_gpt_gpt", "motionstreamer_tokenizer",
                   "motionstreamer_generator")),
    *((name, {f"model.{'transformer.' * name.startswith('motionstreamer')}text_dim": 7},
       "gives 32 numbers a sentence, the model takes text_dim = 7; make them agree")
      for name in ("mdm_denoiser", "mld_denoiser", "momask_masked", "momask_residual", "t2m_gpt_gpt",
                   "motionstreamer_generator")),
]


@pytest.mark.parametrize("name, fields, said", BAD)
def test_what_does_not_fit_is_refused_in_one_sentence(name, fields, said, random_run, tmp_path):
  """Parts of another method, size or data set, a representation and a text encoder of another width."""
  name, _, data = name.partition(":")
  config = load_config(name, f"{data}_tiny" if data else "tiny").unlock()
  folder = lambda value: str(random_run(value.removeprefix("run of "))) if str(value).startswith("run of ") else value
  config.update_from_flattened_dict({field: folder(value) for field, value in fields.items()})
  with pytest.raises(ValueError, match=said) as error:
    fit.run(config.lock(), tmp_path / "run")
  assert "\n" not in str(error.value) and not (tmp_path / "run" / "params.safetensors").exists()


def test_the_application_edits_with_a_model_that_has_no_masks(models):
  edited = Pipeline(models("mdm")).edit(walk(), "a person kicks", change=[(20, 40)], seed=3, max_attempts=1)
  assert edited.num_frames == walk().num_frames and edited.meta["made"] == [[20, 40]]
