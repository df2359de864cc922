"""MDM, DiP, MLD, MoMask, T2M-GPT and MotionStreamer, a row each: sampled, edited, continued, streamed, refused in one
sentence. Twins of CMDM and CDAMD: the same files, one way to ask what a model can do, choices described once.

Their recordings: test_recordings.py; training of every config: tests/test_smoke.py.
"""
import ast
import dataclasses
import functools
import importlib
import re
import subprocess
import sys

import jax
import numpy as np
import pytest

import motion_jax as mj
from motion_jax import export, fit, latents, runs
from motion_jax.data.clip import Clip
from motion_jax.diffusion import samplers
from motion_jax.models import registry
from motion_jax.models.abilities import ABILITIES
from motion_jax.models.base import TextToMotionModel
from motion_jax.models.cdamd.options import MASKS, CdamdSampling
from motion_jax.models.cdamd.options import SOLVERS as CDAMD_SOLVERS
from motion_jax.models.cmdm import ddpm_forcing
from motion_jax.models.cmdm.options import SOLVERS as CMDM_SOLVERS
from motion_jax.models.cmdm.options import CmdmSampling
from motion_jax.models.keys import random_keys
from motion_jax.motion.skeleton import HUMANML3D
from motion_jax.nets.masks import LATENT_MASKS
from motion_jax.utils.input_files import tensor_sizes
from motion_jax_studio import Pipeline, cli
from tests.conftest import ROOT, load_config, some_of

MODELS = ROOT / "motion_jax" / "models"
# {row: (networks beside its own in its folder, a choice that is refused, what is said)}
STEPS = dict(num_steps=999), "999 sampler steps, this model was trained with"
ROWS = {
    "mdm": ((), *STEPS), "dip": ((), *STEPS), "mld": (("tokenizer",), *STEPS), "mld frames": ((), *STEPS),
    "momask": (("residual", "tokenizer"), dict(threshold=2), "got threshold 2, expected a number from 0 to 1"),
    "t2m_gpt": (("tokenizer",), dict(guidance_scale=2), "got guidance_scale 2, expected"),
    "motionstreamer": (("tokenizer",), *STEPS)}
WHOLE_CODES = ("momask", "t2m_gpt")  # lengths are cut to whole codes
BLOCKS = ("dip", "motionstreamer")
UPPER = [joint for joint in range(22) if joint not in (0, 1, 2, 4, 5, 7, 8, 10, 11)]


@pytest.fixture(scope="module")
def models(random_run):
  """A loaded model with random parameters by the name of its row; codes are drawn by numbers that vary much."""
  def loaded(name):
    model, draw = mj.load(random_run(name)), np.random.default_rng(0)
    if name in WHOLE_CODES:
      model.params = jax.tree.map(lambda a: a + 0.5 * draw.standard_normal(a.shape, np.float32), model.params)
    return model

  return functools.cache(loaded)


def walk(seconds=3.0):
  """A body in its rest pose that glides ahead, faster and slower."""
  rest = np.zeros((22, 3))
  for joint, parent in enumerate(HUMANML3D.parents):
    if joint:
      rest[joint] = rest[parent] + HUMANML3D.offsets[joint]
  rest[:, 1] -= rest[:, 1].min()
  time = np.arange(round(seconds * 20))[:, None, None]
  place = (0.03 * time + 0.2 * np.sin(time / 9)) * np.array([0, 0, 1])
  return Clip((rest + place).astype(np.float32), 20.0, (), id="walk")


@pytest.mark.parametrize("name", some_of(ROWS, slow=["momask"]))
def test_parameters_of_all_networks_are_counted(name, random_run):
  """The generator's, and those of every network that lies in its folder; of shipped models: test_shipped_models.py."""
  folder = random_run(name)
  inside = tensor_sizes(folder / "frozen.safetensors") if (folder / "frozen.safetensors").is_file() else {}
  networks = {part for part, _, rest in (tensor.partition("/") for tensor in inside) if rest.startswith("params/")}
  assert networks == set(ROWS[name][0])
  wanted = sum(tensor_sizes(folder / "params.safetensors").values()) + sum(
      count for tensor, count in inside.items() if tensor.partition("/")[0] in networks)
  assert runs.num_params(folder) == mj.load(folder).num_params == wanted


