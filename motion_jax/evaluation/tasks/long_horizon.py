"""Long motions: many captions in a row, judged piece by piece and at the borders (docs/papers/cmdm.md#long-horizon).

Which captions, and for how long, comes from a file of stories (FlowMDM's own list is one, given out apart from its
code), or else from the test items: `sequences` lists of `segments` items each, drawn once by the seed, the same in all
repeats. Of SnapMoGen's recordings (`Benchmark.recorded`) it is what they show, one motion after the other; a repeat
draws one of each motion's captions, and real transitions are those at the recordings' own borders.
"""
import dataclasses
import hashlib
import pathlib
from typing import NamedTuple

import numpy as np

from motion_jax.data.timelines import read_sequences
from motion_jax.evaluation import samples
from motion_jax.evaluation.candidates import load_able
from motion_jax.metrics import long_horizon, physics
from motion_jax.models.cmdm import multi_prompt
from motion_jax.motion.representations import get_layout, to_joints

METRICS = ("top1", "top2", "top3", "fid", "matching", "diversity", "transition_fid", "transition_diversity",
           "transition_distance", "peak_jerk", "auj")
__all__ = ["METRICS", "damaged", "load", "real_rows", "rows"]
BATCH = 8  # long motions made together
SEQUENCES, REFERENCE, SCORES, SPLICES = 11, 12, 13, 14  # streams of random numbers


def load(run, raw=False):
  """A model that makes motions of several prompts. Raises ValueError for another one."""
  return load_able(run, "multi_prompt", raw)


def real_rows(judge, repeat):
  """The real clips, their random crops in the place of transitions."""
  items, evaluator = judge.items, judge.evaluator
  if judge.protocol.recorded:
    rules = dataclasses.replace(_rules(judge.protocol), unit=1)
    made = long_horizon.score(_recorded(judge, repeat), _reference(judge, repeat), *_scoring(judge, repeat, rules))
    judge.curves.setdefault("real", []).append(made.curve)
    return {"real": made.row}
  motions, joints = _real(judge)
  caption = (judge.rng(repeat, REFERENCE).random(len(items)) * [len(said) for said in items.captions]).astype(int)
  every = samples.Pass(np.arange(len(items)), caption, np.zeros(len(items), int), items.rows)
  made = long_horizon.real_row(
      motions, joints, every.captions_of(items), judge.embed_text(evaluator, every), _reference(judge, repeat),
      _embed(judge), judge.rng(repeat, SCORES), _rules(judge.protocol), evaluator.layout.skeleton)
  judge.curves.setdefault("real", []).append(made.curve)
  return {"real": made.row}


def rows(judge, subject, repeat):
  """{"": scores} of a subject's long motions for a repeat."""
  layout, drawn = subject.model.stats.layout, sequences(judge, repeat)
  options = {"way": judge.protocol.way} | dict(subject.options)
  way = options["way"]
  unit = subject.model.dit.block * subject.model.vae.frames_per_latent
  frames = [_frames(tale.frames, way, unit, subject.model.vae.frames_per_latent) for tale in drawn]
  jobs = samples.Jobs([" | ".join(tale.captions) for tale in drawn], [sum(part) for part in frames],
                      [samples.seed_of(judge.seed, repeat, i) for i in range(len(drawn))], list(range(len(drawn))))
  told = [list(zip(tale.captions, (tale.frames / subject.model.fps).tolist())) for tale in drawn]
  made = subject.sample(tell(subject, told, options), subject.store(judge, f"stories, {way}{_file(judge)}"),
                        f"r{repeat:03d}", jobs, f"repeat {repeat + 1}", BATCH)

  def pieces():
    for motion, tale, counts in zip(made, drawn, frames):
      motion = motion[:sum(counts)]
      joints = np.asarray(to_joints(motion, layout), np.float64)
      seen, mode = judge.evaluator.layout, judge.evaluator.mode
      yield long_horizon.Sequence(
          joints if seen.are_joints else layout.convert(motion, seen, mode), joints * layout.skeleton.unit,
          tuple(counts), tuple(tale.captions), judge.embed_captions(judge.evaluator, tale.captions, tale.tokens))

  scored = long_horizon.score(pieces(), _reference(judge, repeat), *_scoring(judge, repeat, _rules(judge.protocol)))
  judge.curves.setdefault(subject.name, []).append(scored.curve)
  return {"": scored.row}


