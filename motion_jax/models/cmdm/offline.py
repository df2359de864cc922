"""Whole motions by the loop of a stream, in batches (`shared.batches`), which compiles nothing for another length."""
import dataclasses
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import numpy as np

from motion_jax.control.guidance import SETTLING, TOLERANCE
from motion_jax.control.signal import ControlSignal
from motion_jax.models.cmdm import streaming
from motion_jax.models.cmdm.guiding import SETTLED, Guide
from motion_jax.models.cmdm.loop import SamplingLoop, behind_nothing, decode_all
from motion_jax.models.cmdm.networks import CmdmNetworks
from motion_jax.models.shared.batches import batches, joined, select
from motion_jax.shapes import Float, Int
from motion_jax.text.contrast import Contrast

SIZES = (1, 4)  # of batches
CAPTIONS = 4  # different captions that a window shows before its step is compiled for twice as many


class Request(NamedTuple):
  """Motions to sample: captions of each, which of them each block has (M, N), frames of each (M,), a key and a
  guidance scale each.

  signal (M, T): constraints that they are held to, by control_steps and refinements (`CmdmModel`).
  """
  prompts: Sequence[Sequence[str]]
  segment: Int[np.ndarray, "m n"]
  frames: Sequence[int]
  keys: jax.Array | np.ndarray
  scale: Float[np.ndarray, " m"]
  contrast: Contrast | None = None
  signal: ControlSignal | None = None
  control_steps: int = 0
  refinements: int = 0


def latents_of(frames: Sequence[int], frames_per_latent: int) -> Int[np.ndarray, " b"]:
  """How many latents motions of these numbers of frames have."""
  return -(-np.asarray(frames) // frames_per_latent)


def captions_seen(segment: Int[np.ndarray, "b n"], width: int) -> int:
  """How many captions a window of `width` blocks shows at most, up to a power of two.

  segment (B, num_blocks): rising integers, which caption each block has.
  """
  last = segment[:, np.minimum(np.arange(segment.shape[1]) + width - 1, segment.shape[1] - 1)]
  return 1 << int((last - segment).max()).bit_length()


def sample(model: CmdmNetworks, plan: streaming.Plan, request: Request) -> Float[np.ndarray, "m t f"]:
  """Normalized features (M, frames, F) of whole blocks; those after a motion's own length mean nothing.

  Motions of half a window's length and less have a window of that width: a second program, which runs twice as fast."""
  half, parts = -(-plan.width // 2), []
  plan = plan.fitted(half) if request.segment.shape[1] <= half else plan
  for index in batches(len(request.prompts), SIZES):
    signal = select(request.signal, index)
    parts.append(_batch(model, plan, request._replace(
        prompts=[request.prompts[i] for i in index], segment=request.segment[index],
        frames=np.asarray(request.frames)[index], keys=request.keys[index], scale=np.asarray(request.scale)[index],
        signal=signal)))
  return joined(parts, len(request.prompts))


def _batch(model, plan, request):
  loop, control = SamplingLoop(model, plan, request.scale, request.keys,
                               latents_of(request.frames, model.frames_per_latent)), request.signal
  if control is not None:
    control = control if not control.is_empty else None
    loop.hold(control, request.control_steps, np.zeros((loop.batch, 3), np.float32))
  is_pulled = control is not None and request.control_steps > 0
  latents, features = [], []
  for block in blocks(loop, request):
    latents.append(block)
    if not model.vae.causal:
      continue
    features.append(loop.decode(block))
    if is_pulled:
      loop.follow(model.stats.denormalize(features[-1]))
  if not model.vae.causal:
    return decode_all(model, np.concatenate(latents, axis=1), request.frames)
  if not (is_pulled and request.refinements):
    return np.concatenate(features, axis=1)
  return decode_all(model, _settled(model, plan, np.concatenate(latents, axis=1), request))


def blocks(loop: SamplingLoop, request: Request, past: Float[np.ndarray, "b p c"] | None = None
           ) -> Iterator[Float[np.ndarray, "b n c"]]:
  """Yields the clean blocks (B, block, C) of a request whose rows are those of the loop, after clean latents that were
  made with their first caption."""
  captions = Captions(loop, request)
  if past is not None:
    loop.prefill(past, caption=0)
  plan, segment = loop.plan, request.segment
  since = None if plan.memory is None else np.asarray(streaming.seen_since(plan, segment))
  ends = np.asarray(streaming.caption_ends(segment, loop.lengths, plan.block))
  for _ in range(plan.age + segment.shape[1] - 1):
    at = np.clip(loop.base + np.arange(plan.width), 0, segment.shape[1] - 1)
    block = loop.step(captions.show(segment[:, at]), None if since is None else since[:, at], until=ends[:, at])
    if block is not None:
      yield block


class Captions:
  """The captions of motions in as many places as a window shows at a time: caption i is in place i modulo their
  number."""

  def __init__(self, loop: SamplingLoop, request: Request) -> None:
    self._loop = loop
    self._places = max(CAPTIONS, captions_seen(request.segment, loop.plan.width))
    names = list(dict.fromkeys(prompt for row in request.prompts for prompt in row))
    self._emb, self._mask = loop.model.encode_words(names, request.contrast)
    self._index = [[names.index(prompt) for prompt in row] for row in request.prompts]
    self._shown = np.array([[row[min(place, len(row) - 1)] for place in range(self._places)] for row in self._index])
    self._say()

  def _say(self):
    self._loop.say(self._emb[self._shown], self._mask[self._shown])

  def show(self, captions: Int[np.ndarray, "b w"]) -> Int[np.ndarray, "b w"]:
    """The places of the captions (B, W) of a window."""
    places, before = captions % self._places, self._shown.copy()
    for row, (own, index) in enumerate(zip(captions, self._index)):
      self._shown[row, places[row]] = np.array(index)[own]
    if (before != self._shown).any():
      self._say()
    return places


def _settled(model, plan, latents, request):
  """Finished latents (B, L, C), pulled once more all together (`Guide.settle`), by the program that pulls a window:
  longer motions are as long as two of them, four, ..."""
  count, fpl = latents.shape[1], model.frames_per_latent
  length = plan.width * plan.block
  while length < count:
    length *= 2
  signal = jax.tree.map(np.asarray, request.signal.slice_frames(0, count * fpl).slice_frames(0, length * fpl))
  guide = dataclasses.replace(Guide.of(model.codec, model.stats, signal), first=np.int32(0))
  latents = np.pad(latents, ((0, 0), (0, length - count), (0, 0)))
  behind, variance = tuple(behind_nothing(model, len(latents))), np.full((1, length, 1), SETTLED, np.float32)
  for _ in range(request.refinements):
    latents = latents + np.asarray(model.compiled.pull(
        guide, behind, np.int32(0), latents, variance, np.int32(SETTLING), np.float32(TOLERANCE / 2)))
  return latents[:, :count]
