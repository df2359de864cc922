"""Batches are a pure function of (seed, step), inside the item rules."""
import numpy as np
import pytest

from motion_jax.data.batches import CaptionedClips, TextItems, Windows, epoch_indices


def _clips(lengths):
  """Features whose value is clip + frame / 1000, so that a crop tells where it is from."""
  ramp = lambda n: np.arange(n, dtype=np.float32)[:, None] / 1000
  return [np.full((n, 2), i, np.float32) + ramp(n) for i, n in enumerate(lengths)]


def test_windows_cover_clips_at_their_stride():
  with pytest.warns(UserWarning, match="1 of 3 clips are shorter than a window of 64 frames, and nothing is learned"):
    windows = Windows(_clips([63, 64, 100]), window=64, stride=10)
  assert windows.starts.tolist() == [[1, 0], [2, 0], [2, 10], [2, 20], [2, 30]]


def test_every_second_batch_is_of_short_windows():
  """They take in the clips that are too short for the others; batches are made in parts as ever."""
  clips = _clips([12, 30, 64, 80])
  windows = Windows(clips, window=64, stride=4, short=12, groups=list("abcd"), balance=0.5)
  shapes = [windows.batch(8, 7, step)["features"].shape[1] for step in range(6)]
  assert shapes == [64, 12] * 3
  shown = {int(row[0, 0]) for step in range(1, 40, 2) for row in windows.batch(8, 7, step)["features"]}
  assert shown == {0, 1, 2, 3} and {int(row[0, 0]) for step in range(0, 40, 2)
                                    for row in windows.batch(8, 7, step)["features"]} == {2, 3}
  assert not np.array_equal(windows.batch(8, 7, 5)["features"], windows.batch(8, 7, 3)["features"])


def test_one_window_a_clip_and_epoch_from_any_place():
  """For autoencoders that see a long clip no more often than a short one (docs/papers/t2m_gpt.md#vq-vae)."""
  windows = Windows(_clips([64, 66, 64, 80]), window=64, stride=4, one_per_clip=True)
  places = set()
  for epoch in range(60):
    rows = np.concatenate([windows.batch(2, 0, 2 * epoch + half)["features"] for half in range(2)])
    assert sorted(rows[:, 0, 0].astype(int)) == [0, 1, 2, 3] and rows.shape == (4, 64, 2)
    places |= {(int(row[0, 0]), round(1000 * float(row[0, 0]) % 1000)) for row in rows}
  assert {place for place in places if place[0] < 3} == {(0, 0), (1, 0), (1, 1), (1, 2), (2, 0)}
  assert {at for clip, at in places if clip == 3} >= {0, 16}


def test_an_epoch_meets_every_item_once_and_the_next_in_another_order():
  epochs = [np.concatenate([epoch_indices(20, 5, 7, 4 * e + s) for s in range(4)]) for e in range(2)]
  assert all(sorted(epoch) == list(range(20)) for epoch in epochs)
  assert (epochs[0] != epochs[1]).any()


@pytest.mark.parametrize("options", [{}, {"lengths": (60, 96, 192)}, {"weights": np.array([1.0, 2, 0, 1, 1])}])
def test_text_batches_are_pure_and_follow_the_item_rules(options):
  lengths = [40, 77, 39, 199, 120]
  items = TextItems(_clips(lengths), [[f"caption {i}", f"other {i}"] for i in range(5)], **options)
  assert 2 not in items.kept  # 39 frames are too few
  assert (items.batch(3, 1, 0)["features"] != items.batch(3, 2, 0)["features"]).any()  # another seed
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


@pytest.mark.parametrize("shorten_rate", [1 / 3, 0.0, 1.0, 0.8])
def test_the_coin_takes_a_latent_less_as_often_as_it_says(shorten_rate):
  """Of 102 frames, 25 latents of 4: 100 are taken, or shortened 96, from any of the places where they fit."""
  items = TextItems(_clips([102] * 8), [["a"]] * 8, **({} if shorten_rate == 1 / 3 else {"shorten_rate": shorten_rate}))
  counts, starts = [], {100: set(), 96: set()}
  for step in range(120):
    batch = items.batch(8, 5, step)
    counts += batch["num_frames"].tolist()
    for x, count in zip(batch["features"], batch["num_frames"]):
      starts[int(count)].add(round(1000 * float(x[0, 0]) % 1000))
  share, deviation = np.mean(np.equal(counts, 96)), np.sqrt(shorten_rate * (1 - shorten_rate) / len(counts))
  assert set(counts) <= {96, 100} and abs(share - shorten_rate) <= 4 * deviation
  assert starts[96] == (set(range(7)) if shorten_rate else set())
  assert starts[100] == (set(range(3)) if shorten_rate < 1 else set())


