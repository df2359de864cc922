"""The checks of `doctor` for a motion, its texts and its statistics; each reports faults by `tally.add`."""
import numpy as np

from motion_jax.motion import plausibility
from motion_jax.motion import rotations as rot
from motion_jax.motion.retarget import floor_height
from motion_jax.motion.skeleton import HUMANML3D, bone_lengths, facing
from motion_jax.utils.errors import InputError
from motion_jax.utils.input_files import load_npy

# Std of the official HumanML3D statistics by block, and the height's mean (docs/papers/cmdm.md#statistics).
_OFFICIAL_STD = (0.012826, 0.016927, 0.153766, 0.122244, 0.299692, 0.019470, 0.355933)
_EVALUATOR_STD = (0.00051467, 0.00067693, 0.00612082, 0.12255538, 0.30038649, 0.01954057, 0.01409494)

SMALL_LEAST = 20  # minimum rows of a clip in the small sizes of configs (configs/: data.min_frames)
_FEW = 0.1        # share of a split's clips that may be too short without a warning
_TWISTED, _CROSSED = 65, 100  # degrees between hips and shoulders; 1,600 captured and hand-made clips have at most 55

LEAK = "results on test or val would be too good: keep each recording in one split"


def load(path, tally):
  try:
    return load_npy(path)
  except (InputError, OSError) as error:
    if tally:
      tally.add("error", "files that cannot be read", "copy them again",
                f"{path.parent.name}/{path.name} ({error_detail(error, path)})"[:120])
    return None


def error_detail(error, path):
  """The message of an error without the path at its beginning."""
  return str(error).removeprefix(str(path)).lstrip(":/ ")


def compare_joints(saved, recovered, layout, name, tally):
  if saved.shape != recovered.shape:
    tally.add("error", "joints of another shape than their features", "make new_joints again from the features",
              f"{name} {saved.shape} for {recovered.shape}")
  elif not np.isfinite(saved).all():
    tally.add("error", "joints with NaN or infinity", "make new_joints again from the features", name)
  elif np.abs(saved - recovered).max() * layout.skeleton.unit > 2e-3:
    tally.add("error", "joints that do not belong to their features (over 2 mm apart)", "one of the two is from "
              "another version of the data: make new_joints again from the features", name)


def report_lengths(rows, splits, least, tally):
  """Reports clips that training omits: below `least` rows, by split, or from 200 on. rows: {id: number of rows}."""
  for split, ids in splits.items():
    lengths = np.array([rows[clip_id] for clip_id in ids if clip_id in rows])
    short = lengths < least
    if short.any():
      level = "error" if short.all() else "warning" if short.mean() > _FEW else "note"
      spared = (f", those of the sizes :laptop and :small clips of less than {SMALL_LEAST} "
                f"({(lengths < SMALL_LEAST).sum()} of these)" if least > SMALL_LEAST else "")
      tally.add(level, f"{short.sum()} of {len(lengths)} {split} clips have less than {least} rows and stay unused",
                f"configs leave clips of less than {least} rows out{spared}; record longer ones, or train with "
                "--config.data.min_frames=N", count=int(short.sum()))
  long = sum(count >= 200 for count in rows.values())
  if long:
    tally.add("warning" if long == len(rows) else "note", "clips of 200 rows or more", "text-to-motion loaders leave "
              "them out; motion-jax data build cuts long clips", count=long)


def report_duplicates(hashes, splits, tally):
  where = {clip_id: split for split, ids in splits.items() for clip_id in ids}
  for names in hashes.values():
    if len(names) > 1:
      apart = len({where.get(name) for name in names}) > 1
      tally.add("error" if apart else "warning", "equal motions in different splits" if apart else "equal motions",
                "keep one of them; a motion in train and test makes results too good" if apart else "keep one of them",
                " = ".join(names[:3]))


def shared_captions(captions):
  """Facts (label, text) on the captions of val and test that train has, too, word for word; captions: {split: [text]}.

  Letter case, white space and a final full stop are ignored.
  """
  known = {split: {" ".join(text.lower().split()).rstrip(" .") for text in texts} - {""}
           for split, texts in captions.items()}
  return [(f"{split} captions in train", f"{len(sentences & known['train'])} of {len(sentences)} different ones "
           f"({len(sentences & known['train']) / len(sentences):.0%}), word for word")
          for split, sentences in known.items() if split in ("val", "test") and sentences and known.get("train")]


