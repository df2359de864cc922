"""Motion files of other research programs: Kimodo's npz, AMASS' poses, and advice for MDM's results."""
import warnings

import numpy as np

from motion_jax.data.datasets.babel import FPS, read_recording
from motion_jax.data.mocap.capture import forward_kinematics
from motion_jax.motion.plausibility import AXES
from motion_jax.motion.skeleton import SMPL

KIMODO_FPS = 30.0
# Of SMPL's pelvis at rest from the model's origin, metres: what AMASS' trans is counted from.
_PELVIS = np.array([0.0, -0.22, 0.03])


def is_amass(keys) -> bool:
  """Whether a .npz with these keys holds the poses of a body model, as AMASS' files do."""
  return "trans" in keys and ("poses" in keys or {"root_orient", "pose_body"} <= set(keys))


def read_amass(path, up=None):
  """Joints (T, 22, 3) of the poses in an AMASS file, metres, y up, at 30 frames a second, on a neutral adult's bones.

  up: the file's upward axis, by default "z". The body's own shape (betas) takes the SMPL body model, which is not here.
  """
  poses = read_recording(path)
  warnings.warn(f"{path}: AMASS poses, put on the bones of a neutral adult; for the person's own (betas), run the SMPL "
                "body model (pip install smplx) and save its joints (frames, 22, 3)", stacklevel=2)
  local = np.tile(SMPL.offsets, (len(poses.translation), 1, 1))
  local[:, 0] = poses.translation + _PELVIS
  return forward_kinematics(SMPL.parents, local, poses.rotations)[0][..., AXES[up or "z"]], FPS


def pickled(path) -> str:
  """What to do about a .npy of pickled objects, which could run code when it is opened."""
  return (f"{path} holds pickled Python objects, as MDM's results.npy does, and is not opened, as that could run code; "
          "where you trust it, this makes plain files of MDM's: python -c \"import numpy as np; r = "
          "np.load('results.npy', allow_pickle=True).item(); [np.save(f'motion_{i}.npy', m.transpose(2, 0, 1)[:n]) "
          "for i, (m, n) in enumerate(zip(r['motion'], r['lengths']))]\"")
