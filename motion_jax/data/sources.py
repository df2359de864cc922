"""Load the clips of a config's data section as features, from any source.

  data.name     data.folder (or folders)        layouts                          more
  humanml3d     HumanML3D's or KIT-ML's         full, essential, coordinates     KIT: full_kit, essential_kit, ...
  snapmogen     SnapMoGen's                     snapmogen, snapmogen_148
  babel         BABEL's, FlowMDM's form         babel                            kind: pairs, segments, both
  records       what `data records` makes       that which it was made for
  archive       folders of `datasets.archive`   any                              mode, mirror, kinematic_captions,
                                                                                 augment
  synthetic     none                            any                              mode, mirror, num_clips

Each data set is a file of `data.datasets`; `datasets.registry` lists them. The data set of a folder is detected before
it is read (`recognize`): a folder that `motion-jax data build` made works with a config for archives, and vice versa.
"""
import contextlib
import contextvars
import dataclasses

import numpy as np

from motion_jax.data.batches import balance_weights
from motion_jax.data.datasets.base import TextItem, augment_shares, clip_items
from motion_jax.data.datasets.records import RecordedFeatures
from motion_jax.data.datasets.registry import DATASETS, dataset_of, get_dataset
from motion_jax.motion.representations import FeatureLayout, get_layout
from motion_jax.motion.stats import Stats, biased_std, compute_stats
from motion_jax.utils.errors import InputError


@dataclasses.dataclass(frozen=True, eq=False)
class FeatureSet:
  """Clips of one split as normalized features (T_i, F), with captions and a group (an action) each.

  tokens: {caption: its tokens "lemma/POS"}, if the data set has them. spans: of each clip that was joined from several,
  (caption, first, past) in rows of its features; () for others. sources: the archive of each clip, "" if unknown.
  own_captions: `captions` without paraphrases (`data.paraphrases`). optimality: of scored samples
  (`diffusion.negative_aware`), None for other clips.
  """
  features: list[np.ndarray]
  captions: list[list[str]]
  groups: list[str]
  ids: list[str]
  stats: Stats
  layout: FeatureLayout
  tokens: dict[str, tuple[str, ...]] = dataclasses.field(default_factory=dict)
  spans: list[tuple[tuple[str, int, int], ...]] = dataclasses.field(default_factory=list)
  sources: list[str] = dataclasses.field(default_factory=list)
  own_captions: list[list[str]] = dataclasses.field(default_factory=list)
  optimality: list[float | None] = dataclasses.field(default_factory=list)

  def source_factors(self, config) -> np.ndarray | None:
    """Sampling factors (N,) of the clips by data.source_weights, pairs (archive, factor); None without them.

    Raises InputError for an archive that is not among the data.
    """
    factors = self._of_archives(config, "source_weights")
    return np.array([factors.get(source, 1.0) for source in self.sources], np.float64) if factors else None

  def draw_weights(self, config, kept=slice(None)) -> np.ndarray | None:
    """Sampling weights (N,) of the clips `kept`: data.balance over their groups, times `source_factors`, scaled so that
    archives have the shares of data.source_shares, pairs (archive, share of all draws); None if the config has none of
    these, and every clip occurs once per epoch.

    Raises InputError for an archive that is not among the data, and for shares that leave nothing for the others.
    """
    factors, shares = self.source_factors(config), self._of_archives(config, "source_shares")
    if not config.balance and factors is None and not shares:
      return None
    weights, sources = balance_weights(np.array(self.groups)[kept], config.balance), np.array(self.sources)[kept]
    weights = weights if factors is None else weights * factors[kept]
    if not all(0 < share < 1 for share in shares.values()) or sum(shares.values()) >= 1:
      raise InputError(f"got data.source_shares {tuple(shares.items())}, expected shares above 0, below 1 together")
    rest = ~np.isin(sources, list(shares))
    for archive, share in shares.items():
      inside = sources == archive
      weights[inside] *= share / weights[inside].sum()
    if shares:
      weights[rest] *= (1 - sum(shares.values())) / weights[rest].sum()
    return weights

  def _of_archives(self, config, name):
    """The pairs (archive, number) of a field as a dict. Raises InputError for an archive that is not read."""
    values = dict(config.get(name, ()))
    if unknown := sorted(set(values) - set(self.sources)):
      raise InputError(f"got data.{name} for {unknown[0]!r}, expected one of the archives that are read: "
                       f"{', '.join(sorted(set(self.sources) - {''})) or 'there is none'}")
    return values


