"""The experiments: a file each, whose get_config(size) is one choice of every number; docs/configs.md is their page."""
