"""Control: joints have to be where they are in real motions, at some frames, and the pelvis on paths that no clip has.

OmniControl's protocol (neu-vi/OmniControl@76336a6:eval/eval_humanml.py, utils/metrics.py): one joint a run, at 1, 2 or
5 frames, a quarter of them or all; a row is the mean of the five densities. Motions are generated with the captions and
lengths of text to motion, each with targets from the real motion of its caption.

Motions that are projected onto their constraints (exact) are joints: distances are measured on them, other metrics on
features computed from them, as for real motion. A second unconstrained row is then treated in the same way.
"""
import dataclasses

import numpy as np

from motion_jax.control import paths
from motion_jax.control import signal as signals
from motion_jax.control.project import project
from motion_jax.control.signal import NUM_JOINTS
from motion_jax.evaluation import samples
from motion_jax.evaluation.candidates import load_able
from motion_jax.evaluation.tasks.base import ClipTask, SampleRequest, TaskScores
from motion_jax.evaluation.tasks.generation import Generation
from motion_jax.metrics import physics
from motion_jax.metrics.control_scores import NAMES, control_scores
from motion_jax.models import registry
from motion_jax.models.keys import keys_of
from motion_jax.models.results import features_of
from motion_jax.motion import rotations as rot
from motion_jax.motion.representations import to_joints
from motion_jax.motion.skeleton import HUMANML3D

JOINTS = ("pelvis", "left_foot", "right_foot", "head", "left_wrist", "right_wrist")
DENSITIES = (1, 2, 5, 25, 100)  # frames, from 25 on per cent of them
FRAMES, PATHS = 21, 22          # streams of random numbers
WALKS, COPIES = ("a person walks", "a person walks forward"), 2  # captions of what follows a path, motions of each


