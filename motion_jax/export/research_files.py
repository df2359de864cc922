"""Motion files of other research programs: AMASS' poses, Kimodo's npz, and advice for pickles."""
import pathlib
import warnings

import numpy as np

from motion_jax.data.datasets.babel import RATES, read_poses
from motion_jax.data.mocap.capture import forward_kinematics
from motion_jax.motion import rotations as rot
from motion_jax.motion.plausibility import with_y_up
from motion_jax.motion.pose import turn_ends
from motion_jax.motion.retarget import retarget
from motion_jax.motion.rigid import fit_pose
from motion_jax.motion.skeleton import HUMANML3D, SMPL
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import load_npz, npz_names

_VIDEO_FPS = 30.0
# {AMASS' name: those of tools that read video}; what is of the world comes before what is of the camera.
_VIDEO_NAMES = {"root_orient": ("root_orient", "global_orient"), "pose_body": ("pose_body", "body_pose"),
                "trans": ("trans_world", "transl", "trans"), "poses": ("pose_world", "poses", "pose")}
# Of SMPL's pelvis at rest from the model's origin, metres: what AMASS' trans is counted from.
_PELVIS = np.array([0.0, -0.22, 0.03])
_TO_AMASS = np.array([[-1.0, 0, 0], [0, 0, 1], [0, 1, 0]])  # y up, facing +z -> z up, facing +y


def is_amass(keys) -> bool:
  """Whether a .npz with these keys holds the poses of a body model, as AMASS' files do, or those of video tools."""
  return _has_own_names(keys) or is_of_video(keys)


def is_of_video(keys) -> bool:
  """Whether these keys are those of SMPL's poses as tools that read video name them (GVHMR, WHAM, TRAM; ROMP, VIBE)."""
  there = {name for name, others in _VIDEO_NAMES.items() if set(others) & set(keys)}
  return not _has_own_names(keys) and ({"root_orient", "pose_body", "trans"} <= there or {"poses", "trans"} <= there)


def _has_own_names(keys):
  return "trans" in keys and ("poses" in keys or {"root_orient", "pose_body"} <= set(keys))


def read_amass(path, up=None, fps=None):
  """Joints (T, 22, 3) of the poses in an AMASS file, metres, y up, and its rate, on a neutral adult's bones.

  up: the upward axis, by default "z", of video tools "y". fps: the rate of a file that states none. The body's own
  shape (betas) takes the SMPL body model, which is not here.
  """
  keys = npz_names(path)
  of_video, states_rate = is_of_video(keys), bool(set(RATES) & set(keys))
  if not (states_rate or fps or of_video):
    raise InputError(f"{path} states no rate ({', '.join(RATES)}); give it by --fps (fps=)")
  if not (states_rate or fps):
    warnings.warn(f"{path} states no rate, taken as {_VIDEO_FPS:g} frames a second; --fps (fps=) sets another",
                  stacklevel=2)
  poses = read_poses(path, _VIDEO_NAMES if of_video else {}, fps or _VIDEO_FPS)
  pelvis = load_npz(path, ("pelvis_offset",)).get("pelvis_offset", _PELVIS)
  if pelvis.shape != (3,):
    raise InputError(f"{path}: got pelvis_offset {pelvis.shape}, expected (3,)")
  warnings.warn(f"{path}: SMPL poses, put on the bones of a neutral adult; for the person's own (betas), run the SMPL "
                "body model (pip install smplx) and save its joints (frames, 22, 3)", stacklevel=2)
  local = np.tile(SMPL.offsets, (len(poses.translation), 1, 1))
  local[:, 0] = poses.translation + pelvis
  joints = forward_kinematics(SMPL.parents, local, poses.rotations)[0]
  up = up or ("y" if of_video else None)
  return with_y_up(joints, up) if up else joints @ _TO_AMASS, poses.fps


def amass(clip, path, pelvis_offset=(0.0, 0.0, 0.0)) -> pathlib.Path:
  """Writes the poses of SMPL-X as AMASS files hold them, z up, facing +y: `poses` and its parts, both spellings of the
  rate, neutral shape, hands and face at rest.

  The motion is brought to a neutral adult's proportions, which is the body that readers make of it. pelvis_offset: the
  pelvis of the reader's body model at rest, metres, which its forward kinematics adds to `trans`; it is subtracted here
  and kept under this name. Raises InputError for a skeleton of other joints than SMPL's 22.
  """
  if clip.skeleton.joints != HUMANML3D.joints:
    raise InputError(f"got a motion of skeleton {clip.skeleton.name!r} for an AMASS file, expected HumanML3D's 22 "
                     "joints")
  offset = np.asarray(pelvis_offset, np.float64)
  joints = retarget(np.asarray(clip.joints, np.float64) * clip.skeleton.unit, SMPL)
  pose = turn_ends(fit_pose(joints, SMPL, clip.fps, SMPL.offsets), joints, SMPL)
  turn = rot.from_matrix(_TO_AMASS)
  vectors = pose.rotations.copy()
  vectors[:, 0] = rot.multiply(turn[None], vectors[:, 0])
  vectors = rot.to_vector(vectors)
  frames = len(vectors)
  parts = {"root_orient": vectors[:, 0], "pose_body": vectors[:, 1:].reshape(frames, 63),
           "pose_jaw": np.zeros((frames, 3)), "pose_eye": np.zeros((frames, 6)), "pose_hand": np.zeros((frames, 90))}
  arrays = {"poses": np.concatenate(list(parts.values()), axis=1), **parts,
            "trans": pose.root @ _TO_AMASS.T - offset, "betas": np.zeros(16), "num_betas": np.array(16),
            "gender": np.array("neutral"), "surface_model_type": np.array("smplx"),
            "mocap_frame_rate": np.float64(clip.fps), "mocap_framerate": np.float64(clip.fps),
            "mocap_time_length": np.float64(frames / clip.fps), "pelvis_offset": offset,
            "prompt": np.array(clip.captions[0].text if clip.captions else "")}
  with atomic_path(path) as temporary:
    np.savez_compressed(temporary, **arrays)
  return pathlib.Path(path)


# What makes plain files of pickles that people have, in their own Python.
_MDM = ("np.load(FILE, allow_pickle=True).item(); [np.save(f'motion_{i}.npy', m.transpose(2, 0, 1)[:n]) for i, (m, n) "
        "in enumerate(zip(d['motion'], d['lengths']))]")
_GMR = ("pickle.load(open(FILE, 'rb')); np.savetxt('motion.csv', np.hstack([d['root_pos'], d['root_rot'], "
        "d['dof_pos']]), delimiter=',')")
_TORCH = "torch.load(FILE, map_location='cpu', weights_only=True); np.save('motion.npy', np.asarray(d))"
_CONVERSIONS = {".npy": ("MDM's results", "", _MDM), ".pkl": ("GMR's robot motions", "pickle, ", _GMR),
                ".pt": ("an array of joints", "torch, ", _TORCH)}


def pickled(path) -> str:
  """Advice for a file of pickled objects, which is not opened, as it could run code."""
  kind = pathlib.Path(path).suffix.lower()
  what, more, code = _CONVERSIONS[{".pickle": ".pkl", ".pth": ".pt"}.get(kind, kind)]
  return (f"{path} holds pickled Python objects and is not opened, as that could run code; where you trust it, this "
          f"makes plain files of {what}: python -c \"import {more}numpy as np; d = "
          f"{code.replace('FILE', repr(str(path)))}\"")
