"""Plans of sentences with several actions, and sentences that must stay whole. Rules with examples: `test_grammar`."""
import time

import pytest

from motion_jax_studio.language import actions, parse, parser
from motion_jax_studio.language.clauses import parts_of
from motion_jax_studio.language.hand_places import postures_of
from tests.studio.sentences import table


def test_sentences_are_parted_into_their_actions_or_stay_whole():
  wanted = {text: actions.lower() for text, actions in table("plans")}
  plans = {text: parse(text) for text in wanted}
  assert {text: "" if plan.is_plain else plan.summary.lower() for text, plan in plans.items()} == wanted
  assert all(plan.text == text and (not plan.is_plain or plan.prompts == [text]) for text, plan in plans.items())


def test_a_sentence_is_cut_into_clauses_once(monkeypatch):
  passes = []
  monkeypatch.setattr(parser, "parts_of", lambda fragments: passes.append(1) or parts_of(fragments))
  for known in (None, lambda text: True, lambda text: False):
    parse("a person walks and waves, then sits down", known)
  assert len(passes) == 3


def test_an_action_fills_its_slots_once_and_again_for_other_words(monkeypatch):
  action = parse("a person walks to the left with the hands on the hips").single
  assert action.slots.course == "left" and action.slots.hands.place == "hips" and not action.slots.is_backward
  other = action.replace(words="walks backward")
  assert other.prompt == "a person walks backward" and other.slots.is_backward and other.slots.hands is None
  plan = parse("a person walks in a circle, then leans to the left and kicks twice")
  monkeypatch.setattr(actions, "slots_of", None)  # requirements, paths and postures read slots
  assert [requirement.kind for requirement in plan.requirements] == ["circle", "usual", "kick"]
  assert plan.path_shapes == [("circle", ""), ("usual", "walk")] and postures_of(plan.segments) == {(1, 0): None}


def test_prompts_keep_their_subject():
  assert parse("an old man with a cane walks slowly, then he sits, and then the man waves").prompts == [
      "an old man with a cane walks slowly", "an old man with a cane sits", "an old man with a cane waves"]
  assert parse("before sitting down, she waves").prompts == ["she waves", "she sits down"]
  assert parse("walk, then wave").prompts == ["a person walks", "a person waves"]
  assert parse("two people walk and then wave").prompts == ["two people walk", "two people wave"]
  assert parse("an old man is ready, then walks and bows").prompts == ["an old man walks", "an old man bows"]


def test_who_does_something_while_standing_still_does_not_rest():
  resting = lambda text: [segment.is_pause for segment in parse(text).segments]
  assert resting("a person walks, then stands still while waving") == [False, False]
  assert resting("a person walks, then stands still") == [False, True]
  assert resting("a person kneels and stays kneeling") == [False, True]


def test_a_caption_that_was_learned_stays_whole():
  learned = {"a person walks forward and turns left", "a person jumps twice"}
  known = lambda text: text in learned
  assert parse("a person jumps twice", known).is_plain
  assert parse("a person walks forward and turns left, then waves", known).summary == (
      "walks forward and turns left | waves")
  assert parse("a person walks forward and turns left, then waves").summary == "walks forward | turns left | waves"


def test_long_texts_take_no_time():
  start = time.process_time()  # not of what else the machine does
  for text in ("a person walks and waves, then " * 160, "and " * 1250, "walking " * 600, "a , " * 1200, "😀" * 5000):
    parse(text)
  assert time.process_time() - start < 5


def test_a_plan_keeps_what_the_text_says_beside_what_a_model_has_learned():
  text = "a person walks forward and turns left"
  plan, whole = parse(text), parse(text, lambda text: True)
  assert plan.summary == "walks forward | turns left" and whole.is_plain and whole.prompts == [text]
  assert whole.actions == plan.actions and whole.requirements == plan.requirements
  assert whole.fully_split() == plan.fully_split() == plan
  assert whole.single.verb == "walk" and parse("a person walks, then waves").single is None
  assert plan.with_segments(plan.segments[:1]).requirements == plan.requirements


@pytest.mark.parametrize("text, subject, done, at_ease", [
    ("a man bows.", "a man", True, True), ("bow twice", "a person", True, True),
    ("she raises a hand", "she", True, False), ("a person walks", "a person", False, False)])
def test_an_action_that_ends_by_itself(text, subject, done, at_ease):
  action = parse(text).single
  assert (action.subject, action.is_done_once, action.leaves_at_ease) == (subject, done, at_ease)
