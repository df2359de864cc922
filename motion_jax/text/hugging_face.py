"""Read older files by Hugging Face's transformers, if installed (extra `convert`).

These are old tokenizer files, and the defaults of a model type that a config.json omits. A complete folder
(config.json, model.safetensors, tokenizer.json) does not need them. Nothing is downloaded, and no code of a folder is
run.
"""
import importlib.util

from motion_jax.utils.errors import InputError, reason

OLD_TOKENIZERS = {"bert": "vocab.txt", "distilbert": "vocab.txt", "t5": "spiece.model"}  # by model_type
LOCAL = dict(local_files_only=True, trust_remote_code=False)


def installed() -> bool:
  return importlib.util.find_spec("transformers") is not None


def old_tokenizer(folder, kind):
  """Name of a folder's older tokenizer file, if transformers can read it, or None."""
  name = OLD_TOKENIZERS.get(kind)
  return name if name and (folder / name).is_file() and installed() else None


def tokenizer(folder):
  """A `tokenizers.Tokenizer` from any tokenizer files of a folder; raises InputError if there are none."""
  import transformers
  try:
    return transformers.AutoTokenizer.from_pretrained(str(folder), **LOCAL).backend_tokenizer
  except Exception as error:  # each kind of tokenizer raises what its own parser does
    raise InputError(f"transformers cannot make a tokenizer of {folder} ({reason(error)}); save tokenizer.json beside "
                     "it, on a machine where AutoTokenizer reads it, with save_pretrained") from error


def whole_config(folder, config):
  """The fields of config.json and the defaults of its model type; without transformers the fields alone."""
  if not installed():
    return config
  import transformers
  try:
    return transformers.AutoConfig.from_pretrained(str(folder), **LOCAL).to_dict() | config
  except Exception as error:  # such as a number where a name belongs
    raise InputError(f"{folder / 'config.json'} is no config that transformers reads ({reason(error)})") from error
