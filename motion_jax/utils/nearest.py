"""Suggest the nearest known name for a mistyped one."""
def did_you_mean(name, known) -> str:
  """" (did you mean X?)" for the known name closest to a mistyped one, "" if none is close. It goes before the list of
  expected names, which may be long."""
  import difflib
  near = difflib.get_close_matches(str(name), [str(candidate) for candidate in known], 1, 0.6)
  return f" (did you mean {near[0]}?)" if near else ""
