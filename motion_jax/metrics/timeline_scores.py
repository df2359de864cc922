"""Scores of STMC's MTT benchmark (CVPR 2024): how well motions follow timelines, for one motion per timeline.

Each interval of a timeline is cut out of the motion and compared, in a joint space of motions and texts, with all texts
of the data set (retrieval) and with a real motion of its own text. Realism: random crops of five seconds against the
real motions, and the jump of the pose at the borders. Definitions: github.com/nv-tlabs/stmc, mtt/stmc_metrics.py
(docs/papers/cmdm.md#long-horizon); errors of that code can be switched off. `data.timelines` reads timelines.
"""
import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from motion_jax.data.timelines import Interval
from motion_jax.metrics import physics, scores
from motion_jax.motion.representations import get_layout, to_features, to_joints
from motion_jax.motion.skeleton import HUMANML3D, Skeleton
from motion_jax.shapes import Array, Float, Int, Num


@dataclasses.dataclass(frozen=True)
class Mtt:
  """Settings of the protocol. The defaults of the last three reproduce errors of the released code, for comparison with
  printed numbers; `CORRECTED` does not."""
  fps: float = 20.0
  top: tuple[int, ...] = (1, 3)
  crops: int = 5                   # for FID+, of each motion
  crop_seconds: float = 5.0
  crop_seed: int = 0               # the generator is re-seeded with it for each motion
  # Parity: crops begin before (number of features per frame) - (frames of a crop), as a size is taken from the wrong
  # axis; None: anywhere in the motion.
  crop_columns: int | None = 263
  # Parity: the last inner border is dropped together with the motion's end.
  loses_last_border: bool = True
  # Parity: of generated motions the x coordinate is subtracted, not the pelvis, and the root path stays.
  slipped_axis: bool = True


CORRECTED = Mtt(crop_columns=None, loses_last_border=False, slipped_axis=False)


def frames_of(timeline: Sequence[Interval], fps: float = 20.0) -> Int[np.ndarray, "n 2"]:
  """First and last frame (N, 2) of each interval of a timeline, rounded down."""
  return np.array([[int(fps * interval.start), int(fps * interval.end)] for interval in timeline])


def crop_starts(num_frames: int, protocol: Mtt = Mtt()) -> Int[np.ndarray, " n"]:
  """First frames of the random crops of a motion, the same for every model."""
  width = _crop_frames(protocol)
  room = num_frames if protocol.crop_columns is None else protocol.crop_columns
  if room <= width:
    raise ValueError(f"got a motion of {num_frames} frames, crops of {width} need more")
  starts = np.random.RandomState(protocol.crop_seed).randint(0, room - width, protocol.crops)
  if starts.max() >= num_frames - 1:
    raise ValueError(f"got a motion of {num_frames} frames, a crop begins at {starts.max()}; generate the whole "
                     "timeline, or set crop_columns=None")
  return starts


def borders_of(timeline: Sequence[Interval], num_frames: int, protocol: Mtt = Mtt()) -> list[int]:
  """The frames at which an interval starts or ends inside the motion."""
  points = sorted({int(point) for point in frames_of(timeline, protocol.fps).ravel()})
  inside = [point for point in points if point < num_frames]
  if protocol.loses_last_border:
    return inside[1:-1]
  return [point for point in inside if point > 0]


def released_steps(joints: Num[Array, "t 22 3"], borders: Sequence[int] | np.ndarray) -> Float[np.ndarray, " n"]:
  """Transition distance of generated joints (T, 22, 3) as in the released code -> (N,).

  Parity: joints are converted to features and back without turns, and each joint's x coordinate is subtracted from all
  three: the result is the change of (0, y - x, z - x), root path included.
  """
  layout = get_layout("full")
  features = to_features(np.asarray(joints), layout)
  features[:, layout["turn"]] = 0
  local = np.asarray(to_joints(features, layout), np.float64)
  local -= local[..., :1]
  borders = np.asarray(borders, int)
  return np.linalg.norm(local[borders] - local[borders - 1], axis=-1).mean(-1)


