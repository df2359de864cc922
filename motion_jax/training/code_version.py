"""The version of the running code."""
import functools
import pathlib
import subprocess


@functools.cache
def commit():
  """The commit of the checkout that the code runs from, and whether files differ from it; None outside of one."""
  folder = pathlib.Path(__file__).parent
  ask = lambda *words: subprocess.run(["git", "-C", str(folder), *words], capture_output=True, text=True, timeout=30)
  try:
    commit = ask("rev-parse", "HEAD")
    if commit.returncode:
      return None
    changed = ask("status", "--porcelain", "--untracked-files=no", "--", str(folder.parent))
    return dict(commit=commit.stdout.strip(), changed=bool(changed.stdout.strip()))
  except (OSError, subprocess.SubprocessError):
    return None
