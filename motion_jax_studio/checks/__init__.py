"""Prompt checks: the requirements of a plan, measured on joints, and best-of-n sampling by them."""
MAX_ATTEMPTS = 4  # samples per motion, by default
