"""CMDM as its paper writes it, where the released code does otherwise: a row for each difference, and one for all.

  motion-jax train --config ablations/cmdm_paper:paper-ddpm --workdir runs/ablations/paper-ddpm/denoiser ...
  motion-jax train --config ablations/cmdm_paper:paper-distances/tokenizer ...
  ... --config ablations/cmdm_paper:paper-ddpm/denoiser/small     sizes: full, small and mini, tiny

ROW[/STAGE[/SIZE]] as in ablations/cmdm, which knows these rows, too; a stage that a row does not change is that of its
row "default". Which sentence of the paper each row follows, and where we had to choose a reading:
docs/papers/paper-and-code.md. No printed row is claimed for any of these: which side made the printed numbers is not
known.

Expected: no number of these rows has been recorded; `tiny` alone is run, by the tests.
"""
from motion_jax.configs import cmdm_denoiser, cmdm_tokenizer, common, part_tmr

FRAMES = {"model.block": 1, "loss.level_block": 1}
DDPM = {"model.predicts": "ddpm", "model.time_scale": 1000.0, "sampler.solver": "ancestral"}
RECONSTRUCTION = {"loss.reconstruction": "smooth_l1", "loss.root_weight": 0.0}
KL = {"loss.kl_weight": 1.0, "loss.kl_ramp": 0}
WEIGHT = {"loss.align": 1.0, "loss.align_fall": 0.0, "loss.last_layer": "linear"}
DISTANCES = {"loss.distance_pairs": "set"}
MEANS = {"loss.mean_latents": True}
OPTIMIZER = {"optimizer.learning_rate": 1e-4, "optimizer.schedule": "cosine", "optimizer.warmup_steps": 0,
             "optimizer.clip_norm": 1.0, "data.batch_size": 128}
OPTIMIZERS = {"tokenizer": OPTIMIZER | {"train.num_epochs": 50},
              "denoiser": OPTIMIZER | {"optimizer.skip_loss": 0.0, "train.num_epochs": 50,
                                       # Of an average nothing is said; the code's would keep 40 % of the random start.
                                       "optimizer.ema_debias": True}}
TEACHER = {"model.pool": "real"}

ROWS = {  # row -> {stage: {field: value}}
    "paper": {"teacher": TEACHER,
              "tokenizer": RECONSTRUCTION | KL | WEIGHT | DISTANCES | OPTIMIZERS["tokenizer"],
              "denoiser": FRAMES | DDPM | MEANS | OPTIMIZERS["denoiser"]},
    # the denoiser
    "paper-frames": {"denoiser": FRAMES},
    "paper-ddpm": {"denoiser": DDPM},
    "paper-mean-latents": {"denoiser": MEANS},
    "paper-ar": {"denoiser": FRAMES | {"sampler.lag": 50}},
    # the tokenizer
    "paper-reconstruction": {"tokenizer": RECONSTRUCTION},
    "paper-kl": {"tokenizer": KL},
    "paper-weight": {"tokenizer": WEIGHT},
    "paper-distances": {"tokenizer": DISTANCES},
    "paper-teacher": {"teacher": TEACHER, "tokenizer": {}},
    # both
    "paper-optimizer": OPTIMIZERS,
}
BASES = {"teacher": part_tmr, "tokenizer": cmdm_tokenizer, "denoiser": cmdm_denoiser}
# The runs that a stage takes its frozen parts from: {stage: {theirs: field of config.frozen}}.
PARTS = {"teacher": {}, "tokenizer": {"teacher": "teacher"}, "denoiser": {"tokenizer": "tokenizer"}}
SIZES = ("full", "small", "mini", "tiny")
# Numbers of the full size alone: smaller ones train at a rate, in batches and for as long as suits them.
OF_FULL = ("optimizer.learning_rate", "optimizer.warmup_steps", "data.batch_size", "train.num_epochs")


def get_config(name="paper"):
  row, stage, size = common.row_stage_size(name, ROWS, BASES, SIZES)
  config, changes = BASES[stage].get_config(size).unlock(), ROWS[row]
  if size != "tiny":  # tiny runs keep untrained frozen parts, which need no other run
    common.take_parts(config, row, changes, PARTS[stage])
  common.set_fields(config, {path: value for path, value in changes.get(stage, {}).items()
                             if size == "full" or path not in OF_FULL})
  return common.as_the_paper_writes(config)
