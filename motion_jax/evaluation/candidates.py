"""Candidates: the models of an evaluation, each with its sampling choices and the folder of its samples."""
import dataclasses
import hashlib
import itertools
import pathlib
from collections.abc import Callable
from typing import Any, NamedTuple

from motion_jax import loading
from motion_jax.evaluation import provenance, samples
from motion_jax.models import registry
from motion_jax.models.abilities import ABILITIES
from motion_jax.motion.representations import to_features
from motion_jax.runs import PRETRAINED, resolve_run
from motion_jax.training import checkpoint

_PARTS = (checkpoint.CONFIG, checkpoint.FROZEN, "Mean.npy", "Std.npy")


@dataclasses.dataclass(frozen=True, eq=False)
class Candidate:
  """A model with the sampling choices of one row.

  name: of the row. hash: of weights, statistics and config. guidance_scale None: the config's own. options: further
  arguments of `generate`. folder: of its samples.
  """
  name: str
  model: Any
  hash: str
  folder: pathlib.Path
  guidance_scale: float | None = None
  options: dict = dataclasses.field(default_factory=dict)
  devices: tuple = ()
  only_read: bool = False
  show: bool = True
  _stores: list = dataclasses.field(default_factory=list)  # those that its motions came from

  @property
  def reader(self):
    """The representation in which `test_set.read_test_set` has to give real clips to the model."""
    return Reader(self.name, self.model.stats.layout, self.model.config.data.mode)

  @property
  def about(self) -> dict:
    """The entry of provenance."""
    sampled = self.model.can("generate")
    scale = self.model.sampling(guidance_scale=self.guidance_scale).guidance_scale if sampled else None
    taught = self.model.config.get("alignment_teacher")
    return dict(model=self.model.folder.name, hash=self.hash, guidance_scale=scale, sampling=dict(self.options),
                sampler=self.model.config.get("sampler", {}).to_dict() if self.model.config.get("sampler") else {},
                parameters=self.model.num_params, layout=self.model.stats.layout.name,
                statistics=self.model.stats.fingerprint, **({"alignment_teacher": taught.to_dict()} if taught else {}))

  def parts(self, names, some=True):
    """The given {folder of samples: part of a task}: a model has all parts."""
    return names

  def store(self, harness, kind="generation") -> samples.Store:
    """The store of its samples for a harness."""
    draw = {name: getattr(harness.protocol, name) for name in (
        "pool", "min_frames", "past_frames", "max_frames", "unit_length", "random_caption", "coin", "random_crop",
        "shuffle", "sort_by_caption", "multimodality_shared", "sequences", "segments")}
    text = self.model.encoder.fingerprint if self.model.can("generate") else None
    return samples.Store(self.folder, dict(
        kind=kind, model=self.hash, text=text, guidance_scale=self.about["guidance_scale"],
        sampling=self._changed_options, seed=harness.seed, limit=harness.limit, draw=draw,
        items=harness.test_set.words_hash, batch=samples.BATCH), provenance.maker(self.devices))

  @property
  def sampled_by(self) -> list[dict]:
    """Code and devices that generated its motions; see `provenance.maker`."""
    makers = []
    for store in self._stores:
      makers += [maker for maker in store.makers if maker not in makers]
    return makers

  @property
  def _changed_options(self):
    """The options that differ from the model's defaults: naming a default does not change the samples."""
    usual = dataclasses.asdict(self.model.sampling()) if self.model.can("generate") else {}
    return {name: value for name, value in self.options.items() if value is not None and usual.get(name) != value}

  def sample(self, make: Callable, store, name, jobs, what, batch=None):
    """`samples.sample` with a progress bar, on this candidate's devices."""
    if all(store.folder != other.folder for other in self._stores):
      self._stores.append(store)
    with samples.progress(len(jobs.captions), f"{self.name}, {what}", self.show) as bar:
      return samples.sample(make, store, name, jobs, batch=batch, devices=self.devices, only_read=self.only_read,
                            bar=bar)

  def generator(self):
    return samples.generator_of(self.model, self.guidance_scale, self.options)


@dataclasses.dataclass(frozen=True, eq=False)
class Reader:
  """A representation that is not an evaluator's."""
  name: str
  layout: Any
  mode: str

  def features_of(self, clip):
    if clip.features is not None and clip.features.shape[-1] == self.layout.dim:
      return clip.features
    return to_features(clip.joints, self.layout, self.mode)


