"""What is asked of an evaluation: data, the protocol for them and its evaluators, before anything is read or made."""
import dataclasses
import pathlib

from motion_jax.evaluation import protocols
from motion_jax.evaluation.protocols import Benchmark
from motion_jax.evaluation.test_set import dataset_of_all
from motion_jax.evaluators.evaluator import Evaluator, load_evaluator
from motion_jax.runs import PRETRAINED, resolve_run
from motion_jax.training import checkpoint

_LONG = ("long_horizon", "timelines")  # tasks that take a file of prompts, and count sequences in place of clips
_TRAINS = {"t2m": "evaluator_matching", "tmr": "part_tmr",
           "snapmogen": "evaluator_snapmogen", "clip": "evaluator_clip"}


@dataclasses.dataclass(frozen=True)
class Request:
  """Data folders, the protocol for them, and how many samples of a trial (None: all of the test set).

  whole: the protocol's own test set, not some of it for a trial, nor prompts in a row of our own drawing.
  """
  folders: tuple[str | pathlib.Path, ...]
  protocol: Benchmark
  limit: int | None
  whole: bool


def resolve(runs, folders, protocol=None, limit=None, multimodality=True) -> Request:
  """What was asked for; a file among the folders is of timelines or of prompt sequences.

  protocol: a name, a `Benchmark`, or None for the one that fits data and model. Raises ValueError for a file with a
  protocol that takes none.
  """
  files = [folder for folder in folders if pathlib.Path(folder).is_file()]
  protocol = protocols.get_protocol(protocol or guess_protocol(runs, folders))
  folders = tuple(folder for folder in folders if folder not in files)
  if files:
    if protocol.task not in _LONG:
      raise ValueError(f"{files[-1]} is a file, protocol {protocol.name!r} takes data folders alone; prompt sequences "
                       "go with long-horizon and babel, timelines with mtt")
    protocol = dataclasses.replace(protocol, timelines=str(files[-1]), note="")
  whole = limit is None and (protocol.task != "long_horizon" or bool(protocol.timelines or protocol.recorded))
  if protocol.task in _LONG and limit:
    protocol, limit = dataclasses.replace(protocol, sequences=limit), None
  protocol = protocol.on(dataset_of_all(folders).judged_as)
  return Request(folders, protocol if multimodality else protocol.without_multimodality(), limit, whole)


def guess_protocol(runs, folders) -> str:
  """The protocol that fits data and model, by the data set and the layout of the first run."""
  files = [folder for folder in folders if pathlib.Path(folder).is_file()]
  folders = [folder for folder in folders if folder not in files]
  if files and pathlib.Path(files[0]).suffix == ".json":  # of prompt sequences
    return dataset_of_all(folders).long_horizon
  if files:
    return "mtt"
  return dataset_of_all(folders).benchmark(
      folders, lambda: checkpoint.load_config(resolve_run(runs[0])).data.layout if runs else None)


def default_out(runs, protocol) -> pathlib.Path:
  """eval/PROTOCOL in the folder of the first run; of a model that ships, below the working directory."""
  folder = resolve_run(runs[0]) if runs else pathlib.Path("real")
  inside = folder.parent != PRETRAINED and runs
  return folder / "eval" / protocol.name if inside else pathlib.Path("eval") / folder.name / protocol.name


def load_evaluators(protocol, evaluator=None, clip_evaluator=None) -> tuple[Evaluator, Evaluator | None]:
  """The evaluator that numbers are of, and that of the CLIP score where there is one ("none": without).

  By default the protocol's own. Raises ValueError for a protocol that has none, or an evaluator of another kind.
  """
  main, clip = evaluator or protocol.evaluator, clip_evaluator or protocol.clip_evaluator
  if main is None:
    raise ValueError(f"protocol {protocol.name!r} has no evaluator that ships: give --evaluator FOLDER, trained by "
                     f"`motion-jax train --config {_TRAINS[protocol.kinds[0]]}`, or converted from released weights "
                     "by `motion-jax convert evaluator`")
  return _of_kind(main, protocol.kinds, protocol, "--evaluator"), (
      None if clip in (None, "none") else _of_kind(clip, ("clip",), protocol, "--clip-evaluator"))


def _of_kind(one, kinds, protocol, option):
  """An evaluator of one of the kinds that a protocol's numbers are of."""
  found = one if isinstance(one, Evaluator) else load_evaluator(one)
  if found.kind not in kinds:
    raise ValueError(f"got {option} {found.name!r} of kind {found.kind!r}, protocol {protocol.name!r} is about the "
                     f"space of kind {' or '.join(kinds)}; {_TRAINS[kinds[0]]} trains one")
  return found