def recognize(config):
  """Detects the data sets of a config's folders, updates its data section, and returns a message for the user, or "".

  config: an unlocked copy, as `fit.resolve` makes it. If data.name is a data set that is read clip by clip, data.name
  and data.folder or data.folders are set by the content of the folders: a single folder is configured by its own data
  set (`Dataset.configure`), several are read clip by clip as "archive". Procedural data are replaced by folders of any
  kind, which size tiny then trains on. Other data sets are used as named.
  """
  data = config.data
  if data.name not in DATASETS or not _gives_way(DATASETS[data.name]):
    return ""
  folders = tuple(data.get("folders", ())) or ((data.folder,) if data.get("folder") else ())
  if not folders:
    return ""
  if data.get("folder") and data.get("folders"):
    raise InputError(f"got data.folder {data.folder!r} and data.folders {tuple(data.folders)}; give one of them")
  if len(folders) == 1 and not DATASETS[data.name].in_folders:
    return dataset_of(folders[0]).configure(data, folders[0])
  datasets = [_readable_by_clip(folder) for folder in folders]
  if len(folders) == 1:
    return datasets[0].configure(data, folders[0])
  data.update(name="archive", folder="", folders=folders)
  names = {dataset.name for dataset in datasets}
  return "" if names == {"archive"} else f"data: {len(folders)} folders, read clip by clip"


def _gives_way(dataset):
  return dataset.by_clip or not dataset.in_folders


def _readable_by_clip(folder):
  dataset = dataset_of(folder)
  if not dataset.by_clip:
    raise InputError(f"{folder} is {dataset.name} data; its own size of the config reads it, as in "
                     "--config cmdm_denoiser:snapmogen")
  return dataset


def load_clips(config):
  """The clips of a data section, of all splits: those of its folders, each read by its own data set."""
  if config.get("folders"):
    return [clip for folder in config.folders for clip in _readable_by_clip(folder).pieces(folder, config)]
  dataset = get_dataset(config.name)
  _check_folder(config, dataset)
  return dataset.pieces(config.get("folder"), config)


def _require_one_license(clips):
  """Raises InputError for NonCommercial together with ShareAlike clips: no licence of weights or data meets both."""
  marked = {mark: sorted({clip.source for clip in clips if mark in clip.license}) for mark in ("BY-NC", "BY-SA")}
  if all(marked.values()):
    raise InputError(f"got {', '.join(marked['BY-NC'])} (NonCommercial) and {', '.join(marked['BY-SA'])} (ShareAlike), "
                     "whose licences one set of weights cannot meet; leave out one of the two")


def _check_folder(config, dataset):
  if dataset.in_folders and not config.get("folder"):
    several = (", or several: --config.data.folders='(\"path/to/cmu\",\"path/to/bandai\")'" if dataset.by_clip else "")
    raise ValueError(f"data.folder is empty; give the folder of {config.name!r}, as in "
                     f"--config.data.folder=path/to/folder{several}")


def digests(config) -> list[str]:
  """Digests of the bytes of the folders of a data section, in order; [] for procedural data."""
  if config.get("folders"):
    return [_readable_by_clip(folder).digest(folder) for folder in config.folders]
  return [get_dataset(config.name).digest(config.folder)] if config.get("folder") else []


