"""The body part and the sides of an action, by its verb and words."""
from motion_jax.text.morphology import verb_of
from motion_studio.language import actions


def test_parts_of_the_body():
  part = lambda text: actions.part_of(verb_of(text.split()[0]), text.split()[1:])
  assert [part(text) for text in ("walks forward", "waves", "nods", "bows", "dances", "thinks", "bows down")] == [
      "legs", "arms", "head", "torso", "body", "", "torso"]
  assert [part(text) for text in ("raises the left knee", "shakes the head", "turns the head")] == [
      "legs", "head", "head"]
  assert part("waves to the man with long legs") == "arms" and part("kicks with the left foot") == "legs"
  assert actions.sides_of("waves the right hand".split()) == ("right",)
  assert actions.sides_of("turns left and waves".split()) == ()
  assert actions.sides_of("raises both hands".split()) == ("left", "right")
  assert actions.is_continuous("walk", []) and not actions.is_continuous("sit", ["down"])
  assert not actions.is_continuous("stand", ["up"])
