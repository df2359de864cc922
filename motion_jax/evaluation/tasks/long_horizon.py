"""Long motions of many prompts, evaluated segment by segment and at the borders (docs/papers/cmdm.md#long-horizon).

Captions and lengths come from a file of prompt sequences (such as FlowMDM's list, which is distributed apart from its
code), or else from the test set: `sequences` lists of `segments` items each, drawn once by the seed, the same in all
replications. For SnapMoGen (`Benchmark.recorded`) they are the motions of whole recordings, in order; a replication
draws one of each motion's captions, and real transitions are those at the recordings' own borders.
"""
import dataclasses
import functools
import hashlib
import pathlib
from typing import NamedTuple

import numpy as np

from motion_jax.data.timelines import read_sequences
from motion_jax.evaluation import samples
from motion_jax.evaluation.candidates import load_able
from motion_jax.evaluation.tasks.base import Damaged, SampleRequest, Task, TaskScores
from motion_jax.metrics import long_horizon, physics
from motion_jax.motion.representations import get_layout, to_joints

BATCH = 8  # long motions made together
SEQUENCES, REFERENCE, SCORES, SPLICES = 11, 12, 13, 14  # streams of random numbers


class PromptSequence(NamedTuple):
  """The captions of a long motion, their tokens (None: by rule), and the requested frames of each (N,)."""
  captions: list[str]
  tokens: list
  frames: np.ndarray


