"""The exit statuses of all commands.

A program that is ended by a signal exits with 128 + its number, as shells expect: 130 after Ctrl-C, 143 after SIGTERM,
129 after SIGHUP, 141 after SIGPIPE, when the reader of its output has exited.
"""
DONE = 0
FAILED = 1        # an error, printed in one line; a training ended by its guards
MISUSED = 2       # a mistake in the arguments
HUNG = 70         # a training in which no step ended for train.hang_minutes
PREEMPTED = 75    # a training ended by SIGTERM: the same command with --resume=auto continues it
PIPE_CLOSED = 128 + 13


def of_signal(number, resumable=False) -> int:
  """The exit status of a program that a signal has stopped, 0 for None; resumable: of a training, see PREEMPTED."""
  if number is None:
    return DONE
  return PREEMPTED if resumable and number == 15 else 128 + int(number)
