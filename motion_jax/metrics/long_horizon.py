"""Scores of long motions with a list of captions: how well they follow the captions, and how smooth transitions are.

FlowMDM's protocol (CVPR 2024), which CMDM's Tables 3, 4 and 5 use (docs/papers/cmdm.md#long-horizon): a long motion is
cut at the borders of its captions and each piece is evaluated like a clip; frames around each border are evaluated as
transitions, against random crops of real motions, and by their jerk. Evaluators are functions `embed(list of motions)
-> (N, E)`; a motion is any array with time first that `embed` accepts (features or joints).
"""
import dataclasses
from collections.abc import Callable, Iterable
from collections.abc import Sequence as SequenceOf
from typing import NamedTuple

import numpy as np

from motion_jax.metrics import physics, scores
from motion_jax.motion import rotations as rot
from motion_jax.motion.skeleton import HUMANML3D, Skeleton, facing
from motion_jax.shapes import Array, Float, Num

Embed = Callable[[list], Array]  # motions, any array with time first each -> (N, E)


@dataclasses.dataclass(frozen=True)
class LongHorizon:
  """Settings of the protocol; the defaults are for HumanML3D, see `BABEL` for the others."""
  width: int = 60                 # frames of a transition, half on either side of the border
  unit_length: int = 4            # durations are rounded down to a multiple; paper and FlowMDM do not state a rule
  shortest: int = 70              # shortest real clip, in frames, of the reference set
  longest: int = 200
  top_k: int = 3
  merge_captions: bool = True     # equal captions of one sequence count once in R-precision
  pool: int = 32                  # candidates of the real row's R-precision; a generated sequence is one pool
  diversity_draws: int = 300      # or all samples, if there are fewer
  # Parity: FlowMDM decodes each transition's features alone: it begins over the origin, facing +z. Its jerk, a sum over
  # x, y and z, depends on the direction.
  placed: bool = True
  real_jerk: float | None = physics.REAL_JERK["humanml3d"]  # reference level of AUJ; None: that of the real crops
  jerk_scale: float = 1.0         # factor of the jerk of joints in metres: 100 is centimetres
  cosine: bool = False            # R-precision ranks by angle, not by Euclidean distance (SnapMoGen)


BABEL = LongHorizon(width=30, unit_length=1, shortest=30, placed=False, real_jerk=physics.REAL_JERK["babel"])


class Sequence(NamedTuple):
  """A long motion (T, ..) for `embed`, its joints (T, J, 3), and its S pieces: frames, captions, embedded texts (S, E).

  The pieces, rounded down to the protocol's unit, follow each other from frame 0.
  """
  motion: np.ndarray
  joints: np.ndarray
  frames: tuple[int, ...]
  captions: tuple[str, ...]
  text: np.ndarray


class Reference(NamedTuple):
  """Statistics of real motion: Gaussian of clips, embedded transitions (N, E), their mean jerk curve, level of AUJ."""
  pieces: scores.Moments
  transitions: np.ndarray
  curve: np.ndarray
  level: float


class Scores(NamedTuple):
  """Scores {metric: number}, and the mean jerk curve (width - 3,) of the transitions."""
  row: dict[str, float]
  curve: np.ndarray


