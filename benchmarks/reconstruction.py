"""What a tokenizer gives back of held-in and held-out clips of archives: where joints are, and how they move.

  python benchmarks/reconstruction.py --archives path/to/cmu path/to/bandai [--model cmdm-small] [--clips 150]

--model: a generator's run, a tokenizer's, or a name that ships.

Joints, in millimetres: with heading and path summed up from the features, root-aligned (docs/papers/cmdm.md
#reconstruction); per frame, heading and path taken from the real features, so that no error adds up; root = distance of
the two paths at their end. Motion, of the same clips: jerk as a share of real jerk; the 99th percentile of the knees'
acceleration as a share of the real one; how much of the highest wrist speed (relative to the pelvis) is left of the
clips with the fastest arms, the fastest tenth of them; how fast feet go that stand in the real clip, by the tight rule
of motion/contacts.py, in metres a second, real and decoded. The last line says what the representation itself loses:
joints -> features -> joints, and features -> joints -> features.
"""
import argparse

import numpy as np

from motion_jax.data.datasets.archive import read_archive
from motion_jax.evaluation.tokenizers import load_tokenizer
from motion_jax.metrics.physics import jerk
from motion_jax.motion.contacts import feet_stand
from motion_jax.motion.representations import canonicalize, extract, to_features, to_joints
from motion_jax.motion.skeleton import HUMANML3D

LENGTH = 192
WRISTS = [HUMANML3D.joints.index(f"{side}_wrist") for side in ("left", "right")]
KNEES = [HUMANML3D.joints.index(f"{side}_knee") for side in ("left", "right")]
FEET = list(HUMANML3D.left_feet + HUMANML3D.right_feet)


def round_trip(tokenizer, joints):
  """Joints (T, 22, 3) -> real and decoded joints, and decoded ones with the real root, of whole latents."""
  layout, stats = tokenizer.stats.layout, tokenizer.stats
  features = layout.from_joints(joints, tokenizer.config.data.mode)
  features = features[:min(len(features), LENGTH) // 4 * 4]
  padded = np.zeros((1, LENGTH, layout.dim), np.float32)
  padded[0, :len(features)] = stats.normalize(features)
  made = stats.denormalize(tokenizer.round_trip(padded, np.array([len(features)]))[0, :len(features)])
  real, whole = (to_joints(x.astype(np.float32), layout) for x in (features, made))
  if layout.are_joints:
    return real, whole, whole - whole[:, :1] + real[:, :1]
  posed = np.concatenate([features[:, layout.root], made[:, layout.root.stop:]], axis=1)
  return real, whole, to_joints(posed.astype(np.float32), layout)


def place_errors(real, whole, body):
  distance = lambda a, b: np.linalg.norm(a - b, axis=-1).mean() * 1000
  return (distance(real - real[:, :1], whole - whole[:, :1]), distance(real, body),
          np.linalg.norm(real[-1, 0] - whole[-1, 0]) * 1000, np.linalg.norm(real[-1, 0] - real[0, 0]) * 1000)


def motion_of(joints, stands, fps):
  """Jerk, knee accelerations (N,), highest wrist speed and speed of standing feet (N,) of joints (T, 22, 3)."""
  knees = np.linalg.norm(np.diff(joints[:, KNEES], 2, axis=0), axis=-1) * fps ** 2
  wrists = np.linalg.norm(np.diff(joints[:, WRISTS] - joints[:, :1], axis=0), axis=-1) * fps
  feet = np.linalg.norm(np.diff(joints[:, FEET], axis=0), axis=-1) * fps
  return jerk(joints).mean(), knees.ravel(), wrists.max(), feet[stands[1:] & stands[:-1]]


def motion_row(pairs, fps):
  """[(real, decoded joints)] -> ratios of jerk and of knees, (real, decoded) speeds of fastest wrists, of planted feet.
  """
  rows = []
  for real, whole in pairs:
    stands = feet_stand(real, fps)
    rows.append([motion_of(x, stands, fps) for x in (real, whole)])
  real, made = ([one[side] for one in rows] for side in (0, 1))
  mean = lambda side, column: np.mean([one[column] for one in side])
  knees = [np.percentile(np.concatenate([one[1] for one in side]), 99) for side in (real, made)]
  fastest = np.argsort([-one[2] for one in real])[:max(len(real) // 10, 1)]
  wrists = [np.mean([side[i][2] for i in fastest]) for side in (real, made)]
  feet = [np.concatenate([one[3] for one in side]).mean() for side in (real, made)]
  return mean(made, 0) / mean(real, 0), knees[1] / knees[0], wrists, feet


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("--archives", nargs="+", required=True)
  parser.add_argument("--model", default="cmdm-small")
  parser.add_argument("--splits", nargs="+", default=["train", "val", "test"])
  parser.add_argument("--with", dest="words", default="", help="only clips with one of these words in a caption, as in "
                      "punch,kick,throw")
  parser.add_argument("--clips", type=int, default=150, help="clips per archive and split, evenly spread")
  args = parser.parse_args()
  tokenizer = load_tokenizer(args.model)
  fps, words = tokenizer.stats.layout.fps, [word for word in args.words.split(",") if word]
  print(f"{tokenizer.folder}\n\n"
        f"| archive | split | clips | with heading, mm | per frame, mm | root at end, mm | path, mm |"
        " jerk | knees | wrists, m/s | planted, m/s |\n" + "| --- " * 11 + "|")
  trips = []
  for folder in args.archives:
    for split in args.splits:
      clips = [clip for clip in read_archive(folder, split) if clip.num_frames > 24 and (
          not words or any(word in caption.text for caption in clip.captions for word in words))]
      if not clips:
        continue
      spread = np.linspace(0, len(clips) - 1, min(args.clips, len(clips))).astype(int)
      clips = [clips[i] for i in np.unique(spread)]
      made = [round_trip(tokenizer, clip.joints) for clip in clips]
      place = np.mean([place_errors(*one) for one in made], axis=0)
      jerks, knees, wrists, feet = motion_row([(real, whole) for real, whole, _ in made], fps)
      print(f"| {folder.rstrip('/').split('/')[-1]} | {split} | {len(clips)} | {place[0]:.1f} | {place[1]:.1f} | "
            f"{place[2]:.0f} | {place[3]:.0f} | {jerks:.2f} | {knees:.2f} | {wrists[1]:.2f} of {wrists[0]:.2f} | "
            f"{feet[1]:.3f}, real {feet[0]:.3f} |", flush=True)
      for clip in clips if split == "test" else []:
        canonical = canonicalize(clip.joints, mode="corrected")
        features = extract(canonical, mode="corrected").astype(np.float32)
        joints = to_joints(features)
        back = to_features(joints, mode="corrected")
        rest = slice(0, max(len(back) - 81, 1))  # the smoothed heading of the last seconds sees one frame less
        benchmark = to_features(clip.joints, mode="benchmark")
        trips.append((np.abs(joints - canonical[:-1]).max() * 1000, np.abs(back - features[:-1])[rest, :259].max(),
                      np.abs(to_joints(benchmark) - canonicalize(clip.joints)[:-1]).max() * 1000))
  if trips:
    joints, features, benchmark = np.array(trips).T
    print(f"\nround trips on {len(trips)} test clips, largest differences: joints -> features -> joints "
          f"{joints.max():.4f} mm (corrected), {benchmark.max():.1f} mm worst and {np.median(benchmark):.4f} mm median "
          f"(benchmark); features -> joints -> features {features.max():.1e}")


if __name__ == "__main__":
  main()
