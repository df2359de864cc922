"""What the recipes of the shipped models share: a config of several passes, each of which trains a stage.

A recipe is trained by one command, from archives that `motion-jax data` makes in the folders named in it:

  motion-jax train --config shipped/cmdm_small --workdir runs/cmdm-small --config.archives=FOLDER_OF_THE_ARCHIVES
  ... --resume                              continues in the pass in which it was stopped
  ... --config shipped/cmdm_small:tiny      every pass with two steps on procedural motion: minutes on a laptop

Passes lie in folders of their own below the workdir; "{NAME}" in a field stands for the folder of an earlier pass.
"""
import ml_collections


def train(name, config, archives, **sections):
  """A pass that trains a stage: config NAME:SIZE with the fields of sections {field: value}, and seed=NUMBER."""
  fields = {}
  for section, values in sections.items():
    fields |= {f"{section}.{field}": value for field, value in values.items()} if isinstance(values, dict) else {
        section: values}
  return dict(name=name, config=config, archives=archives, fields=fields)


def combine(name, function, *runs):
  """A pass that makes a run of runs, by a function of motion_jax/runs.py."""
  return dict(name=name, combine=function, runs=runs)


def get_config(passes, size):
  """The config of these passes. archives: the folder in which the archives lie."""
  if size not in ("small", "tiny"):
    raise ValueError(f"got size {size!r}, expected small or tiny")
  config = ml_collections.ConfigDict()
  config.archives = ""
  config.passes = tuple(passes if size == "small" else map(_tiny, passes))
  return config.lock()


def _tiny(one):
  """A pass with two steps at the size tiny: it keeps how passes build on one another, and the losses."""
  if "combine" in one:
    return one
  return dict(name=one["name"], config=one["config"].replace("small", "tiny"), archives=(),
              fields={field: value for field, value in one["fields"].items() if _matters(field, value)})


def _matters(field, value):
  section = field.partition(".")[0]
  refers = isinstance(value, str) and (not value or value.startswith("{"))
  return section in ("loss", "model") or field in ("train.freeze", "data.control") or refers
