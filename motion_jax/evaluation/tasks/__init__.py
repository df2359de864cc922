"""What a protocol asks of a model: generation, reconstruction, editing, long horizon, timelines, control."""
