"""Trainings that are killed with SIGKILL again and again must end with the same bytes as an undisturbed one.

  python benchmarks/kills.py 1000                          a small line through points, a second a kill
  python benchmarks/kills.py 50 --stage cmdm_denoiser      a config, in its size :tiny

A training is killed up to eight times, at a random moment or at one of POINTS, and resumed each time as by `motion-jax
train --resume`; then it ends normally, and its state, its weights, its rows of metrics and the list of its states are
compared with those of an undisturbed training. The line has skipped steps and a rollback in it. Results are in
OUT/kills.jsonl, a row for each kill; a second call with a larger number continues. Prints a table.
"""
import argparse
import collections
import hashlib
import json
import os
import pathlib
import random
import shutil
import signal
import sys
import threading
import time

ROOT = pathlib.Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))
STEPS, SAVE_EVERY, MOST_KILLS = 12, 3, 8
STEPS_OF_A_STAGE, SAVE_EVERY_OF_A_STAGE = 4, 2
# Where a training kills itself: {name: how often the place may be passed before, where the training that is left alone
# passes it that often}.
POINTS = {"at a step": 6, "in the evaluation": 3, "as a save begins": 3, "in a half-written state": 3,
          "before its record": 3, "before it is in place": 3, "before old ones are removed": 3, "after a save": 3,
          "between two files": 12, "in a half-written row": 6, "in a rollback": 1, "after a rollback": 1,
          "at random": 1}


def main():
  parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
  parser.add_argument("kills", type=int, help="how many")
  parser.add_argument("--stage", default="line", help="line, or the name of a config")
  parser.add_argument("--out", default="kills", type=pathlib.Path, help="folder for results and runs")
  args = parser.parse_args()
  sys.exit(run(args.kills, args.stage, args.out / args.stage))


def run(kills, stage, out) -> int:
  """Kills trainings of a stage until `kills` kills are recorded; returns 1 if an end differs, else 0."""
  out.mkdir(parents=True, exist_ok=True)
  whole = out / "whole"
  if not ((whole / "end.json").is_file() and (whole / "passed.json").is_file()):
    shutil.rmtree(whole, ignore_errors=True)
    # A kill at random waits at most as long as the last of them takes; the second time nothing is compiled. For the
    # few kills of a stage one time will do: one that comes too late is none, and is not counted.
    for _ in range(2 if stage == "line" else 1):
      shutil.rmtree(whole, ignore_errors=True)
      began = time.monotonic()
      if _child(stage, whole, None, 0) != 0:
        raise SystemExit(f"the training of {stage} that is left alone fails; see {whole}/log.txt")
    (whole / "seconds").write_text(str(time.monotonic() - began))
  end, seconds = (whole / "end.json").read_text(), float((whole / "seconds").read_text())
  passed = {"at random": 1} | json.loads((whole / "passed.json").read_text())
  points = {name: min(times, passed[name]) for name, times in POINTS.items() if name in passed}
  rows = [json.loads(line) for line in _lines(out / "kills.jsonl")]
  done = sum("point" in row for row in rows)
  trial = 1 + max((row["trial"] for row in rows), default=-1)
  while done < kills:
    done += _trial(stage, out, trial, end, seconds, points, kills - done)
    trial += 1
  rows = [json.loads(line) for line in _lines(out / "kills.jsonl")]
  print(table(stage, rows))
  return int(any(row.get("equal") is False for row in rows))


