"""A batch of requested motions, passed from step to step of a pipeline."""
import dataclasses
from collections.abc import Sequence
from typing import Any, Self

import jax

from motion_jax.control.constraints import Constraint
from motion_jax.control.signal import ControlSignal
from motion_jax.models.keys import select_keys
from motion_jax.models.results import Motion
from motion_jax.motion.step_records import Record, record
from motion_jax_studio.language import Plan
from motion_jax_studio.language.requirements import Requirement
from motion_jax_studio.planning.planner import Planner


def plan_records(plan: Plan | None) -> list[Record]:
  """[the record of a plan]: its segments, for a reader."""
  return [] if plan is None else [record("plan", "one action" if plan.is_plain else plan.summary)]


@dataclasses.dataclass
class Job:
  """The request of B motions, and what the steps have produced so far.

  Of the request: prompts, frames (None: as long as the plan takes), a key each, seeds for the record, sampling choices,
  constraints. The steps fill in the other fields.
  """
  planner: Planner
  prompts: list[str]
  frames: list[float | None]
  keys: jax.Array
  seeds: Sequence[int | None]
  sampling: dict[str, Any]
  constraints: list[list[Constraint] | ControlSignal]
  exact: bool = True                 # constraints are met exactly, where a body can
  cleanup: bool = False              # clean up every sampled motion, before it is joined to others
  warns: bool = True                 # give warnings; False where no one would see them
  plans: list[Plan | None] = dataclasses.field(default_factory=list)  # None: the prompt as given
  targets: list[Any] = dataclasses.field(default_factory=list)  # `constraining.Target` of those with constraints
  notes: list[str] = dataclasses.field(default_factory=list)  # on constraints that do not fit a prompt
  motions: list[Motion] = dataclasses.field(default_factory=list)
  scheduled: list[Plan | None] = dataclasses.field(default_factory=list)  # plans as sampled, with their pauses
  guided: list[bool] = dataclasses.field(default_factory=list)  # sampled in one pass, guided by its constraints
  given_requirements: list[Sequence[Requirement]] = dataclasses.field(default_factory=list)  # instead of the plans'
  records: list[list[Record]] = dataclasses.field(default_factory=list)  # of steps before there is a motion
  independent: bool = False          # whether segments are sampled independently of one another
  steps: Sequence[Any] = ()          # of the pipeline, in order

  def __post_init__(self) -> None:
    count = len(self.prompts)
    self.plans, self.targets = self.plans or [None] * count, self.targets or [None] * count
    self.notes, self.guided = self.notes or [""] * count, self.guided or [False] * count
    self.scheduled, self.records = self.scheduled or [None] * count, self.records or [[] for _ in range(count)]

  @property
  def requirements(self) -> list[Sequence[Requirement]]:
    """The requirements of each motion."""
    return self.given_requirements or [plan.requirements if plan else [] for plan in self.plans]

  @property
  def model(self) -> Any:
    return self.planner.model

  def select(self, rows: Sequence[int], **changed: Any) -> Self:
    """The job of these motions alone, with other values of some fields."""
    pick = lambda values: [values[i] for i in rows]
    selected = dict(prompts=pick(self.prompts), frames=pick(self.frames), keys=select_keys(self.keys, rows),
                    seeds=pick(self.seeds), constraints=pick(self.constraints), plans=pick(self.plans),
                    targets=pick(self.targets), notes=pick(self.notes),
                    scheduled=pick(self.scheduled), guided=pick(self.guided), records=pick(self.records),
                    given_requirements=pick(self.given_requirements) if self.given_requirements else [],
                    motions=pick(self.motions) if self.motions else [])
    return dataclasses.replace(self, **(selected | changed))