class Control(Generation):
  """Rows of a candidate: "unconstrained" (where exact, also "unconstrained, from joints"), one of each joint, "all
  joints", their mean, and one of each curve.
  """
  METRICS = (*NAMES, "top_speed", *ClipTask.METRICS)
  FILES = ("a motion of each caption alone, one for each `control`, positions (metres, null: free) of a joint at some "
           "frames, and one for each path of the pelvis, none moved nor turned afterwards; a joint or path without "
           "folders is left out")
  OPTIONS = ("control_steps", "refinements", "joints", "exact")
  TEXT_TO_MOTION = False
  FITS_GIVEN = True

  @staticmethod
  def load(run, raw=False):
    """A model that makes motion of 22 joints. Raises ValueError for another one."""
    loaded = load_able(run, "generate", raw)
    if loaded.stats.layout.skeleton is not HUMANML3D:
      raise ValueError(f"{run} moves the skeleton {loaded.stats.layout.skeleton.name!r}, protocol 'control' is about "
                       "the 22 joints of HumanML3D")
    return loaded

  def real(self, replication):
    """The real motions, which meet their own constraints."""
    return TaskScores({"real": self.harness.real_scores(replication) | dict.fromkeys(NAMES, 0.0)})

  def score(self, candidate, replication):
    options, model = dict(candidate.options), candidate.model
    if model.can("generate") and not (model.takes_control or options.get("exact")):
      raise ValueError(f"{candidate.name} is a {model.config.stage} model, which samples by prompts alone; --sampling "
                       f"exact=true projects its motions, or take a {' or a '.join(registry.guided_stages())}, which "
                       "constraints guide")
    chosen = str(options.get("joints", "all"))
    names = JOINTS if chosen == "all" else tuple(chosen.split("+"))
    if wrong := [name for name in names if name not in JOINTS]:
      raise ValueError(f"got the joint {wrong[0]!r}, expected all, or some of {', '.join(JOINTS)} with + between")
    real, layout = self._real_joints(candidate.reader, replication), candidate.model.stats.layout
    jobs = self.jobs(replication)
    plain = self._plain(candidate)
    motions = plain.sample(plain.generator(), plain.store(self.harness), f"r{replication:03d}", jobs,
                           f"unconstrained {replication + 1}")
    rows = {"unconstrained": self._row(replication, motions, layout, self._distances(motions, real, layout, 0, None))}
    names = list(dict.fromkeys(candidate.parts(
        {_folder(name, DENSITIES[0], replication): name for name in names}, some=False).values()))
    if candidate.options.get("exact"):
      again = [features_of(candidate.model, to_joints(motion, layout)) for motion in motions]
      rows["unconstrained, from joints"] = self._row(
          replication, again, layout, self._distances(motions, real, layout, 0, None))
    for name in names:
      runs = []
      for density in DENSITIES:
        signal = [self._signal(joints, name, density, replication, i) for i, joints in enumerate(real)]
        motions, joints = self._made(candidate, jobs, signal, _folder(name, density, replication),
                                     f"{name} {density}")
        errors = [_distances(motion, target) for motion, target in zip(joints, signal)]
        runs.append(self._row(replication, motions, layout, errors))
      rows[name] = {metric: float(np.mean([run[metric] for run in runs])) for metric in runs[0]}
    if len(names) == len(JOINTS):
      rows["all joints"] = {metric: float(np.mean([rows[name][metric] for name in names])) for metric in rows["head"]}
    return TaskScores(rows | self._paths(candidate, replication))

  def requests(self, replication, reader):
    jobs, ids = self.jobs(replication), self.ids(replication)
    real = self._real_joints(reader, replication)
    yield SampleRequest(f"r{replication:03d}", jobs, ids)
    for name in JOINTS:
      for density in DENSITIES:
        yield SampleRequest(_folder(name, density, replication), jobs, [
            record | {"control": _as_json(self._signal(joints, name, density, replication, i))}
            for i, (record, joints) in enumerate(zip(ids, real))])
    jobs, paths = self._walks(replication, self.protocol.max_frames, reader.layout.fps)
    for name, path in paths.items():
      yield SampleRequest(_path_folder(name, replication), jobs,
                   [{"control": _as_json(_path_targets(path))}] * len(jobs.captions))

  def _row(self, replication, motions, layout, errors):
    joints = [to_joints(motion, layout) for motion in motions]
    return self.harness.scores(replication, motions, layout) | control_scores(errors) | _speed(joints, layout.fps)

  def _plain(self, candidate):
    """The candidate without constraints."""
    return dataclasses.replace(candidate, options={
        name: value for name, value in candidate.options.items() if name not in self.OPTIONS})

  def _real_joints(self, reader, replication):
    """Joints [(T, 22, 3)] of the real motions of a draw, each from the origin, faced +z."""
    layout, rotated = reader.layout, []
    for features in self.harness.drawn(replication).cut(self.test_set.of(reader)):
      turn, path = layout.root_path(features)
      joints = np.asarray(to_joints(features, layout), np.float64) - path[0] * [1, 0, 1]
      rotated.append(rot.rotate(np.broadcast_to(turn[0], joints.shape[:-1] + (4,)), joints))
    return rotated

  def _signal(self, joints, name, density, replication, place):
    """The `ControlSignal` (1, T) of a joint at some frames of joints (T, 22, 3)."""
    rng = np.random.default_rng((self.harness.seed, replication, FRAMES, JOINTS.index(name), density, place))
    count = density if density < 25 else max(len(joints) * density // 100, 1)
    frames = rng.choice(len(joints), min(count, len(joints)), replace=False)
    return _targets(joints, frames, HUMANML3D.joints.index(name))

  def _distances(self, motions, real, layout, joint, frames):
    return [_distances(to_joints(motion, layout), _targets(joints, slice(frames), joint))
            for motion, joints in zip(motions, real)]

  def _made(self, candidate, jobs, signal, name, what):
    """(motions [(rows, F)], their joints [(rows, 22, 3)]) constrained by signal, one for each job."""
    given = {option: int(candidate.options[option]) for option in ("control_steps", "refinements")
             if candidate.options.get(option) is not None}
    exact = bool(candidate.options.get("exact"))
    store = candidate.store(self.harness, f"control, {'joints' if exact else 'exact False'}, {given}")
    make = controlled_generator(self._plain(candidate), signal, given, exact)
    sampled = candidate.sample(make, store, name, jobs, what)
    if not exact:
      return sampled, [to_joints(motion, candidate.model.stats.layout) for motion in sampled]
    return ([motion[:, :-3 * NUM_JOINTS] for motion in sampled],
            [motion[:, -3 * NUM_JOINTS:].reshape(len(motion), NUM_JOINTS, 3) for motion in sampled])

  def _paths(self, candidate, replication):
    """A row of each curve: distance of the pelvis from it, and physics of the body on it. All motions are as long as
    the longest curve, so that one compiled program generates them, and are evaluated as long as their curve lasts.
    """
    model, rows, layout = candidate.model, {}, candidate.model.stats.layout
    longest = int(min(model.max_seconds, 60) * layout.fps) if model.can("generate") else self.protocol.max_frames
    jobs, places = self._walks(replication, longest, layout.fps)
    for folder, name in candidate.parts({_path_folder(name, replication): name for name in places}, some=False).items():
      path, signal = places[name], _path_targets(places[name])
      sampled = self._made(candidate, jobs, [signal] * len(jobs.captions), folder, name)[1]
      sampled = [motion[:len(path)] for motion in sampled]
      rows[name] = control_scores([_distances(motion, signal) for motion in sampled]) | {
          "skating": float(np.mean([physics.skating_ratio(motion) for motion in sampled]))
      } | _speed(sampled, layout.fps)
    return rows

  def _walks(self, replication, longest, fps):
    """(jobs, {name: path}): captions of walking, all as long as the longest of the paths, each cut to `longest`
    frames."""
    places = {name: curve(fps)[:longest] for name, curve in paths.CURVES.items()}
    count = len(WALKS) * COPIES
    return samples.Jobs(list(WALKS) * COPIES, [max(map(len, places.values()))] * count,
                        [samples.seed_of(self.harness.seed, replication, i, PATHS) for i in range(count)],
                        list(range(count))), places


def _folder(joint, density, replication):
  return f"{joint}_{density}_r{replication:03d}"


def _path_folder(name, replication):
  return f"{name.replace(' ', '_')}_r{replication:03d}"


def _path_targets(path):
  joints = np.zeros((len(path), 22, 3))
  joints[:, 0, [0, 2]] = path
  return _targets(joints, slice(None), 0, (0, 2))


def _as_json(signal):
  """{"joint", "frames", "positions"} of a signal (1, T) about one joint; a coordinate that is free is null."""
  given = signal.given[0]
  joint, = np.flatnonzero(given.any((0, 2)))
  frames = np.flatnonzero(given[:, joint].any(-1))
  positions = np.where(given[frames, joint], np.round(signal.positions[0, frames, joint].astype(float), 5), None)
  return {"joint": HUMANML3D.joints[joint], "frames": frames.tolist(), "positions": positions.tolist()}


def _targets(joints, frames, joint, axes=(0, 1, 2)):
  positions = np.zeros((1, *joints.shape), np.float32)
  given = np.zeros(positions.shape, bool)
  for axis in axes:
    given[0, frames, joint, axis] = True
  positions[given] = joints[None][given]
  return signals.ControlSignal(positions, given, np.zeros(given.shape[:2], np.float32), np.zeros(given.shape[:2], bool))


def _distances(motion, signal):
  """Distances (N,) of joints (rows, 22, 3) from their targets, at each constrained joint and frame."""
  joints = np.asarray(motion[:signal.given.shape[1]], np.float64)
  given = signal.given[0, :len(joints)]
  off = np.where(given, joints - signal.positions[0, :len(joints)], 0.0)
  return np.linalg.norm(off, axis=-1)[given.any(-1)]


def _speed(motions, fps):
  """The largest speed of a joint in any of the motions [(rows, 22, 3)], metres a second."""
  fastest = [np.linalg.norm(np.diff(motion, axis=0), axis=-1).max() for motion in motions]
  return {"top_speed": float(max(fastest) * fps)}


def controlled_generator(candidate, signal, given, exact):
  """make(jobs) of `samples.sample`: motions of the jobs' captions, each guided by signal[place].

  given: control_steps and refinements of sampling; exact: projected onto the signal afterwards, and each row of
  features is followed by its joints, since features keep joints only to some millimetres, and not where they began.
  """
  def make(jobs):
    chosen = samples.contrast_of(candidate.model) | dict(
        guidance_scale=candidate.guidance_scale, **candidate.options, **given)
    rows = [signal[i].slice_frames(0, max(jobs.frames)) for i in jobs.places]
    constraints, model = signals.stack(rows), candidate.model
    if exact:
      guided = dict(control=constraints) if model.takes_control else {}
      generated = model.generate(jobs.captions, jobs.frames, seeds=jobs.seeds, **guided, **chosen)
      joints = [project(motion.joints, row.slice_frames(0, motion.num_frames), model.fps, warn=True).astype(np.float32)
                for motion, row in zip(generated, rows)]
      return [np.concatenate([features_of(model, clip), clip.reshape(len(clip), -1)], axis=1) for clip in joints]
    keys, seeds = keys_of(None, jobs.seeds, len(jobs.seeds))
    generated = model.sample(jobs.captions, jobs.frames, keys, seeds, False, chosen, constraints)
    return [motion.features for motion in generated]
  return make