def _trial(stage, out, trial, end, seconds, points, most) -> int:
  """One training, killed several times; returns how often. Its folder stays where its end is another."""
  draw, folder, found = random.Random(f"{stage} {trial}"), out / f"trial-{trial}", []
  shutil.rmtree(folder, ignore_errors=True)
  for _ in range(min(MOST_KILLS, most)):
    point = draw.choice(list(points))
    after = draw.uniform(0, seconds) if point == "at random" else draw.randrange(points[point])
    status = _child(stage, folder, point, after)
    if status == -signal.SIGKILL:
      found.append({"trial": trial, "point": point})
    elif status:
      found.append({"trial": trial, "equal": False, "status": status})
      break
  else:
    status = _child(stage, folder, None, 0)
    equal = status == 0 and (folder / "end.json").read_text() == end
    found.append({"trial": trial, "equal": equal, "status": status})
    if equal:
      shutil.rmtree(folder)
  with open(out / "kills.jsonl", "a", encoding="utf-8") as file:
    file.writelines(json.dumps(row) + "\n" for row in found)
  return sum("point" in row for row in found)


def _child(stage, folder, point, after) -> int:
  """Trains in a process of its own, forked from this one, which has imported everything but started no backend."""
  _imported()
  process = os.fork()
  if process == 0:
    status = 1
    try:
      folder.mkdir(parents=True, exist_ok=True)
      log = os.open(folder / "log.txt", os.O_WRONLY | os.O_CREAT | os.O_APPEND)
      os.dup2(log, 1)
      os.dup2(log, 2)
      _train(stage, folder, point, after)
      status = 0
    except BaseException:
      import traceback
      traceback.print_exc()
    finally:
      sys.stdout.flush()
      os._exit(status)
  return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def _imported():
  os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(pathlib.Path("kills").absolute() / "cache"))
  os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
  os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")
  import orbax.checkpoint  # noqa: F401

  from motion_jax import fit  # noqa: F401


def _train(stage, folder, point, after):
  """Trains in a folder, on from what lies there, and writes what its end is; kills itself at a point."""
  from absl import logging
  logging.set_verbosity(logging.ERROR)
  passed = collections.Counter()

  def pass_by(name):
    if name is not None:
      passed[name] += 1
      if name == point and passed[name] > after:
        os.kill(os.getpid(), signal.SIGKILL)

  if point == "at random":
    threading.Timer(after, os.kill, (os.getpid(), signal.SIGKILL)).start()
  _watched(pass_by)
  (_line if stage == "line" else _config)(folder, pass_by, stage)
  (folder / "passed.json").write_text(json.dumps(passed))
  (folder / "end.json").write_text(json.dumps(_end(folder), indent=1))


