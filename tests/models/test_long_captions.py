"""A caption of a hundred words trains, generates, streams, edits and is judged like one of five."""
import json
import types

import jax
import numpy as np
import pytest

import motion_jax as mj
from motion_jax import fit as training
from motion_jax.data.clip import Caption
from motion_jax.data.datasets.humanml3d import write_folder
from motion_jax.data.datasets.synthetic import synthetic_clips
from motion_jax.evaluators.evaluator import fresh_evaluator
from motion_jax.models.cdamd import setup as cdamd_setups
from motion_jax.models.cmdm import setup as cmdm_setups
from motion_jax.models.shared.captioned_batches import check_captions, text_files
from motion_jax.models.tmr import setup as tmr_setups
from motion_jax.text.encoder import load_text_encoder
from motion_jax.text.padding import narrowest, padded_length
from tests.conftest import light_training, load_config

pytestmark = pytest.mark.usefixtures("kept_features")

# As long as the longest of HumanML3D: a hundred words and marks.
LONG = "someone walks forward and then turns left and walks, then turns right and runs and jumps and sits, " * 5
LONG = LONG[:-2] + "."
FAST = dict(num_steps=4, lag=2)


def test_lengths_that_batches_are_padded_to():
  made = [padded_length(count, 24, 512) for count in (1, 24, 25, 48, 49, 97, 200, 400, 512)]
  assert made == [24, 24, 48, 48, 96, 192, 384, 512, 512]
  assert padded_length(60, 24, 64) == 64 and padded_length(3, 77, 64) == 77  # never shorter than asked for
  assert [narrowest(usual) for usual in (64, 24, 77, 120, 512, 20, 8, 3)] == [8, 12, 10, 15, 8, 10, 8, 3]


def test_captions_beyond_the_encoder_are_told_before_training(data):
  encoder = load_text_encoder("words")
  encoder.check(["a person walks", "a person waves"])
  with pytest.raises(ValueError, match=r"2 of 3 captions .* the 64 word pieces .* the longest has \d+: 'some"):
    encoder.check([LONG, "a person walks", LONG + " a person walks", LONG])
  with pytest.raises(ValueError, match="caption of 102 word pieces, expected at most 64"):
    encoder.pieces([LONG], 24)
  with pytest.raises(ValueError, match="2 of 10 captions"):
    cmdm_setups.denoiser(_on(data, "cmdm_denoiser", {"frozen.text": "words"}))


def test_a_long_caption_beside_a_shorter_one_is_left_out_and_not_kept(capsys):
  data = types.SimpleNamespace(captions=[[LONG, "a person walks"], ["a person waves"], []])
  check_captions(data, load_text_encoder("words"))
  assert data.captions == [["a person walks"], ["a person waves"], []]
  assert "captions left out" in capsys.readouterr().out
  captions = [[LONG, "a person walks"], ["a person waves"]]
  data = types.SimpleNamespace(own_captions=captions, features=[np.zeros((40, 3)), np.zeros((60, 3))])
  kept = text_files(data, load_text_encoder("words"))["captions.json"]
  assert json.loads(kept) == [["a person walks", 40], ["a person waves", 60]]


def _clips():
  """Six clips, one of whose captions is long."""
  clips = synthetic_clips(0, 6, num_frames=50)
  clips = [clip.replace(split="test" if i > 3 else "train") for i, clip in enumerate(clips)]
  return [clip.replace(captions=(Caption(LONG),)) if i in (1, 4) else clip for i, clip in enumerate(clips)]


@pytest.fixture(scope="module")
def data(tmp_path_factory):
  """A folder of HumanML3D's layout."""
  out = tmp_path_factory.mktemp("data") / "set"
  write_folder(_clips(), out)
  return out


def _on(folder, name, changes=None, size="tiny"):
  config = load_config(name, size).unlock()
  config.data.update(name="humanml3d", folder=str(folder), batch_size=4)
  for path, value in (changes or {}).items():
    section, field = path.split(".")
    config[section][field] = value
  return config


@pytest.fixture(scope="module")
def setup(data):
  with light_training():
    return training.setups()["cmdm.denoiser"](training.resolve(_on(data, "cmdm_denoiser"))[0])


def test_batches_are_padded_as_their_captions_need(setup):
  """To few widths, and to the same ones however often a step is made: so a resumed run continues exactly."""
  batches, again = ([setup.next_batch(step) for step in range(4)] for _ in range(2))
  assert {batch["text_emb"].shape[1] for batch in batches} == {32, 128}
  assert max(batch["text_mask"].sum(1).max() for batch in batches) > 100
  for one, other in zip(batches, again):
    assert all(np.array_equal(one[name], other[name]) for name in one)


