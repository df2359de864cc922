"""The interface of a data set, as training, the doctor, retrieval and evaluation use it.

To add a data set, write one file with such a class and one line in `registry`. If its clips have HumanML3D's 22 joints,
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

SHORTEST = 8  # frames: shorter clips are not converted to features


class TextItem(NamedTuple):
  """An item of a text-to-motion loader: features (T, F), captions of the whole item, tokens of each caption.

  tokens: (), or a tuple "lemma/POS", ... for each caption; group: its action, if known (else its id). spans: (caption,
  first, past) rows of its parts, if it was joined from several clips; made: augmented, not captured (`data.augment`);
  source: the name of its archive; num_own: number of captions that are not paraphrases; optimality: of a scored sample.
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
  optimality: float | None = None


class TestItem(NamedTuple):
  """An item of evaluation: captions with their tokens "lemma/POS lemma/POS" (None: by rule), the stored motion, and its
  features (T, F) for each reader, in physical units."""
  id: str
  captions: tuple[str, ...]
  tokens: tuple[str | None, ...]
  motion: np.ndarray
  features: dict


class Dataset(Protocol):
  """A kind of data folder. `config` is the data section of a training config, `folder` a path.

  name: in configs and records. holds: description of such a folder, for messages.
  by_clip: clips can be combined with those of other folders and converted to features of any layout.
  in_folders: False for procedural clips, which are not read from files.
  fields: of the data section that determine the items; with "captioned" if whole clips differ from captioned ones.
  files: patterns of the files that determine the content of a folder.
  judged_as: name of such data in evaluation protocols. long_horizon: protocol of long motions.
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
    """The captioned clips of a folder, of one split or all. faults: a list to which (id, fault) of unusable clips is
    appended; these are always omitted."""
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
    """The training items of a split, as features of a layout, not normalized. captioned: False gives every whole clip
    once, for autoencoders, if the captioned parts of clips are separate items (docs/papers/cmdm.md#items)."""
    return clip_items(self.pieces(config.get("folder"), config), config, split, layout)

  def stats(self, config, layout, features) -> Stats:
    """Statistics of features in a layout: the data set's own, or else of `features`, a list of (T, F)."""
    return compute_stats(features, layout, config.get("per_axis", False))

  def fingerprint(self, folder) -> str:
    """Digest of a folder's content: names, sizes and times of its files."""
    folder, digest = pathlib.Path(folder), hashlib.sha256()
    for path in sorted({path for pattern in self.files for path in folder.glob(pattern) if path.is_file()}):
      about = path.stat()
      digest.update(f"{path.relative_to(folder)} {about.st_size} {about.st_mtime_ns}\n".encode())
    return digest.hexdigest()

  def digest(self, folder) -> str:
    """Digest of the bytes of a folder's files and their relative paths; equal for copies."""
    folder, digest = pathlib.Path(folder), hashlib.sha256()
    for path in sorted({path for pattern in self.files for path in folder.glob(pattern) if path.is_file()}):
      with open(path, "rb") as file:
        digest.update(f"{path.relative_to(folder).as_posix()} ".encode() + hashlib.file_digest(file, "sha256").digest())
    return digest.hexdigest()

  # --- the doctor --------------------------------------------------------------------------------------------------

  def examine(self, folder, tally, progress=False) -> list[tuple[str, str]]:
    """Facts about a folder, (label, value) each; faults are reported by tally.add(level, what, advice, example)."""
    facts, faults = [("format", self.holds)], []
    try:
      clips = self.clips(folder, faults=faults)
    except (ValueError, OSError) as error:
      tally.add("error", "clips that cannot be read", "repair the file that is named",
                checks.error_detail(error, folder)[:120])
      return facts
    for name, why in faults:
      tally.add("error", "clips that cannot be used", "repair their files, or remove them", f"{name} ({why})"[:120])
    return facts + _examine_clips(clips, tally, progress)

  # --- evaluation --------------------------------------------------------------------------------------------------

  def benchmark(self, folders, run_layout: Callable) -> str:
    """Name of the evaluation protocol of these folders. run_layout() is the layout of the evaluated run, or None."""
    return "own-66"

  def test_items(self, folder, rules, readers, excluded) -> Iterator[TestItem]:
    """The items of a split for evaluation.

    rules: split, min_frames <= rows < past_frames. readers: {key: an object with features_of(clip), layout and name}.
    excluded: a list to which (id, reason) of unusable clips is appended.
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
    """Marks {mark: id} that identify clips across splits, by name and by content; {} for a missing split."""
    marks = {}
    for clip in self.clips(folder, split, faults=[]):
      named = (pathlib.Path(folder).name, clip.meta.get("clip", clip.id))
      marks |= {named: clip.id, hashlib.sha256(clip.joints.tobytes()).digest(): clip.id}
    return marks

  def overlaps(self, folder, split) -> list[str]:
    """Ids of a split that share frames with train beyond equal marks."""
    return []


def clip_items(clips, config, split, layout: FeatureLayout) -> list[TextItem]:
  """The clips of a split as features (config.mode), on the layout's skeleton and at its rate.

  config.mirror: also mirrored, of train. config.kinematic_captions: with additional captions by kinematics
  (`analysis.describe`). config.augment: with augmented clips, of train (`data.augment`). config.paraphrases: with
  paraphrased captions, of train (`text.paraphrase`). config.workers: number of processes; results do not depend on it.
  """
  clips, new_clips = [clip for clip in clips if clip.split == split], []
  composed = [clip for clip in clips if "made" in clip.meta]  # by the application: has its captions, is not cut further
  clips = [clip for clip in clips if "made" not in clip.meta]
  shown = dict(unit="clip", leave=False, disable=None)
  with workers(config.get("workers", 0)) as team:
    if split == "train":
      new_clips = augmented(clips, augment_shares(config), progress=True, workers=team)
    if config.get("kinematic_captions", False):
      clips = list(tqdm.tqdm(team.map(with_kinematic_captions, clips, 16), f"captions of {split}", len(clips), **shown))
    clips += [*new_clips, *composed]
    if split == "train" and config.get("paraphrases", 0):
      clips = [_in_other_words(clip, config.paraphrases) for clip in clips]
    known = LAYOUTS.get(layout.name) is layout  # passed by name: other processes know it, too
    make = functools.partial(_item, layout=layout.name if known else layout, mode=config.mode)
    items = list(tqdm.tqdm(team.map(make, clips, 16), f"features of {split}", len(clips), **shown))
    if config.get("mirror", False) and split == "train":
      make = functools.partial(make, mirrored=True)
      items += tqdm.tqdm(team.map(make, clips, 16), "features of mirrored clips", len(clips), **shown)
  return [item for item in items if item is not None]


def _in_other_words(clip, number) -> Clip:
  """The clip with up to `number` paraphrases added for each of its captions."""
  said = tuple(dataclasses.replace(caption, text=text) for caption in clip.captions
               for text in paraphrases(caption.text, number))
  written = tuple(dict.fromkeys(clip.captions))
  return clip.replace(captions=tuple(dict.fromkeys((*written, *said))), meta={"num_own": len(written)} | clip.meta)


def _item(clip, layout, mode, mirrored=False) -> TextItem | None:
  """A clip, or its mirror image, as features of a layout; None if it is too short."""
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
                  clip.source, clip.meta.get("num_own"), clip.meta.get("optimality"))


def augment_shares(config) -> dict[str, float]:
  """{kind of augmentation: number of clips per captured clip} of a data section, without zeros."""
  return {kind: float(share) for kind, share in (config.get("augment") or {}).items() if share}


def _examine_clips(clips, tally, progress):
  bodies, hashes = {}, collections.defaultdict(list)
  splits, captions = collections.defaultdict(list), collections.defaultdict(list)
  for clip in tqdm.tqdm(clips, desc="clips", unit="clip", disable=not progress):
    body = bodies.setdefault(clip.skeleton.name, checks.Body(tally, clip.skeleton, canonical=False))
    body.check(clip.id, clip.joints)
    hashes[hashlib.sha1(clip.joints.tobytes()).hexdigest()].append(clip.id)
    splits[clip.split].append(clip.id)
    captions[clip.split] += [caption.text for caption in clip.captions]
    if not any(caption.text.strip() for caption in clip.captions):
      tally.add("error", "clips without a caption", "write one, or remove the clip", clip.id)
    if clip.split not in ("train", "val", "test"):
      tally.add("error", "clips in no split", "split is train, val or test", f"{clip.id} ({clip.split!r})")
  if not clips:
    tally.add("error", "no clip", "make the folder again")
  for body in bodies.values():
    body.report()
  counts = collections.Counter(clip.id for clip in clips)
  tally.add_all("error", "ids that occur twice", "name them differently", [name for name in counts if counts[name] > 1])
  checks.report_duplicates(hashes, splits, tally)
  facts = [("clips", ", ".join([str(len(clips)), *(f"{split} {len(ids)}" for split, ids in splits.items())])),
           ("length", f"{sum(clip.seconds for clip in clips) / 3600:.2f} hours")]
  facts += checks.shared_captions(captions)
  return facts + [fact for body in bodies.values() for fact in body.facts()]


@contextlib.contextmanager
def new_folder(out, overwrite=False):
  """Yields a temporary folder that replaces folder out if the block succeeds, and is deleted otherwise."""
  out = pathlib.Path(out)
  if out.exists() and not overwrite:
    raise FileExistsError(f"{out} exists already; choose another name, or say overwrite")
  if out.exists() and any(out.iterdir() if out.is_dir() else [1]) and not (out / "dataset.json").is_file():
    raise FileExistsError(f"{out} is not a folder that this program made, so it is not overwritten")
  with atomic_folder(out) as folder:
    yield folder
