"""Every row of CDAMD's ablation tables, each as a small change of the base configs, and the baseline it falls out of.

  python launch.py --config configs/ablations/cdamd.py:one-vq --workdir runs/ablations/one-vq/generator ...
  python launch.py --config configs/ablations/cdamd.py:263-no-prior/generator/small ...
  ... --config configs/ablations/cdamd.py:263/autoencoder      sizes: full, small and mini (the archives), tiny

ROW[/STAGE[/SIZE]]: the stage is autoencoder, rvq or generator (the default). Rows differ in the generator alone, but
for the representation: those of 263 columns, and of 67, share the autoencoder and the RVQ-VAE of the row of that name.
Numbers of the paper stand in facts: cdamd 8.4.
"""
import pathlib
import runpy

# row -> (table, representation, {field of the generator: value}); the default has two VQ levels and DCCM.
ROWS = {
    "default": ("I", "coordinates", {}),
    "one-vq": ("I", "coordinates", {"loss.prior_levels": 1}),
    "all-vq": ("I", "coordinates", {"loss.prior_levels": 4}),
    # Table IV: its "DCCM" is the first row of Table I, so the other masks have one level, too (facts: cdamd 8.4).
    "cm": ("IV", "coordinates", {"loss.prior_levels": 1, "loss.mask": "causal"}),
    "bcm": ("IV", "coordinates", {"loss.prior_levels": 1, "loss.mask": "bcm"}),
    # Table V: without the conditional motion prior; without dual-constrained attention, which is "cm" again.
    "no-prior": ("V", "coordinates", {"loss.prior_levels": 0}),
    "no-dcca": ("V", "coordinates", {"loss.prior_levels": 1, "loss.mask": "causal"}),
    "263": ("V", "full", {"loss.prior_levels": 1}),
    "263-no-prior": ("V", "full", {"loss.prior_levels": 0}),
    "263-no-dcca": ("V", "full", {"loss.prior_levels": 1, "loss.mask": "causal"}),
    "67": ("V", "essential", {"loss.prior_levels": 1}),
    # The baseline of all tables, and our reading of facts: cdamd 9, rows 3, 4, 9.
    "mardm": (None, "coordinates", {"model.kind": "mardm", "loss.prior_levels": 0, "loss.mask": "bidirectional",
                                    "sampler.mask": "bidirectional", "sampler.edit_mask": "bidirectional"}),
    "same-mask": (None, "coordinates", {"sampler.mask": "dccm"}),
    "left-to-right": (None, "coordinates", {"sampler.order": "left_to_right"}),
    "prior-per-item": (None, "coordinates", {"loss.prior_drop": "item"}),
}
BASES = {"autoencoder": "cdamd_autoencoder", "rvq": "cdamd_rvq", "generator": "cdamd_generator"}
HOMES = {"coordinates": "default", "full": "263", "essential": "67"}
COLUMNS = {"coordinates": 66, "full": 263, "essential": 67}
# MARDM has no depth to spare: its one wide layer has about the parameters of the four narrow ones with cross-attention.
MARDM = {"full": dict(width=1024, depth=1, num_heads=16, ff_width=4096),
         "small": dict(width=512, depth=1, num_heads=8, ff_width=2048),
         "mini": dict(width=256, depth=1, num_heads=4, ff_width=1024),
         "tiny": dict(width=16, depth=1, num_heads=2, ff_width=16)}


def get_config(name="default"):
  row, stage, size = (name.split("/") + ["generator", "full"][name.count("/"):])[:3]
  if row not in ROWS:
    raise ValueError(f"got row {row!r}, expected one of {', '.join(ROWS)}")
  if stage not in BASES:
    raise ValueError(f"got stage {stage!r}, expected one of {', '.join(BASES)}")
  if size not in MARDM:
    raise ValueError(f"got size {size!r}, expected one of {', '.join(MARDM)}")
  _, layout, changes = ROWS[row]
  base = runpy.run_path(str(pathlib.Path(__file__).parents[1] / f"{BASES[stage]}.py"))
  config = base["get_config"](size).unlock()
  config.data.layout = layout
  parts = ("tokenizer", "prior") if stage == "generator" else ("model",)
  for part in parts:
    config[part].features = COLUMNS[layout]
  if stage == "generator":
    if size != "tiny":  # tiny runs keep untrained frozen parts, which need no other run
      home = f"runs/ablations/{HOMES[layout]}"
      config.frozen.update(tokenizer=f"{home}/autoencoder", prior=f"{home}/rvq")
    config.loss.mask = "dccm"  # the small model that ships knows two masks, the paper's rows one each
    for path, value in changes.items():
      section, field = path.split(".")
      if path == "model.kind":
        kept = {key: config.model.transformer[key] for key in ("latent_dim", "text_dim", "text_scale", "dropout")}
        config.model.transformer = dict(kind=value, **kept, **MARDM[size])
      else:
        config[section][field] = value
    if not config.loss.prior_levels:
      config.frozen.prior = ""
  return config.lock()
