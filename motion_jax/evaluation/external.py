"""Motions that another program made, judged like a model's: what is to be made is written down, what was made is read.

`ask` writes DIR/prompts.jsonl, a line for each motion of each replication: {"file": "r000/00000.npy", "caption",
"frames", "fps", "seed", "id"}. The other program puts a file of that name beside it for each line: joints
(frames, J, 3), y up, in metres (KIT: millimetres), or features (frames, F) of a known representation, not normalized.
`ExternalMotions` reads them; joints are turned to begin over the origin, facing +z, as evaluators know motions.
"""
import dataclasses
import hashlib
import json
import pathlib
import types

import numpy as np

from motion_jax.evaluation import samples
from motion_jax.evaluation.tasks.generation import Generation
from motion_jax.inputs.input_files import load_npy, npy_shape
from motion_jax.metrics.long_horizon import placed
from motion_jax.models.base import Able
from motion_jax.motion import plausibility
from motion_jax.motion.representations import LAYOUTS, layout_for
from motion_jax.runtime.atomic import atomic_path

PROMPTS = "prompts.jsonl"


def ask(task: Generation, out, replications) -> pathlib.Path:
  """Writes what a protocol wants to be made in its first replications; returns the file."""
  fps, lines = task.harness.evaluator.layout.skeleton.fps, []
  for replication in range(replications):
    for name, jobs, items in task.wanted(replication):
      for caption, count, seed, place, item in zip(*jobs, items):
        lines.append(dict(file=_file(name, place), caption=caption, frames=int(count), fps=fps, seed=seed,
                          id=task.test_set.ids[item]))
  with atomic_path(pathlib.Path(out) / PROMPTS) as path:
    path.write_text("".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines), encoding="utf-8")
  return pathlib.Path(out) / PROMPTS


def _file(name, place):
  return f"{name}/{place:05d}.npy"


@dataclasses.dataclass(frozen=True, eq=False)
class Unsampled(Able):
  """What is asked of a model, of motions that are there already: it can do nothing."""
  stats: types.SimpleNamespace  # layout, fingerprint
  folder: pathlib.Path
  config: dict = dataclasses.field(default_factory=dict)


@dataclasses.dataclass(frozen=True, eq=False)
class ExternalMotions:
  """A folder of such motions, in the place of a `candidates.Candidate`. Made by `load_external`."""
  name: str
  folder: pathlib.Path
  model: "Unsampled"
  hash: str
  guidance_scale: float | None = None
  options: dict = dataclasses.field(default_factory=dict)
  sampled_by: tuple = ()

  @property
  def about(self):
    return dict(model=self.folder.name, hash=self.hash, guidance_scale=None, sampling={},
                layout=self.model.stats.layout.name)

  def store(self, harness):
    return None

  def generator(self):
    return None

  def sample(self, make, store, name, jobs, what):
    """Features [(rows, F)] of jobs, from files. Raises FileNotFoundError or ValueError for what cannot be judged."""
    paths = [self.folder / _file(name, place) for place in range(len(jobs.frames))]
    missing = [path for path in paths if not path.is_file()]
    if missing:
      raise FileNotFoundError(f"{len(missing)} of {len(paths)} motions of {self.name!r} are not in {self.folder}, such "
                              f"as {missing[0].relative_to(self.folder)}; motion-jax evaluate --ask DIR "
                              "says what is to be made")
    return [_read(path, count, self.model.stats.layout) for path, count in zip(paths, jobs.frames)]


def load_external(name, folder, evaluator) -> ExternalMotions:
  """Motions of a folder, by the first of them features of a representation, or joints of the evaluator's skeleton."""
  folder = pathlib.Path(folder)
  paths = sorted(folder.glob("r[0-9][0-9][0-9]*/*.npy"))
  if not paths:
    raise FileNotFoundError(f"{folder} holds no motions: expected files such as {_file('r000', 0)}; motion-jax "
                            "evaluate --ask DIR says what is to be made")
  shape = npy_shape(paths[0])
  layout = _joint_layout(evaluator) if len(shape) == 3 else layout_for(shape[-1] if shape else 0)
  digest = hashlib.sha256()
  for path in paths:
    digest.update(str(path.relative_to(folder)).encode() + path.read_bytes())
  stats = types.SimpleNamespace(layout=layout, fingerprint=None)
  return ExternalMotions(name, folder, Unsampled(stats, folder), digest.hexdigest())


def _joint_layout(evaluator):
  own = [layout for layout in LAYOUTS.values()
         if layout.are_joints and layout.skeleton is evaluator.layout.skeleton]
  if not own:
    raise ValueError(f"evaluator {evaluator.name!r} reads {evaluator.layout.name!r} features, which joints alone do "
                     "not give; write features instead")
  return own[0]


def _read(path, count, layout):
  """(count or a few more, F): as many rows as were asked for, and what an evaluator may look at behind them."""
  x = load_npy(path)
  joints = layout.are_joints and x.ndim == 3 and x.shape[1:] == (layout.dim // 3, 3)
  if not joints and x.shape[1:] != (layout.dim,):
    raise ValueError(f"{path}: got an array of shape {x.shape}, expected (frames, {layout.dim}) as in the first file"
                     + (f", or joints (frames, {layout.dim // 3}, 3)" if layout.are_joints else ""))
  if len(x) < count:
    raise ValueError(f"{path}: got {len(x)} frames, {count} were asked for; frames in {PROMPTS} count")
  x = np.asarray(x, np.float32)[:count + samples.TAIL]
  if not np.isfinite(x).all():
    raise ValueError(f"{path} holds NaN or infinity; a motion that was not made cannot be judged")
  if x.ndim == 3:
    plausibility.check(x, layout.skeleton, name=str(path))
  return x if x.ndim == 2 else placed(x, layout.skeleton).reshape(len(x), -1).astype(np.float32)
