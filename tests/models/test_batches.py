"""Any number of motions runs in batches of a few sizes, and each keeps its own result."""
import numpy as np
import pytest

from motion_jax.models.shared.batches import SIZES, batch_sizes, batches, in_batches, joined


@pytest.mark.parametrize("count", [1, 2, 3, 5, 15, 33, 320])
def test_sizes_hold_all_motions_and_are_half_full(count):
  sizes = batch_sizes(count)
  assert sizes == {2: [1, 1], 33: [32, 1]}.get(count, sizes) and set(sizes) <= set(SIZES)
  assert count <= sum(sizes) <= 2 * count and sum(sizes[:-1]) < count


def test_rows_come_back_in_order():
  seen = []

  def run(x, mask, tree, scale):
    seen.append(len(x))
    assert mask is None and len(tree["a"]) == len(x)
    return scale * x + tree["a"]

  x = np.arange(7.0)[:, None] * np.ones(3)
  made = in_batches(run, x, None, {"a": x}, shared=(2.0,))
  np.testing.assert_array_equal(made, 3 * x)
  assert seen == [4, 4]


def test_batches_of_two_sizes_and_arrays_of_unequal_lengths():
  found = {count: [len(batch) for batch in batches(count, (1, 4))] for count in (1, 2, 3, 4, 5, 7)}
  assert found == {1: [1], 2: [1, 1], 3: [4], 4: [4], 5: [4, 1], 7: [4, 4]}
  np.testing.assert_array_equal(np.concatenate(list(batches(7, (1, 4)))), [0, 1, 2, 3, 4, 5, 6, 6])
  whole = joined([np.ones((4, 3, 2)), np.ones((4, 5, 2))], 7)
  assert whole.shape == (7, 5, 2) and not whole[:4, 3:].any()
