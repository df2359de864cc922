"""Which rows of the papers' tables a config repeats: its field `paper_row`, and whether it is still what it claims.

A config is named for what it is when its file made it:

  return named(config, {"cmdm 4": "w/o adaLN"}).lock()

{"SYSTEM TABLE": row}, as `evaluation/report/paper_tables/` has them. Whoever changes the model, its loss or its sampler
afterwards still has a model beside that row, but not that row again: its numbers are shown there and never marked.
"""
import hashlib
import json

# What makes a model the one of a row. How long and on what machine it was trained does not; neither do folders, nor how
# exactly an equation is solved.
_SECTIONS = ("stage", "model", "tokenizer", "prior", "quantizer", "loss")
_SAMPLER = {"cmdm": ("schedule", "num_steps", "lag", "guidance_scale"),
            "cdamd": ("num_iterations", "order", "mask", "guidance_scale")}
_FORMER = {"num_iterations": "num_rounds"}  # former names, by which digests in run folders and older configs have them

# The papers' own models, in all tables that print their numbers.
CMDM = {"cmdm 1": "CMDM w/ FSS", "cmdm 3-humanml3d": "CMDM", "cmdm 4": "CMDM", "cmdm 6": "CMDM w/ FSS",
        "cmdm 7": "CMDM", "cmdm 8": "MAC-VAE 64, 1/4", "cmdm 9": "Part-TMR", "cmdm 10": "M",
        "cmdm 11": "DistilBERT words", "cmdm speed": "CMDM w/ FSS"}
# Tables III and VI do not say how many VQ levels their CDAMD has; IV and V repeat the first row of I
# (docs/papers/cdamd.md#printed-numbers).
CDAMD = {"cdamd 1": "CDAMD (two VQ)", "cdamd 3": "CDAMD", "cdamd 6": "CDAMD"}


def named(config, rows, exact=True):
  """The config with its field `paper_row`; rows: {"SYSTEM TABLE": row}. exact False: a smaller model than printed."""
  with config.unlocked():
    config.paper_row = claim(config, rows, exact)
  return config


def claim(config, rows, exact=True) -> dict:
  """What `named` writes; config: a ConfigDict, or the dict that a run folder's config.json holds."""
  return dict(rows=dict(rows), config=digest_of(config) if rows and exact else "")


def rows_of(config) -> dict[str, str]:
  """{"SYSTEM TABLE": row} that a config names; none where it does not say."""
  claim = config.get("paper_row") or {}
  return dict(claim.get("rows") or {})


def is_exact(config) -> bool:
  """Whether a config is, in all that makes a model, the one that was named for its rows."""
  claim = config.get("paper_row") or {}
  return bool(claim.get("config")) and claim["config"] == digest_of(config)


def digest_of(config) -> str:
  """The beginning of a sha256 sum of what makes the model of a config: networks, loss, sampler, representation."""
  told = {name: config.get(name) for name in _SECTIONS}
  told["sampler"] = {_FORMER.get(name, name): value for name, value in sampling_of(config).items()}
  told["layout"] = (config.get("data") or {}).get("layout")
  told["text_level"] = (config.get("frozen") or {}).get("text_level")
  return hashlib.sha256(json.dumps(_plain(told), sort_keys=True).encode()).hexdigest()[:16]


def sampling_of(config, options=None) -> dict:
  """What of a sampler decides which row a model is in: {name: value}, by its config, or by options in its place."""
  options, sampler = dict(options or {}), config.get("sampler") or {}
  names = _SAMPLER.get((config.get("stage") or "").partition(".")[0], ())
  own = {name: sampler.get(name, sampler.get(_FORMER.get(name, name))) for name in names}
  found = own | {name: value for name, value in options.items() if name in own and value is not None}
  if "schedule" in found:
    found["schedule"] = found["schedule"] or "fss"
    if found["schedule"] == "ar" or found["num_steps"] == found["lag"]:  # the same, said in two ways
      found |= dict(schedule="ar", lag=found["num_steps"])
    elif found["schedule"] == "full":
      found["lag"] = None
  return found


def _plain(value):
  """Plain values, the same before and after a config lay in a file."""
  if hasattr(value, "to_dict"):
    value = value.to_dict()
  if isinstance(value, dict):
    return {str(key): _plain(one) for key, one in value.items()}
  if isinstance(value, list | tuple):
    return [_plain(one) for one in value]
  return value
