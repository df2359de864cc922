"""Writing a store of latents: frozen networks applied to all cuts and captions that training may draw."""
import itertools
from collections.abc import Callable

import jax
import numpy as np
import tqdm

from motion_jax.data import store
from motion_jax.data.batches import TextItems
from motion_jax.text.captions import with_subjects
from motion_jax.text.encoder import TextEncoder


def identity(codecs, items: TextItems, encoder: TextEncoder) -> dict[str, str]:
  """{part: digest} of what a store is made from; codecs: the tree of the tokenizers' parameters."""
  return {"tokenizer": store.digest_of(codecs), "data": store.digest_of(items.features),
          "rules of cutting": store.digest_of(np.array(list(items.cuts()), np.int64)),
          "text encoder": encoder.fingerprint}


def write(folder, codecs, items: TextItems, encoder: TextEncoder, encode: Callable, vary_subject, *, latents_look_back,
          batch_size=16):
  """Writes a store of the cuts of items and of their captions; returns a line about it.

  encode(codecs, features (B, T, F), num_frames (B,)) -> {table: rows (B, L, C)}, pure. vary_subject: training varies
  the subject of captions. latents_look_back: see `store.stored_batch`; then the longest cut from each frame is enough.
  """
  captions = sorted({said for i in items.kept for caption in items.captions[i]
                     for said in (with_subjects(caption) if vary_subject else [caption])})
  encoder.check(captions)
  cuts = list(items.cuts())
  if latents_look_back:  # cuts come with the longest of a clip first
    cuts = list({(clip, start): (clip, start, count, length) for clip, start, count, length in reversed(cuts)}.values())
  run, done = jax.jit(encode), []
  with store.writing(folder) as writer:
    with tqdm.tqdm(total=len(cuts), unit="cut", dynamic_ncols=True, disable=None) as bar:
      for length, group in itertools.groupby(sorted(cuts, key=lambda cut: cut[3]), lambda cut: cut[3]):
        group = list(group)
        for some in (group[at:at + batch_size] for at in range(0, len(group), batch_size)):
          features, counts = np.zeros((batch_size, length, items.features[0].shape[-1]), np.float32), [0] * batch_size
          for row, (clip, start, count, _) in enumerate(some):
            features[row, :count], counts[row] = items.features[clip][start:start + count], count
          made = jax.tree.map(np.asarray, run(codecs, features, np.array(counts, np.int32)))
          for row, count in enumerate(counts[:len(some)]):
            for table, rows in made.items():
              writer.add(table, rows[row, :count // items.frames_per_latent])
          done += [cut[:3] for cut in some]
          bar.update(len(some))
    said = []
    for caption, rows in encoder.in_batches(captions):
      writer.add(store.WORDS, rows)
      said.append(caption)
    writer.close(identity(codecs, items, encoder), done, said)
  return f"wrote {folder}: {len(done)} cuts of {len(items)} clips, {len(said)} captions"
