"""Numbers about motion: empty until the evaluators."""
