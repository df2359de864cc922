"""Runners take sizes from their recording: a copy in which each row of the batch stands twice gives each number twice.

What is expected of the copy are the recorded numbers themselves, for rows do not see one another and losses are means.
Recordings without a batch, and those whose numbers belong to the batch as a whole, are named in `WITHOUT`.
"""
import json
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests import fixtures, golden
from tests.conftest import some_of


class Copy(NamedTuple):
  """How a recording is doubled.

  batch: its number of rows; 0: that of the first of `FIRST`. axes: {beginning of an array's name: its axis of rows,
  None for none, or a function of (array, all arrays)}, of which the longest beginning counts. The axis of other arrays
  is the first one, of outputs the first or second, where it is as long as the batch. arguments, meta: lists with an
  entry for each row. numbered: names that end in the number of a row. left_out: outputs of the batch as a whole. tiled:
  the batch twice, instead of each row twice.
  """
  axes: dict[str, Any] = {}
  batch: int = 0
  arguments: tuple[str, ...] = ()
  meta: tuple[str, ...] = ()
  numbered: tuple[str, ...] = ()
  left_out: tuple[str, ...] = ()
  tiled: bool = False


FIRST = ("lengths", "frames", "m_lens", "t", "x", "motion", "motion0", "features", "latents", "text", "ids", "target",
         "input_ids")
LISTED = ("in/text/c", "in/text_mask/c")
GOALS = ("goals_used", "heading_used")
CONTRASTED = ("out/loss", "out/logits", "out/score", "out/order")


