"""A run that learned on a small text encoder in a folder of one's own carries it, and opens where that one is gone."""
import json
import shutil

import numpy as np
import pytest
from safetensors.numpy import save_file

from motion_jax import loading, runs
from motion_jax.text import bert
from motion_jax.text.encoder import load_text_encoder, shipped_encoders
from motion_jax.training import checkpoint
from motion_jax.training import setup as training_setup
from motion_jax.training.setup import encoder_files
from motion_jax.utils import atomic
from tests.text.reference import params_to_reference


@pytest.fixture
def own_folder(tmp_path):
  """The random encoder, whose width tiny runs have, as a folder in Hugging Face layout."""
  encoder, folder = load_text_encoder("random-init"), tmp_path / "own"
  folder.mkdir()
  fields = bert.bert_fields_of(encoder.model)
  save_file({name: np.ascontiguousarray(array) for name, array in params_to_reference(
      encoder.params, fields).items()}, folder / "model.safetensors")
  encoder.tokenizer.save(str(folder / "tokenizer.json"))
  (folder / "known_words.txt").write_text("walk\nwave\n")
  (folder / "config.json").write_text(json.dumps(dict(
      model_type="distilbert", vocab_size=fields["vocab_size"], dim=fields["width"], n_layers=fields["num_layers"],
      n_heads=fields["num_heads"], hidden_dim=fields["mlp_width"], max_position_embeddings=fields["max_positions"])))
  return folder


def test_a_run_opens_with_the_encoder_that_it_carries(tiny_run, own_folder, tmp_path):
  run, encoder = shutil.copytree(tiny_run, tmp_path / "run"), load_text_encoder(own_folder)
  files = encoder_files(encoder)
  assert set(files) == {"text.json", *(f"text_encoder/{name}" for name in (
      "config.json", "model.safetensors", "tokenizer.json", "known_words.txt"))}
  for name, content in files.items():
    checkpoint.save_text(run, name, content)
  config = json.loads((run / "config.json").read_text())
  config["frozen"]["text"] = str(own_folder)
  (run / "config.json").write_text(json.dumps(config))
  shutil.rmtree(own_folder)
  opened = loading.load(run)
  assert opened.encoder.fingerprint == encoder.fingerprint and opened.encoder.known_words == {"walk", "wave"}
  assert (opened.encoder(["a person walks"])[0] == encoder(["a person walks"])[0]).all()
  assert runs.load_run(run).text == run / "text_encoder" and runs.load_run(tiny_run).text == "random-init"


def test_a_large_one_and_one_that_ships_are_not_carried(own_folder, monkeypatch):
  assert "words" in shipped_encoders()
  for name in ("random-init", *shipped_encoders()):
    assert set(encoder_files(load_text_encoder(name))) == {"text.json"}
  monkeypatch.setattr(training_setup, "_CARRIED", 10_000)
  assert set(encoder_files(load_text_encoder(own_folder))) == {"text.json"}


def test_what_a_killed_program_left_of_a_carried_file_goes(tmp_path):
  names = (".model-abcdefgh.safetensors", ".model-abc.safetensors")
  stray, other = (tmp_path / "text_encoder" / name for name in names)
  stray.parent.mkdir()
  for path in (stray, other):
    path.touch()
  atomic.remove_strays(tmp_path, ["text_encoder/model.safetensors"])
  assert not stray.exists() and other.exists()
