"""A request: which models to evaluate, on which data, by which protocol; `resolve` completes it."""
import dataclasses
import pathlib
from collections.abc import Mapping, Sequence
from typing import Any

from motion_jax.evaluation import protocols
from motion_jax.evaluation.protocols import Benchmark
from motion_jax.evaluation.test_set import dataset_of_all
from motion_jax.evaluators.evaluator import Evaluator, load_evaluator
from motion_jax.runs import PRETRAINED, resolve_run
from motion_jax.training import checkpoint

_LONG = ("long_horizon", "timelines")  # tasks that take a file of prompts; their limit counts sequences, not clips
_TRAINS = {"t2m": "evaluator_matching", "tmr": "part_tmr",
           "snapmogen": "evaluator_snapmogen", "clip": "evaluator_clip"}
Folder = str | pathlib.Path


@dataclasses.dataclass(frozen=True)
class Request:
  """The inputs and outputs of `evaluate`; each field is a flag of `motion-jax evaluate`.

  runs: run folders or names of shipped models. folders: data folders, which form one test set, and files of timelines
  or prompt sequences. motions: (name, folder) of motions from other programs (`evaluation.external`).
  """
  runs: Sequence[Folder] = ()
  folders: Sequence[Folder] = ()
  protocol: str | Benchmark | None = None        # None: by the data and the first run
  evaluator: str | Evaluator | None = None       # a name, a folder or an Evaluator; None: the protocol's
  clip_evaluator: str | Evaluator | None = None  # "none": no CLIP score
  motions: Sequence[tuple[str, Folder]] = ()
  as_given: bool = False                         # those motions keep bones and floor that differ from the evaluator's
  # What is sampled.
  replications: int | None = None                # repetitions with new draws; None: the protocol's
  seed: int | None = None                        # of all draws; None: the protocol's
  limit: int | None = None                       # samples of a trial (of long motions: sequences); None: all
  guidance_scales: Sequence[float] = ()          # one row each; none: the model's own
  sampling: Mapping[str, Any] = dataclasses.field(default_factory=dict)  # further choices of `generate`
  vary: Sequence[Mapping[str, Any]] = ()         # changes of `sampling`, one row each
  weights: str = "ema"                           # of a run: "ema", the average, or "model", the last ones
  # What is computed.
  multimodality: bool = True
  controls: bool = False                         # also evaluate damaged real motions
  allow_shared: bool = False                     # keep test clips that are also in the training split
  force: bool = False                            # continue although real data fails the sanity checks
  recompute: bool = False                        # from stored samples alone
  # Where and how.
  out: Folder | None = None                      # None: eval/PROTOCOL in the folder of the first run
  samples: Folder | None = None                  # keeps generated motions; None: in the run, of shipped models in `out`
  devices: Sequence[Any] | None = None           # JAX devices; they change the time, not the results
  verbose: bool = True


@dataclasses.dataclass(frozen=True)
class Resolved:
  """A request with its protocol.

  whole: the protocol's own test set, not a part of it for a trial, nor prompt sequences that we drew ourselves.
  """
  request: Request
  folders: tuple[Folder, ...]
  protocol: Benchmark
  limit: int | None
  whole: bool


def resolve(request: Request) -> Resolved:
  """Chooses the protocol and adapts it to the data. Raises ValueError for a file with a protocol that takes none."""
  protocol = protocols.get_protocol(request.protocol or guess_protocol(request.runs, request.folders))
  files = [folder for folder in request.folders if pathlib.Path(folder).is_file()]
  folders = tuple(folder for folder in request.folders if folder not in files)
  if files:
    if protocol.task not in _LONG:
      raise ValueError(f"{files[-1]} is a file, protocol {protocol.name!r} takes data folders alone; prompt sequences "
                       "go with long-horizon and babel, timelines with mtt")
    protocol = dataclasses.replace(protocol, timelines=str(files[-1]), note="")
  limit = request.limit
  whole = limit is None and (protocol.task != "long_horizon" or bool(protocol.timelines or protocol.recorded))
  if protocol.task in _LONG and limit:
    protocol, limit = dataclasses.replace(protocol, sequences=limit), None
  protocol = protocol.on(dataset_of_all(folders).judged_as)
  if not request.multimodality:
    protocol = protocol.without_multimodality()
  return Resolved(request, folders, protocol, limit, whole)


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
  """eval/PROTOCOL in the folder of the first run; for a shipped model, below the working directory."""
  folder = resolve_run(runs[0]) if runs else pathlib.Path("real")
  inside = folder.parent != PRETRAINED and runs
  return folder / "eval" / protocol.name if inside else pathlib.Path("eval") / folder.name / protocol.name


def load_evaluators(protocol, evaluator=None, clip_evaluator=None) -> tuple[Evaluator, Evaluator | None]:
  """(the main evaluator, that of the CLIP score or None), by default the protocol's; "none" leaves the latter out.

  Raises ValueError for a protocol that has none, or an evaluator of another kind.
  """
  main, clip = evaluator or protocol.evaluator, clip_evaluator or protocol.clip_evaluator
  if main is None:
    raise ValueError(f"protocol {protocol.name!r} has no evaluator that ships: give --evaluator FOLDER, trained by "
                     f"`motion-jax train --config {_TRAINS[protocol.kinds[0]]}`, or converted from released weights "
                     "by `motion-jax convert evaluator`")
  return _of_kind(main, protocol.kinds, protocol, "--evaluator"), (
      None if clip in (None, "none") else _of_kind(clip, ("clip",), protocol, "--clip-evaluator"))


def _of_kind(evaluator, kinds, protocol, option):
  """An evaluator of one of the kinds that a protocol allows."""
  loaded = evaluator if isinstance(evaluator, Evaluator) else load_evaluator(evaluator)
  if loaded.kind not in kinds:
    raise ValueError(f"got {option} {loaded.name!r} of kind {loaded.kind!r}, protocol {protocol.name!r} is about the "
                     f"space of kind {' or '.join(kinds)}; {_TRAINS[kinds[0]]} trains one")
  return loaded
