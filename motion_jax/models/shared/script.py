"""Prompts in sequence on a grid of blocks: where segments end, and which prompt each block of a stream has."""
import copy
from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np


def borders(frames: Sequence[int], frames_per_block: int) -> tuple[list[int], int]:
  """(blocks that each segment has, total frames): ends rounded to the nearest block, at least one block each.

  The last segment's blocks reach the total, which is cut to the requested length.
  """
  ends = np.cumsum(frames) / frames_per_block
  blocks, count = [], 0
  for end in ends[:-1]:
    blocks.append(max(int(np.floor(end + 0.5)) - count, 1))
    count += blocks[-1]
  blocks.append(max(int(np.ceil(ends[-1] - 1e-9)) - count, 1))
  total = int(sum(frames))
  return blocks, total if total > (sum(blocks) - 1) * frames_per_block else sum(blocks) * frames_per_block


def segment_ends(frames: Sequence[int], frames_per_block: int) -> list[int]:
  """The frames at which segments of whole blocks end where these numbers of frames were requested."""
  blocks, total = borders(frames, frames_per_block)
  return np.minimum(np.cumsum(blocks) * frames_per_block, total).tolist()


class Entry(NamedTuple):
  """A prompt of a stream, the first block that has it, and its number: 1 for the first prompt of the stream."""
  first: int
  prompt: str
  number: int


class Script:
  """The prompts of a stream by block: the current ones and those that follow."""

  def __init__(self, segments: Sequence[tuple[str, int | None]], block_frames: int) -> None:
    """segments: [(prompt, frames)] in sequence, the last without end."""
    self._block_frames, self._count = block_frames, 0
    self.entries: list[Entry] = []
    self.say(segments, 0)

  def say(self, segments: Sequence[tuple[str, int | None]], first: int) -> None:
    """Replaces all prompts from block `first` on by those of segments."""
    blocks, _ = borders([count or 1 for _, count in segments], self._block_frames)
    starts = first + np.cumsum([0, *blocks[:-1]])
    self.entries = [entry for entry in self.entries if entry.first < first] + [
        Entry(int(start), prompt, self._count + i)
        for i, (start, (prompt, _)) in enumerate(zip(starts, segments), start=1)]
    self._count += len(segments)

  def at(self, block: int) -> Entry:
    """The entry of a block; the oldest one for blocks before it."""
    return next((entry for entry in reversed(self.entries) if entry.first <= block), self.entries[0])

  def forget(self, block: int) -> None:
    """Drops the entries that no block from this one on has."""
    first = self.at(block).first
    self.entries = [entry for entry in self.entries if entry.first >= first]

  def copy(self) -> Self:
    """A script that changes independently of this one."""
    other = copy.copy(self)
    other.entries = list(self.entries)
    return other
