"""Networks that benchmarks measure with: their stages, set-ups, words, released weights, and how they are loaded."""
