"""Exit statuses of the commands, all of them.

A program that a signal ended has 128 + its number, as shells expect it: 130 after Ctrl-C, 143 after SIGTERM, 129 after
SIGHUP, 141 where the reader of its output has gone.
"""
DONE = 0
FAILED = 1        # an error, told in one line; a training that guards have ended
MISUSED = 2       # a mistake in the arguments
HUNG = 70         # a training in which no step ended for train.hang_minutes
PREEMPTED = 75    # a training that SIGTERM ended: the same command with --resume=auto goes on
PIPE_CLOSED = 128 + 13


def of_signal(number, resumable=False) -> int:
  """The exit status of a program that a signal has stopped, 0 for None; resumable: of a training, see PREEMPTED."""
  if number is None:
    return DONE
  return PREEMPTED if resumable and number == 15 else 128 + int(number)
