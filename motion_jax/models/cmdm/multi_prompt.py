"""Whole motions of one prompt or several in sequence; `live` is the streaming form.

Prompts change on a grid of blocks (3 latents, 12 frames, 0.6 s).
"""
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from motion_jax.control.signal import ControlSignal
from motion_jax.models.cmdm import offline, streaming
from motion_jax.models.cmdm.guiding import Guide
from motion_jax.models.cmdm.loop import decode_all
from motion_jax.models.cmdm.networks import CmdmNetworks
from motion_jax.models.cmdm.options import CmdmSampling
from motion_jax.models.cmdm.sampling import words_of_latents
from motion_jax.models.shared.script import borders, segment_ends
from motion_jax.shapes import Array, Bool, Float, Int
from motion_jax.text.clauses import clauses_of
from motion_jax.text.contrast import Contrast
from motion_jax.utils.errors import InputError

_BUCKET = 4         # blocks; lengths are rounded up to it, so that not every length waits for a compiler


def segment_frames(frames: Sequence[int], way: str, frames_per_block: int, frames_per_latent: int) -> list[int]:
  """The frames that each segment gets where `frames` were requested: whole blocks of a stream, or whole latents."""
  if way != "stream":
    return [max(1, int(count) // frames_per_latent) * frames_per_latent for count in frames]
  return np.diff(segment_ends(frames, frames_per_block), prepend=0).tolist()


def by_clauses(lists: Sequence[Sequence[tuple[str, int]]], frames_per_block: int, known: Callable[[str], bool]
               ) -> list[list[tuple[str, int]]]:
  """Lists of (prompt, frames) in which prompts of several clauses are replaced by these, with equal shares of the
  blocks. Known prompts stay, for training has shown when their actions happen, and those of fewer blocks than clauses.
  """
  rows = []
  for segments in lists:
    ends, row = segment_ends([count for _, count in segments], frames_per_block), list[tuple[str, int]]()
    for (prompt, _), first, past in zip(segments, [0, *ends], ends):
      parts, blocks = clauses_of(prompt), -(-(past - first) // frames_per_block)
      parts = [prompt] if len(parts) > blocks or len(parts) > 1 and known(prompt) else parts
      borders = [first + round(blocks * at / len(parts)) * frames_per_block for at in range(len(parts))]
      row += [(part, stop - start) for part, start, stop in zip(parts, borders, [*borders[1:], past])]
    rows.append(row)
  return rows


def captions_of(model: CmdmNetworks, prompts: Sequence[Sequence[str]], contrast: Contrast | None = None
                ) -> tuple[Float[np.ndarray, "b g s e"], Bool[np.ndarray, "b g s"]]:
  """Embeddings of all prompts of each motion: text_emb (B, G, S, E), text_mask (B, G, S), G a power of two."""
  count = 1 << (max(map(len, prompts)) - 1).bit_length()
  padded = [list(row) + [row[-1]] * (count - len(row)) for row in prompts]
  names = list(dict.fromkeys(prompt for row in padded for prompt in row))
  emb, mask = model.encode_words(names, contrast)
  index = np.array([[names.index(prompt) for prompt in row] for row in padded])
  return emb[index], mask[index]


def segments_of_blocks(blocks: Sequence[Sequence[int]], num_blocks: int) -> Int[np.ndarray, "b {num_blocks}"]:
  """(B, num_blocks): which segment each block is in; what is beyond a motion's end is its last segment's."""
  rows = [np.repeat(np.arange(len(counts)), counts) for counts in blocks]
  return np.stack([np.pad(row, (0, num_blocks - len(row)), mode="edge") for row in rows]).astype(np.int32)


def stream(model: CmdmNetworks, plan: streaming.Plan, sampling: CmdmSampling, prompts: Sequence[Sequence[str]],
           frames: Sequence[Sequence[int]], keys: jax.Array, contrast: Contrast | None = None,
           signal: ControlSignal | None = None, **control: Any
           ) -> tuple[Float[Array, "b t f"], Sequence[int], list[list[int]]]:
  """Motions of several prompts in one run, whose text changes from block to block.

  prompts, frames: lists of lists, one per motion; signal (B, T) and control: see `run`. Returns (normalized features
  (B, T, F), total frames of each motion, lists of the frames at which its segments end).
  """
  frames_per_block = plan.block * model.frames_per_latent
  blocks, totals = zip(*(borders(counts, frames_per_block) for counts in frames))
  segment = segments_of_blocks(blocks, max(map(sum, blocks)))
  if signal is not None:
    control["signal"] = signal.slice_frames(0, segment.shape[1] * frames_per_block)
  features = run(model, plan, sampling, prompts, segment, totals, keys, contrast, **control)
  return features, totals, [segment_ends(counts, frames_per_block) for counts in frames]


def run(model: CmdmNetworks, plan: streaming.Plan, sampling: CmdmSampling, prompts: Sequence[Sequence[str]],
        segment: Int[np.ndarray, "b n"], frames: Sequence[int], keys: jax.Array, contrast: Contrast | None = None,
        **control: Any) -> Float[Array, "b t f"]:
  """Normalized features of motions of B numbers of frames, whose blocks have the captions that segment (B, num_blocks)
  says; control: of `offline.Request`. A plan without a lag cleans all latents together, by a program for each length;
  of motions longer than those of training, without constraints, as many as these have (`_windows`).
  """
  length = segment.shape[1] * plan.block
  plan = plan._replace(context=min(plan.context, max(model.context, length)))  # no more than there is
  if plan.lag:
    key_data = np.asarray(jax.random.key_data(keys))
    scale = np.full(len(prompts), sampling.guidance_scale, np.float32)
    return offline.sample(model, plan, offline.Request(prompts, segment, frames, key_data, scale, contrast,
                                                         **control))
  if length > model.context and not control:
    return decode_all(model, _windows(model, plan, sampling, prompts, segment, frames, keys, contrast), frames)
  num_blocks = -(-segment.shape[1] // _BUCKET) * _BUCKET
  segment = np.pad(segment, ((0, 0), (0, num_blocks - segment.shape[1])), mode="edge")
  plan = plan._replace(context=max(plan.context, num_blocks * plan.block))
  text_emb, text_mask = captions_of(model, prompts, contrast)
  guidance: dict[str, Any] = {}
  signal, control_steps = control.get("signal"), control.get("control_steps", 0)
  if signal is not None:
    signal = signal.slice_frames(0, num_blocks * plan.block * model.frames_per_latent)
    guidance = dict(control=signal) if model.dit.control else {}
    guidance |= dict(guide=Guide.of(model.codec, model.stats, signal, control_steps, control["refinements"])
                     ) if control_steps else {}
  return model.compiled.generate_whole(
      plan.fitted(num_blocks), num_blocks, model.params, model.codec, text_emb=text_emb, text_mask=text_mask,
      scale=sampling.guidance_scale, keys=keys, segment=segment,
      lengths=offline.latents_of(frames, model.frames_per_latent), **guidance)


def _windows(model, plan, sampling, prompts, segment, frames, keys, contrast):
  """Clean latents (B, L, C) by a plan that cleans all together, no more of them than a motion of training has.

  The first half of each further window is the last half of the one before, with fresh noise of the window's level in
  every step (`sampling.renoised`), as the network knows it; latents have their own captions.
  """
  _demand_euler(plan)
  size, block = model.context, plan.block
  plan, keep, shown = plan._replace(context=size), size // block // 2 * block, np.repeat(segment, block, axis=1)
  text_emb, text_mask = captions_of(model, prompts, contrast)
  seen = streaming.seen_since(plan, segment)
  seen = None if seen is None else block * np.repeat(np.asarray(seen), block, axis=1)
  ends = np.repeat(streaming.caption_ends(segment, offline.latents_of(frames, model.frames_per_latent), block), block,
                   axis=1) if model.dit.time_left else None
  latents, lengths = np.zeros((len(prompts), 0, model.dit.latent_dim), np.float32), offline.latents_of(
      frames, model.frames_per_latent)
  while latents.shape[1] < shown.shape[1]:
    past = latents[:, -keep:]
    start = latents.shape[1] - past.shape[1]
    places = np.minimum(start + np.arange(size), shown.shape[1] - 1)
    part, since = shown[:, places], None if seen is None else np.maximum(seen[:, places] - start, 0)
    until = None if ends is None else ends[:, places] - start
    relative = part - part[:, :1]
    at = np.minimum(part[:, :1] + np.arange(1 << int(relative.max()).bit_length()), text_mask.shape[1] - 1)
    rows = np.arange(len(at))[:, None]
    emb, mask = words_of_latents(text_emb[rows, at], text_mask[rows, at], relative)
    latents = np.concatenate([latents, np.asarray(model.compiled.chain_segment(
        plan, size, model.params, text_emb=emb, text_mask=mask, scale=sampling.guidance_scale,
        lengths=np.clip(lengths - latents.shape[1], 1, size - past.shape[1]), past=past, since=since, until=until,
        keys=jax.vmap(lambda key, start=start: jax.random.fold_in(key, start))(keys)))], axis=1)
  return latents[:, :shown.shape[1]]


def chain(model: CmdmNetworks, plan: streaming.Plan, sampling: CmdmSampling, prompts: Sequence[Sequence[str]],
          frames: Sequence[Sequence[int]], keys: jax.Array, contrast: Contrast | None = None, num_past: int = 1,
          **control: Any) -> tuple[Float[Array, "b t f"], Sequence[int], list[list[int]]]:
  """Motions of several prompts by the released code's procedure; arguments and results as of `stream`, without
  constraints.

  Each segment is sampled by itself after the last num_past latents of the one before, which get fresh noise in every
  step, with its own caption only; all latents are decoded in one pass (docs/papers/cmdm.md#multi-prompt).
  """
  frames_per_latent = model.frames_per_latent
  counts = [[max(1, int(number) // frames_per_latent) for number in row] for row in frames]
  chains = [np.concatenate(parts)
            for parts in chained(model, plan, sampling, prompts, counts, [[] for _ in counts], keys, contrast,
                                 num_past)]
  longest = max(map(len, chains))
  latents = np.stack([np.pad(z, ((0, longest - len(z)), (0, 0))) for z in chains])
  ends = [(np.cumsum(row) * frames_per_latent).tolist() for row in counts]
  totals = [row[-1] for row in ends]
  return decode_all(model, latents, totals), totals, ends


def _demand_euler(plan):
  if plan.solver != "euler":
    raise InputError(f"got solver {plan.solver!r}: a past with fresh noise in every step (way 'chain', and schedule "
                     "'full' after its first window) goes with euler alone")


def chained(model: CmdmNetworks, plan: streaming.Plan, sampling: CmdmSampling, prompts: Sequence[Sequence[str]],
            counts: Sequence[Sequence[int]], made: Sequence[Sequence[Float[np.ndarray, "n c"]]], keys: jax.Array,
            contrast: Contrast | None, num_past: int) -> list[list[Float[np.ndarray, "n c"]]]:
  """Lists of latents (N, C), one per segment of each motion, after those in `made`."""
  _demand_euler(plan)
  text_emb, text_mask = captions_of(model, prompts, contrast)
  latents_of = [list(parts) for parts in made]
  for i in range(max(map(len, counts))):
    lengths = np.array([row[i] if i < len(row) else 1 for row in counts])  # a motion that has ended idles
    given = num_past if latents_of[0] else 0
    longest = -(-int(lengths.max()) // (_BUCKET * plan.block)) * _BUCKET * plan.block
    past = [np.concatenate(parts)[-given:] if given else np.zeros((0, model.dit.latent_dim), np.float32)
            for parts in latents_of]
    if min(map(len, past)) < given:
      raise InputError(f"got a first segment of {min(map(len, past))} latents, the next one looks at {given}")
    at = min(i, text_mask.shape[1] - 1)
    segment_keys = jax.vmap(lambda key, i=i: jax.random.fold_in(key, i))(keys)
    latents = model.compiled.chain_segment(
        plan, given + longest, model.params, text_emb=text_emb[:, at], text_mask=text_mask[:, at],
        scale=sampling.guidance_scale, lengths=jnp.asarray(lengths), past=np.stack(past), keys=segment_keys,
        until=np.repeat(given + lengths[:, None], given + longest, axis=1) if model.dit.time_left else None)
    for parts, z, row in zip(latents_of, np.asarray(latents), counts):
      if i < len(row):
        parts.append(z[:row[i]])
  return latents_of
