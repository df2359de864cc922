"""What the recipes of the shipped models share: a config of several passes, each of which trains a stage.

A recipe is trained by one command, from archives that `motion-jax data` makes in the folders named in it:

  motion-jax train --config shipped/cmdm_small --workdir runs/cmdm-small --config.archives=FOLDER_OF_THE_ARCHIVES
  ... --resume                              continues in the pass in which it was stopped
  ... --config.workers=14                   makes clips and features in as many processes
  ... --config.seconds=7200                 steps for two hours in all, on any machine: each pass gets its share of it
  ... --config shipped/cmdm_small:tiny      every pass with two steps on procedural motion: minutes on a laptop

Passes lie in folders of their own below the workdir; "{NAME}" in a field stands for the folder of an earlier pass.
"""
import ml_collections

# NonCommercial (bandai) and ShareAlike (hdm05) archives are never in one model.
FREE = ("cmu", "cmu2", "reactidle", "gameclips", "kaykit", "mimic")
NON_COMMERCIAL, OPEN = (*FREE, "bandai"), (*FREE, "hdm05")
NO_TEACHER = dict(frozen={"teacher": ""}, model={"teacher_dim": 0})
# The same for all passes of a recipe, so that clips are made and read once. Clips of games are snappy.
SHARES = dict(stitched=0.5, bent_paths=0.25, idle=0.15, counted=0.3, excerpts=0.5, seats=0.15, time_warp=0.15,
              stepping=0.2, wandering=0.1)
DATA = {"kinematic_captions": True, "source_weights": (("gameclips", 0.4), ("kaykit", 0.3), ("mimic", 0.7)),
        **{f"augment.{kind}": share for kind, share in SHARES.items()}}
# Decoders that are trained on how limbs move make motions that need no smoothing.
UNSMOOTHED = {"smoothing": 0.0}
# Of passes that read captions, which paraphrases give other subjects, too.
CAPTIONED = DATA | {"paraphrases": 1, "vary_subject": 0.0}
CONTRAST = {"contrast": 0.5, "contrast_margin": 0.05, "contrast_until": 0.5}


def rates(learning_rate, cooldown, ema_decay=0.999, warmup=200):
  return {"learning_rate": learning_rate, "schedule": "wsd", "cooldown_steps": cooldown, "warmup_steps": warmup,
          "ema_decay": ema_decay}


def steps(num_steps, **fields):
  """The section `train` of a long pass on a fast machine: saved, and judged on held-out clips, a few times."""
  return {"num_steps": num_steps, "save_every": num_steps // 4, "sample_every": 0} | fields


def train(name, config, archives, share=0, **sections):
  """A pass that trains a stage: config NAME:SIZE with the fields of sections {field: value}, and seed=NUMBER. share: of
  the time that config.seconds gives a recipe; 0: all steps of the pass in any case."""
  fields = {}
  for section, values in sections.items():
    fields |= {f"{section}.{field}": value for field, value in values.items()} if isinstance(values, dict) else {
        section: values}
  return dict(name=name, config=config, archives=archives, fields=fields, share=share)


def cmdm_tokenizer(archives, shares, teacher=""):
  """Two passes: the tokenizer, aligned with a teacher if one is given, and its decoder alone, on how it moves."""
  windows = {"batch_size": 128, "balance": 0.5}
  aligned = dict(frozen={"teacher": teacher}) if teacher else NO_TEACHER
  alone = dict(frozen={"teacher": ""}) if teacher else NO_TEACHER
  # The reconstruction loss is a sum over the micro-batch, so the weight of the KL term grows with it.
  loss = {"micro_batch": 128, "kl_weight": 2.0}
  return [
      train("tok", "cmdm_tokenizer:small", archives, shares[0], **aligned, data=DATA | windows, loss=loss,
            train=steps(20_000), optimizer=rates(1e-3, 3_000)),
      train("dec", "cmdm_tokenizer:small", archives, shares[1], **alone,
            data=DATA | windows | {"short_window": 24}, train=steps(20_000, start="{tok}", freeze=("encoder",)),
            loss=loss | {"kl_ramp": 0, "extremity_velocity": 0.8, "foot_contact": 0.25,
                         "brief_contact": 0.3, "bone_length": 0.04, "dynamics": 0.5, "limb_direction": 0.2},
            optimizer=rates(7e-4, 8_000, warmup=50))]


def cmdm_denoiser(archives, share):
  """The denoiser, on captions by kinematics, clips made of others and captions that contradict the motion."""
  return train("den", "cmdm_denoiser:small", archives, share, frozen={"tokenizer": "{dec}", "text": "cmdm-small"},
               data=CAPTIONED | {"per_segment_captions": 0.5, "batch_size": 128, "lengths": (192,)}, loss=CONTRAST,
               train=steps(20_000), optimizer=rates(8e-4, 3_000), sampler=SAMPLER, cleanup=UNSMOOTHED)


SAMPLER = {"num_steps": 20, "guidance_scale": 2.0, "side_guidance": 1.0, "clauses": True}


def combine(name, function, *runs):
  """A pass that makes a run of runs, by a function of motion_jax/runs.py."""
  return dict(name=name, combine=function, runs=runs)


def get_config(passes, size):
  """The config of these passes. archives: the folder in which the archives lie; seconds: by the clock, of the steps of
  all passes together, shared among them; 0: all steps; workers: data.workers of each pass."""
  if size not in ("small", "tiny"):
    raise ValueError(f"got size {size!r}, expected small or tiny")
  config = ml_collections.ConfigDict()
  config.archives, config.seconds, config.workers = "", 0.0, 0
  config.passes = tuple(passes if size == "small" else map(_tiny, passes))
  return config.lock()


def _tiny(one):
  """A pass with two steps at the size tiny: it keeps how passes build on one another, and the losses."""
  if "combine" in one:
    return one
  return dict(name=one["name"], config=one["config"].replace("small", "tiny"), archives=(), share=0,
              fields={field: value for field, value in one["fields"].items() if _matters(field, value)})


def _matters(field, value):
  section = field.partition(".")[0]
  refers = isinstance(value, str) and (not value or value.startswith("{"))
  return (section in ("loss", "model") and field != "loss.micro_batch") or field in (
      "train.freeze", "data.control") or refers
