"""Which rows of the papers' tables are shown with a model of ours: those that its config names, sampled as they were.

A number is marked only against a row of the same kind and protocol: the config is the one that was named for the row,
sampled the same way, judged by that table's own protocol on all of the test split.
"""
from motion_jax import paper_tables
from motion_jax.evaluation.report import tables

# What a row becomes where the same model is sampled otherwise: {row as trained: {(steps, lag): row}}.
_AR, _LAGS = (50, 50), {(steps, lag): f"FSS K={steps}, L={lag}" for steps in (50, 20) for lag in (1, 5, 10)}
_RESAMPLED = {"CMDM w/ FSS": {_AR: "CMDM w/ AR"}, "CMDM": {_AR: "w/o FSS"} | _LAGS}


def paper_of(protocol, evaluator, rows, whole=True) -> dict | None:
  """The `paper` of `tables.compare` for a protocol, or None where nothing printed is comparable.

  rows: {row of ours: (candidate, part)}; whole: of the protocol's own test set, not some of it for a trial, nor other
  prompts. A row without a printed counterpart is shown next to the protocol's own printed row, and not marked.
  """
  if protocol.paper is None or protocol.paper_layout not in (None, evaluator.layout.name):
    return None
  system, table, row = protocol.paper
  matches, also, beside = {}, [row] if row in tables.paper_table(system, table).rows else [], []
  for name, (candidate, part) in rows.items():
    partners, others = printed_rows(protocol, candidate, part)
    exact = paper_tables.matches_paper_row(candidate.model.config)
    if partners:
      matches[name] = [dict(system=partner[0], table=partner[1], row=partner[2]) for partner in partners]
      beside += [name] * (not (whole and exact))
    also += [partner for partner in others if exact and partner not in also]
  return dict(system=system, table=table, row=matches, also=also, unmarked=beside + ["real"] * (not whole))


def printed_rows(protocol, candidate, part=""):
  """(printed rows [(system, table, row)] comparable with a candidate, or with one part of its results; printed rows of
  the same model with metrics that this protocol does not measure)."""
  config, options = candidate.model.config, dict(candidate.options)
  named = _as_sampled(paper_tables.rows_of(config), config, options, getattr(candidate, "guidance_scale", None))
  if options.get("way", protocol.way) != protocol.way:
    named = {}
  here, elsewhere = [], []
  for key, row in named.items():
    table = tables.paper_table(*key.split(" ", 1))
    name = f"{part}: {row}" if part and f"{part}: {row}" in table.rows else row
    if protocol.name in table.protocols and name in table.rows:
      here.append((table.system, table.table, name))
    elif not table.judged:
      elsewhere.append([table.system, table.table, name])
  number = lambda name: int(name.partition("-")[0]) if name[0].isdigit() else 0
  return sorted(here, key=lambda place: (place[:2] != protocol.paper[:2], number(place[1]))), elsewhere


def _as_sampled(rows, config, options, guidance_scale):
  """The printed rows of a config under these options and guidance scale: other ones, or none, where these differ from
  the config's own sampling."""
  configured = paper_tables.sampling_choices(config)
  chosen = paper_tables.sampling_choices(config, options | dict(guidance_scale=guidance_scale))
  others = {name: options.get(name) for name in ("context", "temperature") if options.get(name) is not None}
  shared = options.get("shared_noise")
  shared = config.get("sampler", {}).get("shared_noise") if shared is None else shared  # tokenizers have no sampler
  others |= {"shared_noise": shared} if shared else {}
  if chosen == configured and not others and options.get("solver") in (None, *_SOLVERS.get(config.get("stage"), ())):
    return rows
  # Only how many steps, and how far apart blocks begin, may differ: as the papers' own models were tried.
  free = ("schedule", "num_steps", "lag")
  fixed = [name for name in chosen if name not in free]
  if others or any(chosen[name] != configured[name] for name in fixed) or chosen.get("schedule") == "full":
    return {}
  key = chosen.get("num_steps"), chosen.get("lag")
  resampled = {table: _RESAMPLED.get(row, {}).get(key) for table, row in rows.items()}
  return {table: row for table, row in resampled.items()
          if row and row in tables.paper_table(*table.split(" ", 1)).rows}


# How exactly CDAMD's equation is solved is no row of its own; CMDM's solver is (docs/papers/cmdm.md#fss).
_SOLVERS = {"cmdm.denoiser": ("euler",), "cdamd.generator": ("dopri5", "euler", "heun", "midpoint", "rk4", "ddpm")}
