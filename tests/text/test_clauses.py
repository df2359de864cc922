"""Clauses of a sentence in the order in which they happen, and attention that is steered by them."""
import numpy as np
import pytest

import motion_jax as mj
from motion_jax.models.cmdm.multi_prompt import by_clauses
from motion_jax.text.clauses import Clause, clauses_of
from motion_jax.text.encoder import load_text_encoder


@pytest.mark.parametrize("sentence, parts", [
    ("a person bows", None), ("a person walks while waving", None), ("she looks and waves at the same time", None),
    ("the left and the right arm", None), ("someone walks with one arm up and one arm down", None),
    ("a person waves, then walks away", ["a person waves", "walks away"]),
    ("he walks, turns left and sits down.", ["he walks", "turns left", "sits down."]),
    ("after walking forward, he sits down", ["after walking forward", "he sits down"]),
    ("before sitting down, he walks", ["he walks", "before sitting down"]),
    ("he waves after walking", ["walking", "he waves"]),
    ("a man jumps. He kicks", ["a man jumps", "He kicks"]),
    ("a person walks while waving, then stops", ["a person walks while waving", "stops"]),
    ("she raises the left hand, then the right hand", ["she raises the left hand", "the right hand"])])
def test_clauses(sentence, parts):
  clauses = clauses_of(sentence)
  if parts is None:
    assert clauses == [sentence] and not isinstance(clauses[0], Clause)
  else:
    assert [sentence[slice(*clause.spans[1])] for clause in clauses] == parts
    assert len(set(clauses)) == len(parts) and {clause.sentence for clause in clauses} == {sentence}


def test_words_of_a_clause_and_its_subject_are_shown():
  encoder = load_text_encoder("words")
  sentence = "a person waves, then sits down"
  masks = [encoder.shows(sentence, clause.spans, 12) for clause in clauses_of(sentence)]
  offsets = encoder._encode(sentence).offsets
  words = [" ".join(sentence[a:b] for (a, b), shown in zip(offsets, mask) if shown and a < b) for mask in masks]
  assert words == ["a person waves", "a person sits down"]
  assert not np.array(masks)[:, len(offsets):].any()


def test_clauses_share_the_blocks_of_their_prompt():
  rows = by_clauses([[("a man walks, then sits", 50), ("he bows", 30)], [("he jumps, then runs", 12)],
                      [("he waves, then runs", 24)]], 12, lambda prompt: prompt == "he waves, then runs")
  assert [count for _, count in rows[0]] == [24, 24, 32]  # the last motion ends within a block
  assert [str(part)[-3:] for part, _ in rows[0][:2]] == ["[1]", "[2]"]
  assert rows[1] == [("he jumps, then runs", 12)]  # one block shows one clause
  assert rows[2] == [("he waves, then runs", 24)]


@pytest.mark.slow
def test_motion_steered_by_clauses(tiny_run):
  """One caption and one length, as without; a prompt of one clause gives the same motion to the bit."""
  model = mj.load(tiny_run)
  run = lambda prompt, **sampling: model.generate([prompt], num_frames=40, seeds=[3], **sampling)[0]
  plain, steered = (run("a person walks, then waves", clauses=clauses) for clauses in (False, True))
  assert [caption.text for caption in steered.captions] == [caption.text for caption in plain.captions]
  assert len(steered.joints) == len(plain.joints) == 40 and steered.meta["clauses"]
  assert np.abs(steered.features - plain.features).max() > 1e-4
  np.testing.assert_array_equal(run("a person walks", clauses=True).features, run("a person walks").features)
