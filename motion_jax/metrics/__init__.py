"""Numbers about motion: evaluators and their words, scores, physics, and the loops that make a row of them."""
