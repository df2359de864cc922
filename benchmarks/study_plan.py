"""What `study.py` trains and judges: the rows of the papers' tables, the runs behind each, and their configs.

Rows and their changes are those of configs/ablations/; here is which printed row each of them repeats, what of it is
trained and what is shared, and how the small configs are cut to a number of steps.
"""
import dataclasses
import pathlib
import runpy
from typing import NamedTuple

from motion_jax.runs import PRETRAINED

ROOT = pathlib.Path(__file__).resolve().parents[1]
ABLATIONS = {paper: runpy.run_path(str(ROOT / "configs" / "ablations" / f"{paper}.py")) for paper in ("cmdm", "cdamd")}

# (paper, printed table) -> {row of configs/ablations: the printed row that it repeats}. "no-dcca" of Table V is "cm"
# of Table IV, and the paper's CDAMD is its model with one VQ level in both (docs/papers/cdamd.md#printed-numbers).
# Rows of Table IV are sampled under the causal mask, as in the released code, and again under that of their training.
TABLES = {
    ("cmdm", "4"): {
        "default": "CMDM", "vae": "VAE w/o MA", "c-vae": "C-VAE w/o MA", "one-level": "w/ Full-Seq. Diff.",
        "no-adaln": "w/o adaLN", "no-rope": "w/o ROPE", "no-adaln-no-rope": "w/o adaLN + ROPE", "ar": "w/o FSS",
        **{f"fss-{steps}-{lag}": f"FSS K={steps}, L={lag}" for steps in (50, 20) for lag in (1, 5, 10)}},
    ("cdamd", "1"): {"one-vq": "CDAMD (first VQ)", "default": "CDAMD (two VQ)", "all-vq": "CDAMD (all VQ)",
                     "mardm": "MARDM-SiT-XL"},
    ("cdamd", "4"): {"one-vq": "DCCM", "bcm": "BCM", "cm": "CM", "dccm-inference": "DCCM", "bcm-inference": "BCM"},
    ("cdamd", "5"): {"one-vq": "CDAMD", "no-prior": "w/o CMP", "cm": "w/o DCCA", "263": "CDAMD, 263 features",
                     "263-no-prior": "w/o CMP, 263 features", "263-no-dcca": "w/o DCCA, 263 features"},
}
PAPERS = tuple(dict.fromkeys(paper for paper, _ in TABLES))
STEPS = {"tokenizer": 1500, "denoiser": 500, "autoencoder": 1500, "rvq": 1500, "generator": 500}
JUDGED = 500  # what sampling and judging a row costs, in steps of training: for parts of about equal length


@dataclasses.dataclass(frozen=True)
class Settings:
  """All that decides the numbers of a study, but for the code. Archives are folders; teacher is CMDM's, a folder.

  steps: {stage: steps}. samples: motions of a row and repeat, None: all test clips; stories of `segments` prompts.
  """
  archives: tuple[str, ...]
  papers: tuple[str, ...] = PAPERS
  seeds: int = 3
  steps: dict = dataclasses.field(default_factory=lambda: dict(STEPS))
  size: str = "mini"
  repeats: int = 1
  samples: int | None = None
  stories: int = 16
  segments: int = 8
  teacher: str = str(PRETRAINED / "part-tmr-small")
  evaluator: str = "evaluator-small"
  clip_evaluator: str = "clip-evaluator-small"


class Run(NamedTuple):
  """A stage to train, by a config of configs/ablations."""
  paper: str
  row: str
  stage: str
  seed: int

  @property
  def folder(self):
    """Its run folder, below that of the study."""
    return f"{self.paper}/seed{self.seed}/{self.row}/{self.stage}"


class Row(NamedTuple):
  """A row of a table and a seed: the runs that it needs, in order, the last of which makes motion by `sampling`."""
  paper: str
  name: str
  seed: int
  runs: tuple[Run, ...]
  sampling: dict

  @property
  def scores(self):
    """Its file of numbers, below the study's folder."""
    return f"{self.paper}/seed{self.seed}/{self.name}/scores.json"

  @property
  def group(self):
    """Rows of a group share runs, so that one process has to do them."""
    return self.runs[0]


def names_of(paper) -> list[str]:
  """The rows of a paper, in the order of its tables; the one that others share a run with comes first."""
  rows = [row for (of, _), table in TABLES.items() if of == paper for row in table]
  return list(dict.fromkeys(["default", *rows]))


