"""How a CDAMD model is best asked: solvers, masks and orders of generation, masks of editing, on archives' test clips.

  python benchmarks/cdamd_choices.py --archives path/to/cmu path/to/bandai [--model cdamd-small] [--parts edits]

solvers: the same captions and seeds by each; how far the joints come from dopri5's (millimetres, roots at one place).
masks: what a latent may look at x which latents are made first. Both: recall of the motions by the teacher among all
captions (percent), cosine of matched pairs, mean jerk, share of steps in which a foot slides, seconds of a batch.
edits: each task under each mask on real clips, with their own captions; at the borders between kept and new frames the
step of the joints (mm) and its change from the step before (mm), kept frames as they came (pasted) or decoded, beside
the same clips as they were recorded; and the cosine of the whole motion to its caption.
"""
import argparse
import functools
import time

import numpy as np

from motion_jax import loading, retrieval
from motion_jax.data.clip import Clip
from motion_jax.data.datasets.archive import read_archive
from motion_jax.metrics import physics, scores
from motion_jax.models.cdamd.mask_schedule import TASKS
from motion_studio import Pipeline

FRAMES, BATCH = 96, 32
SOLVERS = (("dopri5", 1), ("euler", 5), ("euler", 10), ("euler", 20), ("midpoint", 5), ("midpoint", 10), ("heun", 5),
           ("heun", 10), ("rk4", 5))
MASKS = ("causal", "dccm", "bcm")
PARTS = ("solvers", "masks", "edits")
ORDERS = ("random", "left_to_right")


def generated(loaded, captions, seed, **sampling):
  """(motions, seconds of a batch once compiled): one of FRAMES frames for each caption."""
  made, times = [], []
  for i in range(0, len(captions), BATCH):
    batch = captions[i:i + BATCH]
    padded = batch + batch[-1:] * (BATCH - len(batch))  # one batch size: one compilation
    start = time.perf_counter()
    motions = loaded.generate(padded, FRAMES, seeds=[1000 * seed + i + j for j in range(BATCH)], **sampling)
    times.append(time.perf_counter() - start)
    made += [motions[j] for j in range(len(batch))]
  return made, np.median(times[1:] or times)


def qualities(retriever, captions, clips, embedded):
  """R@1, R@3 in percent, cosine, mean jerk, skating in percent."""
  similarity = embedded @ retriever.embed_motion([retriever.features_of(clip) for clip in clips]).T
  found = scores.retrieval(similarity)
  joints = [clip.joints for clip in clips]
  return (f"{100 * found['r1']:.1f} | {100 * found['r3']:.1f} | {np.diag(similarity).mean():.3f} | "
          f"{np.mean([physics.jerk(x).mean() for x in joints]):.4f} | "
          f"{100 * np.mean([physics.skating_ratio(x) for x in joints]):.1f}")


def compare(loaded, retriever, clips, choices, seeds, heads, most):
  """One row for each choice of sampling; the first is what the others are compared with."""
  first = {clip.captions[0].text: clip for clip in reversed(clips)}
  captions = sorted(first)
  captions = [captions[i] for i in np.linspace(0, len(captions) - 1, min(most, len(captions))).astype(int)]
  print(f"\n{len(captions)} captions")
  embedded = retriever.embed_text(captions)
  print(f"\n| {' | '.join(heads)} | R@1 | R@3 | cosine | jerk | skating % | mm from the first | s a batch |")
  print("| --- " * (len(heads) + 7) + "|")
  blank = " | ".join(["real", *[""] * (len(heads) - 1)])
  real = [first[caption] for caption in captions]
  print(f"| {blank} | {qualities(retriever, captions, real, embedded)} | | |", flush=True)
  reference = None
  for names, sampling in choices:
    made = [generated(loaded, captions, seed, **sampling) for seed in range(seeds)]
    motions = [motion for part, _ in made for motion in part]
    joints = np.stack([motion.joints for motion in motions])
    reference = joints if reference is None else reference
    off = 1000 * scores.joint_errors(reference, joints).mean()
    rows = [qualities(retriever, captions, part, embedded) for part, _ in made]
    mean = np.mean([[float(x) for x in row.split(" | ")] for row in rows], axis=0)
    tell = f"{mean[0]:.1f} | {mean[1]:.1f} | {mean[2]:.3f} | {mean[3]:.4f} | {mean[4]:.1f}"
    print(f"| {' | '.join(names)} | {tell} | {off:.1f} | {np.median([s for _, s in made]):.2f} |", flush=True)