def damaged(judge, repeat, joints):
  """Controls of transitions: real ones, and "spliced", halves of two clips with nothing between them."""
  evaluator, rules, rng = judge.evaluator, _rules(judge.protocol), judge.rng(repeat, SPLICES)
  skeleton, (_, real) = evaluator.layout.skeleton, _real(judge)
  crops = np.stack([real[i][start:start + rules.width] / skeleton.unit
                    for i, start in long_horizon.random_crops(real, rules.width, rng)])
  half, other = rules.width // 2, np.roll(crops, 1, axis=0)
  last, first = crops[:, half - 1:half, :1], other[:, half:half + 1, :1]
  spliced = np.concatenate([crops[:, :half], other[:, half:] + (last - first) * [1, 0, 1]], axis=1)
  read = list if evaluator.layout.are_joints else (
      lambda x: [evaluator.layout.from_joints_in_place(one, evaluator.mode) for one in x])
  rows = {name: long_horizon.transition_row(read(x), x * skeleton.unit, _reference(judge, repeat), _embed(judge), rules,
                                            skeleton) for name, x in (("real", crops), ("spliced", spliced))}
  return rows, {"spliced": {"transition_fid": 1, "transition_distance": 1, "peak_jerk": 1, "auj": 1}}


class Tale(NamedTuple):
  """The captions of a long motion, their tokens (None: by rule), and the frames that each is asked for (N,)."""
  captions: list[str]
  tokens: list
  frames: np.ndarray


