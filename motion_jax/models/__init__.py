"""Methods, a folder each with the same files in it, and what they share."""
