"""Which rows of the papers' tables a config reproduces: its field `paper_row`, and whether it still matches the row.

A config file names its rows last, when the config is complete:

  return paper_tables.with_rows(config, {"cmdm 4": "w/o adaLN"}).lock()

The keys are "SYSTEM TABLE", as in `evaluation/report/paper_tables/`. A config whose model, loss or sampler was changed
afterwards is still shown next to the row, but no longer as the same model. Configs and converted checkpoints name rows;
only `evaluation` reads them.
"""
import hashlib
import json

# What identifies the model of a row. Training length, devices, folders and the accuracy of a solver do not.
_SECTIONS = ("stage", "model", "tokenizer", "prior", "quantizer", "loss")
_SAMPLER = {"cmdm": ("schedule", "num_steps", "lag", "guidance_scale"),
            "cdamd": ("num_iterations", "order", "mask", "guidance_scale"),
            "mdm": ("num_steps", "guidance_scale"), "mld": ("num_steps", "guidance_scale"),
            "momask": ("num_iterations", "guidance_scale", "residual_scale"), "t2m_gpt": ("draw", "temperature"),
            "motionstreamer": ("num_steps", "guidance_scale")}

# The papers' own models, in all tables that print their numbers.
CMDM = {"cmdm 1": "CMDM w/ FSS", "cmdm 3-humanml3d": "CMDM", "cmdm 4": "CMDM", "cmdm 6": "CMDM w/ FSS",
        "cmdm 7": "CMDM", "cmdm 8": "MAC-VAE 64, 1/4", "cmdm 9": "Part-TMR", "cmdm 10": "M",
        "cmdm 11": "DistilBERT words", "cmdm speed": "CMDM w/ FSS"}
# Tables III and VI do not say how many VQ levels their CDAMD has; IV and V repeat the first row of I
# (docs/papers/cdamd.md#printed-numbers).
CDAMD = {"cdamd 1": "CDAMD (two VQ)", "cdamd 3": "CDAMD", "cdamd 6": "CDAMD"}


def with_rows(config, rows, exact=True):
  """The config with its field `paper_row`; rows: {"SYSTEM TABLE": row}. exact False: a smaller model than printed."""
  with config.unlocked():
    config.paper_row = claim(config, rows, exact)
  return config


def claim(config, rows, exact=True) -> dict:
  """The value of `paper_row`; config: a ConfigDict, or the dict of a run folder's config.json."""
  return dict(rows=dict(rows), config=config_digest(config) if rows and exact else "")


def rows_of(config) -> dict[str, str]:
  """{"SYSTEM TABLE": row} of a config; empty if it names none."""
  claim = config.get("paper_row") or {}
  return dict(claim.get("rows") or {})


def matches_paper_row(config) -> bool:
  """Whether the model of a config is still the one that was named for its rows."""
  claim = config.get("paper_row") or {}
  return bool(claim.get("config")) and claim["config"] == config_digest(config)


def config_digest(config) -> str:
  """16 hexadecimal digits of the SHA-256 of what identifies a model: networks, loss, sampler, representation."""
  model = {name: config.get(name) for name in _SECTIONS}
  model["sampler"] = sampling_choices(config)
  model["layout"] = (config.get("data") or {}).get("layout")
  model["text_level"] = (config.get("frozen") or {}).get("text_level")
  return hashlib.sha256(json.dumps(_plain(model), sort_keys=True).encode()).hexdigest()[:16]


def sampling_choices(config, options=None) -> dict:
  """{name: value} of the sampler choices that distinguish rows, from the config; `options` take precedence."""
  options, sampler = dict(options or {}), config.get("sampler") or {}
  names = _SAMPLER.get((config.get("stage") or "").partition(".")[0], ())
  configured = {name: sampler.get(name) for name in names}
  choices = configured | {name: value for name, value in options.items() if name in configured and value is not None}
  if "schedule" in choices:
    choices["schedule"] = choices["schedule"] or "fss"
    if choices["schedule"] == "ar" or choices["num_steps"] == choices["lag"]:  # the same, written in two ways
      choices |= dict(schedule="ar", lag=choices["num_steps"])
    elif choices["schedule"] == "full":
      choices["lag"] = None
  return choices


def _plain(value):
  """Plain values, equal before and after a config is written to a file."""
  if hasattr(value, "to_dict"):
    value = value.to_dict()
  if isinstance(value, dict):
    return {str(key): _plain(item) for key, item in value.items()}
  if isinstance(value, list | tuple):
    return [_plain(item) for item in value]
  return value