def masked_rows(array, arrays, masked):
  """Rows of the masked latents, motion after motion, perhaps for several branches; each motion's twice."""
  counts = masked.sum(-1)
  parts = np.split(array, np.cumsum(np.tile(counts, len(array) // counts.sum()))[:-1])
  return np.concatenate([part for part in parts for _ in range(2)])


def starts(prefix="", rounds=10):
  """{noise of round k: what doubles it}, of the masked latents of a decoding loop."""
  of_round = lambda k: lambda array, arrays: masked_rows(array, arrays, arrays[f"out/{prefix}masked"][k])
  return {f"in/{prefix}{name}{k}{end}": of_round(k) for k in range(rounds) for name, end in (
      ("start", ""), ("step", "/"))}


def target_rows(array, arrays):
  return masked_rows(array, arrays, arrays["out/masked"])


def before_last(array, arrays):
  return np.concatenate([np.repeat(array[:-1], 2, axis=0), array[-1:]])


COPIES = {
    **{f"cdamd/{name}": Copy() for name in ("ae63", "ae66", "edit_masks", "evaluator", "length_estimator",
                                            "mardm_transformer", "mask_schedule", "rvq_eval", "transformer")},
    "cdamd/corruption": Copy({"out/target_rows": target_rows}),
    "cdamd/diffusion_ddpm": Copy({"in/guided_start": 0, "in/cool_start": 0, "out/guided_path": 1, "out/cool_path": 1,
                                  "out/guided_sample": 0, "out/cool_sample": 0}),
    "cdamd/diffusion_sit": Copy({"in/start": 0, "in/sample_noise": 0, "out/ode_": 0, **{
        f"out/dopri5_{kind}": lambda array, arrays: np.repeat(array, 2, axis=0) if array.ndim == 2 else array
        for kind in ("guided", "plain", "hard")}}),
    "cdamd/edit": Copy({**starts("inpainting/"), **starts("suffix/")}),
    "cdamd/generate": Copy(starts()), "cdamd/generate_mardm": Copy(starts(rounds=6)),
    "cdamd/generate_mardm_ddpm": Copy(starts(rounds=3)),
    "cdamd/evaluator_clip": Copy(left_out=(*CONTRASTED, "out/clip_score_sum")),
    "cdamd/train_step": Copy(tiled=True),  # its noise is listed for masked latents, copy after copy
    **{f"cmdm/{name}": Copy() for name in ("dit_tables", "mac_vae", "mac_vae_long")},
    "cmdm/causal_dit": Copy(numbered=LISTED), "cmdm/full_generate": Copy(numbered=LISTED),
    "cmdm/continuation": Copy({"in/fresh/": 1}, 2, numbered=LISTED),
    "cmdm/sampling": Copy({"out/levels/": None}, 2, numbered=LISTED),
    **{f"cmdm/evaluators_{columns}": Copy(left_out=CONTRASTED) for columns in (67, 259)},
    "cmdm/motion_patches": Copy({"in/joints": 0}, 4, arguments=("frames",), left_out=CONTRASTED, tiled=True),
    "cmdm/part_tmr": Copy(left_out=CONTRASTED),
    "cmdm/tmr": Copy(arguments=("frames",), left_out=(
        *CONTRASTED, "out/similarity", "out/filtered", "out/loss", "out/term_grad", "out/grad")),
    # The GRU of the reference runs over the batch.
    "mdm/mdm_decoder_pooled": Copy({"in/text": 1}, left_out=("out/gru/",)),
    "mdm/mdm_decoder_words": Copy({"in/words": 1}),
    "mdm/mdm_encoder": Copy({"in/text": 1}), "mdm/mdm_losses": Copy({"in/text": 1}),
    "mdm/mdm_losses_geometric": Copy(), "mdm/mdm_tables": Copy(batch=4), "mdm/mdm_targets": Copy(meta=GOALS),
    "mdm/mdm_dip": Copy({"in/noise": 2, "in/words": None}, arguments=("sentence", "changing"), meta=GOALS),
    "mdm/mdm_edit": Copy({"in/text": 1, "in/noise": 1, "out/in_between_range": None}),
    "mdm/mdm_sample": Copy({"in/text": 1, "in/native50/": 1, "in/respaced50/": 1}),
    "mld/mld_denoiser": Copy(tiled=True), "mld/mld_tables": Copy({"out/ddim50/next": 1}),
    "mld/mld_diffusion_loss": Copy({"in/text": before_last, "in/eps": 1}, numbered=("in/drop_u",)),
    "mld/mld_novae": Copy({"in/text": 0, "in/noise": 1}), "mld/mld_sample": Copy({"in/text": 0}),
    "mld/mld_vae": Copy({"in/eps": 1}), "mld/mld_vae_loss": Copy({"in/eps": 1}),
    "mld/mld_vae_variants": Copy({"in/tokens/eps": 1, "in/linear/eps": 1}),
    **{f"momask/{name}": Copy() for name in (
        "mask_corruption", "mask_train_step", "mask_transformer", "residual_generate", "residual_train_step",
        "residual_transformer", "rvq_eval")},
    "momask/edit": Copy({"out/middle/edit_mask": None, "out/frames/edit_mask": None}),
    "momask/mask_generate": Copy({f"out/no_text/{name}": 1 for name in ("masked", "input", "drawn")}),
    "momask/pipeline": Copy(numbered=("out/joints", "out64/joints")),
    "motion/joints": Copy(),
    "motionstreamer/ms_generate": Copy({"in/text": 0, "in/start": 1, "in/steps": 2, "in/reference_end": None}, 1),
    "motionstreamer/ms_head": Copy({"in/steps": 1}), "motionstreamer/ms_tae": Copy(),
    "motionstreamer/ms_transformer": Copy(),
    "t2m_gpt/gpt": Copy(), "t2m_gpt/gpt_sample": Copy(),
    "t2m_gpt/gpt_train": Copy(left_out=("out/fixed/right", "out/drawn/right")),
    "t2m_gpt/pipeline": Copy(numbered=tuple(f"{out}/{name}" for out in ("out", "out64") for name in (
        "codes", "motion", "joints"))),
    "t2m_gpt/vq_eval": Copy(left_out=("out/decoded_batch",)),
    **{f"text/{name}": Copy() for name in ("bert", "clip_text", "distilbert")},
    **{f"text/t5_v1_{kind}": Copy({"out/position_bias": None}) for kind in (0, 1)},
}
WITHOUT = {
    **dict.fromkeys(("cdamd/masks", "cdamd/text_assembly", "cmdm/schedules", "cmdm/word_vectors", "data/windows",
                     "momask/schedules", "momask/statistics", "motion/features_humanml3d", "motion/features_kit",
                     "t2m_gpt/token_items"), "has no batch"),
    **dict.fromkeys(("cdamd/rvq_train", "cdamd/rvq_train_small", "momask/rvq_train_step", "t2m_gpt/quantizer_train",
                     "t2m_gpt/vq_train_step"), "codebooks follow how often the whole batch uses a code"),
    **dict.fromkeys(("cdamd/metrics", "cmdm/protocol", "cmdm/scores"), "scores of whole sets"),
    **dict.fromkeys(("cmdm/mac_vae_loss", "cmdm/mac_vae_loss_reversed", "motionstreamer/ms_tae_loss"),
                    "the loss is a sum over the batch"),
    "motionstreamer/ms_stream": "one stream", "motionstreamer/ms_two_forward": "lists what counts of the batch",
}
QUICK = ("motion/joints", "momask/mask_corruption", "cdamd/corruption", "cdamd/edit_masks", "cdamd/ae63",
         "mdm/mdm_edit", "cdamd/length_estimator", "mld/mld_tables")
SLOW = ("mdm/mdm_dip", "mld/mld_diffusion_loss", "momask/pipeline", "motionstreamer/ms_generate", "cmdm/causal_dit",
        "cdamd/generate_mardm_ddpm", "t2m_gpt/gpt_train")


def doubled(name, folder):
  """The path of a copy of a recording with twice the rows."""
  copy = COPIES[name]
  with np.load(fixtures.path(f"{name}.npz"), allow_pickle=False) as file:
    arrays = {key: file[key] for key in file.files}
  meta = json.loads(str(arrays.pop("meta")))
  size = copy.batch or len(next(arrays[f"in/{key}"] for key in FIRST if f"in/{key}" in arrays))
  twice = lambda array, axis: np.concatenate([array] * 2, axis) if copy.tiled else np.repeat(array, 2, axis)
  made = {}
  for key, array in arrays.items():
    of32 = key.replace("out64/", "out/")
    if key.startswith("param/") or of32.startswith(copy.left_out or ("-",)):
      made |= {key: array} if key.startswith("param/") else {}
      continue
    begun = next((begin for begin in copy.numbered if key.startswith(begin) and key[len(begin):].isdigit()), None)
    if begun is not None:
      made |= {f"{begun}{2 * int(key[len(begun):]) + i}": array for i in range(2)}
      continue
    given = [begin for begin in copy.axes if of32.startswith(begin)]
    first = 1 if key.startswith("in/") else 0 if "grad/" in key else 2  # axes that may be those of rows
    axis = copy.axes[max(given, key=len)] if given else next((
        i for i in range(first) if array.shape[i:i + 1] == (size,)), None)
    made[key] = axis(array, arrays) if callable(axis) else array if axis is None else twice(array, axis)
  both = lambda rows: [rows[i] for i in twice(np.arange(len(rows)), 0)]
  choices = meta.get("arguments") or meta.get("config") or {}
  choices |= {key: both(choices[key]) for key in copy.arguments}
  meta |= {key: both(meta[key]) for key in copy.meta}
  path = folder / f"{name.split('/')[1]}.npz"
  np.savez(path, meta=json.dumps(meta), **made)
  return path, {key for key in made if key.startswith("out/") and made[key].size > arrays.get(key, made[key]).size}


@pytest.fixture(scope="module", autouse=True)
def runners():
  golden.import_runners()


@pytest.mark.parametrize("name", some_of(COPIES, quick=QUICK, slow=SLOW))
def test_a_batch_of_twice_the_rows_is_computed_by_the_same_runner(name, tmp_path):
  path, grown = doubled(name, tmp_path)
  failures = golden.check(path, ["float32"]).failures
  assert not failures
  assert grown or COPIES[name].numbered or name == "cdamd/train_step"  # whose outputs are a loss and its gradients


def test_every_recording_is_doubled_or_cannot_be():
  recorded = {f"{path.parent.name}/{path.stem}" for path in fixtures.path(".").glob("*/*.npz")
              if path.parent.name != "robots" and "meta" in np.load(path).files}
  assert recorded == COPIES.keys() | WITHOUT.keys() and not COPIES.keys() & WITHOUT.keys()
