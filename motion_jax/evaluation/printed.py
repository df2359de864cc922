"""Which row of a paper's table a model of ours goes with, by what it is and how it is sampled: marks stand there alone.
"""
from motion_jax.evaluation import tables

_LEVELS = {1: "CDAMD (first VQ)", 2: "CDAMD (two VQ)", 4: "CDAMD (all VQ)"}
_SCHEDULES = {"fss": "CMDM w/ FSS", "ar": "CMDM w/ AR"}


def paper_of(protocol, evaluator, rows) -> dict | None:
  """What `tables.compare` needs to know of a protocol's paper, or None where the numbers stand alone.

  rows: {row of ours: (subject, part)}. A row that goes with none in print stands beside the protocol's own one, and
  nothing of it is marked.
  """
  if protocol.paper is None or protocol.paper_layout not in (None, evaluator.layout.name):
    return None
  system, table, row = protocol.paper
  found = tables.paper_table(system, table)
  partners = {name: printed_row(found, subject, part) for name, (subject, part) in rows.items()}
  partners = {name: one for name, one in partners.items() if one}
  return dict(system=system, table=table, row=partners, also=[row] if row in found.rows else [])


def printed_row(table, subject, part="") -> str | None:
  """The row of a `tables.PaperTable` that a subject (or a part of what it does) may be compared with."""
  config = subject.model.config
  stage, options = config.get("stage", ""), subject.options
  if table.system == "cmdm" and table.table == "8":
    name = _tokenizer(config, stage)
  elif stage == "cmdm.denoiser":
    schedule = options.get("schedule", "fss")
    name = _SCHEDULES.get(schedule) if "CMDM w/ FSS" in table.rows else "CMDM" if schedule == "fss" else None
  elif stage == "cdamd.generator" and config.model.transformer.kind == "mardm":
    flow = config.loss.diffusion == "flow"
    name = next((one for one in (f"MARDM-{'SiT' if flow else 'DDPM'}-XL", f"MARDM-{'SiT' if flow else 'DDPM'}")
                 if one in table.rows), "MARDM" if table.system == "cdamd" else None)
  elif stage == "cdamd.generator":
    several = "CDAMD (two VQ)" in table.rows
    name = _LEVELS.get(config.loss.prior_levels) if several else "CDAMD"
  else:
    name = None
  name = f"{part}: {name}" if part and name else name
  return name if name in table.rows else None


def _tokenizer(config, stage):
  """CMDM's tokenizers by their latents; what a denoiser holds does not say how it was trained."""
  if stage != "cmdm.tokenizer":
    return None
  model = config.model
  kind = "MAC-VAE" if model.get("teacher_dim") else "C-VAE" if model.get("causal", True) else "VAE"
  return f"{kind} {model.latent_dim}, 1/{2 ** model.num_halvings}"
