"""Data sets beside HumanML3D: their configs train, lengths are whole blocks, their motions stream and are stored."""
import numpy as np
import pytest

from motion_jax import export
from motion_jax import fit as training
from motion_jax.data.batches import TextItems
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.models.shared.moving_path import continue_path
from motion_jax.motion import representations as F
from motion_jax.motion.skeleton import SNAPMOGEN
from motion_jax.training.metrics import read_metrics
from tests.conftest import load_config

pytestmark = pytest.mark.usefixtures("kept_features")


@pytest.mark.slow
@pytest.mark.parametrize("size", ["cmdm_tokenizer:babel_tiny", "cmdm_denoiser:snapmogen_tiny"])
def test_configs_train_two_steps(size, tmp_path, unjudged):
  state = training.run(load_config(*size.split(":")), tmp_path)
  assert int(state.step) == 2
  assert np.isfinite([row["loss"] for row in read_metrics(tmp_path) if "loss" in row]).all()


def test_320_frames_are_padded_to_whole_blocks():
  """80 latents become 81: the batch has 324 frames, never more than 320 are real, long clips are cut, none left out."""
  rules = load_config("cmdm_denoiser", "snapmogen").data
  rng = np.random.default_rng(0)
  clips = [rng.normal(size=(n, 5)).astype(np.float32) for n in (127, 128, 321, 320, 900)]
  items = TextItems(clips, [["a"]] * 5, rules.min_frames, rules.max_frames, tuple(rules.lengths),
                    crop_frames=rules.crop_frames, keep_long=rules.keep_long, shorten_rate=rules.shorten_rate)
  assert items.kept.tolist() == [1, 2, 3, 4]
  batch = items.batch(4, 0, 0)
  assert batch["features"].shape == (4, 324, 5) and sorted(batch["num_frames"]) == [128, 320, 320, 320]
  for row, count in zip(batch["features"], batch["num_frames"]):
    assert (row[count:] == 0).all() and (row[:count] != 0).any(1).all()
  with pytest.raises(ValueError, match="crop_frames 322"):
    TextItems(clips, [["a"]] * 5, 128, 324, (324,), crop_frames=322)


@pytest.mark.parametrize("name", ["full", "motionstreamer"])
def test_streamed_path_is_that_of_the_whole(name):
  """Blocks of rows joined one after another are the clip's joints, also where a row tells of the step before it."""
  clip = synthetic_clips(0, 4, 45, skeleton=F.get_layout(name).skeleton)[3]
  features = F.to_features(clip.joints, name, "corrected")
  whole = F.to_joints(features, name)
  past, joints = None, []
  for rows in np.split(features, [1, 4, 11, 12, 30]):
    part, past = continue_path(rows, past, F.get_layout(name))
    joints.append(part)
  assert np.abs(np.concatenate(joints) - whole).max() * F.get_layout(name).skeleton.unit < 1e-5


def test_snapmogen_s_figure_is_stored(tmp_path):
  clip = synthetic_clips(0, 1, 8, skeleton=SNAPMOGEN)[0]
  for name in ("a.npz", "a.npy"):
    back = export.load(export.save(clip, tmp_path / name)[0])
    assert back.skeleton is SNAPMOGEN and np.array_equal(back.joints, clip.joints)
  assert export.load(export.save(clip, tmp_path / "a.bvh")[0]).joints.shape == (len(clip.joints), 22, 3)
