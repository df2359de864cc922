"""Evaluators and how they learn: motions and sentences by contrast, so that benchmarks can measure in their space.

Facts: cdamd 8.1 (movement autoencoder, then matching), 8.2 (CLIP-type). Networks: `metrics.evaluators`.
"""
import numpy as np


def piece_tables(encoder):
  """Token (V, W) and position (P, W) tables of a BERT- or CLIP-like text encoder, which the CLIP-type evaluator reads.

  The network finds the end of a sentence at its largest id, as CLIP's is; where the encoder's end piece is another, it
  is given a new last row.
  """
  params = encoder.params
  if not {"words", "positions"} <= params.keys():
    raise ValueError(f"text encoder {encoder.name!r} has no tables of words and positions; take a CLIP or BERT model")
  tokens, positions = (np.asarray(params[name]["embedding"]) for name in ("words", "positions"))
  end = _end(encoder)
  return (tokens if end == len(tokens) - 1 else np.concatenate([tokens, tokens[end:end + 1]])), positions


def piece_ids(encoder, captions, max_words):
  """Sentences to word pieces (B, max_words): begin, words, end (the largest id), zeros. Longer ones are cut."""
  end, rows = _end(encoder), len(encoder.params["words"]["embedding"])
  out = np.zeros((len(captions), max_words), np.int32)
  for row, caption in zip(out, captions):
    ids = encoder.tokenizer.encode(caption).ids[:-1][:max_words - 1]
    row[:len(ids)], row[len(ids)] = ids, end if end == rows - 1 else rows
  return out


def _end(encoder):
  return encoder.tokenizer.encode("a").ids[-1]
