"""The further methods compute what their references did: each recorded run of tests/fixtures, a row of this matrix."""
import json

import numpy as np
import pytest

from tests import fixtures
from tests.conftest import some_of
from tests.golden import check, recordings
from tests.models.mdm import runners as _mdm  # noqa: F401
from tests.models.mld import runners as _mld  # noqa: F401
from tests.models.momask import runners as _momask  # noqa: F401
from tests.models.motionstreamer import runners as _motionstreamer  # noqa: F401
from tests.models.t2m_gpt import runners as _t2m_gpt  # noqa: F401

ROWS = {
    "mdm": ("mdm_tables", "mdm_losses", "mdm_losses_geometric", "mdm_sample", "mdm_dip", "mdm_targets", "mdm_edit"),
    "mld": ("mld_tables", "mld_vae_loss", "mld_novae", "mld_sample", "mld_diffusion_loss"),
    "momask": ("rvq_eval", "rvq_train_step", "mask_transformer", "mask_corruption", "mask_train_step", "mask_generate",
               "residual_transformer", "residual_train_step", "residual_generate", "edit", "pipeline", "schedules",
               "statistics"),
    "motionstreamer": ("ms_tae", "ms_tae_loss", "ms_two_forward", "ms_generate", "ms_stream"),
    "t2m_gpt": ("vq_eval", "vq_train_step", "quantizer_train", "gpt", "gpt_train", "gpt_sample", "pipeline",
                "token_items")}
SINGLE = ("mdm/mdm_edit", "momask/mask_corruption", "momask/edit", "t2m_gpt/token_items")
QUICK = ("mdm/mdm_tables", "mdm/mdm_losses_geometric", "mdm/mdm_edit", "mld/mld_tables", "momask/mask_corruption",
         "momask/schedules", "momask/statistics", "t2m_gpt/vq_train_step", "t2m_gpt/token_items")
# Parts of what larger ones compute, or sequences of what smaller ones compute.
RARE = ("momask/rvq_eval", "momask/mask_transformer", "momask/residual_transformer", "momask/pipeline",
        "motionstreamer/ms_tae", "motionstreamer/ms_stream", "t2m_gpt/vq_eval", "t2m_gpt/gpt", "t2m_gpt/pipeline")
NAMES = [f"{method}/{name}" for method, names in ROWS.items() for name in names]


@recordings(*NAMES, single=SINGLE, slow=[name for name in NAMES if name not in QUICK], rare=RARE)
def test_what_is_computed_is_what_was_recorded(name, precision):
  assert not check(fixtures.path(f"{name}.npz"), [precision]).failures


# --- copies of other sizes: runners take batches, guidance and words from the file ----------------------------------

# {recording: ({beginning of an array's name: axis of the batch}, changes of meta.arguments for its first row)}
FIRST_ROW = {
    "mdm/mdm_dip": ({"in/noise": 2, **dict.fromkeys(("in/x", "in/prefix", "in/t", "out/", "out64/"), 0)},
                    dict(sentence=["one"], changing=[["one", "three", "two"]])),
    "mdm/mdm_edit": ({"in/text": 1, "in/noise": 1, "in/lengths": 0, "in/motion": 0, "out/in_between/": 0,
                      "out/upper_body/": 0}, {}),
    "momask/pipeline": ({**dict.fromkeys(("in/frames", "in/text", "in/u", "in/res_u"), 0), **{
        f"{out}/{name}": axis for out in ("out", "out64") for name, axis in dict(
            ids=0, masked=1, input=1, drawn=1, res_codes=0, motion=0).items()}}, {}),
    "motionstreamer/ms_stream": ({}, dict(every=8))}
OTHER = {"mdm/mdm_dip": ("scale", "generated"), "mdm/mdm_edit": ("scale", "in_between/text"),
         "momask/pipeline": ("res_scale", "res_codes")}


def copy_of(name, folder, axes, arguments):
  """A recording with the first row of its batch and other arguments."""
  with np.load(fixtures.path(f"{name}.npz"), allow_pickle=False) as file:
    arrays = {key: file[key] for key in file.files}
  meta = json.loads(str(arrays.pop("meta")))
  step = arguments.get("every", 0) // meta["arguments"].get("every", 1)
  meta["arguments"] |= arguments
  if axes:
    meta |= {key: meta[key][:1] for key in ("goals_used", "heading_used") if key in meta}
    arrays = {key: array for key, array in arrays.items() if not key.endswith("/joints1")}
  for key, array in arrays.items():
    axis = next((axis for start, axis in axes.items() if key.startswith(start)), None)
    arrays[key] = array if axis is None else array.take([0], axis=axis)
    if step and key.endswith("/whole"):
      arrays[key] = array[:, ::step]
  path = folder / f"{name.split('/')[1]}.npz"
  np.savez(path, meta=json.dumps(meta), **arrays)
  return path


@pytest.mark.parametrize("name", some_of(FIRST_ROW, slow=["mdm/mdm_edit"]))
def test_a_recording_of_another_size_is_computed_by_the_same_runner(name, tmp_path):
  axes, arguments = FIRST_ROW[name]
  assert not check(copy_of(name, tmp_path, axes, arguments), ["float32"]).failures


@pytest.mark.parametrize("name", some_of(OTHER, slow=["mdm/mdm_edit"]))
def test_runners_read_the_guidance_of_a_recording(name, tmp_path):
  argument, output = OTHER[name]
  failures = check(copy_of(name, tmp_path, {}, {argument: 1.5}), ["float32"]).failures
  assert any(f" {output} differs by" in failure for failure in failures)
  assert not any("raised" in failure or "shape" in failure for failure in failures)