def row_of(paper, name, seed) -> Row:
  """A row with its runs."""
  rows = ABLATIONS[paper]["ROWS"]
  if paper == "cmdm":
    changes, of_denoiser = rows[name][1], rows[name][1].get("denoiser", {})
    trained, sampling = _trained_as(name, of_denoiser, {row: one[1].get("denoiser", {}) for row, one in rows.items()
                                                        if one[1].keys() <= {"denoiser"}})
    parts = [("tokenizer", name if "tokenizer" in changes else "default"), ("denoiser", trained)]
  else:
    layout = rows[name][1]
    home = ABLATIONS["cdamd"]["HOMES"][layout]
    trained, sampling = _trained_as(name, rows[name][2], {row: one[2] for row, one in rows.items()
                                                          if one[1] == layout and row != "mardm"})
    parts = [("autoencoder", home), ("rvq", home), ("generator", trained)]
    if not ABLATIONS["cdamd"]["get_config"](name).loss.prior_levels:
      del parts[1]
  return Row(paper, name, seed, tuple(Run(paper, row, stage, seed) for stage, row in parts), sampling)


def _trained_as(name, changes, others):
  """(row whose run `name` is sampled from, its choices of sampling): another row, where it differs in sampling alone.

  Otherwise the row is its own, and is sampled as its config says.
  """
  sampling = {path.partition(".")[2]: value for path, value in changes.items() if path.startswith("sampler.")}
  trained = {path: value for path, value in changes.items() if not path.startswith("sampler.")}
  same = next((row for row, other in others.items() if other == trained), None) if sampling else None
  return (same, sampling) if same else (name, {})


def plan(settings, part=(0, 1), only=()) -> list[Row]:
  """The rows of a part, seed by seed. Raises ValueError for a row that is none or a part that cannot be.

  Groups of rows that share runs are dealt to the parts, the most work first, to the part that has least: the same
  arguments give the same parts, which have no run in common.
  """
  rows = [row_of(paper, name, seed) for seed in range(settings.seeds) for paper in settings.papers
          for name in names_of(paper)]
  unknown = set(only) - {row.name for row in rows}
  if unknown:
    raise ValueError(f"got the rows {', '.join(sorted(unknown))}, expected some of "
                     f"{', '.join(dict.fromkeys(row.name for row in rows))}")
  index, count = part
  if not 0 <= index < count:
    raise ValueError(f"got part {index}/{count}, expected 0/{count} to {count - 1}/{count}")
  rows = [row for row in rows if not only or row.name in only]
  groups = {}
  for row in rows:
    groups.setdefault(row.group, []).append(row)
  work, parts = [0] * count, {}
  for group, members in sorted(groups.items(), key=lambda pair: -_work(pair[1], settings)):  # sorting is stable
    parts[group] = work.index(min(work))
    work[parts[group]] += _work(members, settings)
  return [row for row in rows if parts[row.group] == index]


def _work(rows, settings):
  runs = {run for row in rows for run in row.runs}
  return sum(settings.steps[run.stage] for run in runs) + JUDGED * len(rows)


def config_of(run, settings, out, parts):
  """The config of a run; parts: {stage: folder} of the runs before it.

  Steps, and all that is counted in them, are the study's: a fifteenth of them is warm-up, the last third cooldown, the
  average looks back on about a tenth, a ramp of the KL term keeps its share, a rate that falls in steps (MARDM's) falls
  in the same places of the whole. Held-out clips are looked at, and the run is saved, at the end alone (and where a
  slice of time ends): four times in so short a run were a seventh of it. All else is the row's own.
  """
  config = ABLATIONS[run.paper]["get_config"](f"{run.row}/{run.stage}/{settings.size}").unlock()
  steps, own = settings.steps[run.stage], config.train.num_steps
  config.seed = run.seed
  config.data.update(name="archive", folders=tuple(settings.archives))
  config.optimizer.update(warmup_steps=steps // 15, cooldown_steps=steps // 3)
  if config.optimizer.schedule == "step":
    config.optimizer.boundaries = tuple(
        max(1, round(one * steps / (1 if one < 1 else own))) for one in config.optimizer.boundaries)  # or a share
  if config.optimizer.ema_decay:
    config.optimizer.ema_decay = steps / (steps + 10)
  if config.loss.get("kl_ramp"):
    config.loss.kl_ramp = max(1, config.loss.kl_ramp * steps // own)
  config.train.update(num_steps=steps, log_every=max(1, min(50, steps // 10)), save_every=steps)
  if config.frozen.get("teacher") and config.frozen.teacher != "random-init":
    config.frozen.teacher = settings.teacher
  for part, stage in (("tokenizer", "tokenizer"), ("tokenizer", "autoencoder"), ("prior", "rvq")):
    if stage in parts and part in config.frozen:
      config.frozen[part] = str(pathlib.Path(out) / parts[stage])
  return config.lock()