def test_lengths_are_drawn_as_often_as_there_are_clips_of_them():
  """Two padded lengths, eight clips in the shorter and two in the longer: batches come in that proportion."""
  items = TextItems(_clips([60] * 8 + [150] * 2), [["a"]] * 10, lengths=(60, 192), shorten_rate=0.0)
  share = np.mean([items.batch(2, 0, step)["features"].shape[1] == 60 for step in range(400)])
  assert abs(share - 0.8) < 4 * np.sqrt(0.8 * 0.2 / 400)


def test_long_clips_are_cut_at_any_place_for_the_teacher():
  items = CaptionedClips(_clips([14, 6]), [["a"], ["b"]], max_frames=10)
  starts = set()
  for step in range(60):
    batch = items.batch(2, 3, step)
    for x, count, caption in zip(batch["features"], batch["num_frames"], batch["caption"]):
      assert count == (10 if caption == "a" else 6) and (x[count:] == 0).all()
      starts |= {round(1000 * float(x[0, 0]))} if caption == "a" else set()
  assert starts == {0, 1, 2, 3, 4}


def test_windows_of_rare_actions_are_drawn_more_often():
  """Nine windows of one action and one of another, alike at balance 1; the windows of one action are drawn
  alike."""
  groups = ["walk"] * 9 + ["punch"]
  windows = Windows(_clips([64] * 10), groups=groups, balance=1.0)
  drawn = np.concatenate([windows.batch(50, 0, step)["features"][:, 0, 0] for step in range(20)]).astype(int)
  counts = np.bincount(drawn, minlength=10)
  assert abs(counts[9] - 500) < 4 * np.sqrt(250) and np.abs(counts[:9] - 500 / 9).max() < 4 * np.sqrt(500 / 9)


@pytest.mark.parametrize("call, words", [
    (lambda: Windows(_clips([10]), 64), "64 frames"),
    (lambda: TextItems(_clips([10]), [["a"]]), "40 to 199"),
    (lambda: TextItems(_clips([100]), [[]]), "caption"),
    (lambda: TextItems(_clips([100]), [["a"]], lengths=(96,)), "max_frames"),
    (lambda: epoch_indices(0, 4, 0, 0), "add data"),
])
def test_bad_input_is_told(call, words):
  with pytest.raises(ValueError, match=words):
    call()


def test_fewer_items_than_a_batch_are_drawn_evenly():
  with pytest.warns(UserWarning, match="3 items are fewer than a batch of 8"):
    batches = [epoch_indices(3, 8, 0, step) for step in range(6)]
  assert all(len(batch) == 8 and np.bincount(batch, minlength=3).min() >= 2 for batch in batches)
  assert np.bincount(np.concatenate(batches)).tolist() == [16, 16, 16]
  np.testing.assert_array_equal(epoch_indices(3, 8, 0, 4), batches[4])


@pytest.mark.parametrize("make", [
    lambda clips, captions: Windows(clips, window=64, groups=list("aaaabbcc"), balance=1.0, one_per_clip=True),
    lambda clips, captions: TextItems(clips, captions, lengths=(96, 192)),
    lambda clips, captions: CaptionedClips(clips, captions, weights=np.arange(1.0, 9.0))])
def test_a_part_of_a_batch_is_those_rows_of_it(make):
  """As each of several processes makes its own."""
  batches = make(_clips([70, 77, 90, 199, 120, 64, 80, 100]), [[f"caption {i}", f"other {i}"] for i in range(8)])
  for step in range(5):
    whole = batches.batch(6, 3, step)
    for rows in (slice(0, 2), slice(2, 6)):
      part = batches.batch(6, 3, step, rows)
      assert part.pop("caption", None) == whole.get("caption")  # all of them: who draws words draws them for all
      assert part.keys() == whole.keys() - {"caption"}
      for name, array in part.items():
        np.testing.assert_array_equal(array, whole[name][rows])
