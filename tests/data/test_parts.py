"""Per-segment captions: which words each latent sees, and what a training step makes of them."""
import jax
import numpy as np
import pytest

from motion_jax import fit
from motion_jax.data.batches import TextItems
from motion_jax.models.cmdm.parts import part_of_blocks, time_left, words_by_part
from motion_jax.text.encoder import load_text_encoder
from motion_jax.training.setup import untrained
from motion_jax.utils.errors import InputError
from tests.conftest import load_config

SPANS = (("a person walks", 0, 30), ("a person waves", 30, 48))


def items(per_segment_captions):
  return TextItems([np.zeros((48, 2), np.float32)] * 2, [["he walks, then waves"], ["he sits"]], 20, 48, (48,),
                   shorten_rate=0.0, spans=[SPANS, ()], per_segment_captions=per_segment_captions)


def test_how_often_a_clip_has_captions_of_its_parts():
  segments = [row for step in range(50) for row in items(0.5).batch(2, 0, step)["segments"]]
  assert {len(row) for row in segments} == {0, 2}
  assert 0.3 < np.mean([bool(row) for row in segments]) * 2 < 0.7  # of one of the two clips, which come equally often
  assert "segments" not in items(0.0).batch(2, 0, 0)
  always = [items(1.0).batch(2, 0, step) for step in range(5)]
  for batch in always:
    assert [bool(row) for row in batch["segments"]] == [text == "he walks, then waves" for text in batch["caption"]]


def test_a_cut_keeps_the_parts_that_it_shows_in_its_own_frames():
  features, spans = [np.zeros((60, 2), np.float32)], [(("a", 0, 10), ("b", 10, 40), ("c", 40, 60))]
  draws = [TextItems(features, [["a b c"]], 20, 40, (40,), crop_frames=40, keep_long=True, spans=spans,
                     per_segment_captions=1.0).draw(1, 0, step) for step in range(40)]
  for drawn in draws:
    first, past = int(drawn.start[0]), int(drawn.start[0]) + int(drawn.num_frames[0])
    wanted = [(text, max(a, first) - first, min(b, past) - first) for text, a, b in spans[0] if a < past and b > first]
    assert list(drawn.segments[0]) == wanted
  assert {"".join(span[0] for span in drawn.segments[0]) for drawn in draws} >= {"abc", "bc"}


def test_a_block_belongs_to_the_part_of_its_middle():
  assert part_of_blocks(SPANS, 5, 12).tolist() == [0, 0, 1, 1, 1]  # middles at 6, 18, 30, 42 and, behind the end, 54
  assert part_of_blocks((("a", 0, 5), ("b", 5, 40)), 2, 12).tolist() == [1, 1]


def test_latents_know_how_many_of_their_caption_are_left():
  counts = time_left(np.array([48, 40, 46]), [SPANS, (), ()], 14, 4, 3)
  assert counts[0].tolist() == [6, 5, 4, 3, 2, 1, 6, 5, 4, 3, 2, 1, 0, -1]
  assert counts[1].tolist() == list(range(10, -4, -1))
  assert counts[2, 0] == 12  # the last latent begun counts


def test_latents_see_the_words_of_their_part_and_no_others():
  encoder = load_text_encoder("words")
  said, segments = ["he sits", "he walks, then waves slowly"], [(), SPANS]
  given = words_by_part(encoder, said, segments, 3, 48, 4, 3, at_least=4)
  emb, mask = given["text_emb"], given["text_mask"]
  width = emb.shape[1] // 3
  assert emb.shape == (2, 3 * width, encoder.dim) and mask.shape == (2, 12, 3 * width)
  for row, text, latents in ((0, "he sits", range(12)), (1, SPANS[0][0], range(6)), (1, SPANS[1][0], range(6, 12))):
    words = encoder([text])[0][0]
    for latent in latents:
      np.testing.assert_array_equal(emb[row][mask[row, latent]], words)
  own = words_by_part(encoder, said, segments, 3, 48, 4, 3, at_least=4, rows=slice(1, 2))  # one of two processes
  np.testing.assert_array_equal(own["text_emb"][0][own["text_mask"][0, 0]], emb[1][mask[1, 0]])
  np.testing.assert_array_equal(own["text_mask"].any(-1), mask[1:].any(-1))


def test_nothing_that_was_put_together_is_refused():
  config = load_config("cmdm_denoiser", "tiny").unlock()
  config.data.per_segment_captions = 0.5
  with pytest.raises(InputError, match="no clip was put together of several"):
    fit.setups()[config.stage](fit.resolve(config)[0])


@pytest.mark.slow
def test_a_step_learns_from_parts(monkeypatch):
  """The loss is finite, and the words of another part move the latents of their own alone, in the gradient's eyes."""
  config, _ = fit.resolve(load_config("cmdm_denoiser", "tiny"))
  setup = fit.setups()[config.stage](config)
  batch = setup.next_batch(0)
  size, length = len(batch["index"]), batch["features"].shape[1] // config.data.frames_per_latent
  words = batch["text_emb"].shape[1]
  batch |= {"text_emb": np.concatenate([batch["text_emb"]] * 2, axis=1),
            "text_mask": np.repeat(np.eye(2, dtype=bool)[np.arange(length) * 2 // length][None], size, 0
                                   ).repeat(words, -1)}
  params = untrained(jax.eval_shape(setup.stage.init, batch, jax.random.key(0)))
  loss = lambda emb: setup.stage.loss(params, setup.frozen, batch | {"text_emb": emb}, 0, jax.random.key(0))[0]["loss"]
  value, gradient = jax.jit(jax.value_and_grad(loss))(batch["text_emb"])
  assert np.isfinite(value) and np.abs(gradient).sum((0, 2)).reshape(2, words).any(1).all()
