"""Tasks of the protocols: generation, reconstruction, editing, long motions, timelines, control."""
