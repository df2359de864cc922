"""Find the folder of a published text encoder: an existing one, or a download at a pinned revision."""
import pathlib
import re

from motion_jax.utils.install import pip_install

# Pinned commits: a run loads the weights that it was trained with.
REVISIONS = {
    "distilbert/distilbert-base-uncased": "12040accade4e8a0f71eabdb258fecc2e7e948be",
    "sentence-transformers/all-MiniLM-L6-v2": "1110a243fdf4706b3f48f1d95db1a4f5529b4d41",
    "sentence-transformers/all-mpnet-base-v2": "e8c3b32edf5434bc2275fc9bab85f82640a19130",
    "sentence-transformers/sentence-t5-base": "fc5d4628481afbbaaacd7af6bb07cf9d3865f781",
    # The hub's own conversion to safetensors; the main branch has pytorch_model.bin only.
    "openai/clip-vit-base-patch32": "c237dc49a33fc61debc9276459120b7eac67e7ef",
    "openai/clip-vit-base-patch16": "57c216476eefef5ab752ec549e440a49ae4ae5f3",
    "google/t5-v1_1-base": "b5fc947a416ea3cb079532cb3c2bbadeb7f800fc",
}
WITHOUT_SAFETENSORS = ("openai/clip-vit-base-patch16", "google/t5-v1_1-base")
FILES = ("config.json", "model.safetensors", "tokenizer.json", "vocab.json", "merges.txt", "spiece.model",
         "2_Dense/config.json", "2_Dense/model.safetensors")
_NAME = re.compile(r"(?P<name>[\w.-]+(/[\w.-]+)?)(@(?P<revision>[0-9a-f]{40}))?")


def find(name_or_folder):
  """The folder of an encoder: the given one if it exists, else a download of the published encoder of that name.

  Names are those of `REVISIONS`, with or without owner, or "owner/name@revision" with all 40 digits of a commit. Raises
  FileNotFoundError, with advice, if the folder does not exist and nothing can be downloaded.
  """
  folder = pathlib.Path(name_or_folder)
  if folder.is_dir():
    return folder
  text = str(name_or_folder)
  match = _NAME.fullmatch(text)
  name = next((known for known in REVISIONS if match and match["name"] in (known, known.split("/")[1])),
              match and match["name"])
  revision = match and (match["revision"] or REVISIONS.get(name))
  hint = ("give 'words' (it ships with this package) or a folder as Hugging Face lays it out, with config.json, "
          "model.safetensors and tokenizer.json of a BERT, MiniLM, DistilBERT, MPNet, CLIP or T5 model")
  if not revision or "/" not in name:
    also = f"{name}@REVISION with the 40 digits of a commit, or " if match and "/" in name else ""
    raise FileNotFoundError(f"text encoder {text!r} is not a folder, nor one of the names {', '.join(REVISIONS)}; "
                            f"{hint}; or {also}one of these names")
  try:
    from huggingface_hub import snapshot_download
  except ImportError as error:
    raise FileNotFoundError(f"text encoder {text!r} is not a folder, and fetching {name} needs huggingface_hub: "
                            f"{pip_install('hub')}; or {hint}") from error
  files = FILES + (("pytorch_model.bin",) if name in WITHOUT_SAFETENSORS else ())
  try:
    return pathlib.Path(snapshot_download(name, revision=revision, allow_patterns=list(files)))
  except Exception as error:  # network, name, disk or permission: the advice is the same
    message = (str(error).splitlines() or [type(error).__name__])[0]
    raise FileNotFoundError(f"text encoder {text!r} is not a folder, and {name} at revision {revision} could not be "
                            f"fetched ({message}); {hint}") from error
