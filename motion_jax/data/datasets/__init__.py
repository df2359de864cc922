"""Data folders of the field, a file for each format."""
