"""A further data set is one class and one line: it is recognized, read, examined and searched, nothing else touched."""
import pathlib
import types

import numpy as np
import pytest

from motion_jax import fit, retrieval
from motion_jax.data import doctor, sources
from motion_jax.data.clip import Caption, Clip
from motion_jax.data.datasets import registry
from motion_jax.data.datasets.base import Dataset
from motion_jax.data.datasets.synthetic import synthetic_clips
from tests.conftest import load_config


class Takes(Dataset):
  """Folders of SPLIT/NAME.npy, joints (T, 22, 3), with a sentence a line in NAME.txt beside them."""
  name, holds = "takes", "takes (SPLIT/NAME.npy, SPLIT/NAME.txt)"

  def matches(self, folder):
    return any(folder.glob("t*/*.npy"))

  def clips(self, folder, split=None, faults=None):
    found = []
    for path in sorted(pathlib.Path(folder).glob(f"{split or '*'}/*.npy")):
      joints = np.load(path)
      if np.isfinite(joints).all():
        captions = tuple(map(Caption, path.with_suffix(".txt").read_text().splitlines()))
        found.append(Clip(joints, captions=captions, id=path.stem, split=path.parent.name))
      elif faults is not None:
        faults.append((path.stem, "NaN"))
    return found


@pytest.fixture(autouse=True)
def known(monkeypatch):
  monkeypatch.setitem(registry.DATASETS, "takes", Takes())  # the one line


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
  out = tmp_path_factory.mktemp("data") / "my_takes"
  for index, clip in enumerate(synthetic_clips(2, 11, 70)):
    path = out / ("train" if index < 3 else "test") / f"take{index}.npy"
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, clip.joints)
    path.with_suffix(".txt").write_text("\n".join(caption.text for caption in clip.captions))
  return out


def test_a_config_knows_its_folder_again(folder):
  """One for HumanML3D, and one for several folders, read clip by clip."""
  config = load_config("cmdm_tokenizer", "tiny")
  config.update_from_flattened_dict({"data.name": "humanml3d", "data.folder": str(folder)})
  assert fit.resolve(config)[0].data.name == "takes"
  config = config.copy_and_resolve_references().unlock()
  config.update_from_flattened_dict({"data.folder": "", "data.folders": (str(folder), str(folder))})
  assert "2 folders" in sources.recognize(config) and len(sources.load_features(config.data).ids) == 6
  with pytest.raises(ValueError, match="in split 'val'"):
    sources.load_features(config.data, "val")


def test_it_is_examined(folder, tmp_path):
  report = doctor.examine(folder)
  facts = dict(report.facts)
  assert report.ok and facts["format"] == Takes.holds and facts["clips"] == "11, test 8, train 3"
  (tmp_path / "train").mkdir()
  clip = synthetic_clips(2, 1, 60)[0]
  for name, joints, said in (("a", clip.joints, "a person walks"), ("b", clip.joints, ""),
                             ("c", clip.joints * np.nan, "a person waves")):
    np.save(tmp_path / "train" / f"{name}.npy", joints)
    (tmp_path / "train" / f"{name}.txt").write_text(said)
  told = {finding.what: finding.examples for finding in doctor.examine(tmp_path).findings}
  assert told["clips without a caption"] == ("b",) and told["clips that cannot be used"] == ("c (NaN)",)
  assert told["equal motions"] == ("a = b",)


def test_it_is_searched(folder):
  unit = lambda count: np.tile(np.eye(1, 4, dtype=np.float32), (count, 1))
  teacher = types.SimpleNamespace(fingerprint="teacher", features_of=lambda clip: clip.joints,
                                  embed_motion=lambda features, progress: unit(len(features)),
                                  embed_text=lambda words: unit(len(words)))
  found = retrieval.read_collection(teacher, folder, "test")
  assert len(found) == 8 and found.ids[0] == "take10" and found.seconds[0] == 3.5


def test_names_and_folders_that_are_none_are_told(tmp_path):
  with pytest.raises(ValueError, match=r"got data.name 'take' \(did you mean takes\?\), expected one of arch"):
    registry.get_dataset("take")
  with pytest.raises(FileNotFoundError, match=r"is no data folder: expected one of .*takes \(SPLIT/NAME.npy"):
    registry.dataset_of(tmp_path)