def load_features(config, split="train", stats=None, captioned=True) -> FeatureSet:
  """Features of a split of config.data, normalized by stats, or else by the split's own.

  Clips are converted to features (config.mode) on the layout's skeleton and at its rate, and mirrored copies are added
  if config.mirror. Data sets that hold features, or define how clips are cut, are read as they are: each captioned part
  is an item, and lengths are limited; captioned=False gives every whole clip once, for the autoencoders
  (docs/papers/cmdm.md#items).
  """
  kept = _kept.get()
  if kept is None:
    return _load_features(config, split, stats, captioned)
  key = _key(config, split, captioned)
  statistics = stats.fingerprint if stats else (
      bool(config.get("per_axis")), bool(config.get("per_column")), config.get("feature_bias", 0.0))
  if (key, statistics) not in kept:
    data = _load_features(config, split, stats, captioned)
    kept[key, statistics] = kept[key, data.stats.fingerprint] = data
  return kept[key, statistics]


def load_items(config, split="train", captioned=True) -> list[TextItem]:
  """The items of a split of config.data, with unnormalized features; see `load_features`."""
  dataset, layout = get_dataset(config.name), get_layout(config.layout)
  if dataset.by_clip and config.get("folders"):
    clips = load_clips(config)
    _require_one_license(clips)
    return clip_items(clips, config, split, layout)
  _check_folder(config, dataset)
  given = {"kinematic_captions": config.get("kinematic_captions", False), "augment": augment_shares(config),
           "paraphrases": config.get("paraphrases", 0)}
  for field, value in given.items():
    if value and field not in dataset.fields:
      raise InputError(f"got data.{field} for {config.folder}, {dataset.holds}; expected archives, or several folders "
                       "that are read clip by clip: captions and clips are added to theirs only")
  return dataset.items(config, split, layout, captioned)


def _load_features(config, split, stats, captioned):
  dataset, layout, tokens = get_dataset(config.name), get_layout(config.layout), {}
  by_clip = dataset.by_clip and bool(config.get("folders"))
  items = load_items(config, split, captioned)
  if not items:
    places = ", ".join(config.get("folders") or [config.get("folder") or "procedural motion"])
    raise ValueError(f"data of {config.name!r} ({places}) has no clips in split {split!r}")
  given, features = stats, [item.features for item in items]
  # Statistics of captured clips only: a run with augmented clips can start from the weights of one without them.
  captured = [item.features for item in items if not item.made]
  for item in items:
    tokens |= {caption: words for caption, words in zip(item.captions, item.tokens) if words}
  if stats is None and (by_clip or config.get("per_column", False)):  # no data set has files of statistics by column
    stats = compute_stats(captured, layout, config.get("per_axis", False), config.get("per_column", False))
  elif stats is None:
    stats = dataset.stats(config, layout, captured)
  if given is None and config.get("feature_bias", 0.0):  # docs/papers/momask.md#statistics
    stats = dataclasses.replace(stats, std=biased_std(stats.std, config.feature_bias))
  normalized = [x.normalized(stats) if isinstance(x, RecordedFeatures) else stats.normalize(x) for x in features]
  return FeatureSet(normalized, [list(item.captions) for item in items],
                    [item.group or item.id for item in items], [item.id for item in items], stats, layout, tokens,
                    [item.spans for item in items], [item.source for item in items],
                    [list(item.captions[:item.num_own]) for item in items], [item.optimality for item in items])


# --- cached features ---------------------------------------------------------------------------------------------

_kept = contextvars.ContextVar("features that are kept", default=None)


@contextlib.contextmanager
def keep_features():
  """Caches features by representation, split and statistics while the block runs.

  For programs that train many runs on the same data; the cache holds memory until the block ends.
  """
  token = _kept.set({})
  try:
    yield
  finally:
    _kept.reset(token)


def _key(config, split, captioned):
  """The settings that determine the features of a split, except for their statistics."""
  folders = tuple(config.get("folders") or ()) if get_dataset(config.name).by_clip else ()
  readers = [dataset_of(folder) for folder in folders] or [get_dataset(config.name)]
  settings = config.to_dict() | {"captioned": captioned or bool(folders)}
  reader_fields = {field for reader in readers for field in reader.fields}
  fields = sorted({"kinematic_captions", "paraphrases"} | reader_fields - {"augment"})
  return (config.name, folders or config.get("folder"), config.layout, split,
          tuple(sorted(augment_shares(config).items())), *((field, settings.get(field) or None) for field in fields))