def check_stats(folder, layout, computed, tally):
  """Reports Mean and Std that are missing, not by block, or of another representation or other data.

  computed: the Stats of the folder's own features.
  """
  values = {}
  for name in ("Mean", "Std"):
    path = folder / f"{name}.npy"
    if not path.is_file():
      tally.add("error", f"no {name}.npy", "build again, or compute it with motion_jax.motion.stats.compute_stats")
      return
    values[name] = load(path, tally)
    if values[name] is None:
      return
    if values[name].shape != (layout.dim,) or not np.isfinite(values[name]).all():
      tally.add("error", f"{name}.npy is {values[name].shape}, or not finite; the features need ({layout.dim},)",
                "these statistics belong to another representation: restore the data's own")
      return
  mean, std = values["Mean"].astype(np.float64), values["Std"].astype(np.float64)
  if (std <= 0).any():
    tally.add("error", "Std.npy is not positive everywhere", "restore the data's own")
    return
  blocks = {name: std[part] for name, part in layout.blocks.items()}
  if any(np.ptp(block) > 1e-4 * block.mean() for block in blocks.values()):
    tally.add("error", "Std.npy differs inside a block", "the field averages the std over each block (turn, root "
              "velocity, height, positions, rotations, velocities, contacts): build again")
    return
  by_block = np.array([block.mean() for block in blocks.values()])
  ours = np.array([computed.std[part].mean() for part in layout.blocks.values()])
  if len(by_block) == 7 and np.allclose(by_block, _EVALUATOR_STD, rtol=2e-2) and layout.skeleton is HUMANML3D:
    tally.add("error", "Mean and Std are the evaluator's, not the data's", "root and contacts of these are divided by "
              "25: take Mean.npy and Std.npy of the data set")
  elif len(by_block) == 7 and np.allclose(by_block[[0, 1, 2, 6]] * 5, ours[[0, 1, 2, 6]], rtol=0.1):
    tally.add("error", "Std of root and contacts is a fifth of the data's", "these are a training run's statistics "
              "(feat_bias 5): take those of the data set")
  elif np.abs(by_block / ours - 1).max() > 0.1 or (np.abs(mean - computed.mean) / std).max() > 0.2:
    official = (len(by_block) == 7 and layout.skeleton is HUMANML3D
                and np.allclose(by_block, _OFFICIAL_STD, rtol=1e-3))
    worst = int(np.abs(by_block / ours - 1).argmax())
    tally.add("warning" if official else "error",
              "Mean and Std are official HumanML3D's, the clips are not all of it" if official else
              f"Mean and Std are not this data's (std of {list(blocks)[worst]}: {by_block[worst]:.4g}, computed "
              f"{ours[worst]:.4g})",
              "fine for a part of HumanML3D or for its models; else build again" if official else
              "features and statistics come from different versions of the data: build again")


def _twist(joints, skeleton):
  """Angle between the lines through hips and shoulders, degrees, median over a clip."""
  lines = [joints[:, left] - joints[:, right] for right, left in (skeleton.hips, skeleton.shoulders)]
  cosine = np.prod([rot.unit(line, eps=1e-9) for line in lines], axis=0).sum(-1)
  return float(np.degrees(np.arccos(np.clip(np.median(cosine), -1, 1))))


