"""From a config to a trainable stage with its data: one file per paper."""
