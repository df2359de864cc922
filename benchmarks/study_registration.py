"""Registrations: what a study asks, written down and committed before there is any figure.

A registration is a TOML file (docs/benchmark/registered/):

  name, title                  of the study
  seed or seeds, clips, stories, segments, ...   how much is sampled or trained; the tool's own
  alpha                        of Holm's correction over all claims of the file, and of the intervals
  fewest                       {clips = .., stories = .., seeds = ..}: with fewer a claim has no verdict
  rules                        in words: when it stops, what is secondary
  [rows]                       of studies that train nothing: row = the choices of sampling
  [[claims]]                   text; table of the paper; metric, the primary one; rows = [A, "lower" or "higher", B];
                               printed = [metric, row A, row B] as the paper's table has them; margin

The margin is the size of the paper's relative effect, |A - B| / B of the printed numbers, rounded to three digits. A
file that says another one is refused.
"""
import dataclasses
import datetime
import hashlib
import json
import pathlib
import subprocess
import tomllib

from motion_jax.evaluation.report import tables
from motion_jax.training import checkpoint

FILE = "registration.json"  # in the folder of a study
WAYS = ("lower", "higher")
_ROUNDING = 0.0006


@dataclasses.dataclass(frozen=True)
class Claim:
  """Row `a` has a `way` ("lower" or "higher") `metric` than row `b`; margin: the paper's relative effect, without sign.

  source: (paper, printed table). printed: (metric, row of a, row of b) there.
  """
  text: str
  source: tuple[str, str]
  metric: str
  a: str
  way: str
  b: str
  printed: tuple[str, str, str]
  margin: float

  @property
  def in_print(self) -> dict:
    """The paper's two numbers, {"a": {"mean", "digits", ..}, "b": ..}."""
    metric, *rows = self.printed
    return {side: tables.paper_row(*self.source, row)[metric] for side, row in zip("ab", rows)}


@dataclasses.dataclass(frozen=True)
class Registration:
  """The contents of a registration; settings: the fields that are the tool's own."""
  path: pathlib.Path
  sha256: str
  claims: tuple[Claim, ...]
  rows: dict
  settings: dict


def load(path) -> Registration:
  """Reads a registration. Raises ValueError for a claim that names a row or a printed number that does not exist, or
  another margin than the paper's effect.
  """
  path = pathlib.Path(path)
  try:
    content = path.read_bytes()
    settings = tomllib.loads(content.decode())
  except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
    raise ValueError(f"{path} is no registration: {error}; expected a TOML file such as "
                     "docs/benchmark/registered/schedules.toml") from None
  try:
    paper, rows = settings.pop("paper", "cmdm"), settings.pop("rows", {})
    claims = tuple(_claim(dict(one), paper, rows) for one in settings.pop("claims"))
    {name: settings[name] for name in ("name", "title", "alpha", "fewest", "rules")}
  except KeyError as error:
    raise ValueError(f"{path} has no {error.args[0]!r}, expected what benchmarks/study_registration.py lists") from None
  return Registration(path, hashlib.sha256(content).hexdigest(), claims, rows, settings)


def _claim(one, paper, rows) -> Claim:
  a, way, b = one["rows"]
  source = one.get("paper", paper), str(one["table"])
  claim = Claim(one["text"], source, one["metric"], a, way, b, tuple(one["printed"]), float(one["margin"]))
  if way not in WAYS:
    raise ValueError(f"claim {claim.text!r}: got {way!r}, expected {' or '.join(WAYS)}")
  if claim.metric not in tables.METRICS and not claim.metric.startswith("held_out"):
    raise ValueError(f"claim {claim.text!r}: got the metric {claim.metric!r}, expected one of "
                     f"{', '.join(tables.METRICS)}, or held_out_loss")
  if rows and not {a, b} <= set(rows):
    raise ValueError(f"claim {claim.text!r}: got the rows {a} and {b}, expected some of {', '.join(rows)}")
  try:
    numbers = claim.in_print
  except KeyError:
    raise ValueError(f"claim {claim.text!r}: {source[0]}'s table {source[1]} prints no {claim.printed[0]!r}") from None
  effect = abs(relative(numbers["a"]["mean"], numbers["b"]["mean"]))
  if abs(effect - claim.margin) > _ROUNDING:
    raise ValueError(f"claim {claim.text!r}: got margin {claim.margin:g}, the printed numbers are {effect:.4f} apart, "
                     f"relative to {claim.printed[2]!r}")
  return claim


def relative(a, b):
  """The effect of a against b."""
  return (a - b) / b


def keep(registration, out, has_results, amend=None) -> dict:
  """Writes the registration into a study's folder, with the commit that holds it, and returns what is written there.

  Raises ValueError where the folder has another one and results, unless `amend` says why: that is kept, too.
  """
  out = pathlib.Path(out)
  before = checkpoint.load_json(out, FILE) if (out / FILE).is_file() else None
  now = dict(file=registration.path.name, sha256=registration.sha256, **_committed(registration.path))
  if before and before["sha256"] == now["sha256"]:
    return before | {"commit": now["commit"] or before["commit"]}
  if before and has_results and not (amend or "").strip():
    raise ValueError(f"{registration.path} has changed since there are results in {out} (sha256 "
                     f"{before['sha256'][:12]} then, {now['sha256'][:12]} now): go back to the registered file, take "
                     'another --out, or say why with --amend "why", which the report prints')
  amendments = before["amendments"] if before else []
  if before and has_results:
    amendments = [*amendments, dict(why=amend.strip(), date=_today(), **{f"was_{k}": before[k] for k in (
        "sha256", "commit")}, sha256=now["sha256"])]
  kept = now | dict(date=_today(), amendments=amendments)
  out.mkdir(parents=True, exist_ok=True)
  checkpoint.save_text(out, FILE, json.dumps(kept, indent=1) + "\n")
  return kept


def lines(kept) -> list[str]:
  """Lines of Markdown on a registration as `keep` returns it."""
  where = f"commit {kept['commit'][:12]}" if kept["commit"] else "**not in a commit**"
  said = [f"Registered in `{kept['file']}` (sha256 {kept['sha256'][:12]}, {where}), taken up on {kept['date']}."]
  for one in kept["amendments"]:
    said += ["", f"**Amended on {one['date']}, when there were results (sha256 {one['was_sha256'][:12]} to "
                 f"{one['sha256'][:12]}): {one['why']}**"]
  return said


def _today():
  return datetime.datetime.now(datetime.UTC).strftime("%Y-%m-%d %H:%M UTC")


def _committed(path) -> dict:
  """{"commit": the last commit of a file, or None where git does not have it as it is}."""
  def git(*args):
    return subprocess.run(("git", *args), cwd=path.resolve().parent, capture_output=True, text=True, check=False)
  try:
    if git("diff", "--quiet", "HEAD", "--", path.name).returncode:
      return dict(commit=None)
    return dict(commit=git("log", "-1", "--format=%H", "--", path.name).stdout.strip() or None)
  except OSError:
    return dict(commit=None)