@pytest.mark.parametrize("name", some_of(ROWS, slow=[name for name in ROWS if name not in ("dip", "mld frames")]))
def test_a_motion_depends_on_its_prompt_and_seed_alone(name, models):
  model, (_, choice, said) = models(name), ROWS[name]
  any_code = dict(threshold=0.0) if name == "momask" else {}  # of 8 codes the usual threshold leaves one
  make = lambda prompts, frames, seeds: model.generate(prompts, frames, seeds=seeds, **any_code)
  both = make(["a person waves", "a person walks"], [25, 42], [1, 2])
  lengths = [24, 40] if name in WHOLE_CODES else [25, 42]
  alone = make("a person walks", 42, [2])[0]
  assert [motion.joints.shape for motion in both] == [(length, 22, 3) for length in lengths]
  assert alone.meta["seed"] == 2
  np.testing.assert_allclose(both[1].joints, alone.joints, atol=1e-4)
  others = make(["a person walks", "he falls down"], 42, [3, 2])
  assert all(np.abs(other.joints - alone.joints).max() > 1e-3 for other in others)
  with pytest.raises(ValueError, match=said):
    model.generate("a person walks", 40, **choice)


@pytest.mark.slow
def test_t2m_gpt_ends_by_itself_and_greedy_codes_have_no_seed(models):
  model = models("t2m_gpt")
  own = model.generate(["a person walks", "a person waves"], seeds=[3, 4])
  assert all(motion.num_frames % 4 == 0 and 4 <= motion.num_frames <= 200 for motion in own)
  greedy = [model.generate("a person walks", seed=seed, draw="greedy")[0].joints for seed in (1, 2)]
  np.testing.assert_array_equal(*greedy)


