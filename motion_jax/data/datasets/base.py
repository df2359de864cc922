"""The interface of a data set: one object with all that training, the doctor, retrieval and evaluation need.

A further data set is one file with such a class and one line in `registry`. If its clips have HumanML3D's 22 joints,
`name`, `holds`, `matches` and `clips` are enough: the other methods use these clips. A data set whose files hold
features, or define how clips are cut, overrides the others.
"""
import collections
import contextlib
import dataclasses
import functools
import hashlib
import pathlib
from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

import numpy as np
import tqdm

from motion_jax.data import checks, mirror
from motion_jax.data.augment import augmented
from motion_jax.data.clip import Clip
from motion_jax.data.kinematic_captions import with_kinematic_captions
from motion_jax.data.worker_processes import workers
from motion_jax.motion.representations import LAYOUTS, FeatureLayout, get_layout, to_features
from motion_jax.motion.stats import Stats, compute_stats
from motion_jax.text.paraphrase import paraphrases
from motion_jax.utils.atomic import atomic_folder

SHORTEST = 8  # frames of a clip of which features are made


class TextItem(NamedTuple):
  """What a text-to-motion loader draws: features (T, F), captions for all of them, tokens of each caption.

  tokens: none, or a tuple "lemma/POS", ... for each caption; group: what it shows, where the data tell (else its id).
  spans: (caption, first, past) rows of its parts, if it was put together of several; made: not captured, but made of
  clips that were (`data.augment`); source: the name of its archive.
  """
  id: str
  features: np.ndarray
  captions: tuple[str, ...]
  tokens: tuple[tuple[str, ...], ...] = ()
  group: str = ""
  spans: tuple[tuple[str, int, int], ...] = ()
  made: bool = False
  source: str = ""
  num_own: int | None = None


class TestItem(NamedTuple):
  """What is judged: captions with their tokens "lemma/POS lemma/POS" (None: by rule), the motion as it is stored, and
  its features (T, F) for each reader, in physical units."""
  id: str
  captions: tuple[str, ...]
  tokens: tuple[str | None, ...]
  motion: np.ndarray
  features: dict