class Body:
  """Checks bodies: feet below or above the floor, sliding feet, bones of varying length, exchanged sides."""

  def __init__(self, tally, skeleton, canonical=True):
    self.tally, self.skeleton, self.canonical = tally, skeleton, canonical
    self.floors, self.slides, self.heights, self.backwards = [], [], [], []

  def check(self, name, joints):
    """Checks joints (T, J, 3) in the skeleton's unit; a single frame is skipped."""
    if len(joints) < 2:
      return
    skeleton, add = self.skeleton, self.tally.add
    fault = plausibility.fault(joints, skeleton, name=name)
    if fault:
      add("error", "joints that are no person's", "cut the frames away, scale the source to metres, or remove the clip",
          fault[:120])
    joints = joints.astype(np.float64)
    lengths = bone_lengths(joints, skeleton)[:, 1:] * skeleton.unit
    if lengths.std(0).max() > 0.01:
      bone = skeleton.joints[1 + int(lengths.std(0).argmax())]
      add("warning", "bones that change their length by more than 1 cm", "tracking faults, or joints of a network: cut "
          "the frames away", f"{name} ({bone})")
    elif self.canonical and np.abs(lengths.mean(0) - skeleton.bone_lengths[1:] * skeleton.unit).max() > 0.02:
      add("warning", "bones over 2 cm off the canonical body", "bring the clips to one body "
          "(motion_jax.motion.retarget), or statistics mix people's sizes with their motion", name)
    feet = list(skeleton.left_feet + skeleton.right_feet)
    floor = floor_height(joints, skeleton) * skeleton.unit
    self.floors.append(floor)
    self.heights.append(np.median(joints[:, 0, 1]) * skeleton.unit)
    if floor < -0.08:
      add("warning", "feet over 8 cm below the floor", "put the floor at y = 0 (motion_jax.motion.retarget)", name)
    elif floor > 0.12:
      add("note", "feet that never come within 12 cm of the floor", "fine for stairs and jumps; else put the floor at "
          "y = 0", name)
    step = np.linalg.norm(np.diff(joints[:, feet], axis=0)[..., [0, 2]], axis=-1) * skeleton.unit
    height = joints[:, feet, 1] * skeleton.unit - floor
    low = np.maximum(height[1:], height[:-1]) < 0.03
    if low.sum() > 5:
      self.slides.append(np.median(step[low]))
      if np.percentile(step[low], 20) > 0.02:  # a runner's feet are low in flight too, but stand for a fifth
        add("warning", "feet that slide over 2 cm a frame on the floor", "look at them: skating, a wrong rate, or a "
            "wrong scale", name)
    if np.abs(np.diff(joints, axis=0)).max() * skeleton.unit > 0.6:
      add("warning", "joints that jump over 60 cm in a frame", "tracking faults: cut the frames away",
          f"{name} (frame {int(np.abs(np.diff(joints, axis=0)).max((1, 2)).argmax()) + 1})")
    twist = _twist(joints, skeleton)
    if twist > _CROSSED:
      add("error", "shoulders that point the other way than the hips", "left and right are exchanged in one of them, "
          "or the source's collars lie in one point: check the mapping, build again", f"{name} ({twist:.0f} degrees)")
    elif twist > _TWISTED:
      add("warning", "shoulders far off the hips' direction", "people twist by up to 55 degrees: check the mapping and "
          "look at the clip", f"{name} ({twist:.0f} degrees)")
    ahead = facing(joints, skeleton)
    toes = np.stack([joints[:, foot[1]] - joints[:, foot[0]] for foot in (skeleton.left_feet, skeleton.right_feet)], 1)
    if low.sum() > 5:
      stands = low[:, [1, 3]] & (step[:, [1, 3]] < 0.02)
      forward = (toes * ahead[:, None]).sum(-1)[1:][stands]
      if len(forward) and np.median(forward) < 0:
        self.backwards.append(name)

  def report(self):
    if len(self.backwards) > 0.3 * len(self.floors):
      self.tally.add_all("error", "bodies whose standing toes point backwards", "left and right are exchanged, or an "
                         "axis is mirrored: check the mapping and the axes of the source", self.backwards)
    elif self.backwards:
      self.tally.add_all("note", "bodies whose standing toes point backwards", "fine for a few, who twist or dance",
                         self.backwards)
    if self.heights and not 0.3 < np.median(self.heights) < 1.6:
      self.tally.add("error", f"pelvis at {np.median(self.heights):.3g} m in most clips", "the unit is wrong "
                     "(HumanML3D has metres, KIT millimetres) or y is not up")

  def facts(self):
    if not self.floors:
      return []
    slide = f", {1000 * np.median(self.slides):.1f} mm a frame while low" if self.slides else ""
    middle, low, high = (round(1000 * np.percentile(self.floors, share)) for share in (50, 5, 95))
    return [("feet", f"stand at {middle} mm (5 % to 95 %: {low} to {high}){slide}")]
