"""Presentation of results: tables beside the papers' numbers, charts, a page."""
