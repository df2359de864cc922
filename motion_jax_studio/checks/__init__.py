"""What a plan requires of a motion, measured on its joints, and best-of-n resampling by it."""
MAX_ATTEMPTS = 4  # at a motion, by default