def score(timelines: Sequence[Sequence[Interval]], motions: Sequence[Array], joints: Sequence[Array],
          embed: Callable[[list], Array], texts: Sequence[str], text_latents: Num[Array, "m e"],
          real_latents: Num[Array, "m e"], protocol: Mtt = Mtt(), skeleton: Skeleton = HUMANML3D) -> dict[str, float]:
  """Scores of generated motions, {"crop_top1", "crop_top3", "tmr_m2t", "tmr_m2m", "fid", "transition_distance"}.

  timelines: lists of `data.timelines.Interval`; motions: one array (T, ..) each, for `embed(list of motions) -> (N, E)`
  (the benchmark's: 263 features and TMR); joints (T, J, 3), metres. texts: the different texts of the data set (M,);
  text_latents and real_latents (M, E): their embeddings, and those of a real motion of each. Shares and metres.
  """
  if not len(timelines) == len(motions) == len(joints) or not len(timelines):
    raise ValueError(f"got {len(timelines)} timelines, {len(motions)} motions and {len(joints)} joints, expected one "
                     "motion for each timeline")
  number = _numbers(texts, text_latents, real_latents)
  crops, pieces, own_texts, steps = [], [], [], []
  for timeline, motion, clip in zip(timelines, motions, joints):
    width = _crop_frames(protocol)
    crops.append(embed([motion[start:start + width] for start in crop_starts(len(motion), protocol)]))
    pieces.append(embed(_cut(timeline, motion, protocol)))
    own_texts += [number(interval.text) for interval in timeline]
    borders = borders_of(timeline, len(motion), protocol)
    if borders:
      steps.append(released_steps(clip, borders) if protocol.slipped_axis
                   else physics.transition_distance(np.asarray(clip), borders, skeleton))
  if not steps:
    raise ValueError("no timeline has a border inside, so there are no transitions to score")
  return _row(np.concatenate(pieces), np.array(own_texts), text_latents, real_latents, np.concatenate(crops), steps,
              protocol)


def real_row(texts: Sequence[str], text_latents: Num[Array, "m e"], real_latents: Num[Array, "m e"],
             joints: Sequence[Array], protocol: Mtt = Mtt(), skeleton: Skeleton = HUMANML3D) -> dict[str, float]:
  """The same scores of the real motions, with borders at the quarters of their joints (T, J, 3).

  By definition FID is 0 and the similarity of a motion to itself 1.
  """
  _numbers(texts, text_latents, real_latents)
  steps = [physics.transition_distance(np.asarray(clip), [quarter * len(clip) // 4 for quarter in (1, 2, 3)], skeleton)
           for clip in joints]
  return _row(real_latents, np.arange(len(texts)), text_latents, real_latents, real_latents, steps, protocol)


def _row(pieces, own_texts, text_latents, real_latents, crops, steps, protocol):
  to_text, to_motion = scores.cosines(pieces, text_latents), scores.cosines(pieces, real_latents)
  precision = scores.hits(-to_text, max(protocol.top), own_texts) / len(own_texts)
  row = {f"crop_top{k}": float(precision[k - 1]) for k in protocol.top}
  for name, cosines in (("tmr_m2t", to_text), ("tmr_m2m", to_motion)):
    row[name] = float((cosines[np.arange(len(own_texts)), own_texts].mean() + 1) / 2)
  # Gaussians of normalized embeddings: only the direction of TMR's embeddings is meaningful.
  row["fid"] = scores.fid(scores.units(real_latents), scores.units(crops))
  row["transition_distance"] = float(np.concatenate(steps).mean())
  return row


def _numbers(texts, text_latents, real_latents):
  """Function from a text to its row, after checking the three inputs for consistency."""
  if len(set(texts)) != len(texts):
    twice = next(text for i, text in enumerate(texts) if text in texts[:i])
    raise ValueError(f"the text {twice!r} is listed twice; retrieval needs different texts")
  if not np.shape(text_latents) == np.shape(real_latents) or len(text_latents) != len(texts):
    raise ValueError(f"got {len(texts)} texts, their embeddings of shape {np.shape(text_latents)} and real motions' of "
                     f"{np.shape(real_latents)}; expected one row each")
  rows = {text: i for i, text in enumerate(texts)}

  def number(text):
    if text not in rows:
      raise ValueError(f"a timeline says {text!r}, which is not among the {len(rows)} texts of the data set")
    return rows[text]
  return number


def _cut(timeline, motion, protocol):
  pieces = []
  for interval, (start, end) in zip(timeline, frames_of(timeline, protocol.fps)):
    if start >= len(motion) - 1:
      raise ValueError(f"{interval.text!r} begins at frame {start}, the motion has {len(motion)}; generate the whole "
                       "timeline")
    pieces.append(motion[start:end])
  return pieces


def _crop_frames(protocol):
  return int(protocol.crop_seconds * protocol.fps)
