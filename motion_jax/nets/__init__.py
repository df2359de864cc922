"""Linen modules: arrays in, arrays out; no loss, no schedule."""
