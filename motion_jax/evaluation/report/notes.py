"""Notes under a table of results: the number of replications, and what did not look right."""
import collections

from motion_jax.evaluation.result import Result

NAMED = 3  # clips that are named where many are left out


def of(result: Result, label) -> list[str]:
  """Sentences under the table of a result; label(metric): its name in the table."""
  provenance, sanity, controls = result.provenance, result.sanity or {}, result.controls or {}
  lines = [_replications(result, label), *(f"{note}." for note in result.notes)]
  if sanity.get("fid_halves") is not None:
    lines.append(f"FID of real is of other cuts of the same clips; two halves of the real motions that share no clip "
                 f"are {sanity['fid_halves']:.3f} apart.")
  lines += [f"Does not look right: {failure}." for failure in sanity.get("failures", ())]
  lines += [f"Mind: {warning}." for warning in sanity.get("warnings", ())]
  lines += [f"Control failed: {failure}." for failure in controls.get("failures", ())]
  return lines + _data(provenance.get("data") or {}) + _samples(provenance)


def _replications(result, label):
  counts = collections.defaultdict(set)
  for row in result.rows.values():
    for metric, value in row.items():
      if metric in result.metrics and value and value.get("values"):
        counts[len(value["values"])].add(metric)
  if not counts:
    return "Ours: one number each."
  most = max(counts, key=lambda count: len(counts[count]))
  others = ", ".join(f"{label(metric)}: {count}" for count in sorted(set(counts) - {most})
                     for metric in result.metrics if metric in counts[count] - counts[most])
  others = f" ({others})" if others else ""
  if most == 1:
    return f"Ours: one repeat{others}, no interval."
  return (f"Ours: mean ± 95 % interval of {most} repeats{others}: over draws of captions, cuts and noise, not over "
          "other test clips.")


def _data(data):
  lines = []
  excluded = data.get("excluded_clips") or []
  if excluded:
    some = "; ".join(f"{name}: {why}" for name, why in excluded[:NAMED])
    lines.append(f"{len(excluded)} clips left out ({some}{'; ..' if len(excluded) > NAMED else ''}).")
  shared = data.get("shared_with_train") or []
  if shared:
    lines.append(f"{len(shared)} clips of the split are in train, too ({', '.join(shared[:NAMED])}"
                 f"{', ..' if len(shared) > NAMED else ''}): numbers are too good.")
  return lines


def _samples(provenance):
  """Rows that know captions of the test, and rows whose motions other code made than judged them."""
  lines = []
  for model in provenance.get("models") or ():
    seen, every = model.get("captions_seen") or (0, 0)
    if seen:
      lines.append(f"{seen} of the {every} different test captions ({seen / every:.0%}) are captions that "
                   f"{model['row']} was trained on.")
    others = [maker for maker in model.get("sampled_by") or () if maker.get("code") != provenance.get("code")]
    if others:
      commits = sorted({str((maker.get("code") or {}).get("commit", "unknown"))[:12] for maker in others})
      lines.append(f"Motions of {model['row']} were made by code {', '.join(commits)}, judged by "
                   f"{str((provenance.get('code') or {}).get('commit', 'unknown'))[:12]}.")
  return lines
