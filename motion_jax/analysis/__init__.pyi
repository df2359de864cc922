from . import event_words
from .describe import events_of, sentences
from .events import Event, find_events
from .signals import Body, course_of, turning_points

__all__ = ["Body", "Event", "course_of", "event_words", "events_of", "find_events", "sentences", "turning_points"]
