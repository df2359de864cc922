"""Turns clips into files for people."""