@pytest.mark.parametrize("name", BLOCKS)
@pytest.mark.slow
def test_a_stream_is_the_motion_and_a_motion_is_continued(name, models):
  model, rows = models(name), [("a person waves", 40 / 20), ("a person sits", 60 / 20)]
  whole = model.multi_prompt(rows, seed=4)
  first = model.generate("a person waves", 40, seeds=[4])[0].joints
  np.testing.assert_allclose(whole.joints[:40], first, atol=1e-4)
  stream = model.stream("a person waves", seed=4, num_frames=100)
  begun = [next(stream) for _ in range(40 // model.block_frames)]
  assert stream.say("a person sits") == 40 and stream.script == [(40, "a person sits")]
  fork = stream.fork(num_frames=100)
  rest = list(stream)
  np.testing.assert_array_equal(np.concatenate(rest), np.concatenate(list(fork)))
  np.testing.assert_allclose(np.concatenate(begun + rest), whole.joints, atol=1e-4)
  assert [(caption.text, caption.start, caption.end) for caption in whole.captions] == [
      ("a person waves", 0, 2), ("a person sits", 2, 5)]
  # A motion is continued from its end, as much of it as the network has places for, and not from its beginning.
  clip = walk(30.0)
  made, late, early = (model.extend(part, "a person jumps", seconds=2.0, seed=5).joints
                       for part in (clip, clip.cut(200, 600), clip.cut(0, 580)))
  np.testing.assert_array_equal(made[:600], clip.joints)
  sampled, cleaned = model.extend(clip.cut(540, 600), "a person jumps", seconds=2.0, cleanup=True).meta["steps"]
  assert (sampled["step"], cleaned["step"]) == ("sample", "cleanup") and cleaned["cm"] > 0
  assert 60 <= cleaned["frames"][0][0] and cleaned["frames"][-1][-1] <= 100
  assert len(made) == 640 and np.isfinite(made).all()
  np.testing.assert_allclose(late[400:], made[600:], atol=2e-3)
  assert np.abs((early - early[579])[580:] - (made - made[599])[600:]).max() > 0.01


def test_words_count_from_the_next_block_or_later(models):
  """In blocks of two seconds: rounded up to a block, never before the one that is to come."""
  stream = models("dip").stream("a person waves", seed=4)
  assert stream.say("a person sits", after=0.1) == 40 and stream.say("he turns", after=2.0) == 40
  assert stream.say("he falls", not_before=41) == 80 and stream.say([("he bows", 30), ("he runs", None)]) == 0
  assert stream.script == [(0, "he bows"), (40, "he runs")]
  with pytest.raises(ValueError, match="got words that count after -1 s"):
    stream.say("he falls", after=-1)


@pytest.mark.slow
def test_a_motion_may_end_by_itself(models):
  model = models("motionstreamer")
  far = model.generate("a person walks", 40, seeds=[1], ends="itself", stop_distance=0.0)[0]
  near = model.generate("a person walks", 40, seeds=[1], ends="itself", stop_distance=1e6)[0]
  assert (far.num_frames, near.num_frames) == (40, 4)
  np.testing.assert_array_equal(near.joints, far.joints[:4])


@pytest.mark.slow
def test_latents_of_motionstreamer_are_bounded_if_that_is_chosen(models):
  """Off by default, as released; the last diffusion step is the clean latent itself."""
  model, largest = models("motionstreamer"), []
  for bound in ({}, dict(clip_latents=0.0), dict(clip_latents=0.1)):
    state = model.make_block(model.begin_blocks(jax.random.split(jax.random.key(0), 2)), ["a person walks"] * 2,
                             model.sampling(**bound))[1]
    largest.append(np.abs(state.memory.latents).max())
  assert largest[0] == largest[1] > 0.1 >= largest[2] - 1e-6


@pytest.mark.slow
def test_mdm_edits_frames_and_parts_of_the_body(models):
  """Also in the application, of a model that has no masks."""
  model, clip = models("mdm"), walk()
  edited = model.edit(clip, "a person kicks", change=[(20, 40)], seed=3)
  np.testing.assert_allclose(edited.joints[:20], clip.joints[:20], atol=1e-5)
  assert edited.meta["made"] == [[20, 40]] and np.abs(edited.joints[25:35] - clip.joints[25:35]).max() > 1e-3
  arms = model.edit(clip, "a person waves", change=[(20, 40)], seed=3, part="upper_body")
  legs = np.setdiff1d(range(22), UPPER)
  np.testing.assert_allclose(arms.joints[:, legs], clip.joints[:, legs], atol=1e-5)
  assert np.abs(arms.joints[25:35, 20:22] - clip.joints[25:35, 20:22]).max() > 1e-3
  with pytest.raises(ValueError, match="got part 'legs', expected one of body, upper_body, lower_body"):
    model.edit(clip, "a person waves", change=[(20, 40)], part="legs")
  pasted = Pipeline(model).edit(clip, "a person kicks", change=[(20, 40)], seed=3, max_attempts=1)
  assert pasted.num_frames == clip.num_frames and pasted.meta["made"] == [[20, 40]]


@pytest.mark.slow
def test_momask_edits_whole_codes_and_keeps_the_others_on_all_levels(models, monkeypatch):
  model, clip = models("momask"), walk()
  edited = model.edit(clip, "a person runs", change=[(20, 29)], seed=3)
  assert edited.meta["made"] == [[20, 32]] and edited.num_frames == 60
  with pytest.raises(ValueError, match="everything is kept"):
    model.edit(clip, "a person runs", keep=[(0, 60)])
  monkeypatch.setattr(latents.RvqCodec, "decode", lambda self, codes, *_: codes)
  patched = mj.load(model.folder)
  codes = lambda span, seed: patched.inpainted(
      [np.random.default_rng(0).normal(size=(60, 263))], [np.isin(np.arange(60), range(*span))], ["a person runs"],
      random_keys([seed]), dict(threshold=0.0))[0][0, :15]
  one, other, late = codes((20, 31), 1), codes((20, 31), 2), codes((44, 60), 1)
  changed = np.isin(np.arange(15), range(5, 8))
  np.testing.assert_array_equal(one[~changed], other[~changed])
  np.testing.assert_array_equal(one[8:11], late[8:11])
  assert (one != other)[changed].any(0).all() and (one[:5] == late[:5]).all() and (one >= 0).all()


@pytest.mark.parametrize("name", some_of(BLOCKS, slow=["dip"]))
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


# (config, size, changed fields; a value "run of NAME" is the folder of that random run), what the sentence says.
BAD = [
    ("mld_denoiser", {"frozen.tokenizer": "run of momask rvq"}, "a 'momask.rvq' run, expected one of stage mld.vae"),
    ("momask_masked", {"frozen.tokenizer": "run of t2m_gpt vq"}, "'t2m_gpt.vq' run, expected one of stage momask.rvq"),
    ("momask_masked", {"frozen.residual": "run of momask rvq"}, "'momask.rvq' run, expected one of stage momask.resid"),
    ("t2m_gpt_gpt", {"frozen.tokenizer": "run of mld vae"}, "a 'mld.vae' run, expected one of stage t2m_gpt.vq"),
    ("motionstreamer_generator", {"frozen.tokenizer": "run of mld vae"}, "one of stage motionstreamer.tokenizer"),
    ("mld_denoiser:kit", {"frozen.tokenizer": "run of mld vae"}, "features 263, config.tokenizer says features 251"),
    ("t2m_gpt_gpt:kit", {"frozen.tokenizer": "run of t2m_gpt vq"}, "features 263, this config says features 251"),
    ("motionstreamer_generator:kit", {"frozen.tokenizer": "run of motionstreamer tae"},
     "the tokenizer in .* has features 263, config.tokenizer says features 251; make them agree"),
    ("mld_denoiser", {"frozen.tokenizer": "run of mld vae", "tokenizer.depth": 5},
     "the VAE in .* has depth 3, config.tokenizer says depth 5; make them agree"),
    ("t2m_gpt_gpt", {"frozen.tokenizer": "run of t2m_gpt vq", "quantizer.num_codes": 9, "model.num_codes": 9},
     "has 1 levels of 8 codes, config.quantizer says 1 of 9; make them agree"),
    *((name, {"data.layout": "essential"}, "features = 263, layout 'essential' has 67 numbers a frame; make them agree")
      for name in ("mdm_denoiser", "mld_denoiser")),
    *((name, {f"model.{part}text_dim": 7}, "gives 32 numbers a sentence, the model takes text_dim = 7; make them agree")
      for name, part in (("mdm_denoiser", ""), ("momask_residual", ""), ("motionstreamer_generator", "transformer."))),
]


@pytest.fixture(scope="module")
def tokenizers(random_run):
  return {f"run of {name}": str(random_run(name)) for name in (
      "mld vae", "momask rvq", "t2m_gpt vq", "motionstreamer tae")}


@pytest.mark.parametrize("name, fields, said", BAD)
def test_what_does_not_fit_is_refused_in_one_sentence(name, fields, said, tokenizers, tmp_path):
  """Parts of another method, size or data set, a representation and a text encoder of another width."""
  name, _, data = name.partition(":")
  config = load_config(name, f"{data}_tiny" if data else "tiny").unlock()
  config.update_from_flattened_dict({field: tokenizers.get(value, value) for field, value in fields.items()})
  with pytest.raises(ValueError, match=said) as error:
    fit.run(config.lock(), tmp_path / "run")
  assert "\n" not in str(error.value) and not (tmp_path / "run" / "params.safetensors").exists()


# --- twins --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", registry.METHODS)
def test_a_method_has_its_files_imports_no_other_and_says_what_it_can(method):
  files = {path.name for path in (MODELS / method).glob("*.py")}
  assert files >= {"__init__.py", "losses.py", "stages.py", "sampling.py", "setup.py", "model.py", "options.py",
                   "weights.py"}
  others = [f"motion_jax.models.{other}" for other in registry.METHODS if other != method]
  for path in (MODELS / method).glob("*.py"):
    for node in ast.walk(ast.parse(path.read_text())):
      names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else (
          [f"{node.module}.{alias.name}" for alias in node.names] if isinstance(node, ast.ImportFrom) else [])
      assert not any(name.startswith(other) for name in names for other in others), f"{path} imports {names}"
  for stage, model in importlib.import_module(f"{registry.METHODS[method]}.model").MODELS.items():
    assert stage.startswith(f"{method}.") and issubclass(model, TextToMotionModel) and "generate" in model.abilities
    assert set(model.abilities) <= set(ABILITIES)
    assert all(callable(getattr(model, ability)) for ability in model.abilities)
    assert registry.model_of(stage) is model and stage in registry.setups()


def test_abilities_are_those_of_the_methods():
  """Asked by `model.can` alone: not by a class, by whether there is a method, or by a function's signature."""
  for ability, stages in (("edit", {"cdamd.generator", "momask.masked", "mdm.denoiser"}),
                          ("stream", {"cmdm.denoiser", "mdm.dip", "motionstreamer.generator"}),
                          ("multi_prompt", {"mdm.dip", "motionstreamer.generator"}), ("reconstruct", {"mld.denoiser"})):
    assert set(registry.model_stages(ability)) >= stages
  with pytest.raises(ValueError, match="got the ability 'fly', expected one of generate"):
    object.__new__(TextToMotionModel).can("fly")
  asked = re.compile(r"inspect\.signature|hasattr\((\w+\.)*(model|loaded|subject)\b|"
                     r"isinstance\((\w+\.)*(model|loaded), (?!nn)\w*Model")
  for folder in ("motion_jax/evaluation", "motion_jax_studio/cli", "motion_jax/models", "benchmarks"):
    for path in (ROOT / folder).rglob("*.py"):
      assert not asked.search(path.read_text()), path


def test_choices_are_those_that_there_are_and_by_default_the_configs():
  assert set(CMDM_SOLVERS["flow"]) == set(samplers.SOLVERS) and CMDM_SOLVERS["ddpm"] == ddpm_forcing.SOLVERS
  assert set(CDAMD_SOLVERS) == {*samplers.METHODS, "dopri5", "ddpm"} and set(MASKS) == set(LATENT_MASKS)
  cmdm, cdamd = load_config("cmdm_denoiser", "full"), load_config("cdamd_generator", "full")
  chosen = CmdmSampling(num_steps=4).resolved(cmdm, context=48)
  assert dataclasses.asdict(chosen) == dict(guidance_scale=3.0, schedule="fss", num_steps=4, lag=2, solver="euler",
                                            context=48, memory=None, contrast_scale=0.0, clauses=False)
  assert CmdmSampling(schedule="ar", num_steps=7).resolved(cmdm, context=48).about()["lag"] == 7
  unmasking = CdamdSampling(num_iterations=3).resolved(cdamd)
  assert (unmasking.num_iterations, unmasking.num_steps, unmasking.order) == (
      3, cdamd.sampler.num_steps, cdamd.sampler.order)
  with pytest.raises(ValueError, match="got solver 'ancestral', this model knows euler, heun: it was trained to pred"):
    CmdmSampling(solver="ancestral").resolved(cmdm, context=48)
  for wrong, told in ((dict(unmasked_only="no"), "unmasked_only 'no', expected true or false"),
                      (dict(mask="dcm"), "mask 'dcm', expected one of causal, dccm"),
                      (dict(temperature=-1), "temperature -1, expected a number from 0 to 100")):
    with pytest.raises(ValueError, match=told):
      CdamdSampling(**wrong)


def test_the_command_line_reads_choices_without_jax():
  code = ("import sys, motion_jax_studio.cli; from motion_jax.models import registry; registry.options(); "
          "sys.exit('jax' in sys.modules)")
  assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0
