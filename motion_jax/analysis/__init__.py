"""Analysis of joints: what a motion shows, as events (walk, turn, kick, ...), signals and sentences."""
from typing import TYPE_CHECKING

from motion_jax.utils import lazy

if TYPE_CHECKING:
  from motion_jax.analysis import event_words
  from motion_jax.analysis.describe import events_of, sentences
  from motion_jax.analysis.events import Event, find_events
  from motion_jax.analysis.signals import Body, course_of, turning_points

__all__ = ["Body", "Event", "course_of", "event_words", "events_of", "find_events", "sentences", "turning_points"]

__getattr__, __dir__ = lazy.attach(__name__)
