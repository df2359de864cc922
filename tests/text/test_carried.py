"""A run that learned on a small text encoder in a folder of one's own carries it, and opens where that one is gone."""
import json
import os
import shutil

import pytest

from motion_jax import loading, runs
from motion_jax.text.encoder import SHIPPED, load_text_encoder, shipped_encoders
from motion_jax.training import checkpoint
from motion_jax.training.setup import encoder_files
from motion_jax.utils import atomic


@pytest.fixture
def own_folder(tmp_path):
  """A user's folder with the encoder that the shipped model of captions was trained with."""
  return shutil.copytree(SHIPPED / "cmdm-small" / "text_encoder", tmp_path / "own")


@pytest.mark.slow
def test_a_run_opens_with_the_encoder_that_it_carries(own_folder, tmp_path):
  run = shutil.copytree(SHIPPED / "cmdm-small", tmp_path / "run", ignore=shutil.ignore_patterns("text_encoder"))
  (own_folder / "known_words.txt").write_text("walk\nwave\n")
  encoder = load_text_encoder(own_folder)
  files = encoder_files(encoder)
  assert set(files) == {"text.json", *(f"text_encoder/{name}" for name in (
      "config.json", "model.safetensors", "tokenizer.json", "known_words.txt"))}
  for name, content in files.items():
    checkpoint.save_text(run, name, content)
  config = json.loads((run / "config.json").read_text())
  config["frozen"]["text"] = str(own_folder)
  (run / "config.json").write_text(json.dumps(config))
  shutil.rmtree(own_folder)
  stray = run / "text_encoder" / ".model-part-abcdefgh.safetensors"  # of a program that was killed
  stray.touch()
  atomic.remove_strays(run, files)
  assert not stray.exists()
  opened = loading.load(run)
  assert opened.encoder.fingerprint == encoder.fingerprint and opened.encoder.known_words == {"walk", "wave"}
  assert (opened.encoder(["a person walks"])[0] == encoder(["a person walks"])[0]).all()
  assert runs.load_run(run).text == run / "text_encoder"


def test_a_large_one_and_one_that_ships_are_not_carried(own_folder):
  assert "words" in shipped_encoders()
  for name in ("random-init", *shipped_encoders()):
    assert set(encoder_files(load_text_encoder(name))) == {"text.json"}
  encoder = load_text_encoder(own_folder)
  os.truncate(own_folder / "model.safetensors", 16 << 20)
  assert set(encoder_files(encoder)) == {"text.json"}