class Dataset(Protocol):
  """A kind of data folder. `config` is the data section of a training config, `folder` a path.

  name: of it in configs and records. holds: what such a folder has, for messages.
  by_clip: its clips may stand beside those of other folders, and become features of any layout.
  in_folders: False for clips that are made, not read.
  fields: of the data section that decide its items, "captioned" among them where whole clips are others.
  files: patterns of the files that decide what is in a folder.
  judged_as: the name by which protocols of evaluation know such data. long_horizon: the protocol of long motions.
  """
  name: str
  holds: str
  by_clip: bool = True
  in_folders: bool = True
  fields: tuple[str, ...] = ("mode", "mirror", "kinematic_captions", "augment", "paraphrases")
  files: tuple[str, ...] = ("**/*",)
  judged_as: str = "archive"
  long_horizon: str = "long-horizon"

  def matches(self, folder: pathlib.Path) -> bool:
    """Whether a folder is of this kind, by the names of its files."""
    raise NotImplementedError(f"{type(self).__name__} does not know its folders")

  def clips(self, folder, split=None, faults=None) -> list[Clip]:
    """The captioned clips of a folder, of one split or of all. faults: a list that takes (id, what is wrong) of clips
    that cannot be used, which are left out in any case."""
    raise NotImplementedError(f"{type(self).__name__} reads no clips")

  # --- training ----------------------------------------------------------------------------------------------------

  def configure(self, data, folder) -> str:
    """Sets a config's data section for a folder of this kind; returns a message for the user, or ""."""
    data.update(name=self.name, folder=str(folder), folders=())
    return f"data: {folder}, {self.holds}"

  def pieces(self, folder, config) -> list[Clip]:
    """The clips of a folder that training uses, all splits."""
    return self.clips(folder)

  def items(self, config, split, layout, captioned=True) -> list[TextItem]:
    """What training takes of a split, as features of a layout, not normalized. captioned: False gives autoencoders
    every whole clip once, where the captioned parts of clips are items of their own (docs/papers/cmdm.md#items)."""
    return clip_items(self.pieces(config.get("folder"), config), config, split, layout)

  def stats(self, config, layout, features) -> Stats:
    """The statistics of features in a layout: a data set's own, or those of `features`, a list of (T, F)."""
    return compute_stats(features, layout, config.get("per_axis", False))

  def fingerprint(self, folder) -> str:
    """A digest of what lies in a folder: names, sizes and times of its files."""
    folder, digest = pathlib.Path(folder), hashlib.sha256()
    for path in sorted({path for pattern in self.files for path in folder.glob(pattern) if path.is_file()}):
      about = path.stat()
      digest.update(f"{path.relative_to(folder)} {about.st_size} {about.st_mtime_ns}\n".encode())
    return digest.hexdigest()

  def digest(self, folder) -> str:
    """A digest of the bytes of what lies in a folder: that of a copy is the same, wherever it lies."""
    folder, digest = pathlib.Path(folder), hashlib.sha256()
    for path in sorted({path for pattern in self.files for path in folder.glob(pattern) if path.is_file()}):
      with open(path, "rb") as file:
        digest.update(f"{path.relative_to(folder).as_posix()} ".encode() + hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()

  # --- the doctor --------------------------------------------------------------------------------------------------

  def examine(self, folder, found, progress=False) -> list[tuple[str, str]]:
    """Facts about a folder, (label, value) each; what is wrong goes to found.add(level, what, advice, example)."""
    facts, faults = [("format", self.holds)], []
    try:
      clips = self.clips(folder, faults=faults)
    except (ValueError, OSError) as error:
      found.add("error", "clips that cannot be read", "repair the file that is named",
                checks.error_detail(error, folder)[:120])
      return facts
    for name, why in faults:
      found.add("error", "clips that cannot be used", "repair their files, or remove them", f"{name} ({why})"[:120])
    return facts + _examine_clips(clips, found, progress)

  # --- evaluation --------------------------------------------------------------------------------------------------

  def benchmark(self, folders, run_layout: Callable) -> str:
    """The name of the protocol that fits these folders; run_layout() is the layout's name of the run that is judged,
    or None without one."""
    return "own-66"

  def test_items(self, folder, rules, readers, excluded) -> Iterator[TestItem]:
    """The items of a split as evaluation reads them.

    rules: split, min_frames <= rows < past_frames. readers: {key: what has features_of(clip), layout and name}.
    excluded: a list that takes (id, why) of clips that cannot be used.
    """
    for clip in self.clips(folder, rules.split, excluded):
      if not clip.captions or not rules.min_frames <= clip.num_frames - 1 < rules.past_frames:
        continue
      try:
        features = {key: reader.features_of(clip) for key, reader in readers.items()}
      except ValueError as error:
        excluded.append((clip.id, str(error)))
        continue
      yield TestItem(clip.id, tuple(c.text for c in clip.captions), (None,) * len(clip.captions), clip.joints, features)

  def marks(self, folder, split) -> dict:
    """{mark: id}: names and contents by which a clip is known again; a split that is not there has none."""
    marks = {}
    for clip in self.clips(folder, split, faults=[]):
      named = (pathlib.Path(folder).name, clip.meta.get("clip", clip.id))
      marks |= {named: clip.id, hashlib.sha256(clip.joints.tobytes()).digest(): clip.id}
    return marks

  def overlaps(self, folder, split) -> list[str]:
    """Ids of a split that have frames in common with one of train, which marks do not tell."""
    return []


def clip_items(clips, config, split, layout: FeatureLayout) -> list[TextItem]:
  """The clips of a split as features (config.mode) on the layout's skeleton and at its rate; of train mirrored ones,
  too, if config.mirror. config.kinematic_captions: with captions by kinematics beside their own (`data.describe`).
  config.augment: of train more clips, made of these (`data.augment`). config.paraphrases: of train captions also in
  other words (`text.paraphrase`). config.workers: number of processes that do all this, with equal results."""
  clips, made = [clip for clip in clips if clip.split == split], []
  shown = dict(unit="clip", leave=False, disable=None)
  with workers(config.get("workers", 0)) as team:
    if split == "train":
      made = augmented(clips, augment_shares(config), progress=True, workers=team)
    if config.get("kinematic_captions", False):
      clips = list(tqdm.tqdm(team.map(with_kinematic_captions, clips, 16), f"captions of {split}", len(clips), **shown))
    clips += made
    if split == "train" and config.get("paraphrases", 0):
      clips = [_in_other_words(clip, config.paraphrases) for clip in clips]
    known = LAYOUTS.get(layout.name) is layout  # by its name, which a process of its own knows, too
    make = functools.partial(_item, layout=layout.name if known else layout, mode=config.mode)
    items = list(tqdm.tqdm(team.map(make, clips, 16), f"features of {split}", len(clips), **shown))
    if config.get("mirror", False) and split == "train":
      make = functools.partial(make, mirrored=True)
      items += tqdm.tqdm(team.map(make, clips, 16), "features of mirrored clips", len(clips), **shown)
  return [item for item in items if item is not None]


def _in_other_words(clip, number) -> Clip:
  """The clip with up to `number` paraphrases of each of its captions beside them."""
  said = tuple(dataclasses.replace(caption, text=text) for caption in clip.captions
               for text in paraphrases(caption.text, number))
  own = tuple(dict.fromkeys(clip.captions))
  return clip.replace(captions=tuple(dict.fromkeys((*own, *said))), meta=clip.meta | {"num_own": len(own)})


def _item(clip, layout, mode, mirrored=False) -> TextItem | None:
  """A clip, or its mirror image, as features of a layout; None for one that is too short."""
  layout = get_layout(layout)
  if mirrored:
    clip = mirror.mirror_clip(clip)
  if clip.num_frames < SHORTEST:
    return None
  if clip.skeleton is not layout.skeleton:
    clip = clip.on_skeleton(layout.skeleton)
  features = to_features(clip.joints, layout, mode)
  spans = tuple((text, first, min(past, len(features))) for text, first, past in clip.meta.get("spans", ()))
  return TextItem(clip.id, features, tuple(caption.text for caption in clip.captions), (),
                  str(clip.meta.get("content") or clip.meta.get("label") or clip.id), spans, "made" in clip.meta,
                  clip.source, clip.meta.get("num_own"))


def augment_shares(config) -> dict[str, float]:
  """{kind of new clips: number per captured clip} of a data section, without those of 0."""
  return {kind: float(share) for kind, share in (config.get("augment") or {}).items() if share}


def _examine_clips(clips, found, progress):
  bodies, hashes = {}, collections.defaultdict(list)
  splits, captions = collections.defaultdict(list), collections.defaultdict(list)
  for clip in tqdm.tqdm(clips, desc="clips", unit="clip", disable=not progress):
    body = bodies.setdefault(clip.skeleton.name, checks.Body(found, clip.skeleton, canonical=False))
    body.check(clip.id, clip.joints)
    hashes[hashlib.sha1(clip.joints.tobytes()).hexdigest()].append(clip.id)
    splits[clip.split].append(clip.id)
    captions[clip.split] += [caption.text for caption in clip.captions]
    if not any(caption.text.strip() for caption in clip.captions):
      found.add("error", "clips without a caption", "write one, or remove the clip", clip.id)
    if clip.split not in ("train", "val", "test"):
      found.add("error", "clips in no split", "split is train, val or test", f"{clip.id} ({clip.split!r})")
  if not clips:
    found.add("error", "no clip", "make the folder again")
  for body in bodies.values():
    body.report()
  counts = collections.Counter(clip.id for clip in clips)
  found.add_all("error", "ids that occur twice", "name them differently", [one for one in counts if counts[one] > 1])
  checks.report_duplicates(hashes, splits, found)
  facts = [("clips", ", ".join([str(len(clips)), *(f"{split} {len(ids)}" for split, ids in splits.items())])),
           ("length", f"{sum(clip.seconds for clip in clips) / 3600:.2f} hours")]
  facts += checks.shared_captions(captions)
  return facts + [fact for body in bodies.values() for fact in body.facts()]


@contextlib.contextmanager
def new_folder(out, overwrite=False):
  """Yields a temporary neighbour of folder out that takes its place if the block ends well, else vanishes."""
  out = pathlib.Path(out)
  if out.exists() and not overwrite:
    raise FileExistsError(f"{out} exists already; choose another name, or say overwrite")
  if out.exists() and any(out.iterdir() if out.is_dir() else [1]) and not (out / "dataset.json").is_file():
    raise FileExistsError(f"{out} is not a folder that this program made, so it is not overwritten")
  with atomic_folder(out) as folder:
    yield folder