class LongHorizon(Task):
  FILES = ("one motion of all `segments` in a row, each of a caption and its frames; prompts change at those frames")
  METRICS = ("top1", "top2", "top3", "fid", "matching", "diversity", "transition_fid", "transition_kid",
             "transition_diversity", "transition_distance", "peak_jerk", "auj")
  OPTIONS = ("way", "cleanup", "ease")  # the last two: judge the features of cleaned, eased joints, as users see them

  def __init__(self, harness):
    super().__init__(harness)
    self._references = {}  # {replication: the real side}

  @staticmethod
  def load(run, raw=False):
    """A model that generates motions of several prompts. Raises ValueError for another one."""
    return load_able(run, "multi_prompt", raw)

  def real(self, replication):
    """The real clips, with random crops in place of transitions; for recordings their own transitions."""
    test_set, evaluator = self.test_set, self.harness.evaluator
    if self.protocol.recorded:
      rules = dataclasses.replace(self._rules, unit_length=1)
      scored = long_horizon.score(self._recorded(replication), self._reference(replication),
                                  *self._scoring(replication, rules))
      return TaskScores({"real": scored.row}, {"real": scored.curve})
    motions, joints = self._real
    rng = self.harness.rng(replication, REFERENCE)
    caption = (rng.random(len(test_set)) * [len(captions) for captions in test_set.captions]).astype(int)
    every = samples.Draw(np.arange(len(test_set)), caption, np.zeros(len(test_set), int), test_set.rows)
    scored = long_horizon.real_row(
        motions, joints, every.captions_of(test_set), self.harness.embed_text(evaluator, every),
        self._reference(replication), self._embed(), self.harness.rng(replication, SCORES), self._rules,
        evaluator.layout.skeleton)
    return TaskScores({"real": scored.row}, {"real": scored.curve})

  def score(self, candidate, replication):
    """The row of a candidate's long motions."""
    model, prompts = candidate.model, self.sequences(replication)
    options = ways_of(candidate, self.protocol.way)
    frames = [model.segment_frames(script.frames.tolist(), *options.get("way", "").split()) for script in prompts]
    jobs = self._jobs(replication, prompts, frames)
    timed = [list(zip(script.captions, (script.frames / model.stats.layout.fps).tolist())) for script in prompts]
    store = candidate.store(self.harness, f"multi-prompt, {options.get('way', 'stream')}{self._file_hash}")
    motions = candidate.sample(multi_prompt_generator(candidate, timed, options), store, f"r{replication:03d}", jobs,
                               f"replication {replication + 1}", BATCH)
    scored = long_horizon.score(self._pieces(motions, prompts, frames, model.stats.layout),
                                self._reference(replication), *self._scoring(replication, self._rules))
    count, size = sum(len(script.captions) - 1 for script in prompts), self._reference(replication).transitions.shape[1]
    note = {"": f"its transition FID is of {count} transitions in {size} dimensions, whose covariance has no full "
                "rank: compare transition KID, which needs none"} if count <= size else {}
    return TaskScores({"": scored.row}, {"": scored.curve}, notes=note)

  def requests(self, replication, reader):
    prompts = self.sequences(replication)
    frames = [sequence.frames.tolist() for sequence in prompts]
    yield SampleRequest(f"r{replication:03d}", self._jobs(replication, prompts, frames), [
        {"segments": [{"caption": caption, "frames": count} for caption, count in zip(sequence.captions, counts)]}
        for sequence, counts in zip(prompts, frames)])

  def _jobs(self, replication, prompts, frames):
    return self.sequence_jobs(replication, [sequence.captions for sequence in prompts],
                              [int(sum(part)) for part in frames])

  def _pieces(self, motions, prompts, frames, layout):
    """The `metrics.long_horizon.Sequence`s of generated motions [(rows, F)], one at a time."""
    evaluator = self.harness.evaluator
    for motion, sequence, counts in zip(motions, prompts, frames):
      motion = motion[:sum(counts)]
      joints = np.asarray(to_joints(motion, layout), np.float64)
      yield long_horizon.Sequence(
          joints if evaluator.layout.are_joints else layout.convert(motion, evaluator.layout, evaluator.mode),
          joints * layout.skeleton.unit, tuple(counts), tuple(sequence.captions),
          self.harness.embed_captions(evaluator, sequence.captions, sequence.tokens))

  def damaged(self, replication, joints):
    """Transitions: real ones, and "spliced", halves of two clips without anything between them."""
    evaluator, rules, rng = self.harness.evaluator, self._rules, self.harness.rng(replication, SPLICES)
    layout, (_, real) = evaluator.layout, self._real
    skeleton = layout.skeleton
    crops = np.stack([real[i][start:start + rules.width] / skeleton.unit
                      for i, start in long_horizon.random_crops(real, rules.width, rng)])
    half, other = rules.width // 2, np.roll(crops, 1, axis=0)
    last, first = crops[:, half - 1:half, :1], other[:, half:half + 1, :1]
    spliced = np.concatenate([crops[:, :half], other[:, half:] + (last - first) * [1, 0, 1]], axis=1)
    read = list if layout.are_joints else (
        lambda x: [layout.from_joints_in_place(clip, evaluator.mode) for clip in x])
    rows = {name: long_horizon.transition_row(read(x), x * skeleton.unit, self._reference(replication), self._embed(),
                                              rules, skeleton) for name, x in (("real", crops), ("spliced", spliced))}
    return Damaged(rows, {"spliced": dict.fromkeys(
        ("transition_fid", "transition_kid", "transition_distance", "peak_jerk", "auj"), 1)})

  @property
  def notes(self):
    wanted, have = self.protocol.sequences, self.protocol.recorded and len(self._recordings)
    return (f"Of {have} recordings, where the protocol wants {wanted}: there are no more",) if 0 < have < wanted else ()

  # --- prompts -----------------------------------------------------------------------------------------------------

  def sequences(self, replication=0) -> list[PromptSequence]:
    """The prompt sequences of a replication, with lengths cut to whole units."""
    test_set, protocol = self.test_set, self.protocol
    whole = lambda frames: frames // protocol.unit_length * protocol.unit_length
    if protocol.recorded:
      rngs = self.harness.rng(replication, SEQUENCES).spawn(protocol.sequences)
      return [self._captioned(at, rng.random(len(at)), whole) for at, rng in zip(self._chosen, rngs)]
    if protocol.timelines:
      return [PromptSequence([text for text, _ in prompts], [None] * len(prompts),
                             whole(np.maximum([frames for _, frames in prompts], protocol.unit_length)))
              for prompts in read_sequences(protocol.timelines)[:protocol.sequences]]
    rng, result = self.harness.rng(0, SEQUENCES), []
    for _ in range(protocol.sequences):
      item = rng.choice(len(test_set), protocol.segments, replace=len(test_set) < protocol.segments)
      caption = (rng.random(protocol.segments) * [len(test_set.captions[i]) for i in item]).astype(int)
      drawn = samples.Draw(item, caption, np.zeros(len(item), int), test_set.rows[item])
      result.append(PromptSequence(drawn.captions_of(test_set), drawn.tokens_of(test_set), whole(drawn.frames)))
    return result

  def _captioned(self, at, drawn, whole):
    """The items `at` (N,) of a recording with one caption each, chosen by numbers drawn (N,) from 0 to 1."""
    captions = [self.test_set.captions[i] for i in at]
    return PromptSequence([some[int(share * len(some))] for some, share in zip(captions, drawn)], [None] * len(at),
                          whole(self.test_set.rows[at]))

  @functools.cached_property
  def _recordings(self) -> list[np.ndarray]:
    """The items of each recording, in order."""
    places = {}
    for i, name in enumerate(self.test_set.ids):
      places.setdefault(name.rsplit("#", 2)[0], []).append(i)
    return [np.array(at) for at in places.values()]

  @functools.cached_property
  def _chosen(self) -> list[np.ndarray]:
    """The recordings that are used: all, or as many as the protocol wants, chosen by the seed."""
    order = self.harness.rng(0, SEQUENCES).permutation(len(self._recordings))[:self.protocol.sequences]
    return [self._recordings[i] for i in sorted(order)]

  @functools.cached_property
  def _file_hash(self):
    """Separates samples of a prompt file from others."""
    path = self.protocol.timelines
    return f" of {hashlib.sha256(pathlib.Path(path).read_bytes()).hexdigest()}" if path else ""

  # --- the real side, and what scores are taken with ---------------------------------------------------------------

  def _recorded(self, replication):
    """The recordings as `metrics.long_horizon.Sequence`s, with the captions that the replication draws."""
    test_set, evaluator, layout = self.test_set, self.harness.evaluator, get_layout(self.protocol.joints_layout)
    read, features = test_set.of(evaluator), test_set.features[layout.name, evaluator.mode]
    for at, sequence in zip(self._chosen, self.sequences(replication)):
      joints = np.asarray(to_joints(np.concatenate([features[i] for i in at]), layout), np.float64)
      yield long_horizon.Sequence(
          np.concatenate([read[i] for i in at]), joints * layout.skeleton.unit, tuple(map(int, test_set.rows[at])),
          tuple(sequence.captions), self.harness.embed_captions(evaluator, sequence.captions, sequence.tokens))

  @property
  def _real(self):
    """Real motions in the evaluator's features (as joints, where those are coordinates), and their joints."""
    layout = self.harness.evaluator.layout
    features = self.test_set.of(self.harness.evaluator)
    joints = [np.asarray(to_joints(x, layout), np.float64) for x in features]
    return joints if layout.are_joints else features, [layout.skeleton.unit * x for x in joints]

  def _reference(self, replication) -> long_horizon.Reference:
    skeleton = self.harness.evaluator.layout.skeleton
    key = 0 if self.protocol.recorded else replication  # recordings are the same in all replications
    if key not in self._references:
      self._references[key] = (
          long_horizon.reference_of(self._recorded(0), self._embed(for_fid=True), self._rules, skeleton)
          if self.protocol.recorded else
          long_horizon.reference(*self._real, self._embed(), self.harness.rng(replication, REFERENCE + 100),
                                 self._rules, skeleton))
    return self._references[key]

  def _scoring(self, replication, rules):
    """Further arguments of `metrics.long_horizon.score`."""
    evaluator = self.harness.evaluator
    return (self._embed(for_fid=True), self.harness.rng(replication, SCORES), rules, evaluator.layout.skeleton,
            None if evaluator.motion_for_fid is None else self._embed())

  def _embed(self, for_fid=False):
    """embed(motions) of `metrics.long_horizon`: joints are moved to the origin first, features begin there anyway.
    for_fid: the vectors of FID and diversity, where the evaluator has separate ones.
    """
    evaluator = self.harness.evaluator

    def embed(motions):
      layout = evaluator.layout
      if layout.are_joints:
        motions = [layout.from_joints_in_place(long_horizon.placed(x, layout.skeleton)) for x in motions]
      return self.harness.embed(evaluator, motions, np.array([len(x) for x in motions]),
                                evaluator.embed_for_fid if for_fid and evaluator.motion_for_fid is not None else None)
    return embed

  @property
  def _rules(self) -> long_horizon.LongHorizon:
    protocol = self.protocol
    babel = protocol.real_jerk == "babel"
    return dataclasses.replace(
        long_horizon.BABEL if babel else long_horizon.LongHorizon(), width=protocol.transition_frames,
        shortest=protocol.min_frames, longest=protocol.past_frames - 1, pool=protocol.pool,
        unit_length=1 if babel else protocol.unit_length, diversity_draws=protocol.diversity_draws,
        cosine=protocol.cosine, jerk_scale=1 / protocol.jerk_unit,
        real_jerk=physics.REAL_JERK[protocol.real_jerk] if protocol.real_jerk else None)