def whole_units(frames: Iterable[int], protocol: LongHorizon) -> list[int]:
  """Durations rounded down to a multiple of the protocol's unit, as the model generates them."""
  kept = [int(count) // protocol.unit_length * protocol.unit_length for count in frames]
  if not kept or min(kept) <= 0:
    raise ValueError(f"got durations {list(frames)}, expected {protocol.unit_length} frames or more each")
  return kept


def cut_pieces(motion: Num[Array, " t *frame"], frames: SequenceOf[int] | np.ndarray) -> list[Array]:
  """Cuts motion (T, ..) into consecutive pieces of the given lengths, from frame 0."""
  ends = np.cumsum(frames)
  if ends[-1] > len(motion):
    raise ValueError(f"got a motion of {len(motion)} frames and pieces of {ends[-1]} together; generate as many frames "
                     "as the durations ask for")
  return [motion[end - count:end] for end, count in zip(ends, frames)]


def random_crops(motions: SequenceOf[Array], width: int, rng: np.random.Generator) -> list[tuple[int, int]]:
  """Random crops [(index, first frame)], one for each motion of width frames or more."""
  long_enough = [i for i, motion in enumerate(motions) if len(motion) >= width]
  if not long_enough:
    raise ValueError(f"none of {len(motions)} motions has the {width} frames of a transition")
  return [(i, int(rng.integers(len(motions[i]) - width + 1))) for i in long_enough]


def caption_hits(text: Num[Array, "s e"], motion: Num[Array, "s e"], captions: SequenceOf[str], top_k: int = 3,
                 merge: bool = True, cosine: bool = False) -> Float[np.ndarray, " {top_k}"]:
  """Hits of R-precision among the pieces of one sequence, text and motion (S, E) -> (top_k,), out of S.

  merge: of equal captions only the first piece is used, in texts and in motions, and hits are scaled up to S; a random
  embedding of U different captions then scores S k / U. cosine: rank by angle.
  """
  if not len(text) == len(motion) == len(captions):
    raise ValueError(f"got {len(text)} texts, {len(motion)} pieces and {len(captions)} captions of one sequence")
  kept = [i for i, caption in enumerate(captions) if not merge or caption not in captions[:i]]
  measure = scores.cosine_distances if cosine else scores.distances
  away = measure(np.asarray(text)[kept], np.asarray(motion)[kept])
  return scores.hits(away, top_k) * (len(captions) / len(kept))


def placed(joints: Num[np.ndarray, "t j 3"], skeleton: Skeleton) -> Float[np.ndarray, "t j 3"]:
  """Moves and turns joints (T, J, 3) to begin over the origin, facing +z; height and bones stay."""
  joints = joints - joints[:1, :1] * [1, 0, 1]
  ahead = facing(joints[:1], skeleton)
  return rot.rotate(rot.between(ahead, np.array([[0.0, 0.0, 1.0]]))[:, None], joints)


def reference_of(sequences: Iterable[Sequence], embed: Embed, protocol: LongHorizon = LongHorizon(),
                 skeleton: Skeleton = HUMANML3D) -> Reference:
  """Reference from real `Sequence`s, which have borders of their own."""
  pieces, crops, moving = [], [], []
  for sequence in sequences:
    borders = np.cumsum(sequence.frames)[:-1]
    pieces.append(embed(cut_pieces(sequence.motion, sequence.frames)))
    crops.append(embed(list(physics.cut_transitions(sequence.motion, borders, protocol.width))))
    moving.append(_placed(physics.cut_transitions(sequence.joints, borders, protocol.width), protocol, skeleton))
  curve = protocol.jerk_scale * physics.jerk_curve(np.concatenate(moving))
  level = float(curve.mean()) if protocol.real_jerk is None else protocol.real_jerk
  return Reference(scores.moments(np.concatenate(pieces)), np.concatenate(crops), curve, level)


def reference(motions: SequenceOf[Array], joints: SequenceOf[Array], embed: Embed, rng: np.random.Generator,
              protocol: LongHorizon = LongHorizon(), skeleton: Skeleton = HUMANML3D) -> Reference:
  """Reference from real clips (T, ..), for `embed`, and their joints (T, J, 3).

  Clips of protocol.shortest to longest frames are pieces; a random crop of each that is long enough is a transition.
  """
  pieces = [motion for motion in motions if protocol.shortest <= len(motion) <= protocol.longest]
  if len(pieces) < 2:
    raise ValueError(f"got {len(pieces)} real clips of {protocol.shortest} to {protocol.longest} frames, a Gaussian "
                     "needs 2 or more")
  crops, moving = _crops(motions, joints, rng, protocol, skeleton)
  curve = protocol.jerk_scale * physics.jerk_curve(moving)
  level = float(curve.mean()) if protocol.real_jerk is None else protocol.real_jerk
  return Reference(scores.moments(embed(pieces)), np.asarray(embed(crops)), curve, level)


def score(sequences: Iterable[Sequence], real: Reference, embed: Embed, rng: np.random.Generator,
          protocol: LongHorizon = LongHorizon(), skeleton: Skeleton = HUMANML3D, embed_text_space: Embed | None = None
          ) -> Scores:
  """Scores generated `Sequence`s, any iterable, against a `Reference`.

  embed(list of motions) -> (N, E); rng: numpy generator for the draws of diversity. embed_text_space: embedding to
  compare with texts, if FID uses another one. Metrics: top1 .. top3, matching, fid, diversity of the pieces;
  transition_fid, transition_kid (`scores.kernel_distance`, which needs no covariance), transition_diversity,
  transition_distance, peak_jerk, auj of the transitions.
  """
  beside_text = embed_text_space or embed
  pieces, transitions, away, hits, count = [], [], [], np.zeros(protocol.top_k), 0
  jerks, steps = [], []
  for sequence in sequences:
    frames = whole_units(sequence.frames, protocol)
    borders = np.cumsum(frames)[:-1]
    cut = cut_pieces(sequence.motion, frames)
    embedded = beside_text(cut)
    hits += caption_hits(sequence.text, embedded, sequence.captions, protocol.top_k, protocol.merge_captions,
                          protocol.cosine)
    away.append(np.linalg.norm(np.asarray(sequence.text, np.float64) - embedded, axis=1))
    count += len(frames)
    pieces.append(embedded if beside_text is embed else embed(cut))
    if len(borders):
      transitions.append(embed(list(physics.cut_transitions(sequence.motion, borders, protocol.width))))
      moving = physics.cut_transitions(sequence.joints, borders, protocol.width)
      jerks.append(physics.jerk(_placed(moving, protocol, skeleton)))
      steps.append(physics.transition_distance(sequence.joints, borders, skeleton))
  if not jerks:
    raise ValueError("no sequence has two captions or more, so there are no transitions to score")
  return _scores(hits / count, away, np.concatenate(pieces), np.concatenate(transitions), np.concatenate(jerks), steps,
                 real, rng, protocol)


def real_row(motions: SequenceOf[Array], joints: SequenceOf[Array], captions: SequenceOf[str], text: Num[Array, "n e"],
             real: Reference, embed: Embed, rng: np.random.Generator, protocol: LongHorizon = LongHorizon(),
             skeleton: Skeleton = HUMANML3D) -> Scores:
  """The same scores of real clips, their captions (N,) and embedded texts (N, E), in random order.

  R-precision in pools of protocol.pool clips; transitions are random crops with their border in the middle. FID is 0 by
  definition if `real` is of the same clips.
  """
  kept = [i for i, motion in enumerate(motions) if protocol.shortest <= len(motion) <= protocol.longest]
  kept = [kept[i] for i in rng.permutation(len(kept))]
  pools = [kept[i:i + protocol.pool] for i in range(0, len(kept) - protocol.pool + 1, protocol.pool)]
  if not pools:
    raise ValueError(f"got {len(kept)} real clips of {protocol.shortest} to {protocol.longest} frames, a pool needs "
                     f"{protocol.pool}")
  embedded = dict(zip(kept, embed([motions[i] for i in kept])))
  text = np.asarray(text, np.float64)
  hits, away = np.zeros(protocol.top_k), []
  for pool in pools:
    motion = np.stack([embedded[i] for i in pool])
    hits += caption_hits(text[pool], motion, [captions[i] for i in pool], protocol.top_k, protocol.merge_captions,
                          protocol.cosine)
    away.append(np.linalg.norm(text[pool] - motion, axis=1))
  crops, moving = _crops(motions, joints, rng, protocol, skeleton)
  steps = [physics.transition_distance(crop, [protocol.width // 2], skeleton) for crop in moving]
  return _scores(hits / (len(pools) * protocol.pool), away, np.stack(list(embedded.values())), embed(crops),
                 physics.jerk(moving), steps, real, rng, protocol)


def transition_row(motions: SequenceOf[Array], joints: Num[Array, "n w j 3"], real: Reference, embed: Embed,
                   protocol: LongHorizon = LongHorizon(), skeleton: Skeleton = HUMANML3D) -> dict[str, float]:
  """Scores of transitions alone: motions, a list of (width, ..), and their joints (N, width, J, 3)."""
  curve = protocol.jerk_scale * physics.jerk(_placed(joints, protocol, skeleton)).mean(0)
  steps = [physics.transition_distance(crop, [protocol.width // 2], skeleton) for crop in joints]
  embedded = embed(list(motions))
  return {"transition_fid": scores.fid(scores.moments(real.transitions), embedded),
          "transition_kid": scores.kernel_distance(real.transitions, embedded),
          "transition_distance": float(np.concatenate(steps).mean()), "peak_jerk": physics.peak_jerk(curve),
          "auj": physics.area_under_jerk(curve, real.level)}


def _placed(transitions, protocol, skeleton):
  """Joints (N, width, J, 3) of transitions, placed for the computation of jerk if the protocol does so."""
  return np.stack([placed(crop, skeleton) for crop in transitions]) if protocol.placed else transitions


def _crops(motions, joints, rng, protocol, skeleton):
  """Random crops of motions, as a list, and of their joints (N, width, J, 3), at the same frames."""
  if [len(motion) for motion in motions] != [len(clip) for clip in joints]:
    raise ValueError("motions and joints have different numbers of frames; cut both to the frames that they share")
  places = random_crops(motions, protocol.width, rng)
  return ([motions[i][start:start + protocol.width] for i, start in places],
          _placed(np.stack([joints[i][start:start + protocol.width] for i, start in places]), protocol, skeleton))


def _scores(precision, away, pieces, transitions, jerks, steps, real, rng, protocol):
  """Assembles Scores from embeddings of pieces and transitions (N, E), jerks (N, width - 3) and lists of distances."""
  curve = protocol.jerk_scale * jerks.mean(0)
  row = {f"top{k + 1}": float(share) for k, share in enumerate(precision)}
  row["matching"] = float(np.concatenate(away).mean())
  for prefix, features, gaussian in (
      ("", pieces, real.pieces), ("transition_", transitions, scores.moments(real.transitions))):
    draws = scores.draw_pairs(rng, len(features), min(protocol.diversity_draws, len(features)))
    row |= {f"{prefix}fid": scores.fid(gaussian, features), f"{prefix}diversity": scores.diversity(features, *draws)}
  row |= {"transition_kid": scores.kernel_distance(real.transitions, transitions),
          "transition_distance": float(np.concatenate(steps).mean()), "peak_jerk": physics.peak_jerk(curve),
          "auj": physics.area_under_jerk(curve, real.level)}
  return Scores(row, curve)
