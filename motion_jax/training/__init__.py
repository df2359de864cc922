"""Training for any method: the stage that a method offers, its set-up, the loop, checkpoints."""
