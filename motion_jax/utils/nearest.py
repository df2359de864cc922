"""Suggest the nearest known name for a mistyped one."""
def did_you_mean(name, known) -> str:
  """" (did you mean X?)" for the known name that is most like a mistyped one, "" where none is: after the name, before
  the list of what is expected, which may be long."""
  import difflib
  near = difflib.get_close_matches(str(name), [str(candidate) for candidate in known], 1, 0.6)
  return f" (did you mean {near[0]}?)" if near else ""
