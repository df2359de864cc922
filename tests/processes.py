"""Programs in processes of their own, which need not import everything again: `run` and `Process`, as in subprocess.

What a test starts here is a fork of one process that has imported what training and evaluation import, and started
nothing of JAX: the environment that a test gives it (devices, flags of XLA) is the one that counts. A worker of the
tests starts that process when it is first needed; it ends with the worker.
"""
import functools
import gc
import json
import os
import pathlib
import runpy
import signal
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).parents[1]


class Process:
  """Like `subprocess.Popen` of Python with these arguments: "-c", code or "-m", module or a file, and what they read.

  What it prints is in the files `stdout` and `stderr`, which may be the same.
  """

  def __init__(self, arguments, env, stdout, stderr, cwd=ROOT):
    self.returncode = None
    self.pid = _ask(arguments=[str(word) for word in arguments], env=dict(env), cwd=str(cwd), stdout=str(stdout),
                    stderr=str(stderr))

  def poll(self):
    if self.returncode is None:
      self.returncode = _ask(pid=self.pid)
    return self.returncode

  def wait(self, timeout=float("inf")):
    deadline = time.monotonic() + timeout
    while self.poll() is None:
      if time.monotonic() > deadline:
        raise subprocess.TimeoutExpired(str(self.pid), timeout)
      time.sleep(0.02)
    return self.returncode

  def send_signal(self, number):
    if self.poll() is None:
      os.kill(self.pid, number)

  def kill(self):
    self.send_signal(signal.SIGKILL)


def run(arguments, env, cwd=ROOT) -> subprocess.CompletedProcess:
  """Waits for a process, which see above; with its exit status and the text that it printed."""
  with tempfile.TemporaryDirectory() as folder:
    files = [pathlib.Path(folder, name) for name in ("stdout", "stderr")]
    status = Process(arguments, env, *files, cwd=cwd).wait()
    return subprocess.CompletedProcess(arguments, status, *(file.read_text() for file in files))


@functools.cache
def _server():
  return subprocess.Popen([sys.executable, "-m", "tests.processes"], cwd=ROOT, stdin=subprocess.PIPE,
                          stdout=subprocess.PIPE, text=True)


def _ask(**question):
  server = _server()
  print(json.dumps(question), file=server.stdin, flush=True)
  return json.loads(server.stdout.readline())


def _serve():
  """Answers questions, a line of JSON each, until nobody can ask more; returns in a fork alone, what it is to do."""
  import orbax.checkpoint  # noqa: F401

  from motion_jax.evaluation import run  # noqa: F401
  from tests import conftest  # noqa: F401
  gc.collect()
  gc.freeze()  # forks need not copy what a collector would look at

  questions, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
  for line in questions:
    question = json.loads(line)
    if "arguments" not in question:
      ended, status = os.waitpid(question["pid"], os.WNOHANG)
      answer = os.waitstatus_to_exitcode(status) if ended else None
    elif not (answer := os.fork()):
      return question
    print(json.dumps(answer), file=answers, flush=True)
  os._exit(0)


def _main():
  question = _serve()
  os.environ.clear()
  os.environ.update(question["env"])
  os.chdir(question["cwd"])
  os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
  for number, name in ((1, "stdout"), (2, "stderr")):
    os.dup2(os.open(question[name], os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_APPEND), number)
  kind, *words = question["arguments"]
  sys.argv = [kind, *words[1:]] if kind in ("-c", "-m") else [kind, *words]
  if kind == "-c":
    exec(compile(words[0], "<string>", "exec"), {"__name__": "__main__"})
  elif kind == "-m":
    runpy.run_module(words[0], run_name="__main__", alter_sys=True)
  else:
    runpy.run_path(kind, run_name="__main__")


if __name__ == "__main__":
  _main()
