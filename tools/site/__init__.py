"""Builds the parts of the documentation site that are not written by hand; `mkdocs.yml` names the hooks."""