def _watched(pass_by):
  """Puts the points into the functions that save."""
  from motion_jax.training import metrics, report, saver
  from motion_jax.utils import atomic

  def around(owner, name, before=None, after=None):
    real = getattr(owner, name)

    def watched(*args, **kwargs):
      pass_by(before)
      found = real(*args, **kwargs)
      pass_by(after)
      return found

    setattr(owner, name, watched)

  around(saver.Saver, "save", before="as a save begins")
  around(saver, "file_digests", before="in a half-written state")
  around(saver, "write_record", before="before its record", after="before it is in place")
  around(saver.Saver, "prune", before="before old ones are removed", after="after a save")
  around(saver.Saver, "discard_after", before="in a rollback", after="in a rollback")
  around(saver.Saver, "remember", before="in a rollback", after="after a rollback")
  around(atomic.os, "replace", before="between two files", after="between two files")
  append = report.append_metrics

  def half(folder, row):
    with open(pathlib.Path(folder) / metrics.METRICS, "a", encoding="utf-8") as file:
      written = file.tell()
      file.write(json.dumps(row)[:len(json.dumps(row)) // 2])
      file.flush()
      pass_by("in a half-written row")
      file.truncate(written)
    append(folder, row)

  report.append_metrics = half


def _line(folder, pass_by, _):
  """A line through points, in which the steps from 8 on are left out until the run is rolled back."""
  import jax
  import ml_collections
  import numpy as np

  from configs import common
  from motion_jax.training import checkpoint, loop
  from motion_jax.training.guards import WINDOW
  from motion_jax.training.stage import Stage

  def loss(params, frozen, batch, step, rng):
    error = batch["x"] @ params["w"] - batch["y"] + 0.01 * jax.random.normal(rng, batch["y"].shape)
    return {"loss": (error ** 2).sum()}, batch["y"].size

  def next_batch(number):
    pass_by("at a step")
    x = np.random.default_rng(number).normal(size=(8, 3)).astype(np.float32)
    y = x @ np.array([1.0, -2, 3], np.float32) + (1e4 if 7 <= number < WINDOW else 0)
    return {"x": x, "y": y, "index": np.arange(8)}

  def evaluate(params):
    pass_by("in the evaluation")
    return {"wave": float(np.sin(100 * np.asarray(params["w"]).sum()))}  # the best may be any of them

  config = ml_collections.ConfigDict(dict(seed=0, mesh=common.mesh(), optimizer=common.optimizer(
      0.1, ema_decay=0.9, skip_loss=1e3), train=common.train(STEPS, 1, SAVE_EVERY, best="max wave", max_skips=3)))
  loop.train(config, folder, Stage(lambda batch, rng: {"w": jax.random.normal(rng, (3,))}, loss, None), next_batch,
             resume=not checkpoint.is_fresh(folder), evaluate=evaluate)


def _config(folder, pass_by, name):
  """A config's :tiny, a few steps more."""
  from motion_jax import fit
  from motion_jax.training.setup import TrainingSetup
  from motion_jax.utils import config_files
  config = config_files.load(f"{name}:tiny").unlock()
  config.train.update(num_steps=STEPS_OF_A_STAGE, save_every=SAVE_EVERY_OF_A_STAGE)
  known = fit.setups()[config.stage]

  def setup(config):
    made = known(config)

    def next_batch(step):
      pass_by("at a step")
      return made.next_batch(step)

    def evaluate(params):
      pass_by("in the evaluation")
      return made.evaluate(params)

    return TrainingSetup(**made._asdict() | {"next_batch": next_batch,
                                             "evaluate": evaluate if made.evaluate else None})

  fit.setups = lambda: {config.stage: setup}
  fit.run(config.lock(), folder, resume="auto")


def _end(folder):
  """What a training has come to: digests of weights and of the newest state, rows less their seconds, states."""
  import jax
  import numpy as np
  import orbax.checkpoint as ocp

  from motion_jax.training import checkpoint
  from motion_jax.training.metrics import read_metrics, without_clock
  from motion_jax.training.saver import STATE, Saver
  steps = Saver(folder).steps
  with ocp.StandardCheckpointer() as reader:
    state = reader.restore(folder.absolute() / "checkpoints" / str(steps[-1]) / STATE)
  digest = lambda content: hashlib.sha256(content).hexdigest()
  return {"states": steps,
          "newest": {jax.tree_util.keystr(path): digest(np.asarray(leaf).tobytes())
                     for path, leaf in jax.tree_util.tree_leaves_with_path(state)},
          "files": {name: digest((folder / name).read_bytes()) for name in (
              checkpoint.PARAMS, checkpoint.RAW, checkpoint.LAST) if (folder / name).is_file()},
          "rows": without_clock(read_metrics(folder)),
          "strays": sorted(path.name for path in folder.rglob(".*"))}


def _lines(path):
  return path.read_text(encoding="utf-8").splitlines() if path.is_file() else []


def table(stage, rows) -> str:
  """Rows of kills.jsonl as a table: how often a training was killed where, and how the ends compare."""
  kills = collections.Counter(row["point"] for row in rows if "point" in row)
  ends = [row["equal"] for row in rows if "equal" in row]
  return "\n".join([f"| {stage}: killed | times |", "|---|---|", *(f"| {name} | {kills[name]} |" for name in POINTS),
                    f"| in all | {kills.total()} |",
                    f"| trainings that ended with equal bytes | {sum(ends)} of {len(ends)} |"])


if __name__ == "__main__":
  main()
