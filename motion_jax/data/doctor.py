"""Check a data folder: faults, and advice for each, by the checks of its data set."""
import collections
import dataclasses
import pathlib
import textwrap

import numpy as np

from motion_jax.data.datasets.registry import dataset_of

LEVELS = ("error", "warning", "note")


@dataclasses.dataclass(frozen=True)
class Finding:
  """One kind of fault: level, description, count, examples, advice."""
  level: str
  what: str
  count: int
  examples: tuple[str, ...]
  advice: str


@dataclasses.dataclass(frozen=True)
class Report:
  """Result of `examine`: facts (label, value) and findings, the worst first."""
  folder: str
  facts: tuple[tuple[str, str], ...]
  findings: tuple[Finding, ...]

  @property
  def ok(self) -> bool:
    """Whether there are no errors; training is possible with warnings and notes."""
    return not any(finding.level == "error" for finding in self.findings)


def examine(folder, progress=False) -> Report:
  """Checks every file of a data folder. Raises FileNotFoundError if no known data set matches the folder."""
  folder = pathlib.Path(folder)
  findings = _Findings()
  dataset = dataset_of(folder)
  with np.errstate(all="ignore"):  # bad numbers are reported as findings
    facts = dataset.examine(folder, findings, progress)
  return Report(str(folder), tuple(facts), findings.sorted())


def format_report(report) -> str:
  """A Report as a plain-text table."""
  lines = [f"{report.folder}"]
  width = max((len(label) for label, _ in report.facts), default=0)
  lines += [f"  {label:<{width}}  {value}" for label, value in report.facts] + [""]
  if report.findings:
    lines.append(f"{'level':<8} {'count':>6}  what")
  for finding in report.findings:
    examples = ", ".join(finding.examples) + (", ..." if finding.count > len(finding.examples) else "")
    lines += [f"{finding.level:<8} {finding.count:>6}  {finding.what}" + (f": {examples}" if finding.examples else "")]
    lines += textwrap.wrap(finding.advice, 100, initial_indent=" " * 17 + "-> ", subsequent_indent=" " * 20)
  counts = collections.Counter(finding.level for finding in report.findings)
  totals = ", ".join(f"{counts[level]} {level}{'s' * (counts[level] != 1)}" for level in LEVELS if counts[level])
  state = ("not healthy: repair the errors before training" if counts["error"] else
           "usable: read the warnings before training" if counts["warning"] else "healthy")
  lines.append(state + (f" ({totals})" if totals else ""))
  return "\n".join(lines)


class _Findings:
  """Collects findings; those of one kind become one line."""

  def __init__(self):
    self.kinds = {}

  def add(self, level, what, advice, example=None, count=1):
    entry = self.kinds.setdefault((level, what, advice), [0, []])
    entry[0] += count
    if example is not None and len(entry[1]) < 3:
      entry[1].append(str(example))

  def add_all(self, level, what, advice, examples):
    for example in examples:
      self.add(level, what, advice, example)

  def sorted(self):
    findings = [Finding(level, what, count, tuple(examples), advice)
                for (level, what, advice), (count, examples) in self.kinds.items()]
    return tuple(sorted(findings, key=lambda finding: LEVELS.index(finding.level)))
