"""A damaged run folder, whatever is damaged in it, is one line that names the file."""
import json
import shutil

import numpy as np
import pytest
from safetensors import numpy as safetensors

from motion_jax import loading
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training import checkpoint
from motion_jax.training.metrics import read_metrics
from motion_jax.utils.errors import InputError
from tests.fuzz_healthy import healthy, put


@pytest.fixture
def run(tmp_path):
  put(tmp_path / "run", healthy("run"))
  return tmp_path / "run"


@pytest.mark.parametrize("path, value, words", [
    ("model", None, "config.json"), ("model", 7, "config.json"), ("model.width", "wide", "config.json"),
    ("model.width", 10**9, "got model.width 1e"), ("model.colour", "red", "config.json"),
    ("tokenizer.num_halvings", 40, "got tokenizer.num_halvings 40"), ("sampler", None, "got sampler.num_steps None"),
    ("sampler.num_steps", 10**9, "got sampler.num_steps 1000000000"), ("sampler.lag", "2", "got sampler.lag 2"),
    ("sampler.guidance_scale", float("nan"), "got sampler.guidance_scale nan"), ("data.layout", "fulll", "fulll"),
    ("frozen.text", 5, "config.json"), ("stage", {"a": 1}, "holds a FrozenConfigDict as the stage of a run"),
    ("stage", "a\nb", "holds a str as the stage"), ("data.max_frames", 0, "got data.max_frames 0"),
    ("data", [1], "data is '[1]', expected an object"), ("cleanup", "", "cleanup is '', expected an object")])
def test_a_config_of_wrong_types_is_one_line(run, path, value, words):
  config = json.loads((run / "config.json").read_text())
  *parents, last = path.split(".")
  section = config[parents[0]] if parents else config
  section[last] = value
  if value is None:
    del section[last]
  (run / "config.json").write_text(json.dumps(config))
  with pytest.raises(ValueError) as error:
    loading.load(run)
  text = str(error.value)
  assert isinstance(error.value, InputError) and words in text and str(run) in text and "\n" not in text


@pytest.mark.parametrize("name, damage", [
    *((name, lambda data: data[:len(data) // 2]) for name in (
        "params.safetensors", "frozen.safetensors", "Mean.npy", "Std.npy", "config.json")),
    ("params.safetensors", lambda data: data[:1] + b"\xf1" + data[2:]),
    ("params.safetensors", lambda data: safetensors.save({"a": np.zeros(1), "a/b": np.zeros(1)})),  # they make no tree
    ("text.json", lambda data: b""), ("text.json", lambda data: b"\xff" * 40)])
def test_a_damaged_file_is_named(run, name, damage):
  (run / name).write_bytes(damage((run / name).read_bytes()))
  with pytest.raises(InputError, match=name) as error:
    loading.load(run)
  assert "\n" not in str(error.value)


@pytest.mark.parametrize("text", ["[]", '[["", 40]]', '[["walks", "x"]]', '[["walks", 1e400]]', '[["walks", -3]]', "{"])
def test_usual_lengths_that_are_none(run, text):
  (run / "captions.json").write_text(text)
  with pytest.raises(InputError, match="captions.json"):
    checkpoint.load_lengths(run)


def test_a_damaged_log_names_its_line(tmp_path):
  (tmp_path / "metrics.jsonl").write_text('{"step": 1, "loss": 2}\n{"step": 2, "lo')
  with pytest.raises(InputError, match="metrics.jsonl line 2"):
    read_metrics(tmp_path)


def test_a_licence_that_is_no_text_keeps_nobody_from_a_motion(run):
  (run / "LICENSE.txt").write_bytes(b"free \xff\xfe")
  (run / "LIMITS.txt").write_text("It cannot fly.\n")
  model = loading.load(run)
  assert model.license.startswith("free") and model.limits == "It cannot fly."


def test_raw_weights_and_another_text_encoder_are_opened_where_they_are_given(run):
  shutil.copy(run / checkpoint.PARAMS, run / checkpoint.RAW)
  assert loading.load(run, raw=True).params_file == checkpoint.RAW != loading.load(run).params_file
  with pytest.raises(InputError, match="the text encoder gives 128 numbers a word, the model in .* was trained on"):
    loading.load(run, text="words")


def test_known_words_that_are_no_text_are_named(tmp_path):
  put(tmp_path / "words", healthy("words") | {"known_words.txt": b"walk\0run"})
  with pytest.raises(InputError, match="known_words.txt"):
    load_text_encoder(tmp_path / "words")
