"""Whether an evaluation can be trusted: real data look right, damaged motions score worse."""
