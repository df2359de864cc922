"""Presentation of results: tables next to the papers' numbers, charts, a page."""
