"""Batches are a pure function of (seed, step), inside the item rules."""
import numpy as np
import pytest

from motion_jax.data.batches import TextItems, Windows, balance_weights, epoch_indices


def _clips(lengths):
  """Features whose value is clip + frame / 1000, so that a crop tells where it is from."""
  ramp = lambda n: np.arange(n, dtype=np.float32)[:, None] / 1000
  return [np.full((n, 2), i, np.float32) + ramp(n) for i, n in enumerate(lengths)]


def test_windows_cover_clips_at_their_stride():
  windows = Windows(_clips([63, 64, 100]), window=64, stride=10)
  assert windows.starts.tolist() == [[1, 0], [2, 0], [2, 10], [2, 20], [2, 30]]


def test_an_epoch_meets_every_item_once_and_the_next_in_another_order():
  epochs = [np.concatenate([epoch_indices(20, 5, 7, 4 * e + s) for s in range(4)]) for e in range(2)]
  assert all(sorted(epoch) == list(range(20)) for epoch in epochs)
  assert (epochs[0] != epochs[1]).any()


@pytest.mark.parametrize("options", [{}, {"lengths": (60, 96, 192)}, {"weights": np.array([1.0, 2, 0, 1, 1])}])
def test_text_batches_are_pure_and_follow_the_item_rules(options):
  lengths = [40, 77, 39, 199, 120]
  items = TextItems(_clips(lengths), [[f"caption {i}", f"other {i}"] for i in range(5)], **options)
  assert 2 not in items.kept  # 39 frames are too few
  for step in range(20):
    batch, again = items.batch(3, 1, step), items.batch(3, 1, step)
    assert all(np.array_equal(batch[k], again[k]) for k in batch)
    for row in range(3):
      count, x = batch["num_frames"][row], batch["features"][row]
      clip = int(round(float(x[0, 0])))
      assert batch["caption"][row].endswith(str(clip))
      assert count % 4 == 0 and lengths[clip] // 4 * 4 - 4 <= max(count, 192 - 8) and count <= 192
      assert count in (min(lengths[clip] // 4 * 4, 192), min(lengths[clip] // 4 * 4 - 4, 192))
      assert np.allclose(np.diff(x[:count, 0]), 0.001, atol=1e-5)  # one piece of one clip
      assert (x[count:] == 0).all()


def test_other_seeds_give_other_batches():
  items = TextItems(_clips([100] * 50), [["a"]] * 50)
  assert (items.batch(8, 0, 0)["features"] != items.batch(8, 1, 0)["features"]).any()


def test_balance_weights():
  weights = balance_weights(["a", "a", "a", "b"], 1.0)
  assert np.isclose(weights[:3].sum(), weights[3])
  assert np.allclose(balance_weights(["a", "a", "b"], 0.0), 1)


@pytest.mark.parametrize("call, words", [
    (lambda: Windows(_clips([10]), 64), "64 frames"),
    (lambda: TextItems(_clips([10]), [["a"]]), "40 to 199"),
    (lambda: TextItems(_clips([100]), [[]]), "caption"),
    (lambda: TextItems(_clips([100]), [["a"]], lengths=(96,)), "max_frames"),
    (lambda: epoch_indices(3, 4, 0, 0), "lower data.batch_size"),
])
def test_bad_input_is_told(call, words):
  with pytest.raises(ValueError, match=words):
    call()
