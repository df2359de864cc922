"""Sentences to features of their words."""
