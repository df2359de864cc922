"""Motions that continue an existing one: its end is encoded, and new latents are sampled after it."""
from collections.abc import Sequence

import jax
import numpy as np

from motion_jax.models.cmdm import multi_prompt, offline, streaming
from motion_jax.models.cmdm.loop import SamplingLoop, decode_all
from motion_jax.models.cmdm.networks import CmdmNetworks
from motion_jax.models.cmdm.options import CmdmSampling
from motion_jax.models.results import cleanup_record, features_of
from motion_jax.models.shared.script import borders, segment_ends
from motion_jax.motion.cleanup import clean_up
from motion_jax.motion.representations import to_joints
from motion_jax.motion.step_records import Record
from motion_jax.shapes import Float, Num
from motion_jax.text.contrast import Contrast
from motion_jax.utils.errors import InputError


def encode_past(model: CmdmNetworks, joints: Num[np.ndarray, "t j 3"], count: int) -> Float[np.ndarray, "1 p c"]:
  """Clean latents (1, P, C) of the last frames of joints (T, J, 3), as many as there are up to `count`."""
  frames_per_latent = model.frames_per_latent
  least = max(frames_per_latent, 3)
  if len(joints) < least:
    raise InputError(f"got a motion of {len(joints)} frames, expected {least} or more to continue from")
  features = model.stats.normalize(features_of(model, joints))
  known = min(count, len(features) // frames_per_latent)
  # A causal encoder ignores later frames: padding to one length compiles one program.
  padding = (count - known) * frames_per_latent * model.vae.causal
  padded = np.pad(features[-known * frames_per_latent:], ((0, padding), (0, 0)))
  return np.asarray(model.compiled.encode(model.codec, padded[None]))[:, :known]


def extend(model: CmdmNetworks, plan: streaming.Plan, sampling: CmdmSampling, joints: Num[np.ndarray, "t j 3"],
           past_prompt: str, prompts: Sequence[str], frames: Sequence[int], keys: jax.Array,
           contrast: Contrast | None = None, way: str = "stream", num_past: int | None = None, cleanup: bool = True
           ) -> tuple[Float[np.ndarray, "n j 3"], list[int], list[Record]]:
  """The continuation of joints (T, J, 3): (joints (P + N, J, 3), frames at which segments end, records of the cleanup).

  The new latents are decoded after those of the past: the first P of these frames show the end of the given motion,
  except for the tokenizer's error and its place on the ground.
  """
  if not plan.lag:
    raise InputError("got schedule 'full': a motion continues only by schedule 'fss' or 'ar'")
  known, frames_per_latent = encode_past(model, joints, plan.context), model.frames_per_latent
  past = known[:, -(num_past or (plan.context if way == "stream" else 1)):]
  if way == "stream":
    frames_per_block = plan.block * frames_per_latent
    blocks, total = borders(frames, frames_per_block)
    request = offline.Request([[past_prompt, *prompts]], multi_prompt.segments_of_blocks([blocks], sum(blocks)) + 1,
                              [total], keys, np.array([sampling.guidance_scale]), contrast)  # caption 0 is the past's
    loop = SamplingLoop(model, plan, request.scale, keys, offline.latents_of([total], frames_per_latent))
    new = np.concatenate(list(offline.blocks(loop, request, past)), axis=1)
    ends = segment_ends(frames, frames_per_block)
  else:
    counts = [max(1, int(number) // frames_per_latent) for number in frames]
    parts = multi_prompt.chained(model, plan, sampling, [prompts], [counts], [[past[0]]], keys, contrast,
                                 past.shape[1])[0]
    new, ends = np.concatenate(parts[1:])[None], (np.cumsum(counts) * frames_per_latent).tolist()
  length, layout = known.shape[1] * frames_per_latent + ends[-1], model.stats.layout
  whole = decode_all(model, np.concatenate([known, new], axis=1), [length])
  features = model.stats.denormalize(whole)[0, :length]
  decoded, contacts = to_joints(features, layout), layout.contacts(features)
  if not (cleanup and layout.has_fixed_bones and contacts is not None):
    return decoded, ends, []
  cleaned, new_frames = clean_up(decoded, contacts, layout.skeleton, smoothing=model.smoothing), slice(-ends[-1], None)
  return cleaned, ends, [cleanup_record(decoded[new_frames], cleaned[new_frames], layout.skeleton, len(joints))]
