"""Motions from other programs, evaluated like those of a model: prompts are written to files, motions are read.

`export_prompts` writes DIR/prompts.jsonl, a line for each motion of each replication: {"file": "r000/00000.npy",
"caption", "frames", "fps", "seed", ...} and the fields of the task (`Task.FILES`, which DIR/README.md repeats). Real
motions to be edited or encoded are in DIR/real_r000. For each line the other program adds the file of that name: joints
(frames, J, 3), y up, in metres (KIT: millimetres), or features (frames, F) of a known representation, not normalized.
`ExternalMotions` reads them. Joints on other bones than the evaluator's skeleton, or off the floor, are retargeted as
those of real motions are, and all begin over the origin, facing +z, as evaluators expect. Where a task gives real
motions or targets (`Task.FITS_GIVEN`), and with as_given, they keep their bones and height; with the former their place
and direction, too.
"""
import dataclasses
import hashlib
import json
import pathlib
import types
from typing import NamedTuple

import numpy as np

from motion_jax.evaluation import samples
from motion_jax.evaluation.candidates import Reader
from motion_jax.evaluation.tasks.base import Task
from motion_jax.metrics.long_horizon import placed
from motion_jax.models.abilities import Able
from motion_jax.motion import plausibility
from motion_jax.motion.representations import LAYOUTS, Representation, layout_for
from motion_jax.motion.representations.base import one_ahead
from motion_jax.motion.retarget import floor_height, retarget
from motion_jax.motion.skeleton import bone_lengths
from motion_jax.utils.atomic import atomic_path
from motion_jax.utils.input_files import load_npy, npy_shape

PROMPTS, README, GIVEN = "prompts.jsonl", "README.md", "real_"
_SAME_BONES, _ON_FLOOR = 0.02, 0.05  # metres by which a folder's median motion may differ from the skeleton, the floor
_MEASURED = 256                      # motions of a folder whose bones are measured, spread over all
_README = """# Motions for protocol {protocol}

Wanted: {files}.

Each line of `{prompts}` is a motion: put a numpy array at its `file`, beside this page, joints (frames, {joints}, 3) in
{unit}, y up, or features (frames, F) of a known representation, not normalized. `frames` are wanted at `fps`{tail}.
Seeds are there to tell motions of one caption apart; ids name clips of the data.

- Skeleton: {skeleton}, its joints in this order: {names}. Bone lengths in {unit}: {lengths}.
- Floor: y = 0, where the lower foot stands. {bones}
- Lines: {lines} motions, of {replications} replication(s), {limit}.

    {command}

Another `--limit`, `--replications`, `--seed`, evaluator or data wants other motions.
"""
_RETARGETED = ("Joints on other bones, or off the floor, are retargeted to this skeleton as real motions are, and the "
               "table says so; `--as-given` leaves them.")
_LEFT = "Motions are read as they are: those that you are given lie on these bones and this floor."


