"""Judging models: evaluators, protocols, tables beside the papers, reports."""