def border_jumps(joints, made):
  """Mean step of the joints into each border (first frame of kept or new), and how it differs from the step before."""
  borders = [edge for span in made for edge in span if 2 <= edge < len(joints)]
  steps = np.diff(joints, axis=0)
  return [(np.linalg.norm(steps[b - 1], axis=-1).mean(), np.linalg.norm(steps[b - 1] - steps[b - 2], axis=-1).mean())
          for b in borders]


def edited(loaded, clips, captions, task, mask, paste, seed):
  batches = range(0, len(clips), BATCH)
  edits = (functools.partial(Pipeline(loaded).edits, plan=False) if paste else
           functools.partial(loaded.edits, cleanup=True))
  return [motion for i in batches for motion in edits(
      clips[i:i + BATCH], captions[i:i + BATCH], task, mask=mask,
      seeds=[1000 * seed + i + j for j in range(len(clips[i:i + BATCH]))])]


def mean_jumps(motions):
  """(step, change of step) in millimetres over all borders of all motions."""
  jumps = [jump for motion in motions for jump in border_jumps(motion.joints, motion.meta["made"])]
  return 1000 * np.mean(jumps, axis=0)


def edits(loaded, retriever, clips, seeds):
  heads = ("task", "mask", "step, mm", "change of step, mm", "decoded: step", "decoded: change", "cosine")
  print(f"\n| {' | '.join(heads)} |\n" + "| --- " * len(heads) + "|")
  captions = [clip.captions[0].text for clip in clips]
  embedded = retriever.embed_text(captions)

  def cosine(motions):
    moved = retriever.embed_motion([retriever.features_of(motion) for motion in motions])
    return float((embedded * moved).sum(1).mean())

  for task in TASKS:
    rows = {mask: [] for mask in MASKS}
    for mask in MASKS:
      for seed in range(seeds):
        pasted, decoded = (edited(loaded, clips, captions, task, mask, paste, seed) for paste in (True, False))
        rows[mask].append([*mean_jumps(pasted), *mean_jumps(decoded), cosine(pasted)])
    real = [real_motion(loaded, clip, motion) for clip, motion in zip(clips, pasted)]
    step, change = mean_jumps(real)
    print(f"| {task} | real | {step:.1f} | {change:.1f} | | | {cosine(real):.3f} |")
    for mask, found in rows.items():
      numbers = np.mean(found, axis=0)
      print(f"| {task} | {mask} | {' | '.join(f'{x:.1f}' for x in numbers[:4])} | {numbers[4]:.3f} |", flush=True)


def real_motion(loaded, clip, motion):
  """The clip as the model is given it: on its body, at its place, in whole latents."""
  features, count = loaded.padded_features(clip)
  joints = loaded.stats.denormalize(features[:count]).reshape(count, -1, 3)
  return Clip(joints, loaded.fps, clip.captions, id=clip.id, meta={"made": motion.meta["made"]})


def main():
  parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
  parser.add_argument("--archives", nargs="+", required=True)
  parser.add_argument("--model", default="cdamd-small")
  parser.add_argument("--teacher", default="part-tmr-small")
  parser.add_argument("--parts", nargs="+", default=PARTS, choices=PARTS)
  parser.add_argument("--guidance", type=float)
  parser.add_argument("--seeds", type=int, default=1)
  parser.add_argument("--captions", type=int, default=1000, help="captions to generate from, at most (all)")
  parser.add_argument("--clips", type=int, default=64, help="test clips to edit (64)")
  args = parser.parse_args()
  loaded, retriever = loading.load(args.model), retrieval.load(args.teacher)
  clips = [clip for folder in args.archives for clip in read_archive(folder, "test")]
  clips = [clip for clip in clips if 40 <= clip.num_frames <= loaded.config.data.max_frames]
  scale = loaded.sampling(guidance_scale=args.guidance).guidance_scale
  print(f"{loaded.id}: {len(clips)} test clips, guidance {scale:g}, {args.seeds} seed(s), {FRAMES} frames")
  if "solvers" in args.parts:
    choices = [((solver, str(steps) if solver != "dopri5" else "its own"),
                dict(solver=solver, num_steps=steps, guidance_scale=scale)) for solver, steps in SOLVERS]
    compare(loaded, retriever, clips, choices, args.seeds, ("solver", "steps"), args.captions)
  if "masks" in args.parts:
    choices = [((mask, order), dict(mask=mask, order=order, guidance_scale=scale)) for mask in MASKS
               for order in ORDERS]
    compare(loaded, retriever, clips, choices, args.seeds, ("mask", "order"), args.captions)
  if "edits" in args.parts:
    every = np.linspace(0, len(clips) - 1, min(args.clips, len(clips))).astype(int)
    edits(loaded, retriever, [clips[i] for i in every], args.seeds)


if __name__ == "__main__":
  main()