def sequences(judge, repeat=0) -> list[Tale]:
  """What is to be told, lengths cut to whole units."""
  items, protocol = judge.items, judge.protocol
  if protocol.recorded:
    told = []
    for at, rng in zip(_chosen(judge), judge.rng(repeat, SEQUENCES).spawn(protocol.sequences)):
      caption = (rng.random(len(at)) * [len(items.captions[i]) for i in at]).astype(int)
      told.append(Tale([items.captions[i][c] for i, c in zip(at, caption)], [None] * len(at),
                       items.rows[at] // protocol.unit * protocol.unit))
    return told
  if protocol.timelines:
    return [Tale([text for text, _ in story], [None] * len(story),
                 np.maximum([frames for _, frames in story], protocol.unit) // protocol.unit * protocol.unit)
            for story in read_sequences(protocol.timelines)[:protocol.sequences]]
  rng = judge.rng(0, SEQUENCES)
  found = []
  for _ in range(protocol.sequences):
    again = len(items) < protocol.segments
    item = rng.choice(len(items), protocol.segments, replace=again)
    caption = (rng.random(protocol.segments) * [len(items.captions[i]) for i in item]).astype(int)
    drawn = samples.Pass(item, caption, np.zeros(len(item), int), items.rows[item])
    found.append(Tale(drawn.captions_of(items), drawn.tokens_of(items),
                      drawn.frames // protocol.unit * protocol.unit))
  return found


def _chosen(judge):
  """[items of a recording, in its order] of the recordings that are told: all, or as many as wanted, by the seed."""
  if "recordings" not in judge.kept:
    found, wanted = {}, judge.protocol.sequences
    for i, name in enumerate(judge.items.ids):
      found.setdefault(name.rsplit("#", 2)[0], []).append(i)
    found = [np.array(at) for at in found.values()]
    order = judge.rng(0, SEQUENCES).permutation(len(found))[:wanted]
    judge.kept["recordings"] = [found[i] for i in sorted(order)]
    if len(found) < wanted:
      judge.kept.setdefault("notes", []).append(
          f"Of {len(found)} recordings, where the protocol wants {wanted}: there are no more")
  return judge.kept["recordings"]


def _recorded(judge, repeat):
  """The recordings as `Sequence`s, with the captions that the repeat draws."""
  items, evaluator, layout = judge.items, judge.evaluator, get_layout(judge.protocol.joints_layout)
  seen, features = items.of(evaluator), items.features[layout.name, evaluator.mode]
  for at, tale in zip(_chosen(judge), sequences(judge, repeat)):
    joints = np.asarray(to_joints(np.concatenate([features[i] for i in at]), layout), np.float64)
    yield long_horizon.Sequence(
        np.concatenate([seen[i] for i in at]), joints * layout.skeleton.unit, tuple(map(int, items.rows[at])),
        tuple(tale.captions), judge.embed_captions(evaluator, tale.captions, tale.tokens))


def _scoring(judge, repeat, rules):
  """What `metrics.long_horizon.score` is told beside motions and their reference."""
  two = judge.evaluator.seen is not None
  return (_embed(judge, seen=True), judge.rng(repeat, SCORES), rules, judge.evaluator.layout.skeleton,
          _embed(judge) if two else None)


def _file(judge):
  """What tells samples of a file's stories from others."""
  path = judge.protocol.timelines
  return f" of {hashlib.sha256(pathlib.Path(path).read_bytes()).hexdigest()}" if path else ""


def _frames(counts, way, unit, latent):
  """How long the pieces of a story come out: prompts change on a grid of whole blocks, or of latents."""
  if way != "stream":
    return [max(1, int(count) // latent) * latent for count in counts]
  blocks, total = multi_prompt.borders(counts, unit)
  ends = np.minimum(np.cumsum(blocks) * unit, total)
  return np.diff(ends, prepend=0).tolist()


def tell(subject, tales, options):
  """make(jobs) of `samples.sample`: motions of the [(prompt, seconds)] at the jobs' places; options: of
  `multi_prompts`."""
  def make(jobs):
    made = subject.model.multi_prompts([tales[i] for i in jobs.places], seeds=jobs.seeds, cleanup=False,
                                 guidance_scale=subject.guidance_scale, **options)
    return [motion.features for motion in made]
  return make


def _rules(protocol):
  babel = protocol.real_jerk == "babel"
  return dataclasses.replace(
      long_horizon.BABEL if babel else long_horizon.LongHorizon(), width=protocol.transition_frames,
      shortest=protocol.min_frames, longest=protocol.past_frames - 1, pool=protocol.pool,
      unit=1 if babel else protocol.unit, diversity_draws=protocol.diversity_draws, cosine=protocol.cosine,
      jerk_scale=1 / protocol.jerk_unit,
      real_jerk=physics.REAL_JERK[protocol.real_jerk] if protocol.real_jerk else None)


def _real(judge):
  """Real motions as the evaluator reads them, pieces of joints where those are coordinates, and their joints."""
  evaluator = judge.evaluator
  features = judge.items.of(evaluator)
  joints = [np.asarray(to_joints(x, evaluator.layout), np.float64) for x in features]
  scale = evaluator.layout.skeleton.unit
  return joints if evaluator.layout.are_joints else features, [scale * x for x in joints]


def _reference(judge, repeat):
  key = "reference", repeat
  if judge.protocol.recorded:
    key = "reference"  # the same in all repeats
    if key not in judge.kept:
      judge.kept[key] = long_horizon.reference_of(_recorded(judge, 0), _embed(judge, seen=True), _rules(judge.protocol),
                                                  judge.evaluator.layout.skeleton)
  elif key not in judge.kept:
    judge.kept[key] = long_horizon.reference(*_real(judge), _embed(judge), judge.rng(repeat, REFERENCE + 100),
                                             _rules(judge.protocol), judge.evaluator.layout.skeleton)
  return judge.kept[key]


def _embed(judge, seen=False):
  """embed(motions) of `metrics.long_horizon`: joints are put at the origin first, features begin there anyway. seen:
  what FID and diversity are taken of, where that is another vector."""
  evaluator = judge.evaluator

  def embed(motions):
    layout = evaluator.layout
    if layout.are_joints:
      motions = [layout.from_joints_in_place(long_horizon.placed(x, layout.skeleton)) for x in motions]
    return judge.embed(evaluator, motions, np.array([len(x) for x in motions]),
                       evaluator.embed_for_fid if seen and evaluator.seen is not None else None)
  return embed
