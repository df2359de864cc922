"""Padded lengths of batches of captions: few of them, to limit compilation."""
import numpy as np


def padded_length(length, first, limit):
  """The padded number of word pieces of a batch whose longest caption has `length`: `first` times a power of two.

  There are few such lengths, hence few compiled programs. Only `first` and the caption itself may exceed `limit`.

    first 24, limit 64:   1 to 24 -> 24   25 to 48 -> 48   49 to 64 -> 64
  """
  padded = first
  while padded < length:
    padded *= 2
  return max(min(padded, limit), length, first)


def narrowest(usual):
  """The smallest width of batches whose captions usually have up to `usual` word pieces, as `first` of `padded_length`.

  `usual` is halved while at least 8 remain; the widths then include about `usual`:

    64 -> 8    24 -> 12    77 -> 10    6 -> 6
  """
  while usual >= 16:
    usual = -(-usual // 2)
  return usual


def pad(encodings, length):
  """Pads word pieces of captions: ids (B, length), and the mask of real ones (B, length)."""
  ids = np.zeros((len(encodings), length), np.int32)
  for row, encoding in zip(ids, encodings):
    row[:len(encoding)] = encoding
  return ids, np.arange(length) < np.array([len(e) for e in encodings])[:, None]
