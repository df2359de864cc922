"""Every row of CDAMD's ablation tables, each as a small change of the base configs, and the baseline it falls out of.

  motion-jax train --config ablations/cdamd:one-vq --workdir runs/ablations/one-vq/generator ...
  motion-jax train --config ablations/cdamd:263-no-prior/generator/small ...
  ... --config ablations/cdamd:263/autoencoder      sizes: full, small and mini (the archives), tiny

ROW[/STAGE[/SIZE]]: the stage is autoencoder, rvq or generator (the default). Rows differ in the generator alone, but
for the representation: those of 263 columns, and of 67, share the autoencoder and the RVQ-VAE of the row of that name.
Numbers of the paper stand in docs/papers/cdamd.md#printed-numbers.

Expected: at full size no row has been run. At size mini, cut to 250 to 500 steps, those of benchmarks/study.py
have, with their numbers in docs/benchmark/study_cdamd.md.
"""
from motion_jax import paper_tables
from motion_jax.configs import cdamd_autoencoder, cdamd_generator, cdamd_rvq, common
from motion_jax.configs.ablations import cdamd_paper

# row -> ({table: its printed row there}, representation, {field of the generator: value}); the default has two VQ
# levels and DCCM. The first row of Table I is that of the other masks, and of the parts that are left out
# (docs/papers/cdamd.md#printed-numbers), so these have one level, too; which one Tables III and VI mean is not said.
_ONE = {"1": "CDAMD (first VQ)", "3": "CDAMD", "4": "DCCM", "5": "CDAMD", "6": "CDAMD"}
ROWS = {
    "default": ({table.removeprefix("cdamd "): row for table, row in paper_tables.CDAMD.items()}, "coordinates", {}),
    "one-vq": (_ONE, "coordinates", {"loss.prior_levels": 1}),
    "all-vq": ({"1": "CDAMD (all VQ)"}, "coordinates", {"loss.prior_levels": 4}),
    "cm": ({"4": "CM", "5": "w/o DCCA"}, "coordinates", {"loss.prior_levels": 1, "loss.mask": "causal"}),
    "bcm": ({"4": "BCM"}, "coordinates", {"loss.prior_levels": 1, "loss.mask": "bcm"}),
    # The same runs, sampled under the mask that they were trained with, as the paper says. The released code, and
    # so the rows above, always sample under the causal one; "cm" has one mask in both.
    "dccm-inference": ({"4": "DCCM"}, "coordinates", {"loss.prior_levels": 1, "sampler.mask": "dccm"}),
    "bcm-inference": ({"4": "BCM"}, "coordinates",
                      {"loss.prior_levels": 1, "loss.mask": "bcm", "sampler.mask": "bcm"}),
    # Table V: without the conditional motion prior; without dual-constrained attention, which is "cm" again.
    "no-prior": ({"5": "w/o CMP"}, "coordinates", {"loss.prior_levels": 0}),
    "no-dcca": ({"4": "CM", "5": "w/o DCCA"}, "coordinates", {"loss.prior_levels": 1, "loss.mask": "causal"}),
    "263": ({"5": "CDAMD, 263 features"}, "full", {"loss.prior_levels": 1}),
    # In no table, as Table I on coordinates: how many levels Table V's 263 features have is that of its first row.
    "263-two-vq": ({}, "full", {"loss.prior_levels": 2}),
    "263-all-vq": ({}, "full", {"loss.prior_levels": 4}),
    "263-no-prior": ({"5": "w/o CMP, 263 features"}, "full", {"loss.prior_levels": 0}),
    "263-no-dcca": ({"5": "w/o DCCA, 263 features"}, "full", {"loss.prior_levels": 1, "loss.mask": "causal"}),
    "67": ({}, "essential", {"loss.prior_levels": 1}),
    # The baseline of all tables is cdamd_generator:mardm; here is only where its autoencoder lies.
    "mardm": ({table.removeprefix("cdamd "): row for table, row in cdamd_generator.PRINTED["mardm"].items()},
              "coordinates", {}),
    # Our reading of the paper: docs/papers/paper-and-code.md#cdamd.
    "same-mask": ({}, "coordinates", {"sampler.mask": "dccm"}),
    "left-to-right": ({}, "coordinates", {"sampler.order": "left_to_right"}),
    "prior-per-item": ({}, "coordinates", {"loss.prior_drop": "item"}),
}
BASES = {"autoencoder": cdamd_autoencoder, "rvq": cdamd_rvq, "generator": cdamd_generator}
HOMES = {"coordinates": "default", "full": "263", "essential": "67"}
COLUMNS = {"coordinates": 66, "full": 263, "essential": 67}
SIZES = ("full", "small", "mini", "tiny")


def get_config(name="default"):
  if name.startswith("paper"):
    return cdamd_paper.get_config(name)
  row, stage, size = common.row_stage_size(name, ROWS, BASES, SIZES)
  printed, layout, changes = ROWS[row]
  config = BASES[stage].get_config(f"mardm_{size}" if (row, stage) == ("mardm", "generator") else size).unlock()
  config.data.layout = layout
  parts = ("tokenizer", "prior") if stage == "generator" else ("model",)
  for part in parts:
    config[part].features = COLUMNS[layout]
  if stage == "generator":
    if size != "tiny":  # tiny runs keep untrained frozen parts, which need no other run
      home = f"runs/ablations/{HOMES[layout]}"
      config.frozen.update(tokenizer=f"{home}/autoencoder", prior=f"{home}/rvq")
    if row != "mardm":
      config.loss.mask = "dccm"  # the small model that ships knows two masks, the paper's rows one each
    common.set_fields(config, changes)
    if not config.loss.prior_levels:
      config.frozen.prior = ""
  elif stage == "rvq" and size == "full" and layout != "coordinates":
    config.loss.columns = cdamd_rvq.DATA[str(COLUMNS[layout])][2]
  rows = {f"cdamd {table}": name for table, name in printed.items()}
  return paper_tables.with_rows(config, rows, exact=size == "full").lock()
