"""Plans of prompts for one model, in the words of its training captions and with their usual lengths."""
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
  """Plans prompts for one model; made once per model, for it caches what it reads from the training captions."""

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
    """Whether the model's method generates one motion of several segments; otherwise prompts are not split."""
    return self.model.can("sample_segments")

  def plan(self, prompt: str) -> Plan:
    """The plan of a prompt; it has a single segment if the model's method has no segments.

    A training caption stays one action, with any subject. For some models actions are reworded (`phrasing`).
    """
    plan = parse(prompt, self.model.captions.knows, self.meanings)
    if not self.can_sequence:
      return plan.with_segments((Segment(Action(prompt, prompt)),))
    return in_words_of_captions(plan) if wants_words_of_captions(self.model.config) else plan

  def with_postures(self, plan: Plan) -> Plan:
    """The plan with standing still as the base motion of actions that the pose step adds (`posing.postures`)."""
    if not self.can_sequence or not can_be_checked(self.model):
      return plan
    return standing(plan, self.model.captions.knows, self._can)

  def in_plain_words(self, plan: Plan) -> Plan:
    """The plan with actions in plain words (`language.plain_words`), worded for this model."""
    reworded = in_plain_words(plan) if self.can_sequence else plan
    return in_words_of_captions(reworded) if wants_words_of_captions(self.model.config) else reworded

  def natural_frames(self, prompt: str, min_seconds: float = 0.0) -> int:
    """Usual frames of a prompt of one action: the estimate of the model's method, or else of similar training clips.

    min_seconds: the least duration of its path, such as `Plan.min_duration`.
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
    """Whether more than a few training captions name an action in similar words."""
    judgement = self.repertoire.judge(prompt) if self.repertoire else None
    return judgement is None or judgement.known and not judgement.few

  @functools.cached_property
  def meanings(self) -> Meanings:
    """Replacements of verbs by those of the model's training captions."""
    return Meanings(self.model.captions.texts if self.model.captions else (), self.model.encoder)

  @functools.cached_property
  def repertoire(self) -> Repertoire | None:
    """The phrases of the model's training captions; None if its folder has no captions."""
    return Repertoire(self.model.captions.texts, self.model.encoder) if self.model.captions else None