@pytest.mark.slow
def test_the_loss_does_not_see_the_padding_nor_who_shares_a_device(setup):
  short, batch = (next(batch for batch in map(setup.next_batch, range(6)) if batch["text_emb"].shape[1] == width)
                  for width in (32, 128))
  params = shaken(setup.stage.init(batch, jax.random.key(0)))
  loss = jax.jit(lambda batch: setup.stage.loss(params, setup.frozen, batch, 0, jax.random.key(0)))
  sums, weight = loss(batch)
  more = {name: np.pad(array, ((0, 0), (0, 96)) + ((0, 0),) * (array.ndim - 2))
          for name, array in short.items() if name in ("text_emb", "text_mask")}
  np.testing.assert_allclose(loss(short | more)[0]["loss"], loss(short)[0]["loss"], rtol=1e-5)
  halves = [loss({name: value[rows] for name, value in batch.items()}) for rows in (slice(0, 2), slice(2, 4))]
  np.testing.assert_allclose(sum(part["loss"] for part, _ in halves), sums["loss"], rtol=1e-5)
  assert sum(count for _, count in halves) == weight
  heard, _ = loss(batch | {"text_emb": batch["text_emb"] * (np.arange(128) < 64)[None, :, None]})
  assert abs(float(heard["loss"] - sums["loss"])) > 1e-4  # the words behind the sixty-fourth are


def shaken(params):
  """Random parameters: gates that begin at 0 let no word through."""
  draw = np.random.default_rng(0)
  return jax.tree.map(lambda a: a + 0.1 * draw.standard_normal(a.shape, np.float32), params)


@pytest.fixture(scope="module")
def model(tiny_run):
  """A model that listens: two steps leave the gates at 0."""
  loaded = mj.load(tiny_run)
  loaded.params = shaken(loaded.params)
  return loaded


@pytest.mark.slow
def test_a_motion_does_not_know_how_its_words_were_padded(model):
  make = lambda prompts, seeds: model.generate(prompts, num_frames=48, seeds=seeds, **FAST)
  alone, long_alone = make("someone walks", [5])[0], make(LONG, [1])[0]
  both = make([LONG, "someone walks"], [1, 5])
  assert np.abs(both[1].joints - alone.joints).max() < 1e-5
  assert np.abs(both[0].joints - long_alone.joints).max() < 1e-5
  cut = " ".join(LONG.split()[:50])
  assert np.abs(make(cut, [1])[0].joints - long_alone.joints).max() > 1e-4  # the end of the caption counts
  assert both[0].captions[0].text == LONG


@pytest.mark.slow
def test_everyday_captions_are_padded_as_ever(model):
  """24 for the model that ships: the shapes, and so the bits, that it has always run with."""
  assert model.encode_words(["someone walks"])[0].shape == (1, 64, 32)
  shipped = mj.load("cmdm-small")
  shape = lambda prompt: shipped.encode_words([prompt])[0].shape
  assert shape("a person walks") == (1, 24, 128) and shape("a person walks and " * 7 + "waves") == (1, 48, 128)


@pytest.mark.slow
def test_a_stream_takes_a_long_prompt_on_the_way(model):
  """What was said before goes on as if nothing longer had come, and it is the motion of both prompts."""
  def told(prompt):
    stream, parts = model.stream("someone walks", seed=0, num_frames=96, **FAST), []
    for part in stream:
      parts.append(part)
      if len(parts) == 3 and prompt:
        stream.say(prompt)
    return np.concatenate(parts)

  plain, long = told(None), told(LONG)
  # Three blocks were given, a fourth was under way.
  assert np.abs(plain[:48] - long[:48]).max() < 1e-6 and np.abs(plain[48:] - long[48:]).max() > 1e-5
  both = model.multi_prompt([("someone walks", 2.4), (LONG, 2.4)], seed=0, **FAST)
  assert np.abs(both.joints - long).max() < 1e-4


@pytest.mark.slow
def test_few_prompts_compile_again(model):
  """Prompts of 70 to 120 word pieces, and streams from short to long and back: two widths."""
  compiled = lambda: model.compiled.advance.jitted._cache_size()
  make = lambda size: model.generate(" ".join(LONG.split()[:size]), num_frames=48, seeds=[0], cleanup=True, **FAST)
  make(66)
  first = compiled()
  make(70), make(80), make(90)
  assert compiled() == first
  stream = model.stream("someone walks", seed=0, **FAST)

  def after(prompt):
    stream.say(prompt)
    assert np.isfinite([next(stream) for _ in range(4)]).all()
    return compiled()

  after("someone runs"), after(LONG)
  assert after("someone runs") == after(LONG[:400]) == after("someone sits")


def test_cdamd_learns_from_long_captions(data):
  """Behind a sentence its words, however many; what it then makes of them: `test_cdamd_model`."""
  setup = cdamd_setups.generator(_on(data, "cdamd_generator", {"frozen.text_level": "words"}))
  batches = [setup.next_batch(step) for step in range(6)]
  assert {batch["text_emb"].shape[1] for batch in batches} == {78, 155}


@pytest.mark.slow
def test_a_teacher_learns_from_long_captions_and_judges_them(data):
  next_batch = tmr_setups.teacher(training.resolve(_on(data, "part_tmr", {"data.max_words": 24}))[0]).next_batch
  batches = [next_batch(step) for step in range(4)]
  assert {batch["ids"].shape[1] for batch in batches} >= {192} and max(
      batch["text_mask"].sum(1).max() for batch in batches) == 102
  judge = fresh_evaluator("tmr", "full")
  text = judge.embed_text([LONG, "someone walks"])
  assert np.abs(text[0] - judge.embed_text([LONG.rsplit(" ", 3)[0]])[0]).max() > 1e-5  # its last words count
  np.testing.assert_allclose(text[1], judge.embed_text(["someone walks"])[0], atol=1e-6)