def ways_of(candidate, usual=None) -> dict:
  """The choices of a candidate for `multi_prompts`, among them the way of several prompts where its model has more than
  one: the one that it was given, else the usual one. Raises ValueError for a way that the model does not have."""
  options, ways = dict(candidate.options), candidate.model.ways
  way = options.pop("way", None)
  if way not in (None, *(ways or ("stream",))):
    raise ValueError(f"got the choice of sampling way {way!r}, {candidate.name} knows {', '.join(ways or ('stream',))}")
  return options | ({"way": way or usual} if ways and (way or usual) else {})


def multi_prompt_generator(candidate, sequences, options):
  """make(jobs) of `samples.sample`: motions of the [(prompt, seconds)] at the jobs' places; options: of
  `multi_prompts`. Cleanup and easing change joints, so the features are then computed from those.
  """
  options = samples.contrast_of(candidate.model) | dict(options)
  of_joints = options.get("cleanup", False) or options.get("ease", False)
  def in_place(joints):  # not retargeted: bones that drift and feet in the floor are to be judged
    layout, mode = candidate.model.stats.layout, candidate.model.config.data.mode
    return layout.from_joints_in_place(long_horizon.placed(np.asarray(joints, np.float64), layout.skeleton), mode)

  def make(jobs):
    motions = candidate.model.multi_prompts([sequences[i] for i in jobs.places], seeds=jobs.seeds,
                                            guidance_scale=candidate.guidance_scale, **options)
    return [in_place(motion.joints) if of_joints else motion.features for motion in motions]
  return make
