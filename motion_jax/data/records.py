"""Convert any data folder to records: features in the files of tensorflow-datasets (read by `datasets.records`)."""
import json
import pathlib
import shutil

import ml_collections
import numpy as np

from motion_jax.data import sources
from motion_jax.data.datasets import records
from motion_jax.data.datasets.base import new_folder
from motion_jax.motion.representations import get_layout
from motion_jax.motion.stats import save_stats
from motion_jax.utils.errors import InputError

SPLITS = ("train", "val", "test")


def write(folders, out, layout="full", mode="corrected", mirror=True, overwrite=False) -> str:
  """Converts data folders of any known data set to records, and returns a summary to print.

  layout: of the features (`motion.representations`); mode and mirror: how to compute features that a folder does not
  hold already. `out` is created only if everything succeeds. Raises InputError without the extra `data`.
  """
  tfds, layout = records.tensorflow_datasets(), get_layout(layout)
  config = ml_collections.ConfigDict(dict(data=dict(name="archive", folder="", folders=tuple(map(str, folders)),
                                                    layout=layout.name, mode=mode, mirror=mirror)))
  message, config = sources.recognize(config), config.data
  splits = {}
  for split in SPLITS:
    parts, whole = (sources.load_items(config, split, captioned) for captioned in (True, False))
    if parts:
      splits[split] = parts
    sizes = lambda items: [(item.id, len(item.features)) for item in items]
    if whole and sizes(whole) != sizes(parts):
      splits[split + records.WHOLE] = whole
  if "train" not in splits:
    raise InputError(f"{', '.join(map(str, folders))}: no clip is in the split train, expected one: statistics "
                     "are made of these")
  with new_folder(out, overwrite) as folder:
    _write_tfds(tfds, folder, splits, layout)
    save_stats(sources.load_features(config).stats, folder)
    licenses = sorted({clip.license for clip in sources.load_clips(config) if clip.license})
    row = lambda item: dict(id=item.id, frames=len(item.features), captions=list(item.captions),
                            tokens=[list(words) for words in item.tokens], group=item.group or item.id)
    about = dict(format="records", layout=layout.name, mode=config.mode, license="; ".join(licenses),
                 splits={split: [row(item) for item in items] for split, items in splits.items()})
    (folder / records.INDEX).write_text(json.dumps(about, ensure_ascii=False) + "\n", encoding="utf-8")
    # This file marks a folder that this program made and may overwrite.
    origin = dict(format="records", sources=[pathlib.Path(source).name for source in folders])
    (folder / "dataset.json").write_text(json.dumps(origin) + "\n", encoding="utf-8")
  counts = ", ".join(f"{split} {len(items)}" for split, items in splits.items())
  return "\n".join(line for line in (message, f"wrote {out}: {counts} clips of {layout.name} features") if line)


def _write_tfds(tfds, folder, splits, layout):
  """Writes motions/1.0.0 by a builder of tensorflow-datasets, clips in the order of their split."""

  class Motions(tfds.core.GeneratorBasedBuilder, skip_registration=True):
    """Motions as features, with captions."""
    VERSION = tfds.core.Version("1.0.0")

    def _info(self):
      text = tfds.features.Text()
      return tfds.core.DatasetInfo(builder=self, description="Motions as features, with captions.",
                                   disable_shuffling=True, features=tfds.features.FeaturesDict({
                                       "id": text, "captions": tfds.features.Sequence(text), "group": text,
                                       "features": tfds.features.Tensor(shape=(None, layout.dim), dtype=np.float32)}))

    def _split_generators(self, dl_manager):
      return {split: self._generate_examples(items) for split, items in splits.items()}

    def _generate_examples(self, items):
      for place, item in enumerate(items):
        yield place, {"id": item.id, "captions": list(item.captions), "group": item.group or item.id,
                      "features": np.asarray(item.features, np.float32)}

  builder = Motions(data_dir=str(folder), file_format="array_record")
  builder.download_and_prepare()
  shutil.rmtree(folder / "downloads", ignore_errors=True)
