"""Names of published encoders: a pinned revision and only the needed files are fetched, or the error says why not."""
import re
import sys
import types

import pytest

from motion_jax.text import hub
from motion_jax.text.encoder import SHIPPED, load_text_encoder


@pytest.fixture
def fetched(monkeypatch):
  """The calls that would have gone to the network; each is answered with the folder of the encoder that ships."""
  calls = []

  def snapshot_download(name, revision, allow_patterns):
    calls.append((name, revision, allow_patterns))
    return str(SHIPPED / "words")

  monkeypatch.setitem(sys.modules, "huggingface_hub", types.SimpleNamespace(snapshot_download=snapshot_download))
  return calls


def test_a_known_name_is_fetched_at_its_revision(fetched):
  encoder = load_text_encoder("distilbert-base-uncased")
  assert encoder.fingerprint == load_text_encoder("words").fingerprint
  assert encoder.name == "distilbert-base-uncased"
  for name in hub.REVISIONS:
    assert hub.find(name) == hub.find(name.split("/")[1]) == SHIPPED / "words"
  assert {call[:2] for call in fetched} == set(hub.REVISIONS.items())
  assert all(re.fullmatch("[0-9a-f]{40}", revision) for revision in hub.REVISIONS.values())
  files = {name: patterns for name, _, patterns in fetched}
  assert "pytorch_model.bin" not in files["openai/clip-vit-base-patch32"]
  assert {"pytorch_model.bin", "vocab.json", "config.json"} < set(files["openai/clip-vit-base-patch16"])


def test_another_revision_or_repository(fetched):
  other, foreign = "a" * 40, "b" * 40
  hub.find(f"distilbert-base-uncased@{other}")
  hub.find(f"someone/else@{foreign}")
  assert [call[:2] for call in fetched] == [("distilbert/distilbert-base-uncased", other), ("someone/else", foreign)]


@pytest.mark.parametrize("name, message", [
    ("no-such-encoder", "distilbert-base-uncased.*config.json, model.safetensors and tokenizer.json"),
    ("someone/else", "someone/else@REVISION with the 40 digits"), ("someone/else@main", "is not a folder"),
    ("/no/such/folder", "is not a folder"), (f"else@{'b' * 40}", "is not a folder")])
def test_a_name_without_a_revision_is_not_fetched(fetched, name, message):
  with pytest.raises(FileNotFoundError, match=message):
    hub.find(name)
  assert not fetched


def test_a_folder_is_taken_before_a_name(fetched, tmp_path, monkeypatch):
  monkeypatch.chdir(tmp_path)
  (tmp_path / "distilbert-base-uncased").mkdir()
  assert not hub.find("distilbert-base-uncased").is_absolute() and not fetched


def test_without_package_or_network(monkeypatch):
  def snapshot_download(*_, **__):
    raise OSError("no route to host\nand a long explanation")

  monkeypatch.setitem(sys.modules, "huggingface_hub", types.SimpleNamespace(snapshot_download=snapshot_download))
  with pytest.raises(FileNotFoundError, match=r"fetched \(no route to host\); give 'words'.*model.safetensors"):
    hub.find("openai/clip-vit-base-patch32")
  monkeypatch.setitem(sys.modules, "huggingface_hub", None)
  with pytest.raises(FileNotFoundError, match=r'pip install -q "\.\[hub\]" .in a clone of motion-jax.; or give'):
    load_text_encoder("openai/clip-vit-base-patch32")
