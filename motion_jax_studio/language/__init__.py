"""A sentence becomes a Plan: `parse("a person walks while waving, then sits down")`."""
from motion_jax_studio.language.actions import Action, Segment, pause
from motion_jax_studio.language.parser import parse
from motion_jax_studio.language.plan import Plan

__all__ = ["Action", "Plan", "Segment", "parse", "pause"]