def export_prompts(task: Task, reader, out, replications, flags="") -> pathlib.Path:
  """Writes the prompts of a protocol's first replications for other programs; returns the file. reader: of real motions
  that are given; flags: of the command that evaluates the motions, for the README."""
  out, layout, lines = pathlib.Path(out), reader.layout, []
  for replication in range(replications):
    for request in task.requests(replication, reader):
      rows = zip(*request.jobs, request.records, request.source_joints or [None] * len(request.records))
      for caption, count, seed, place, record, joints in rows:
        line = dict(file=_file(request.name, place), caption=caption, frames=int(count), fps=layout.fps, seed=seed)
        if joints is not None:
          line["motion"] = _file(f"{GIVEN}r{replication:03d}", place)
          _write_given(out / line["motion"], joints)
        lines.append(line | record)
  tail = (f"; up to {samples.TAIL} more are looked at, what a decoder makes after the end"
          if task.protocol.made_padding == "decoded" else "")
  skeleton, limit = layout.skeleton, task.harness.limit
  command = f"motion-jax evaluate --data DATA --protocol {task.protocol.name} --motions NAME=THIS_FOLDER {flags}"
  page = _README.format(
      protocol=task.protocol.name, files=task.FILES, prompts=PROMPTS, tail=tail, joints=skeleton.num_joints,
      unit="metres" if skeleton.unit == 1 else "millimetres", skeleton=skeleton.name, names=", ".join(skeleton.joints),
      lengths=", ".join(f"{name} {length:.3g}" for name, length in zip(skeleton.joints[1:], skeleton.bone_lengths[1:])),
      bones=_LEFT if task.FITS_GIVEN else _RETARGETED, lines=len(lines), replications=replications,
      limit=f"limited to {limit} test clips" if limit else "of the whole test set", command=command.strip())
  for name, text in ((README, page), (PROMPTS, "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines))):
    with atomic_path(out / name) as path:
      path.write_text(text, encoding="utf-8")
  return out / PROMPTS


def _write_given(path, joints):
  if not path.is_file():  # tasks of one replication share the real motions
    with atomic_path(path) as part, open(part, "wb") as file:
      np.save(file, joints)


def _file(name, place):
  return f"{name}/{place:05d}.npy"


def joint_reader(evaluator) -> Reader:
  """The reader of real motions for other programs: joints alone, where a layout of the evaluator's body has that."""
  layout = _joint_layouts(evaluator)
  return Reader("joints", layout[0] if layout else evaluator.layout, evaluator.mode)


@dataclasses.dataclass(frozen=True, eq=False)
class Unsampled(Able):
  """Stand-in for a model, for motions that exist already: it has no abilities."""
  stats: types.SimpleNamespace  # layout, fingerprint
  folder: pathlib.Path
  config: dict = dataclasses.field(default_factory=dict)

  def segment_frames(self, frames):
    """As `CmdmModel.segment_frames`: segments have exactly the frames that were requested."""
    return list(frames)


@dataclasses.dataclass(frozen=True, eq=False)
class ExternalMotions:
  """A folder of motions from another program, used like a `candidates.Candidate`. Made by `load_external`.

  moved: joints are put over the origin. bones: how the folder's bones and floor differ from the skeleton's. as_given:
  such differences are kept. tail: rows after the end of a motion that are read.
  """
  name: str
  folder: pathlib.Path
  model: "Unsampled"
  hash: str
  mode: str = "benchmark"
  moved: bool = True
  bones: "Bones | None" = None
  as_given: bool = False
  tail: int = samples.TAIL
  guidance_scale: float | None = None
  options: dict = dataclasses.field(default_factory=dict)
  sampled_by: tuple = ()

  @property
  def about(self):
    return dict(model=self.folder.name, hash=self.hash, guidance_scale=None,
                sampling={"as_given": True} if self.as_given else {}, layout=self.model.stats.layout.name,
                **({"retargeted": self.retargeted} | self.bones._asdict() if self.bones else {}))

  @property
  def retargeted(self) -> bool:
    """Whether joints are brought to the evaluator's skeleton and floor."""
    return bool(self.bones and self.bones.differ and self.moved and not self.as_given)

  @property
  def note(self) -> str:
    """A sentence on bones and floor that differ from the evaluator's, and what was done about it; "" for none."""
    if not (self.bones and self.bones.differ):
      return ""
    done = ("retargeted to its skeleton and put on the floor, as real motions are; --as-given leaves them"
            if self.retargeted else "left as given, while real motions are on its skeleton and floor")
    return (f"{self.name}: joints differ from the evaluator's skeleton by up to {100 * self.bones.off:.1f} cm a bone "
            f"({self.bones.joint}) and {100 * abs(self.bones.floor):.1f} cm at the floor; {done}")

  @property
  def reader(self):
    return Reader(self.name, self.model.stats.layout, self.mode)

  def parts(self, names, some=True):
    """The entries of names {folder: part of a task} whose folder exists. Raises FileNotFoundError if some=True and none
    does."""
    present = {name: part for name, part in names.items() if (self.folder / name).is_dir()}
    if some and not present:
      raise FileNotFoundError(f"{self.folder} has none of the folders {', '.join(names)}; "
                              "motion-jax evaluate --export-prompts DIR says what is to be made")
    return present

  def store(self, harness, kind=""):
    return None

  def generator(self):
    return None

  def sample(self, make, store, name, jobs, what, batch=None):
    """Features [(rows, F)] of jobs, from files. Raises FileNotFoundError or ValueError for what cannot be judged."""
    paths = [self.folder / _file(name, place) for place in range(len(jobs.frames))]
    missing = [path for path in paths if not path.is_file()]
    if missing:
      raise FileNotFoundError(f"{len(missing)} of {len(paths)} motions of {self.name!r} are not in {self.folder}, such "
                              f"as {missing[0].relative_to(self.folder)}; motion-jax evaluate --export-prompts DIR "
                              "says what is to be made")
    return [self._read(path, count) for path, count in zip(paths, jobs.frames)]

  def _read(self, path, count):
    """Features (count + up to `tail` rows, F) of a file: the requested frames, and rows after them that an evaluator
    may read."""
    layout, x = self.model.stats.layout, load_npy(path)
    joints = layout.are_joints and x.ndim == 3 and x.shape[1:] == (layout.dim // 3, 3)
    if not joints and x.shape[1:] != (layout.dim,):
      raise ValueError(f"{path}: got an array of shape {x.shape}, expected (frames, {layout.dim}) as in the first file"
                       + (f", or joints (frames, {layout.dim // 3}, 3)" if layout.are_joints else ""))
    if len(x) < count:
      raise ValueError(f"{path}: got {len(x)} frames, expected {count}, the frames of its line in {PROMPTS}")
    x = np.asarray(x, np.float32)[:count + self.tail]
    if not np.isfinite(x).all():
      raise ValueError(f"{path} holds NaN or infinity; a motion that was not made cannot be judged")
    if not layout.are_joints:
      return x
    x = x.reshape(len(x), -1, 3)
    x = x[:count + int(np.argmin(np.append(_has_body(x[count:]), False)))]  # zeros after the end are no motion
    plausibility.check(x, layout.skeleton, name=str(path))
    if not self.moved:
      return x.reshape(len(x), -1)
    if not self.retargeted:
      return placed(x, layout.skeleton).reshape(len(x), -1).astype(np.float32)
    made = _as_real(x[:count], layout, self.mode)  # what follows the end moves neither the floor nor the feet
    return made if len(x) == count else np.concatenate([made, _as_real(x, layout, self.mode)[count:]])


class Bones(NamedTuple):
  """How the median motion of a folder differs from a skeleton, in metres: `off` at the bone to `joint`, and the height
  of its floor."""
  off: float
  joint: str
  floor: float

  @property
  def differ(self) -> bool:
    return self.off > _SAME_BONES or abs(self.floor) > _ON_FLOOR


def load_external(name, folder, evaluator, moved=True, as_given=False, tail=samples.TAIL) -> ExternalMotions:
  """Motions of a folder, by the first of them features of a representation, or joints of the evaluator's skeleton."""
  folder = pathlib.Path(folder)
  paths = sorted(path for path in folder.glob("*r[0-9][0-9][0-9]*/*.npy") if not path.parent.name.startswith(GIVEN))
  if not paths:
    raise FileNotFoundError(f"{folder} holds no motions: expected files such as {_file('r000', 0)}; motion-jax "
                            "evaluate --export-prompts DIR says what is to be made")
  shape = npy_shape(paths[0])
  layout = _joint_layout(evaluator) if len(shape) == 3 else layout_for(shape[-1] if shape else 0)
  digest = hashlib.sha256()
  for path in paths:
    digest.update(str(path.relative_to(folder)).encode() + path.read_bytes())
  stats = types.SimpleNamespace(layout=layout, fingerprint=None)
  return ExternalMotions(name, folder, Unsampled(stats, folder), digest.hexdigest(), evaluator.mode, moved,
                         bones_of(paths, layout) if layout.are_joints else None, as_given, tail)


def bones_of(paths, layout: Representation) -> Bones | None:
  """How motions differ from the skeleton of a layout of joints; None if none can be measured, which reading reports."""
  skeleton, lengths, floors = layout.skeleton, [], []
  for i in np.unique(np.linspace(0, len(paths) - 1, _MEASURED).astype(int)):
    x = np.asarray(load_npy(paths[i]))
    if x.size and x.shape[1:] in ((layout.dim,), (layout.dim // 3, 3)) and np.isfinite(x).all():
      joints = x.reshape(len(x), -1, 3).astype(np.float64)
      joints = joints[_has_body(joints)]
      if len(joints):
        lengths.append(np.median(bone_lengths(joints, skeleton), axis=0))
        floors.append(floor_height(joints, skeleton))
  if not lengths:
    return None
  off = np.abs(np.median(lengths, axis=0) - skeleton.bone_lengths) * skeleton.unit
  return Bones(float(off.max()), skeleton.joints[int(off.argmax())], float(np.median(floors)) * skeleton.unit)


def _has_body(joints):
  """(T,): whether the joints (T, J, 3) of a frame are not all in one point, as in zeros after the end."""
  return np.ptp(joints, axis=1).any(-1)


def _as_real(joints, layout, mode):
  """Rows (T, F) of joints (T, J, 3) as those of real motions are made: on the skeleton's bones, on the floor, from the
  origin, facing +z."""
  joints = one_ahead(joints)
  return layout.from_joints(retarget(joints, layout.skeleton) if mode == "corrected" else joints, mode)


def _joint_layouts(evaluator):
  return [layout for layout in LAYOUTS.values() if layout.are_joints and layout.skeleton is evaluator.layout.skeleton]


def _joint_layout(evaluator):
  layouts = _joint_layouts(evaluator)
  if not layouts:
    raise ValueError(f"evaluator {evaluator.name!r} reads {evaluator.layout.name!r} features, which joints alone do "
                     "not give; write features instead")
  return layouts[0]
