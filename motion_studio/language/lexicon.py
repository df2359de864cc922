"""Words that several rules of the language share."""
PAUSE, HOLD = "stands still", "holds still"  # the words of a pause, and of a pose that is kept
