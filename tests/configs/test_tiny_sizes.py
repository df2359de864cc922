"""Sizes `tiny` of all stages fit one another: each stage takes the run folders of those before it."""
import types

import jax
import pytest

from motion_jax import fit
from motion_jax.training import checkpoint
from motion_jax.training.setup import untrained
from motion_jax.training.stage import DEVICES
from tests.conftest import load_config

pytestmark = pytest.mark.usefixtures("kept_features")

# {config: {field: the config whose run folder it takes}}
CMDM = {"part_tmr": {}, "cmdm_tokenizer": {"frozen.teacher": "part_tmr"},
        "cmdm_denoiser": {"frozen.tokenizer": "cmdm_tokenizer"}}
CDAMD = {"cdamd_autoencoder": {}, "cdamd_rvq": {}, "cdamd_length": {},
         "cdamd_generator": {"frozen.tokenizer": "cdamd_autoencoder", "frozen.prior": "cdamd_rvq",
                             "frozen.length": "cdamd_length"}}
MARDM = {"cdamd_autoencoder": {}, "cdamd_generator": {"frozen.tokenizer": "cdamd_autoencoder"}}
MOMASK = {"momask_rvq": {}, "momask_residual": {"frozen.tokenizer": "momask_rvq"},
          "momask_masked": {"frozen.tokenizer": "momask_rvq", "frozen.residual": "momask_residual"}}
WITH_LENGTH = {"momask_length": {}} | MOMASK | {
    "momask_masked": MOMASK["momask_masked"] | {"frozen.length": "momask_length"}}
T2M_GPT = {"t2m_gpt_vq": {}, "t2m_gpt_gpt": {"frozen.tokenizer": "t2m_gpt_vq"}}
MDM = {"mdm_denoiser": {}}
MLD = {"mld_vae": {}, "mld_denoiser": {"frozen.tokenizer": "mld_vae"}}
MLD_FRAMES = {"mld_frames": {}}
MOTIONSTREAMER = {"motionstreamer_tokenizer": {},
                  "motionstreamer_generator": {"frozen.tokenizer": "motionstreamer_tokenizer"}}
EVALUATOR = {"evaluator_movement": {}, "evaluator_matching": {"frozen.movement": "evaluator_movement"}}
OTHERS = {"evaluator_clip": {}, "evaluator_snapmogen": {}}


def chain(stages, **sizes):
  """A case of the test: (stages, {config: its size}), sizes before `tiny` where a data set has its own. Quick is what
  traces in a second."""
  sizes = {name: f"{sizes[name]}_tiny" if name in sizes else "tiny" for name in stages}
  return pytest.param(stages, sizes, id=",".join(f"{name}:{size}" for name, size in sizes.items()),
                      marks=pytest.mark.exhaustive if set(sizes.values()) != {"tiny"} else
                      [] if stages.keys() <= {"mdm_denoiser", "mld_frames", *EVALUATOR} else pytest.mark.slow)


def on(data, stages):
  return chain(stages, **dict.fromkeys(stages, data))


def traced_training(config, workdir, stage, next_batch, frozen, *_):
  """In the place of `train.train`: traces a step, compiles nothing, and leaves random parameters."""
  batch, rng = jax.device_put(next_batch(0)), jax.random.key(0)
  frozen = jax.device_put(frozen or {})
  made = [jax.eval_shape(init, batch, rng) for init in (stage.init, stage.init_extra) if init is not None]
  loss = lambda params, *extra: stage.loss(params, frozen, batch, 0, rng, *extra)[0]["loss"]
  jax.eval_shape(jax.vmap(loss, None, axis_size=1, axis_name=DEVICES), *made)
  checkpoint.save_params(workdir, {name: part for one in made for name, part in untrained(one).items()})
  (workdir / "metrics.jsonl").touch()
  return types.SimpleNamespace(step=0)


@pytest.mark.parametrize("stages, sizes", [
    chain(CMDM | {"cmdm_student": {"distill.teacher": "cmdm_denoiser"}}),
    chain(CMDM | {"cmdm_scored": {"frozen.tokenizer": "cmdm_denoiser", "scored.sampler": "cmdm_denoiser",
                                  "scored.reference": "cmdm_denoiser"}}),
    chain({"tmr": {}, "cmdm_tokenizer": {"frozen.teacher": "tmr"}}),
    chain({"motion_patches": {}, "cmdm_tokenizer": {"frozen.teacher": "motion_patches"}}),
    *(on(data, CMDM) for data in ("kit", "essential", "snapmogen", "babel")),
    chain(CDAMD), on("kit", CDAMD),
    *(chain(CDAMD, **dict.fromkeys(("cdamd_autoencoder", "cdamd_rvq", "cdamd_generator"), data))
      for data in ("67", "263", "steps")),
    chain(MARDM, cdamd_generator="mardm"), chain(MARDM, cdamd_autoencoder="67", cdamd_generator="mardm_67"),
    chain(MARDM, cdamd_autoencoder="64", cdamd_generator="mardm_kit"),
    chain(WITH_LENGTH), on("kit", MOMASK), chain(T2M_GPT), on("kit", T2M_GPT),
    chain(MLD), on("kit", MLD), chain(MOTIONSTREAMER), on("kit", MOTIONSTREAMER), on("272", MOTIONSTREAMER),
    chain(MDM), chain(MDM, mdm_denoiser="kit"), chain(MDM, mdm_denoiser="dip_kit"),
    chain(MDM, mdm_denoiser="goals"),
    chain(MDM, mdm_denoiser="words_essential"), on("v2", MLD), chain(MLD_FRAMES), on("kit", MLD_FRAMES),
    *(on("snapmogen", stages) for stages in (MOMASK, T2M_GPT, MDM, MOTIONSTREAMER)),
    chain(EVALUATOR), chain(OTHERS), chain(MARDM, cdamd_autoencoder="snapmogen", cdamd_generator="mardm_snapmogen")])
def test_each_stage_takes_the_runs_of_those_before_it(stages, sizes, tmp_path, monkeypatch):
  monkeypatch.setattr(fit.loop, "train", traced_training)
  for name, parts in stages.items():
    config = load_config(name, sizes[name]).unlock()
    config.update_from_flattened_dict({field: str(tmp_path / run) for field, run in parts.items()})
    fit.run(config.lock(), tmp_path / name)
    assert (tmp_path / name / checkpoint.PARAMS).is_file()
