"""Plans of prompts for one model: in the words of its training captions, with their usual lengths."""
import functools
from typing import Any

from motion_jax_studio.checks.violations import can_be_checked
from motion_jax_studio.language import Action, Plan, Segment, parse
from motion_jax_studio.language.meaning import Meanings
from motion_jax_studio.language.plain_words import in_plain_words
from motion_jax_studio.language.repertoire import Repertoire
from motion_jax_studio.planning.phrasing import in_words_of_captions, wants_words_of_captions
from motion_jax_studio.planning.standing import standing


class Planner:
  """Plans prompts for one model. Made once per model: it keeps what it has read of the training captions."""

  def __init__(self, model: Any) -> None:
    self.model = model

  @property
  def fps(self) -> float:
    return self.model.fps

  @property
  def frames_per_latent(self) -> int:
    return self.model.frames_per_latent

  @property
  def can_sequence(self) -> bool:
    """Whether the model's method makes one motion of several segments; without that a prompt is never split."""
    return self.model.can("sample_segments")

  def plan(self, prompt: str) -> Plan:
    """The segments of a prompt; a single one where the model's method knows no segments.

    A training caption stays one action, with any subject. `phrasing` says whose actions get other words.
    """
    found = parse(prompt, self.model.captions.knows, self.meanings)
    if not self.can_sequence:
      return found.with_segments((Segment(Action(prompt, prompt)),))
    return in_words_of_captions(found) if wants_words_of_captions(self.model.config) else found

  def with_postures(self, plan: Plan) -> Plan:
    """The plan in which a body stands still below actions that the pose step adds (`posing.postures`)."""
    if not self.can_sequence or not can_be_checked(self.model):
      return plan
    return standing(plan, self.model.captions.knows, self._can)

  def in_plain_words(self, plan: Plan) -> Plan:
    """The plan with actions in plain words (`language.plain_words`), as this model learned them."""
    found = in_plain_words(plan) if self.can_sequence else plan
    return in_words_of_captions(found) if wants_words_of_captions(self.model.config) else found

  def natural_frames(self, prompt: str, min_seconds: float = 0.0) -> int:
    """Usual length of a prompt of one action: the method's own estimate, or else that of similar training clips.

    min_seconds: of its path, such as `Plan.min_duration`.
    """
    model = self.model
    usual = model.estimated_frames(prompt)
    if usual is None:
      usual = model.captions.natural_frames(prompt)
    return model.default_frames(prompt) if usual is None else int(
        min(max(usual, min_seconds * self.fps), round(model.max_seconds * self.fps)))

  def nearest_captions(self, prompt: str, num: int = 1) -> list[tuple[str, int]]:
    """[(training caption, its usual frames)], the nearest in meaning first."""
    return self.model.captions.nearest(prompt, num)

  def _can(self, prompt):
    """Whether the training captions name an action in much the same words, and more than a few do."""
    found = self.repertoire.judge(prompt) if self.repertoire else None
    return found is None or found.known and not found.few

  @functools.cached_property
  def meanings(self) -> Meanings:
    """What verbs mean in those of the model's training captions."""
    return Meanings(self.model.captions.texts if self.model.captions else (), self.model.encoder)

  @functools.cached_property
  def repertoire(self) -> Repertoire | None:
    """The actions that the model's training captions name; None where its folder keeps no captions."""
    return Repertoire(self.model.captions.texts, self.model.encoder) if self.model.captions else None