@dataclasses.dataclass(frozen=True)
class Choices:
  """Sampling choices, one row for each combination: guidance scales (none: the model's own) and further arguments of
  `generate`: shared by all rows, and `varied`, changes of them. more: options of the task, besides those of the method.
  """
  guidance: tuple[float, ...] = ()
  shared: dict = dataclasses.field(default_factory=dict)
  varied: tuple[dict, ...] = ({},)
  more: tuple[str, ...] = ()

  @property
  def named(self) -> set[str]:
    """Options that differ between rows, and are therefore part of row names."""
    rows = [self.shared | row for row in self.varied]
    return {key for row in rows for key in row if any(other.get(key) != row[key] for other in rows)}


class Loaded(NamedTuple):
  """Candidates, one per row, and sentences on variations that a model does not have."""
  candidates: list[Candidate]
  left_out: list[str]


def load_candidates(runs, load, choices: Choices, out, samples_folder=None, devices=(), only_read=False, show=True
                    ) -> Loaded:
  """Loads the models of runs by load(run), with each sampling choice that they have. out: keeps the samples of shipped
  models, unless there is a samples_folder. Raises ValueError for a choice that no model has.
  """
  models = dict(zip(row_names(runs), map(load, runs)))
  varied, left_out = _varied_of(models, choices)
  candidates, named = [], choices.named
  for name, loaded in models.items():
    shipped = pathlib.Path(loaded.folder).parent == PRETRAINED
    folder = pathlib.Path(samples_folder or (out if shipped else loaded.folder / "eval") / "samples")
    for scale, choice in itertools.product(choices.guidance or (None,), varied[name]):
      options = choices.shared | choice
      row = name + "".join(f", {key} {value}" for key, value in options.items() if key in named)
      if len(choices.guidance) > 1:
        row += f", guidance {scale:g}"
      candidates.append(Candidate(row, loaded, hash_of(loaded), folder, scale, options, devices, only_read, show))
  return Loaded(candidates, left_out)


def _varied_of(models, choices):
  """({model: the variations that it has}, sentences about the others). Models of two methods have different choices: a
  choice that only other models have is left out of a model's rows."""
  varied, wrong = {name: [] for name in models}, {}
  for choice in choices.varied:
    for name, loaded in models.items():
      try:
        check_options(name, loaded, choices.guidance, choices.shared | choice, choices.more)
        varied[name].append(choice)
      except ValueError as error:
        wrong[name, str(choice)] = error
    if models and not any(choice in known for known in varied.values()):
      raise next(error for (_, which), error in wrong.items() if which == str(choice))
  for name, loaded in models.items():
    if not varied[name]:  # a model that knows none of them is judged as it is sampled anyway
      check_options(name, loaded, choices.guidance, choices.shared, choices.more)
      varied[name].append({})
  described = lambda choice: ", ".join(f"{key} {value}" for key, value in choice.items())
  return varied, [f"No row of {name} with {described(choice)}: {error}"
                  for choice in choices.varied for name in models if (error := wrong.get((name, str(choice))))]


def row_names(runs):
  """The last part of each run's path, or the whole path where names coincide or have another meaning in a result."""
  names = [resolve_run(run).resolve().name for run in runs]
  return [name if names.count(name) == 1 and name not in ("real", "shuffled") else str(run)
          for name, run in zip(names, runs)]


def check_options(name, loaded, guidance, options, more=()):
  """Raises ValueError if a model cannot be sampled with these guidance scales and options. more: options of the task,
  besides those of the method.
  """
  if not loaded.can("generate"):
    if guidance or options:
      raise ValueError(f"{name} is not sampled, so guidance and choices of sampling mean nothing to it; leave them out")
    return
  known = [key for key in loaded.options.described() if key != "guidance_scale"] + list(more)
  wrong = [key for key in options if key not in known]
  if wrong:
    hint = "; --guidance-scale takes scales" if wrong[0] == "guidance_scale" else ""
    raise ValueError(f"got the choice of sampling {wrong[0]!r}, {name} knows {', '.join(known)}{hint}")
  for scale in guidance or (None,):  # which raises for values that cannot be
    loaded.sampling(guidance_scale=scale, **{key: value for key, value in options.items() if key not in more})


def load_able(run, ability, raw=False):
  """The model of a run, which must have an ability of `ABILITIES`. Raises ValueError for another model."""
  loaded = loading.load(run, raw=raw)
  if not loaded.can(ability):
    raise ValueError(f"{run} holds a model that has no {ability!r} ({ABILITIES[ability]}); this protocol needs the run "
                     f"of a {' or a '.join(registry.model_stages(ability))}")
  return loaded


def hash_of(loaded) -> str:
  """sha256 of the files that determine the motions of a loaded model."""
  folder, params = loaded.folder, getattr(loaded, "params_file", checkpoint.PARAMS)
  digest = hashlib.sha256()
  for name in (*_PARTS, params):
    path = pathlib.Path(folder) / name
    if path.is_file():
      digest.update(name.encode() + path.read_bytes())
  return digest.hexdigest()
